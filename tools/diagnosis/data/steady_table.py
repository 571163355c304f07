"""Steady-state tables: a row for each beat, its turning radius, turning period, speed."""

from __future__ import annotations

import numpy as np

from plant.errors import PlantError
from plant.tail_input import TailBeat
from tools.diagnosis.data.csv import Table
from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.data.screen import BEAT_COLUMNS, Reading
from tools.diagnosis.fish.steady import CHANNELS, RADIUS, SteadyInputs
from tools.diagnosis.model import Run

LEAST_ROWS = 3
HELD_SHARE = 1.0 / 3.0
"""Of the rows, held out: those in the middle of equal parts of all, in the order of their beats.
They lie between others, so that both parts hold small and large biases; what is learnt is asked
where it can be known. So the source validated its identification at 20°, 30° and 40° by 25° and
35°."""
GROUPS, HELD_GROUPS = 6, 3
"""The rows that train, and those that are held out, make so many runs at most, dealt like cards."""

COLUMNS = tuple(channel.name for channel in CHANNELS)
_WIDEST_RAD = 1.7


def steady_runs(
    table: Table, readings: dict[str, Reading], notices: list[Notice]
) -> tuple[list[Run], set[int]]:
    """Return the runs of a table, and the channels whose standard deviations it gives."""
    file = table.name

    def column(name: str) -> np.ndarray | None:
        reading = readings.get(name) or Reading(name)
        values = table.columns.get(reading.column)
        return None if values is None else values * reading.scale

    beats = _beats(table, [column(name) for name in BEAT_COLUMNS])
    samples: list[tuple[int, int, float, float]] = []
    known: set[int] = set()
    for channel, name in enumerate(COLUMNS):
        values, spread = column(name), column(f"{name}_sd")
        if values is None:
            continue
        given = spread is not None and bool(np.all(np.isfinite(spread[np.isfinite(values)])))
        if given:
            known.add(channel)
        elif spread is not None:
            notices.append(
                Notice("sd", f"{file}, column {name}_sd: has empty cells; estimated instead")
            )
        for row in np.flatnonzero(np.isfinite(values)).tolist():
            if not values[row] > 0.0:
                raise DataError(
                    f"{file}, row {table.line[row]}, column {name}: {values[row]:g} is no "
                    "size of a steady motion; leave the cell empty where it did not turn"
                )
            sd = float(spread[row]) if given and spread is not None else np.nan
            if given and not sd > 0.0:
                raise DataError(
                    f"{file}, row {table.line[row]}, column {name}_sd: {sd:g}: must be above 0"
                )
            samples.append((row, channel, float(values[row]), sd))
    if {channel for _, channel, *_ in samples} == {RADIUS}:
        notices.append(
            Notice(
                "radius",
                f"{file}: a turning radius alone hardly shows resistance: less speed narrows a "
                "turn as much as slower turning widens it; measure turn_period_s or speed_m_s too",
            )
        )
    rows = sorted({row for row, *_ in samples}, key=lambda row: (*_told(beats[row]), row))
    if len(rows) < LEAST_ROWS:
        raise DataError(
            f"{file}: {len(rows)} rows with a measurement; {LEAST_ROWS} at least are needed: two "
            "to learn from, and one to judge by"
        )
    held = _held_out(len(rows))
    trained = [row for k, row in enumerate(rows) if k not in held]
    judged = [row for k, row in enumerate(rows) if k in held]
    runs = [_run(file, mine, beats, samples, False) for mine in _dealt(trained, GROUPS)]
    runs += [_run(file, mine, beats, samples, True) for mine in _dealt(judged, HELD_GROUPS)]
    return runs, known


def _dealt(rows: list[int], groups: int) -> list[list[int]]:
    """Return the rows in so many groups at most, like cards."""
    return [rows[k::groups] for k in range(min(groups, len(rows)))]


def _told(beat: TailBeat) -> tuple[float, float, float]:
    """Return what rows are ordered by."""
    return beat.bias_rad, beat.amplitude_rad, beat.frequency_hz


def _held_out(count: int) -> set[int]:
    """Return which of so many ordered rows are held out: the middles of equal parts."""
    several = max(round(HELD_SHARE * count), 1)
    return {int((k + 0.5) * count / several) for k in range(several)}


def _beats(table: Table, columns: list[np.ndarray | None]) -> list[TailBeat]:
    """Return the beat of every row."""
    beats = []
    for name, values in zip(BEAT_COLUMNS, columns, strict=True):
        if values is None:
            raise DataError(f"{table.name}, row 1: has no column {name}; add it")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise DataError(
                f"{table.name}, row {table.line[bad[0]]}, column {name}: is empty; say what beat "
                "it was"
            )
        if name != BEAT_COLUMNS[2] and values.size and np.abs(values).max() > _WIDEST_RAD:
            raise DataError(
                f"{table.name}, column {name}: {np.abs(values).max():g} is no tail angle in "
                f"radians; for degrees add [channels.{name}] scale = 0.0174533"
            )
    for row, told in enumerate(zip(*(values.tolist() for values in columns), strict=True)):  # type: ignore[union-attr]  # none is missing
        try:
            beat = TailBeat(*told)
        except PlantError as error:
            raise DataError(f"{table.name}, row {table.line[row]}: {error}") from None
        if not (beat.amplitude_rad > 0.0 and beat.frequency_hz > 0.0):
            raise DataError(
                f"{table.name}, row {table.line[row]}: a tail at rest makes no steady motion; "
                "remove the row"
            )
        beats.append(beat)
    return beats


def _run(
    file: str,
    rows: list[int],
    beats: list[TailBeat],
    samples: list[tuple[int, int, float, float]],
    held_out: bool,
) -> Run:
    """Make a run of some rows, all at one time: a table's order says nothing."""
    mine = [sample for row in rows for sample in samples if sample[0] == row]
    place = np.array([rows.index(row) for row, *_ in mine], dtype=np.int64)
    return Run(
        f"{file} rows {', '.join(str(row + 2) for row in rows)}",
        np.zeros(place.size),
        np.array([channel for _, channel, *_ in mine], dtype=np.int64),
        np.array([value for *_, value, _ in mine]),
        SteadyInputs(tuple(beats[row] for row in rows), place, np.array([sd for *_, sd in mine])),
        held_out=held_out,
    )
