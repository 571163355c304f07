"""Successive expansion of a noisy field: what section 6.7 of the source leaves to future work.

As in Algorithm 2 a block grows by a row and a column a step, sampled in some columns J and rows I.
Four things differ, because a sample is the field plus noise of standard deviation σ.

**The rank** r of W = M[I, J] is the count of its singular values above what noise alone reaches
(`procboard.survey.rank`); what is below is left out: W⁺ is that of the best approximation of rank
r. Lines of I and J are sampled in full, never recovered, so that errors do not build on errors.
There is one line more than the rank on both sides, which shows when the rank grows.

**The field** is C W⁺ R with the sampled columns C = M[:, J] and rows R = M[I, :]: every row k is a
combination of the rows I with weights x = W⁺ᵀ C[k]ᵀ by least squares, every column l one of the
columns J with weights y = W⁺ R[:, l].

**Its error** in a cell that was not sampled is, to first order in the noise, yᵀδC[k] + xᵀδR[:, l] −
xᵀδW y (what comes from the turning of singular spaces vanishes where C, W and R have one rank). The
errors of samples are independent, so that its variance is σ²D with D = |x|² + |y|² + |x|²|y|². A
sampled cell stays as it was measured: with so few lines to spare smoothing gains next to nothing,
and a field that has no low rank is not falsified where it was seen.

**The condition bound**: √D is how much noise a cell's value is amplified by. Where it exceeds
``amplification``, the row or column with the larger weights is sampled in full and joins I or J. So
the lines spread over the field by themselves, dense where it changes quickly, and those that have
become superfluous (by pivoted QR) are not sampled on. This also bounds what least squares may do
where a small singular value has just been taken for the field's.

**A new line is independent** where its samples in J (one more than the rank) and one drawn at
random elsewhere do not fit, by a χ² that one in a thousand of those that do exceeds. It is sampled
in full, and so is the line across it through its worst misfit. What differs from the lines in few
cells only, such as a narrow peak between them, may be missed; nor does the deviation tell of it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import (
    EPSILON,
    FloatArray,
    independent_columns,
    inverse,
    product,
    svd,
    total,
)
from procboard.survey.expansion import Estimate, Expansion
from procboard.survey.rank import Steps, grown_block, rank_of, sampled_into
from procboard.survey.successive import ROUNDING, Line, drawn, new_lines, ring

AMPLIFICATION: Final = 3.0
"""Largest standard deviation of a cell that was not sampled, in those of a sample."""
SPARE: Final = 1
"""Lines on each side beyond the rank."""
RARE: Final = 3.0902
"""What a normal deviate exceeds once in a thousand times."""


def noise_tolerant(
    shape: tuple[int, int], sigma: float, *, amplification: float = AMPLIFICATION, seed: int = 0
) -> Expansion:
    """Survey a grid whose samples have noise; the rank is found on the way.

    Args:
        shape: rows and columns of the grid.
        sigma: standard deviation of a sample's error, in the field's unit; 0 for exact samples.
        amplification: condition bound, above 1; smaller ones ask for more samples.
        seed: of the cells that are looked at besides.

    Raises ``SurveyError`` for a negative noise or a bound that no reconstruction keeps.

    """
    if not (math.isfinite(sigma) and sigma >= 0.0):
        raise SurveyError(f"survey: noise of {sigma} is none")
    if not amplification > 1.0:
        raise SurveyError(f"survey: amplification is above 1, got {amplification}")
    return Expansion(shape, lambda: Tolerant(shape, sigma, amplification, seed))


class Weights(NamedTuple):
    """Weights of a block's rows and columns in the lines I and J, and what follows from them."""

    x: FloatArray
    """(height, |I|)."""
    y: FloatArray
    """(|J|, width)."""
    amplified: FloatArray
    """D, (height, width)."""


def exceeded(freedom: int) -> float:
    """Return what a χ² exceeds once in a thousand times (Wilson and Hilferty 1931)."""
    part = 2.0 / (9.0 * freedom)
    return float(freedom * (1.0 - part + RARE * math.sqrt(part)) ** 3)


