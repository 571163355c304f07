"""From a table to the samples of one run: what is wrong with times and channels is found here.

Handled, and said: rows in the wrong place, repeated rows, gaps, channels that never change, columns
that nobody knows. Refused, with what to do: a clock that was set back, times that are missing, a
table without commands or without measurements.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plant.errors import PlantError
from plant.tail_input import TailBeat, TailProgramme
from tools.diagnosis.data.clock import check_clock
from tools.diagnosis.data.csv import Table
from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.model import FloatArray

BEAT_COLUMNS = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
TOLD = "tail_command_rad"
IGNORED = ("battery_v", "servo_current_a", "temperature_c")
LEAST_SAMPLES = 50
LEAST_S = 5.0
"""A run shorter than this holds no steady swimming: a robot needs some beats to get going."""

_MISPLACED = 0.01
"""Share of rows in the wrong place up to which they are put right; more is another clock."""
_GAP = 10.0
_LEAST_GAP_S = 0.5
"""A gap is longer than this, and than so many usual intervals."""
_WIDEST_RAD = 1.7
"""No tail is told to go farther: beyond, the angles are degrees."""


@dataclass(frozen=True, slots=True)
class Samples:
    """One channel of one run: times since the first row (s), rising, and values."""

    time_s: FloatArray
    value: FloatArray


@dataclass(frozen=True, slots=True)
class Recorded:
    """One run as it was recorded, in SI units; ``beats``: whether its programme was recorded."""

    name: str
    programme: TailProgramme
    told: Samples | None
    channels: dict[str, Samples]
    duration_s: float
    supply_v: float | None
    beats: bool


@dataclass(frozen=True, slots=True)
class Reading:
    """How a column of the files becomes a channel (`[channels.X]` of experiment.toml)."""

    column: str
    scale: float = 1.0


def recorded(
    table: Table,
    channels: tuple[str, ...],
    readings: Mapping[str, Reading],
    notices: list[Notice],
) -> Recorded | None:
    """Return the run of a table; None where it is too short to be of use (which is said)."""
    time_s, rows, lines = _times(table, _reading("time_s", readings), notices)

    def column(name: str) -> FloatArray | None:
        reading = _reading(name, readings)
        values = table.columns.get(reading.column)
        if values is None:
            return None
        scaled: FloatArray = values[rows] * reading.scale
        return scaled

    _unknown_columns(table, channels, readings, notices)
    found: dict[str, Samples] = {}
    for name in channels:
        values = column(name)
        if values is None:
            continue
        samples = _samples(table.name, name, time_s, values, lines, notices)
        if samples is not None:
            found[name] = samples
    told_values = column(TOLD)
    told = None if told_values is None else _filled(time_s, told_values)
    beats = [column(name) for name in BEAT_COLUMNS]
    missing = [name for name, values in zip(BEAT_COLUMNS, beats, strict=True) if values is None]
    if missing and told is None:
        raise DataError(
            f"{table.name}, row 1: says not what the tail was told: {', '.join(missing)} "
            f"missing, and no {TOLD}; add the columns"
        )
    if not found:
        raise DataError(
            f"{table.name}, row 1: holds no measured channel that can be used; there may be "
            f"{', '.join(channels)}"
        )
    duration_s = max(float(samples.time_s[-1]) for samples in found.values())
    count = sum(samples.time_s.size for samples in found.values())
    if duration_s < LEAST_S or count < LEAST_SAMPLES:
        notices.append(
            Notice(
                "short",
                f"{table.name}: {duration_s:.3g} s with {count} samples is too short; the run is "
                f"left out; record {LEAST_S:g} s and {LEAST_SAMPLES} samples at least",
            )
        )
        return None
    battery = column("battery_v")
    supply = None if battery is None or np.isnan(battery).all() else float(np.nanmean(battery))
    programme = (
        TailProgramme.steady(TailBeat())
        if missing
        else _programme(table.name, time_s, beats, lines, readings)
    )
    return Recorded(table.name, programme, told, found, duration_s, supply, not missing)


def _reading(name: str, readings: Mapping[str, Reading]) -> Reading:
    return readings.get(name) or Reading(name)


def _times(
    table: Table, reading: Reading, notices: list[Notice]
) -> tuple[FloatArray, np.ndarray, list[int]]:
    """Return rising times since the first row, the rows they are of, and their lines."""
    file = table.name
    time = table.columns.get(reading.column)
    if time is None:
        raise DataError(f"{file}, row 1: has no column {reading.column}; add the times in seconds")
    if table.rows == 0:
        raise DataError(f"{file}, row 2: the table is empty; record the run again")
    bad = np.flatnonzero(np.isnan(time))
    if bad.size:
        raise DataError(
            f"{file}, row {table.line[bad[0]]}, column {reading.column}: the time is missing; "
            "fill it in or remove the row"
        )
    time = time * reading.scale
    if bool(np.all(np.diff(time) >= 0.0)):
        check_clock(file, time, reading.column)
    rows = np.arange(time.size)
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        place = int(back[0]) + 1
        where = f"{file}, row {table.line[place]}, column {reading.column}"
        says = f"time goes back from {time[place - 1]:g} to {time[place]:g}"
        order = np.argsort(time, kind="stable")
        moved = int(np.sum(order != rows))
        if moved > max(2, _MISPLACED * time.size):
            raise DataError(
                f"{where}: {says}, and the rows behind follow it; was the clock set anew? "
                "cut the file there into two runs"
            )
        notices.append(
            Notice("decreasing", f"{where}: {says}; {moved} rows in the wrong place were sorted")
        )
        rows = order
        time = time[order]
    return time - time[0], rows, [table.line[row] for row in rows]


def _samples(
    file: str,
    name: str,
    time_s: FloatArray,
    values: FloatArray,
    lines: list[int],
    notices: list[Notice],
) -> Samples | None:
    """Return a channel's samples; None where it says nothing."""
    kept = np.flatnonzero(~np.isnan(values))
    if kept.size == 0:
        return None
    again = np.flatnonzero(np.diff(time_s[kept]) <= 0.0) + 1
    if again.size:
        row = lines[kept[again[0]]]
        notices.append(
            Notice(
                "repeated",
                f"{file}, row {row}, column {name}: the time {time_s[kept[again[0]]]:g} s stands "
                f"there again ({again.size} such samples); the first of them is kept",
            )
        )
        kept = np.delete(kept, again)
    t, v = time_s[kept], values[kept]
    if t.size > 1 and np.all(v == v[0]):
        notices.append(
            Notice(
                "constant",
                f"{file}, column {name}: is {v[0]:g} in all {v.size} rows; taken as an instrument "
                "that did not work, and left out",
            )
        )
        return None
    step = np.diff(t)
    if step.size:
        usual = float(np.median(step))
        gaps = np.flatnonzero((step > _GAP * usual) & (step > _LEAST_GAP_S))
        if gaps.size:
            widest = int(gaps[np.argmax(step[gaps])])
            notices.append(
                Notice(
                    "gap",
                    f"{file}, row {lines[kept[widest]]}, column {name}: nothing for "
                    f"{step[widest]:.3g} s"
                    + (f" (the longest of {gaps.size} gaps)" if gaps.size > 1 else "")
                    + "; the model swims on meanwhile",
                )
            )
    return Samples(t, v)


