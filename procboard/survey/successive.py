"""Algorithms 2 and 3 of the source's chapter 6: a known block grows by a row and a column a step.

A block M′ of rank r′ has r′ independent columns J and rows I, and W = M′[I, J] can be inverted. Of
a new row a the cells in J are sampled. They are a combination xᵀW of the basis rows, and so is the
whole row: M[a, :] = xᵀ M[I, :], x = W⁻ᵀ M[a, J] (lines 4–7 of Algorithm 2). A new column likewise
(lines 8–11), and where they meet the cell follows from the new row's x and the new column.
A basis once found stays one, because what is recovered are its combinations; it changes only where
the rank does. The data must be exact: `procboard.survey.tolerant` is for noise.

Algorithm 2 stays with the rank of its first block and is wrong where the field has more; so the
source says. Algorithm 3 samples, while r′ < r, one more cell of each new row and column, drawn at
random. Where it is not what the basis says, the row is independent and is sampled everywhere.

Ours, where the source is silent:

- **Rectangles.** Rows and columns grow together until the shorter side is full, then the longer
  one alone. Samples, where the first block has rank r: r² + r(n − r) + r(m − r) = r(n + m − r).
- **The corner.** Where a row is independent it is no combination of the others, and nothing tells
  its cell in the new column: the corner is sampled, too. (A field of 10 × 10 with rank 7, 11 × 11
  with rank 8 may also differ in the corner alone; no line of Algorithm 3 would look there.)
- **The new basis.** An independent row joins I, and the column where it differs most from what was
  expected joins J: W stays as far from singular as one row can make it.
- **The rank is not given.** `procboard.survey.rank` grows the first block until its rank stays.
  Algorithm 3 then never knows that r′ = r, and looks at an extra cell in every step.
- **The order of a visit.** Row and column of a step may go to two robots. For one, steps go by
  turns from row to column and from column to row, so that it never swims back empty.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, NamedTuple

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import (
    EPSILON,
    FloatArray,
    Svd,
    independent_columns,
    inverse,
    product,
    svd,
)
from procboard.survey.expansion import Estimate, Expansion
from procboard.survey.rank import Cell, Steps, boustrophedon, grown_block, rank_of, sampled_into

ROUNDING: Final = 100.0
"""An extra sample is what the basis says if it differs by less than this many roundings of the
largest value, times the condition of W: some tens of operations stand behind each."""


def algorithm_2(shape: tuple[int, int], rank: int | None = None) -> Expansion:
    """Survey a grid by Algorithm 2. ``rank`` of the field; None: that of the first block.

    Raises ``SurveyError`` for a rank that the grid cannot have.
    """
    _check_rank(shape, rank)
    return Expansion(shape, lambda: Successive(shape, rank, looks=False, seed=0))


def algorithm_3(shape: tuple[int, int], rank: int | None = None, seed: int = 0) -> Expansion:
    """Survey a grid by Algorithm 3, extra samples drawn from ``seed``.

    ``rank`` of the field; None: not known, and looked for to the end. Raises ``SurveyError`` for a
    rank that the grid cannot have.
    """
    _check_rank(shape, rank)
    return Expansion(shape, lambda: Successive(shape, rank, looks=True, seed=seed))


def _check_rank(shape: tuple[int, int], rank: int | None) -> None:
    if rank is not None and not 1 <= rank <= min(shape):
        raise SurveyError(f"survey: rank {rank} in a grid of {shape}")


class Line(NamedTuple):
    """A row (axis 0) or a column (axis 1) that joins a block; it has ``length`` cells there."""

    axis: int
    number: int
    length: int

    def cells(self, places: list[int] | range) -> list[Cell]:
        """Return the cells at places along the line."""
        if self.axis == 0:
            return [(self.number, place) for place in places]
        return [(place, self.number) for place in places]


def new_lines(height: int, width: int, shape: tuple[int, int]) -> list[Line]:
    """Row and column by which a block of height × width grows, or one of them in a full grid."""
    row = [Line(0, height, width)] if height < shape[0] else []
    return row + ([Line(1, width, height)] if width < shape[1] else [])


def ring(cells: list[Cell], step: int) -> tuple[Cell, ...]:
    """Order cells of a new row and a new column for a visit, by turns row or column first.

    The row runs from the axis to the corner and the column back to the axis, or the other way.
    """
    walk = sorted(set(cells), key=lambda cell: cell[1] - cell[0])
    return tuple(walk[::-1] if step % 2 else walk)


def drawn(line: Line, among: list[int], seed: int) -> list[int]:
    """Draw one of the places ``among`` those of a line; none where there are none.

    A generator of its own for each line: what is drawn does not depend on what was drawn before.
    """
    if not among:
        return []
    draw = np.random.default_rng((seed, line.axis, line.number))
    return [among[int(draw.integers(len(among)))]]


class Successive:
    """Algorithm 2, or 3 where it ``looks``."""

    def __init__(self, shape: tuple[int, int], rank: int | None, *, looks: bool, seed: int) -> None:
        self._shape = shape
        self._rank = rank
        self._looks = looks
        self._seed = seed
        self._known = np.full(shape, np.nan)
        self._basis: tuple[list[int], list[int]] = ([], [])  # rows I, columns J

    @property
    def lines(self) -> int:
        """Of I or J: the rank."""
        return max(map(len, self._basis))

    def estimate(self) -> Estimate:
        """The block so far; exact, so nothing is said of deviations."""
        return Estimate(self._known.copy(), np.full(self._shape, np.nan))

    def steps(self) -> Steps:
        """Sample the first block, then grow it to the whole grid."""
        side = yield from self._first_block()
        self._find_basis(side)
        height = width = side
        for step in range(max(self._shape) - side):
            yield from self._step(height, width, step)
            height, width = min(height + 1, self._shape[0]), min(width + 1, self._shape[1])

    def _first_block(self) -> Generator[tuple[Cell, ...], FloatArray, int]:
        if self._rank is None:
            return (yield from grown_block(self._known))
        yield from sampled_into(self._known, boustrophedon(range(self._rank), range(self._rank)))
        return self._rank

    def _find_basis(self, side: int) -> None:
        """Choose columns by pivoting, and rows that are independent in those columns."""
        block = self._known[:side, :side]
        parts = svd(block)
        rank = rank_of(parts.s, block.shape)
        columns = independent_columns(block, rank)
        self._basis = independent_columns(block[:, columns].T, rank), columns
        self._invert(parts if rank == side else None)

    def _invert(self, parts: Svd | None = None) -> None:
        """W⁻¹ and the rounding that a prediction may show, from the decomposition of W."""
        rows, columns = self._basis
        self._inverse, condition = np.zeros((0, 0)), 1.0
        if rows:
            parts = parts or svd(self._known[np.ix_(rows, columns)])
            self._inverse, condition = inverse(parts, len(rows)), float(parts.s[0] / parts.s[-1])
        self._tolerance = ROUNDING * EPSILON * condition

    def _step(self, height: int, width: int, step: int) -> Steps:
        """Sample and recover a row and a column more, or one of them where the grid is full."""
        lines = new_lines(height, width, self._shape)
        looks = self._looks and len(self._basis[0]) != self._rank
        extra = {line.axis: self._extra(line) if looks else [] for line in lines}
        cells = [
            cell
            for line in lines
            for cell in line.cells(self._basis[1 - line.axis] + extra[line.axis])
        ]
        yield from sampled_into(self._known, ring(cells, step))

        # lines 4–7 for the row, 8–11 for the column
        weights = {line.axis: self._weights(line) for line in lines}
        expected = {line.axis: self._expected(line, weights[line.axis]) for line in lines}
        new = [line for line in lines if self._differs(line, extra[line.axis], expected[line.axis])]
        corner = [(height, width)] if new and len(lines) == 2 else []
        everywhere = [cell for line in new for cell in line.cells(range(line.length))]
        yield from sampled_into(self._known, ring(everywhere + corner, step))

        for line in lines:
            here = self._view(line.axis)[line.number, : line.length]
            if line in new:
                self._join(line, int(np.argmax(np.abs(here - expected[line.axis]))))
            else:
                here[:] = np.where(np.isnan(here), expected[line.axis], here)
        if len(lines) == 2 and not corner:
            # the new row is the same combination of rows in the new column, too
            column = self._known[self._basis[0], width]
            self._known[height, width] = product(weights[0], column[:, None])[0, 0]
        if new:
            self._invert()

    def _view(self, axis: int) -> FloatArray:
        """The known field with lines of an axis as its rows."""
        return self._known if axis == 0 else self._known.T

    def _extra(self, line: Line) -> list[int]:
        basis = self._basis[1 - line.axis]
        return drawn(line, [p for p in range(line.length) if p not in basis], self._seed)

    def _weights(self, line: Line) -> FloatArray:
        """Of the basis lines in a new one, (1, r′)."""
        sampled: FloatArray = self._view(line.axis)[line.number, self._basis[1 - line.axis]]
        return product(sampled[None, :], self._inverse if line.axis == 0 else self._inverse.T)

    def _expected(self, line: Line, weights: FloatArray) -> FloatArray:
        """What a new line is if it depends on the basis lines, (length,)."""
        basis: FloatArray = self._view(line.axis)[self._basis[line.axis], : line.length]
        expected: FloatArray = product(weights, basis)[0]
        return expected

    def _differs(self, line: Line, places: list[int], expected: FloatArray) -> bool:
        if not places:
            return False
        measured = self._view(line.axis)[line.number, places]
        largest = float(np.nanmax(np.abs(self._known)))
        return bool((np.abs(measured - expected[places]) > self._tolerance * largest).any())

    def _join(self, line: Line, place: int) -> None:
        """Take an independent line into the basis, and the line that crosses it at a place."""
        row, column = (line.number, place) if line.axis == 0 else (place, line.number)
        rows, columns = self._basis
        self._basis = sorted([*rows, row]), sorted([*columns, column])
