"""channels.csv and truth.csv: plain tables, numbers written so that they read back exactly.

Python's `repr` of a float is the shortest text that gives the same float again. In channels.csv
every instrument keeps its own times: a row is a moment at which anything was sampled, and what was
not sampled then is an empty cell, never a repeated or interpolated value.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tools.records.data import CHANNEL_COLUMNS, TRUTH_COLUMNS, FloatArray, Series


def write_channels(path: Path, channels: Mapping[str, Series]) -> None:
    """Write the channels of the contract; others that a run has are left to the report."""
    names = CHANNEL_COLUMNS[1:]
    known = [channels[name].time_s for name in names if name in channels]
    times = np.unique(np.concatenate(known)) if known else np.empty(0)
    columns = [_text(times)]
    for name in names:
        cells = [""] * times.size
        series = channels.get(name)
        if series is not None:
            rows = np.searchsorted(times, series.time_s).tolist()
            for row, cell in zip(rows, _text(series.value), strict=True):
                cells[row] = cell
        columns.append(cells)
    _write(path, CHANNEL_COLUMNS, columns)


def write_truth(path: Path, truth: Mapping[str, FloatArray], every: int = 1) -> None:
    """Write every n-th row of the true state; a column that a plant does not have stays empty.

    What it has beyond `TRUTH_COLUMNS` stands behind them.
    """
    rows = truth["time_s"][::every].size
    names = (*TRUTH_COLUMNS, *(name for name in truth if name not in TRUTH_COLUMNS))
    columns = [_text(truth[name][::every]) if name in truth else [""] * rows for name in names]
    _write(path, names, columns)


def read_columns(path: Path) -> dict[str, Series]:
    """Read a table back: for each column, the times and values of its cells that are filled."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        header = next(reader)
        columns = list(zip(*reader, strict=True)) or [()] * len(header)
    times = np.array([float(cell) for cell in columns[header.index("time_s")]])
    read: dict[str, Series] = {}
    for name, cells in zip(header, columns, strict=True):
        filled = [row for row, cell in enumerate(cells) if cell]
        if filled:
            values = np.array([float(cells[row]) for row in filled])
            read[name] = Series(times[filled], values)
    return read


def _text(values: FloatArray) -> list[str]:
    return ["" if value != value else repr(value) for value in values.tolist()]  # NaN: no sample


def _write(path: Path, header: Sequence[str], columns: Sequence[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(header) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*columns, strict=True))