def _filled(time_s: FloatArray, values: FloatArray) -> Samples | None:
    kept = ~np.isnan(values)
    return Samples(time_s[kept], values[kept]) if kept.any() else None


def _programme(
    file: str,
    time_s: FloatArray,
    columns: list[FloatArray | None],
    lines: list[int],
    readings: Mapping[str, Reading],
) -> TailProgramme:
    """Return the beats and when they changed; an empty cell is no change.

    Where none is said at first, the tail rests until one is: a board needs a moment to begin.
    """
    held = []
    begun = np.ones(time_s.size, dtype=bool)
    for name, values in zip(BEAT_COLUMNS, columns, strict=True):
        assert values is not None
        known = np.flatnonzero(~np.isnan(values))
        if known.size == 0:
            raise DataError(f"{file}, column {name}: is empty; say what the tail was told")
        last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(values.size)))
        held.append(np.where(last >= 0, values[np.maximum(last, 0)], 0.0))
        begun &= last >= 0
        if name != BEAT_COLUMNS[2] and float(np.abs(values[known]).max()) > _WIDEST_RAD:
            row = lines[int(known[np.argmax(np.abs(values[known]))])]
            raise DataError(
                f"{file}, row {row}, column {name}: {np.abs(values[known]).max():g} is no tail "
                f"angle in radians; for degrees add [channels.{name}] scale = 0.0174533"
            )
    told = np.column_stack(held) * begun[:, None]
    changed = np.concatenate(
        ([0], np.flatnonzero(np.any(np.diff(told, axis=0) != 0.0, axis=1)) + 1)
    )
    try:
        beats = tuple(TailBeat(*told[row].tolist()) for row in changed)
        return TailProgramme(beats, tuple(time_s[changed].tolist()))
    except PlantError as error:
        raise DataError(f"{file}: {error}") from None


def _unknown_columns(
    table: Table,
    channels: tuple[str, ...],
    readings: Mapping[str, Reading],
    notices: list[Notice],
) -> None:
    known = ["time_s", *BEAT_COLUMNS, TOLD, *channels, *IGNORED]
    read = {_reading(name, readings).column for name in known}
    for name in table.columns:
        if name in read or name in known:
            continue
        close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
        hint = f" (is it {close[0]}?);" if close else ";"
        notices.append(
            Notice(
                "unknown column",
                f"{table.name}, row 1: nobody knows a column {name}{hint} it is not used "
                "(name it in [channels.X] column = … of experiment.toml)",
            )
        )
