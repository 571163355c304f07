"""A scalar field from a grid of samples: bilinear between nodes, held at its edge outside.

Two forms hold the same: a CSV table, and an NPZ archive of arrays. Both name what they hold with
its unit (``temperature_c``, ``pollutant_ug_l``), so that a table in kelvin, or a pollutant in a
temperature's place, is refused instead of swum in. Values are looked up with plain float arithmetic
in one order: the same bits on every machine.

    temperature_c,0.0,0.5,1.0       first cell: what it is; then x of the columns, m
    -0.5,20.0,20.5,21.0             y of the row, m; then the values
    0.5,20.0,21.5,23.0

Lines that begin with ``#`` and empty lines say nothing. An archive has ``x_m`` (nx,), ``y_m`` (ny,)
and the values (ny, nx). Text and bytes come in, files are the caller's.
"""

import csv
import io
import math
import zipfile
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from plant.errors import PlantError

QUANTITIES: dict[str, tuple[float, float]] = {
    "temperature_c": (-10.0, 100.0),
    "pollutant_ug_l": (0.0, 1e6),
}
"""What a grid may hold, with its range in that unit: liquid water; no negative concentration."""


class GridError(PlantError, ValueError):
    """A table that makes no field; the message says at which row and column, counted from 1."""


@dataclass(frozen=True, slots=True)
class GridField:
    """Nodes at ``x_m`` × ``y_m``, both ascending; ``values[row][column]`` belongs to (x, y).

    Raises ``GridError`` for axes that do not ascend, fewer than two nodes along one, a ragged
    table, and values that are not finite.
    """

    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Check axes and table; rows and columns are counted as in the CSV form."""
        _check_axis("x_m", self.x_m, "row 1, column")
        _check_axis("y_m", self.y_m, "column 1, row")
        if len(self.values) != len(self.y_m):
            raise GridError(f"{len(self.values)} rows of values for {len(self.y_m)} of y_m")
        for row, values in enumerate(self.values, start=2):
            if len(values) != len(self.x_m):
                raise GridError(
                    f"row {row}: {len(values)} values for {len(self.x_m)} columns of x_m"
                )
            for column, value in enumerate(values, start=2):
                if not math.isfinite(value):
                    raise GridError(f"row {row}, column {column}: {value} is not finite")

    def value(self, x_m: float, y_m: float) -> float:
        """Field at a point of the tank; beyond the grid, at the nearest point of its edge."""
        i, t = _place(self.x_m, x_m)
        j, s = _place(self.y_m, y_m)
        below, above = self.values[j], self.values[j + 1]
        # (1 − t)·a + t·b is a at t = 0 and b at t = 1 to the last bit; a + t·(b − a) is not.
        low = (1.0 - t) * below[i] + t * below[i + 1]
        high = (1.0 - t) * above[i] + t * above[i + 1]
        return (1.0 - s) * low + s * high


def _check_axis(name: str, nodes: Sequence[float], where: str) -> None:
    if len(nodes) < 2:
        raise GridError(f"{name}: at least two nodes are wanted, got {len(nodes)}")
    for number, node in enumerate(nodes, start=2):
        if not math.isfinite(node):
            raise GridError(f"{name} ({where} {number}): {node} is not finite")
        if number > 2 and not node > nodes[number - 3]:
            raise GridError(
                f"{name} ({where} {number}): must ascend, {node!r} comes after "
                f"{nodes[number - 3]!r}"
            )


def _place(nodes: Sequence[float], at: float) -> tuple[int, float]:
    """Interval of an axis, and the place in it from 0 to 1."""
    if at <= nodes[0]:
        return 0, 0.0
    last = len(nodes) - 2
    if at >= nodes[-1]:
        return last, 1.0
    i = min(bisect_right(nodes, at) - 1, last)
    return i, (at - nodes[i]) / (nodes[i + 1] - nodes[i])


def _in_range(field: GridField, quantity: str) -> GridField:
    least, most = QUANTITIES[quantity]
    for row, values in enumerate(field.values, start=2):
        for column, value in enumerate(values, start=2):
            if not least <= value <= most:
                raise GridError(
                    f"row {row}, column {column}: {quantity} = {value:g} lies outside "
                    f"{least:g} … {most:g}"
                )
    return field


def from_csv(text: str, quantity: str) -> GridField:
    """Read the CSV form of a quantity of ``QUANTITIES``; raises ``GridError``.

    Rows in messages are lines of the text, comments and empty lines included.
    """
    rows = [
        (number, cells)
        for number, cells in enumerate(_cells(text), start=1)
        if any(cells) and not cells[0].startswith("#")
    ]
    if not rows:
        raise GridError("no table in it")
    (first, head), body = rows[0], rows[1:]
    if head[0] != quantity:
        raise GridError(f"row {first}, column 1: must be {quantity}, got {head[0]!r}")
    x_m = tuple(_numbers(first, head[1:]))
    y_m: list[float] = []
    values: list[tuple[float, ...]] = []
    for line, cells in body:
        if len(cells) != len(head):
            raise GridError(f"row {line}: {len(cells)} cells, the first row has {len(head)}")
        y, *rest = _numbers(line, cells, 1)
        if y_m and not y > y_m[-1]:
            raise GridError(f"row {line}, column 1: y_m must ascend, {y!r} comes after {y_m[-1]!r}")
        y_m.append(y)
        values.append(tuple(rest))
    return _in_range(GridField(x_m, tuple(y_m), tuple(values)), quantity)


def _cells(text: str) -> Iterable[list[str]]:
    try:
        for row in csv.reader(io.StringIO(text.removeprefix("\ufeff")), strict=True):
            yield [cell.strip() for cell in row]
    except csv.Error as error:
        raise GridError(f"not a CSV table: {error}") from error


def _numbers(line: int, cells: Sequence[str], first: int = 2) -> list[float]:
    found = []
    for column, cell in enumerate(cells, start=first):
        try:
            value = float(cell)
        except ValueError:
            shown = repr(cell) if cell else "an empty cell"
            raise GridError(f"row {line}, column {column}: {shown} is no number") from None
        if not math.isfinite(value):
            raise GridError(f"row {line}, column {column}: {cell} is not finite")
        found.append(value)
    return found


def from_npz(data: bytes, quantity: str) -> GridField:
    """Read the NPZ form of a quantity of ``QUANTITIES``; raises ``GridError``."""
    if not data.startswith(b"PK"):  # np.load would take a bare array, or a pickle, for one
        raise GridError("not an NPZ archive")
    arrays = {}
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            for name in ("x_m", "y_m", quantity):
                if name not in archive.files:
                    held = ", ".join(archive.files) or "nothing"
                    raise GridError(f"no array {name} in it; it holds {held}")
                arrays[name] = archive[name]
    except (OSError, EOFError, zipfile.BadZipFile, ValueError) as error:
        if isinstance(error, GridError):
            raise
        raise GridError(f"not an NPZ archive of arrays of numbers: {error}") from error
    for name, array in arrays.items():
        if array.dtype.kind not in "iuf":
            raise GridError(f"{name}: an array of numbers is wanted, got {array.dtype}")
        wanted = 2 if name == quantity else 1
        if array.ndim != wanted:
            raise GridError(f"{name}: {wanted} dimension(s) are wanted, got {array.ndim}")
    x_m, y_m, table = (arrays[name].astype(np.float64) for name in ("x_m", "y_m", quantity))
    if table.shape != (y_m.size, x_m.size):
        raise GridError(
            f"{quantity}: shape {table.shape} is not that of y_m × x_m, ({y_m.size}, {x_m.size})"
        )
    rows = tuple(tuple(row) for row in table.tolist())
    return _in_range(GridField(tuple(x_m.tolist()), tuple(y_m.tolist()), rows), quantity)
