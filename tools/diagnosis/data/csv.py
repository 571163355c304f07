"""A CSV table as columns of numbers; each cell that is none is named by file, row and column.

Empty cells mean "no sample" and become NaN, as do the texts that programs write for it; a cell that
says NaN or infinity is noticed. Rows are counted as editors count lines: the header is row 1.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.model import FloatArray

_NO_NUMBER = {"nan", "inf", "+inf", "-inf", "infinity", "-infinity", "na", "n/a", "null", "none"}


@dataclass(frozen=True, slots=True)
class Table:
    """Columns (n,) by name, NaN where there is no sample, and the line of each row (n,)."""

    name: str
    columns: dict[str, FloatArray]
    line: list[int]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.line)


def read_table(path: Path, notices: list[Notice]) -> Table:
    """Read a table; raises ``DataError`` with the place of what cannot be read."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"{path.name}: not a text file in UTF-8; export it as CSV") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from None
    lines = text.splitlines()
    if not lines or not lines[0].strip():
        raise DataError(f"{path.name}, row 1: is empty; the first row names the columns")
    if "," not in lines[0] and (";" in lines[0] or "\t" in lines[0]):
        sign = "semicolons" if ";" in lines[0] else "tabs"
        raise DataError(f"{path.name}, row 1: {sign} separate the columns; export it with commas")
    reader = csv.reader(lines)
    header = [name.strip() for name in next(reader)]
    for place, name in enumerate(header):
        if name and name in header[:place]:
            raise DataError(f"{path.name}, row 1: two columns are called {name}; rename one")
    rows: list[list[str]] = []
    line: list[int] = []
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(header):
            raise DataError(
                f"{path.name}, row {reader.line_num}: has {len(cells)} cells, the header "
                f"{len(header)}; complete or remove the row"
            )
        rows.append(cells)
        line.append(reader.line_num)
    columns = {
        name: _numbers(path.name, name, [row[place] for row in rows], line, notices)
        for place, name in enumerate(header)
        if name
    }
    return Table(path.name, columns, line)


def _numbers(
    file: str, name: str, cells: list[str], line: list[int], notices: list[Notice]
) -> FloatArray:
    """Make numbers of a column's cells."""
    try:  # nearly always; thousands of cells at once
        values = np.array([float(cell) if cell else math.nan for cell in cells], dtype=np.float64)
        odd = [i for i in np.flatnonzero(~np.isfinite(values)).tolist() if cells[i]]
    except ValueError:
        values, odd = _slowly(file, name, cells, line)
    odd = [i for i in odd if cells[i].strip()]
    if odd:
        values[odd] = np.nan
        notices.append(
            Notice(
                "nan",
                f"{file}, row {line[odd[0]]}, column {name}: {cells[odd[0]].strip()!r} is no "
                f"number{f' (and {len(odd) - 1} more)' if len(odd) > 1 else ''}; "
                "taken as not measured",
            )
        )
    return values


def _slowly(
    file: str, name: str, cells: list[str], line: list[int]
) -> tuple[FloatArray, list[int]]:
    values = np.full(len(cells), np.nan)
    odd = []
    for i, cell in enumerate(cells):
        word = cell.strip()
        if not word:
            continue
        if word.lower() in _NO_NUMBER:
            odd.append(i)
            continue
        try:
            values[i] = float(word)
        except ValueError:
            comma = " (decimal commas? write points)" if word.replace(",", "", 1).isdigit() else ""
            raise DataError(
                f"{file}, row {line[i]}, column {name}: {cell!r} is no number{comma}; mend the "
                "cell, or leave it empty where nothing was measured"
            ) from None
    return values, odd
