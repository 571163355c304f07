"""From a table to the samples of one run: what is wrong with times and channels is found here.

Handled, and said: rows in the wrong place, repeated rows, gaps, times and samples that cannot be,
channels that never change, columns that nobody knows. Refused, with what to do: a clock that was
set back, times that are missing, a table without commands or without measurements, an instrument
that makes more spikes than a few.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plant.errors import PlantError
from plant.tail_input import TailBeat, TailProgramme
from tools.diagnosis.data.clock import FRAME_S, check_clock
from tools.diagnosis.data.csv import Table
from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.data.spikes import MOST, spikes
from tools.diagnosis.model import FloatArray

BEAT_COLUMNS = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
TOLD = "tail_command_rad"
IGNORED = ("battery_v", "servo_current_a", "temperature_c")
LEAST_SAMPLES = 50
LEAST_S = 5.0
"""A run shorter than this holds no steady swimming: a robot needs some beats to get going."""

_MISPLACED = 0.01
"""Share of rows in the wrong place up to which they are put right; more is another clock."""
SILENCE_S = 60.0
"""After so long without any sample a run is cut: the longest of the usual runs."""
_STRAYS = 3
"""So many rows may stand apart from all others by their times, or a share of MOST."""
_SPIKES = 10
"""So many spikes may be set aside of a channel, or a share of MOST."""
_GAP = 10.0
_LEAST_GAP_S = 0.5
"""A gap is longer than this, and than so many usual intervals."""
_WIDEST_RAD = 1.7
"""No tail is told to go farther: beyond, the angles are degrees."""


@dataclass(frozen=True, slots=True)
class Samples:
    """One channel of one run: times since the first row (s), rising, values, and their rows."""

    time_s: FloatArray
    value: FloatArray
    row: np.ndarray


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
    if told is not None:
        _check_tail_angle(table.name, TOLD, told.value, [lines[row] for row in told.row])
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
                f"left out; record {LEAST_S:g} s and {LEAST_SAMPLES} samples at least"
                + _perhaps_minutes(found, duration_s),
            )
        )
        return None
    battery = column("battery_v")
    pack = None if battery is None else _filled(time_s, battery)
    if pack is not None:
        pack = _without_spikes(table.name, "battery_v", pack, lines, notices)
    supply = None if pack is None else float(np.mean(pack.value))
    programme = (
        TailProgramme.steady(TailBeat())
        if missing
        else _programme(table.name, time_s, beats, lines, readings)
    )
    return Recorded(table.name, programme, told, found, duration_s, supply, not missing)


def _perhaps_minutes(found: Mapping[str, Samples], duration_s: float) -> str:
    """Return a hint where the camera would be too fast by far, were the times seconds."""
    for name in ("x_m", "y_m", "heading_rad"):
        count = found[name].value.size if name in found else 0
        if count >= LEAST_SAMPLES and duration_s < FRAME_S * count:
            return " (are these minutes? then add [channels.time_s] scale = 60)"
    return ""


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
    check_clock(file, np.sort(time), reading.column)
    rows = _without_strays(table, reading.column, time, notices)
    time = time[rows]
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        place = int(back[0]) + 1
        where = f"{file}, row {table.line[rows[place]]}, column {reading.column}"
        says = f"time goes back from {time[place - 1]:g} to {time[place]:g}"
        order = np.argsort(time, kind="stable")
        moved = int(np.sum(order != np.arange(time.size)))
        if moved > max(2, _MISPLACED * time.size):
            raise DataError(
                f"{where}: {says}, and the rows behind follow it; was the clock set anew? "
                "cut the file there into two runs"
            )
        notices.append(
            Notice("decreasing", f"{where}: {says}; {moved} rows in the wrong place were sorted")
        )
        rows, time = rows[order], time[order]
    return time - time[0], rows, [table.line[row] for row in rows]


def _without_strays(
    table: Table, column: str, time: FloatArray, notices: list[Notice]
) -> np.ndarray:
    """Return the rows but for the few whose times stand apart from all others."""
    order = np.argsort(time, kind="stable")
    step = np.diff(time[order])
    if step.size == 0:
        return np.arange(time.size)
    apart = step > max(SILENCE_S, _GAP * _GAP * float(np.median(step)))
    group = np.concatenate(([0], np.cumsum(apart)))
    few = np.bincount(group) <= _STRAYS
    stray = np.zeros(time.size, dtype=bool)
    stray[order] = few[group]
    count = int(np.sum(stray))
    if count in (0, time.size) or count > max(_STRAYS, MOST * time.size):
        return np.arange(time.size)
    first = int(np.flatnonzero(stray)[0])
    more = f" (and {count - 1} more)" if count > 1 else ""
    notices.append(
        Notice(
            "stray time",
            f"{table.name}, row {table.line[first]}, column {column}: {time[first]:g} s "
            f"stands apart from all other times{more}; the row is left out",
        )
    )
    return np.flatnonzero(~stray)


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
    found = _without_spikes(file, name, Samples(time_s[kept], values[kept], kept), lines, notices)
    kept, t, v = found.row, found.time_s, found.value
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
                    + ("; the model swims on meanwhile" if step[widest] <= SILENCE_S else ""),
                )
            )
    return found


def _without_spikes(
    file: str, name: str, samples: Samples, lines: list[int], notices: list[Notice]
) -> Samples:
    """Set spikes aside; refuse a channel that makes many."""
    spike = spikes(name, samples.time_s, samples.value)
    count, total = int(np.sum(spike)), samples.value.size
    if count == 0:
        return samples
    first = int(np.flatnonzero(spike)[0])
    where = f"{file}, row {lines[samples.row[first]]}, column {name}"
    if count > max(_SPIKES, MOST * total):
        raise DataError(
            f"{where}: {samples.value[first]:g} lies beyond all reach of its neighbours, and so do "
            f"{count} of {total} samples; empty such cells, or leave the column out"
        )
    more = f" (as do {count - 1} more)" if count > 1 else ""
    notices.append(
        Notice(
            "spike",
            f"{where}: {samples.value[first]:g} lies beyond all reach of its neighbours{more}; "
            "set aside",
        )
    )
    return Samples(samples.time_s[~spike], samples.value[~spike], samples.row[~spike])


def _filled(time_s: FloatArray, values: FloatArray) -> Samples | None:
    kept = np.flatnonzero(~np.isnan(values))
    return Samples(time_s[kept], values[kept], kept) if kept.size else None


def _check_tail_angle(file: str, name: str, values: FloatArray, lines: list[int]) -> None:
    """Refuse angles of the tail that are degrees."""
    largest = int(np.argmax(np.abs(values)))
    if abs(values[largest]) > _WIDEST_RAD:
        raise DataError(
            f"{file}, row {lines[largest]}, column {name}: {abs(values[largest]):g} is no tail "
            f"angle in radians; for degrees add [channels.{name}] scale = 0.0174533"
        )


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
        if name != BEAT_COLUMNS[2]:
            _check_tail_angle(file, name, values[known], [lines[row] for row in known])
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
