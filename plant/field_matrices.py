"""Fields as matrices over a grid of cells, and matrices as fields; the source's two experiments.

A survey's matrix has a row for each y and a column for each x. Making one is the preparation of a
scenario: NumPy's and LAPACK's last bits may differ between machines here. A matrix that robots
swim in must therefore come from a file (`plant.grid_field.from_csv` reads what `to_csv` writes,
bit for bit), or from a closed form alone (`sampled`, `as_field`), not from a decomposition that is
computed again on each machine.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.errors import PlantError
from plant.field_sources import HeatedTank
from plant.fields import Field
from plant.grid_field import GridField
from plant.tank import Tank

INCH_M: Final = 0.0254
GREYS: Final = 255.0
"""White; the source scales its fields to 0 … 255."""


class ImageError(PlantError, ValueError):
    """Bytes that are no grey image in the PGM form."""


@dataclass(frozen=True, slots=True)
class SampleGrid:
    """Cells of a survey: the centre of cell (0, 0), the spacing, and how many."""

    rows: int
    columns: int
    cell_m: float = INCH_M
    x_m: float = 0.0
    y_m: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a grid without cells or without extent."""
        for name in ("rows", "columns"):
            check_number(f"grid.{name}", getattr(self, name), least=1)
        check_number("grid.cell_m", self.cell_m, above=0.0)
        for name in ("x_m", "y_m"):
            check_number(f"grid.{name}", getattr(self, name))

    def centre(self, row: int, column: int) -> tuple[float, float]:
        """Return x and y of a cell's centre, m."""
        return self.x_m + column * self.cell_m, self.y_m + row * self.cell_m


def sampled(source: Field, grid: SampleGrid) -> FloatArray:
    """Values of a field at the cells' centres, (rows, columns)."""
    return np.array(
        [
            [source.value(*grid.centre(row, column)) for column in range(grid.columns)]
            for row in range(grid.rows)
        ],
        np.float64,
    )


def as_field(matrix: FloatArray, grid: SampleGrid) -> GridField:
    """A field that has a matrix's values at the cells' centres and is bilinear between them.

    Raises ``GridError`` for fewer than two rows or columns and values that are not finite.
    """
    return GridField(
        tuple(grid.centre(0, column)[0] for column in range(grid.columns)),
        tuple(grid.centre(row, 0)[1] for row in range(grid.rows)),
        tuple(tuple(row) for row in matrix.tolist()),
    )


def to_csv(grid_field: GridField, quantity: str) -> str:
    """Write the form that ``plant.grid_field.from_csv`` reads, every number to its last bit."""
    head = ",".join([quantity, *map(repr, grid_field.x_m)])
    rows = [
        ",".join(map(repr, (y, *values)))
        for y, values in zip(grid_field.y_m, grid_field.values, strict=True)
    ]
    return "\n".join([head, *rows, ""])


def from_pgm(data: bytes) -> FloatArray:
    """Read a grey image, PGM plain (P2) or raw (P5), as a matrix 0 … 255, its first row first.

    Raises ``ImageError``. Any tool writes PGM: ``pnmtopng`` and its kin, ImageMagick, Pillow.
    """
    # magic, width, height and white; comments run from # to the end of a line (pgm(5), Netpbm)
    blank = rb"(?:\s|#[^\n]*\n)+"
    head = re.match(rb"(P[25])" + blank + rb"(\d+)" + blank + rb"(\d+)" + blank + rb"(\d+)\s", data)
    if head is None:
        raise ImageError("not a PGM image: no P2 or P5 with width, height and white")
    width, height, white = (int(head[group]) for group in (2, 3, 4))
    if not (width and height and 0 < white < 65536):
        raise ImageError(f"a PGM image of {width} × {height} with white {white}")
    body = data[head.end() :]
    if head[1] == b"P5":
        octets = 2 if white > 255 else 1
        count = min(len(body) // octets, width * height)
        values = np.frombuffer(body, dtype=f">u{octets}", count=count)
    else:
        words = re.sub(rb"#[^\n]*", b"", body).split()
        if not all(word.isdigit() for word in words):
            raise ImageError("a plain PGM image with something else than numbers")
        values = np.array([int(word) for word in words])
    if values.size < width * height:
        raise ImageError(f"a PGM image of {width} × {height} with {values.size} values")
    greys: FloatArray = values[: width * height].reshape(height, width) * (GREYS / white)
    return greys


def scaled(matrix: FloatArray) -> FloatArray:
    """Scale to 0 … 255. A least that is not 0 already is a constant more, and often a rank more."""
    least = float(matrix.min())
    span = float(matrix.max()) - least
    return (matrix - least) * (GREYS / span) if span > 0.0 else np.zeros_like(matrix)


def truncated(matrix: FloatArray, rank: int) -> FloatArray:
    """Nearest matrix of a rank (Eckart and Young 1936): the source's Ã."""
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    nearest: FloatArray = (u[:, :rank] * s[:rank]) @ vt[:rank]
    return nearest


READING_NOISE: Final = 0.004
"""Of the span: 0.02 °C for a field that spans 4 °C, which a good thermometer has; made up. Without
it the leading 6 × 6 block of so smooth a field has a condition of about 1e14, and nothing in
doubles would give the field back to better than 1e-4."""


def tank_temperature(seed: int = 1) -> FloatArray:
    """The source's experiment of section 6.5.1 made again, since its data are not printed.

    A kilowatt in a tank, measured with some noise at 24 × 24 points an inch apart, scaled to 0 …
    255, then truncated to rank 6. (The source speaks of the scaling after the truncation, of pixels
    in a picture; a matrix scaled so would have rank 7.) Tank and place of the heater are made up
    after Fig. 6.3.
    """
    tank = Tank(x_min_m=0.0, y_min_m=0.0, x_max_m=3.0, y_max_m=2.0, depth_m=0.6)
    source = HeatedTank(tank, x_m=1.37, y_m=0.93)
    grid = SampleGrid(24, 24, x_m=1.15, y_m=0.65)
    measured = scaled(sampled(source, grid))
    noise = np.random.default_rng(seed).standard_normal(measured.shape)
    return truncated(scaled(measured + READING_NOISE * GREYS * noise), 6)


def late_rank(seed: int = 8) -> FloatArray:
    """The source's field of section 6.6.2 made again: 20 × 20, rank 8, scaled to 0 … 255.

    Its first 10 × 10 block has rank 7 and its first 11 × 11 has rank 8. A constant is among the
    eight, so that scaling adds none; the last is absent from the first ten rows.
    """
    rng = np.random.default_rng(seed)
    left, right = rng.standard_normal((20, 8)), rng.standard_normal((8, 20))
    left[:, 0] = right[0] = 1.0
    left[:10, 7] = 0.0
    return scaled(left @ right)
