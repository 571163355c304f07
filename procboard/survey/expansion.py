"""A survey as a state machine without I/O: cells wanted, samples told, the field as far as known.

The algorithms are generators (`procboard.survey.successive`, `procboard.survey.tolerant`): they
yield the cells that they must know and are sent those cells' values, and read like the source's
listings. An `Expansion` runs one on whatever is told, in whatever order. An algorithm sees the
values that it asked for and no others. So what is wanted depends on the *set* of samples told, not
on the order: boards that know the same samples want the same cells, also where one of them learnt
of later steps first.

Two readings of one cell (a robot that took over, a message that came twice) count as their mean,
each value once, whatever their order. Where that changes a value which has been used already, the
algorithm runs again from the start, a few milliseconds, and may then want other cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Set
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray
from procboard.survey.completion import BoolArray
from procboard.survey.rank import Cell, Steps


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A field as far as it is known; NaN where it is not.

    ``deviation``: standard deviation of each cell's error, in the field's unit, to first order in
    the samples' noise; NaN where the algorithm says nothing of it.
    """

    matrix: FloatArray
    deviation: FloatArray


class Algorithm(Protocol):
    """A way to survey: steps that ask for cells, and what is known after those gone so far."""

    @property
    def lines(self) -> int:
        """Rows or columns, whichever are more, from which the others follow; 0: from none."""

    def steps(self) -> Steps:
        """Ask for cells, get their values, return when the field is known."""

    def estimate(self) -> Estimate:
        """The field as far as the steps so far tell; its arrays are the caller's."""


class Expansion:
    """One survey of a grid of rows × columns.

    Args:
        shape: rows and columns of the grid, at least 1 each.
        start: makes the algorithm, in its first state.

    Raises ``SurveyError`` for a grid without cells.

    """

    def __init__(self, shape: tuple[int, int], start: Callable[[], Algorithm]) -> None:
        if min(shape) < 1:
            raise SurveyError(f"survey: a grid has at least one cell, got {shape}")
        self.shape = shape
        self._start = start
        self._readings: dict[Cell, frozenset[float]] = {}
        self._values: dict[Cell, float] = {}
        self.answered = 0
        """Requests that the algorithm has worked on, again wherever it began anew: what costs."""
        self._begin()

    @property
    def done(self) -> bool:
        """Whether the whole field is known."""
        return self._steps is None

    @property
    def sampled(self) -> BoolArray:
        """Where samples have been told, (rows, columns)."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        for cell in self._values:
            mask[cell] = True
        return mask

    @property
    def request(self) -> tuple[Cell, ...]:
        """Cells that the algorithm waits for, those included that have been told meanwhile."""
        return self._request

    @property
    def used(self) -> Set[Cell]:
        """Cells whose values the algorithm has seen; the same for all that wait for the same."""
        return self._used

    @property
    def lines(self) -> int:
        """Rows or columns, whichever are more, that the algorithm has made its basis."""
        return self._algorithm.lines

    def wanted(self) -> tuple[Cell, ...]:
        """Cells to be sampled next, in the order of a visit; none once the field is known."""
        return tuple(cell for cell in self._request if cell not in self._values)

    def tell(self, cell: Cell, value: float) -> None:
        """Take a sample, wanted or not. Raises ``SurveyError`` for what is no cell or number."""
        value = self._checked(cell, value)
        readings = self._readings.get(cell, frozenset()) | {value}
        self._set(cell, readings, math.fsum(readings) / len(readings))

    def correct(self, cell: Cell, value: float) -> None:
        """Take a value in place of all that was told of a cell; errors as `tell`."""
        value = self._checked(cell, value)
        self._set(cell, frozenset((value,)), value)

    def estimate(self) -> Estimate:
        """The field as far as it is known, with its standard deviation.

        Cells told that the algorithm has not used stand as they were told; of them it says nothing.
        """
        estimate = self._algorithm.estimate()
        for cell, value in self._values.items():
            if cell not in self._used or math.isnan(estimate.matrix[cell]):
                estimate.matrix[cell], estimate.deviation[cell] = value, math.nan
        return estimate

    def reconstruction(self) -> FloatArray:
        """The field as far as it is known, (rows, columns); NaN where it is not."""
        return self.estimate().matrix

    def _checked(self, cell: Cell, value: float) -> float:
        row, column = cell
        if not (0 <= row < self.shape[0] and 0 <= column < self.shape[1]):
            raise SurveyError(f"survey: no cell {cell} in a grid of {self.shape}")
        value = float(value)
        if not math.isfinite(value):
            raise SurveyError(f"survey: sample {value} of cell {cell} is not finite")
        return value

    def _set(self, cell: Cell, readings: frozenset[float], value: float) -> None:
        before = self._values.get(cell)
        self._readings[cell], self._values[cell] = readings, value
        self._missing.discard(cell)
        if cell in self._used and value != before:
            self._begin()
        else:
            self._go_on()

    def _begin(self) -> None:
        self._algorithm = self._start()
        self._steps: Steps | None = self._algorithm.steps()
        self._used: set[Cell] = set()  # cells whose values the algorithm has seen
        self._send(None)
        self._go_on()

    def _go_on(self) -> None:
        while self._steps is not None and not self._missing:
            self._used.update(self._request)
            self.answered += 1
            self._send(np.array([self._values[cell] for cell in self._request], np.float64))

    def _send(self, values: FloatArray | None) -> None:
        assert self._steps is not None
        try:
            self._request = next(self._steps) if values is None else self._steps.send(values)
        except StopIteration:
            self._steps, self._request = None, ()
        self._missing = {cell for cell in self._request if cell not in self._values}