class Tolerant:
    """The algorithm; its state is the block's size, the lines I and J, and what was sampled."""

    def __init__(
        self, shape: tuple[int, int], sigma: float, amplification: float, seed: int
    ) -> None:
        self._shape = shape
        self._sigma = sigma
        self._bound = amplification * amplification
        self._seed = seed
        self._measured = np.full(shape, np.nan)
        self._lines: tuple[list[int], list[int]] = ([], [])  # rows I, columns J
        self._size = (0, 0)
        self._rank = 0
        self._inverse = np.zeros((0, 0))

    @property
    def lines(self) -> int:
        """Of I or J, whichever are more."""
        return max(map(len, self._lines))

    def steps(self) -> Steps:
        """Sample the first block, then grow it to the whole grid."""
        side = yield from grown_block(self._measured, self._sigma, SPARE)
        self._lines = list(range(side)), list(range(side))
        self._size = (side, side)
        self._fit()
        for step in range(max(self._shape) - side):
            yield from self._grow(step)

    def estimate(self) -> Estimate:
        """The block so far: sampled cells as measured, the others recovered."""
        matrix, deviation = np.full(self._shape, np.nan), np.full(self._shape, np.nan)
        height, width = self._size
        if height:
            weights = self._weights()
            measured = self._measured[:height, :width]
            unknown = np.isnan(measured)
            matrix[:height, :width] = np.where(unknown, self._recovered(weights), measured)
            amplified = np.where(unknown, weights.amplified, 1.0)
            deviation[:height, :width] = self._noise() * np.sqrt(amplified)
        return Estimate(matrix, deviation)

    def _grow(self, step: int) -> Steps:
        """Add a row and a column, or one of them where the grid is full."""
        height, width = self._size
        lines = new_lines(height, width, self._shape)
        looked = {line.axis: self._drawn(line) for line in lines}
        cells = [
            cell
            for line in lines
            for cell in line.cells(self._lines[1 - line.axis] + looked[line.axis])
        ]
        yield from sampled_into(self._measured, ring(cells, step))
        self._size = (min(height + 1, self._shape[0]), min(width + 1, self._shape[1]))

        weights = self._weights()
        new = [line for line in lines if self._misfits(line, looked[line.axis], weights)]
        everywhere = [cell for line in new for cell in line.cells(range(self._size[1 - line.axis]))]
        yield from sampled_into(self._measured, ring(everywhere, step))
        crossing = [self._worst(line, weights) for line in new]
        for line, place in zip(new, crossing, strict=True):
            yield from self._take(line.axis, line.number)
            yield from self._take(1 - line.axis, place)
        yield from self._condition()
        self._drop()

    def _condition(self) -> Steps:
        """Take lines until no cell is amplified beyond the bound."""
        while True:
            weights = self._weights()
            amplified = self._amplified(weights)
            row, column = divmod(int(np.argmax(amplified)), self._size[1])
            if amplified[row, column] <= self._bound:
                return
            x, y = weights.x[row], weights.y[:, column]
            if total(x * x) >= total(y * y):
                yield from self._take(0, row)
            else:
                yield from self._take(1, column)

    def _drop(self) -> None:
        """Leave out lines that the rank and the condition bound can do without."""
        kept, fit = self._lines, (self._rank, self._inverse)
        count = self._rank + SPARE
        if max(map(len, kept)) <= count:
            return
        core = self._core()
        chosen = [
            [lines[i] for i in independent_columns(across, min(count, len(lines)))]
            for lines, across in zip(kept, (core.T, core), strict=True)
        ]
        self._lines = chosen[0], chosen[1]
        self._fit()
        if self._rank < fit[0] or self._amplified(self._weights()).max() > self._bound:
            self._lines, (self._rank, self._inverse) = kept, fit

    def _core(self) -> FloatArray:
        """W = M[I, J]."""
        core: FloatArray = self._measured[np.ix_(*self._lines)]
        return core

    def _fit(self) -> None:
        parts = svd(self._core())
        self._rank = rank_of(parts.s, (len(self._lines[0]), len(self._lines[1])), self._sigma)
        self._inverse = inverse(parts, self._rank)

    def _weights(self) -> Weights:
        rows, columns = self._lines
        height, width = self._size
        x = product(self._measured[:height, columns], self._inverse)
        y = product(self._inverse, self._measured[rows, :width])
        xx, yy = total((x * x).T)[:, None], total(y * y)
        return Weights(x, y, xx + yy + xx * yy)

    def _amplified(self, weights: Weights) -> FloatArray:
        """D of the block's cells that were not sampled, 0 of the others."""
        height, width = self._size
        return np.where(np.isnan(self._measured[:height, :width]), weights.amplified, 0.0)

    def _recovered(self, weights: Weights) -> FloatArray:
        return product(weights.x, self._measured[self._lines[0], : self._size[1]])

    def _noise(self) -> float:
        """σ, or the rounding of exact samples."""
        return max(self._sigma, ROUNDING * EPSILON * float(np.nanmax(np.abs(self._measured))))

    def _misfits(self, line: Line, looked: list[int], weights: Weights) -> bool:
        """Whether the samples of a new line are none of a combination of the lines there are."""
        basis = self._lines[1 - line.axis]
        rest, amplified = self._rest(line, weights)
        own = weights.x[line.number] if line.axis == 0 else weights.y[:, line.number]
        squares = total(rest[basis] ** 2) / (1.0 + total(own * own))
        squares += total(rest[looked] ** 2 / (1.0 + amplified[looked]))
        freedom = len(basis) - self._rank + len(looked)
        return freedom > 0 and bool(squares > self._noise() ** 2 * exceeded(freedom))

    def _rest(self, line: Line, weights: Weights) -> tuple[FloatArray, FloatArray]:
        """What was measured of a line less what is recovered, and D along it."""
        height, width = self._size
        rest = self._measured[:height, :width] - self._recovered(weights)
        amplified = weights.amplified
        if line.axis == 0:
            return rest[line.number], amplified[line.number]
        return rest[:, line.number], amplified[:, line.number]

    def _worst(self, line: Line, weights: Weights) -> int:
        """Place of a line, sampled in full, where it fits worst and no line crosses it yet."""
        rest, amplified = self._rest(line, weights)
        misfit = np.abs(rest) / np.sqrt(1.0 + amplified)
        misfit[self._lines[1 - line.axis]] = -1.0
        return int(np.argmax(misfit))

    def _drawn(self, line: Line) -> list[int]:
        basis = self._lines[1 - line.axis]
        last = min(line.length + 1, self._shape[1 - line.axis])  # with the corner
        return drawn(line, [place for place in range(last) if place not in basis], self._seed)

    def _take(self, axis: int, number: int) -> Steps:
        """Sample a line in full, as far as the block goes, and have it among I or J."""
        if number not in self._lines[axis]:
            places = range(self._size[1 - axis])
            cells = tuple(Line(axis, number, len(places)).cells(places))
            yield from sampled_into(self._measured, cells)
            lines = sorted([*self._lines[axis], number])
            rows, columns = self._lines
            self._lines = (lines, columns) if axis == 0 else (rows, lines)
            self._fit()
