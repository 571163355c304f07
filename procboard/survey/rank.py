"""How many singular values of a block are the field's, and growing a block until that stays.

**Without noise** a singular value counts above max(m, n) ε s₁, the rounding of the decomposition
itself (Golub and Van Loan, Matrix Computations, 4th ed., section 5.4.1).

**With noise** of standard deviation σ in every entry, a singular value of a block of m × n counts
above the largest one that the noise alone reaches once in a thousand blocks,

    σ √(µ + 3.2724 s),   µ = (a + b)²,   s = (a + b)(1/a + 1/b)^⅓,   a = √(m − ½), b = √(n − ½).

µ is about the edge of the Marchenko–Pastur law and the rest what fluctuates, by the law of Tracy
and Widom (Johnstone 2001; with the halves of Z. Ma 2012 it holds for small blocks: twice in a
thousand at 2 × 2, three times for a single cell). By Weyl's inequality no singular value beyond the
field's rank exceeds the largest one of the noise, so that often is a rank overstated. The threshold
of Gavish and Donoho (2014), 2.31 σ√n for square blocks, is higher for large ones and lower for the
few cells here; it is the best for clearing a matrix of noise, whereas here singular values are
divided by, and a false one costs more than it brings.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Final

import numpy as np

from procboard.survey.algebra import EPSILON, FloatArray, svd

Cell = tuple[int, int]
"""Row and column, from 0; rows lie along y, columns along x."""
Steps = Generator[tuple[Cell, ...], FloatArray, None]
"""Yields the cells it must know next, in the order of a visit; gets their values in that order."""

RARE: Final = 3.2724
"""What one in a thousand exceeds in the law of Tracy and Widom for β = 1 (Bejan 2005, Table 2)."""


def threshold(shape: tuple[int, int], sigma: float, largest: float) -> float:
    """Return the size from which on a singular value of a block is the field's, in its unit.

    Args:
        shape: of the block.
        sigma: standard deviation of the noise of each entry; 0 where there is none.
        largest: the block's largest singular value, for the rounding.

    """
    rounding = max(shape) * EPSILON * largest
    a, b = math.sqrt(shape[0] - 0.5), math.sqrt(shape[1] - 0.5)
    edge, spread = (a + b) ** 2, (a + b) * (1.0 / a + 1.0 / b) ** (1.0 / 3.0)
    return max(rounding, sigma * math.sqrt(edge + RARE * spread))


def rank_of(s: FloatArray, shape: tuple[int, int], sigma: float = 0.0) -> int:
    """Rank of a block from its singular values, which fall; 0 for a block of noise or zeros."""
    if not s.size:
        return 0
    return int(np.count_nonzero(s > threshold(shape, sigma, float(s[0]))))


def boustrophedon(rows: range, columns: range) -> tuple[Cell, ...]:
    """All cells of a block, the first row from left to right, the next one back."""
    return tuple(
        (row, column)
        for number, row in enumerate(rows)
        for column in (reversed(columns) if number % 2 else columns)
    )


def around(side: int) -> tuple[Cell, ...]:
    """Cells that a block of side × side has more than one of side − 1: a walk round its corner.

    Odd sides begin with the column, even ones with the row, so that one walk leads to the next.
    """
    last = side - 1
    walk = [(row, last) for row in range(side)] + [(last, column) for column in range(last)][::-1]
    return tuple(walk if side % 2 else walk[::-1])


def sampled_into(known: FloatArray, cells: tuple[Cell, ...]) -> Steps:
    """Ask for cells and note their values."""
    for cell, value in zip(cells, (yield cells), strict=True):
        known[cell] = value


def grown_block(
    known: FloatArray, sigma: float = 0.0, patience: int = 1
) -> Generator[tuple[Cell, ...], FloatArray, int]:
    """Grow the leading square block of a field until its rank has stayed ``patience`` times.

    The source gives the rank; this finds it, for (r + patience)² samples instead of r². What the
    corner does not show is not found: a leading block may have a smaller rank than the field.
    Values are noted in ``known``, (rows, columns). Returns the block's side.
    """
    most: int = min(known.shape)
    for side in range(1, most + 1):
        yield from sampled_into(known, around(side))
        here = known[:side, :side]
        if rank_of(svd(here).s, here.shape, sigma) <= side - patience:
            return side
    return most
