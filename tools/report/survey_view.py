"""`SurveyView`: what is shown of a survey by a shoal, as plain arrays and rows.

The pictures of a survey are made from this alone, whether robots swam with full dynamics, without
any, or in a tank. Times are seconds of the run, places metres in the tank's axes, matrices have a
row for each y and a column for each x, and NaN where nothing is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from procboard.survey.knowledge import Grid
from tools.records.data import FloatArray
from tools.records.survey_data import Cell, SurveyEvent

Span: TypeAlias = tuple[float, float]
CountArray: TypeAlias = npt.NDArray[np.int64]


class Doing(Enum):
    """What a robot does for a while; a sample is an instant of it."""

    SWIMS = "swims"
    RESTS = "rests"
    DEAD = "dead"


@dataclass(frozen=True, slots=True)
class SampleRow:
    """A sample of a cell."""

    time_s: float
    robot: int
    cell: Cell
    x_m: float
    y_m: float
    """Where its readings were taken, as the robot believes."""
    value: float
    deviation: float
    """Standard deviation of the value's error, as the robot states it."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyRobot:
    """A robot and its way; ``time_s`` grows."""

    address: int
    name: str
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    doing: tuple[tuple[Span, Doing], ...] = ()
    """One after the other, without overlap."""

    def dead(self) -> tuple[Span, ...]:
        """When it was dead."""
        return tuple(span for span, doing in self.doing if doing is Doing.DEAD)

    def dead_at(self, time_s: float) -> bool:
        """Whether it was dead then."""
        return any(start <= time_s <= end for start, end in self.dead())


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """The field as it was known from a moment on."""

    time_s: float
    wanted: int
    """Cells that the survey has asked for up to now, the sampled ones included."""
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class SurveyView:
    """A survey from its begin to the run's end."""

    quantity: str
    """As in "temperature"."""
    unit: str
    grid: Grid
    duration_s: float
    robots: tuple[SurveyRobot, ...]
    """In the order of their addresses."""
    samples: tuple[SampleRow, ...]
    """In the order of their times."""
    reconstruction: FloatArray
    deviation: FloatArray
    """As stated with the reconstruction; NaN where nothing is."""
    field: FloatArray | None = None
    """The truth at the cells' centres; None where nobody knows it."""
    given_up: tuple[Cell, ...] = ()
    complete_s: float | None = None
    """When the field was known to all that live; None: not by the end."""
    known: tuple[Known, ...] = ()
    """Growing in time."""
    events: tuple[SurveyEvent, ...] = ()
    """In the order of their times."""
    base_m: tuple[float, float] | None = None
    base_outages: tuple[Span, ...] = ()
    """When the base station could reach nobody."""
    parents: tuple[tuple[int, int], ...] = ()
    """(robot, where it sends its data on to), as last seen."""

    @cached_property
    def cells(self) -> int:
        """How many there are."""
        return self.grid.rows * self.grid.columns

    @cached_property
    def order(self) -> CountArray:
        """Number of the sample, from 1, that was a cell's first; 0 where there is none."""
        found = np.zeros(self.grid.shape, dtype=np.int64)
        for number, sample in enumerate(self.samples, start=1):
            if not found[sample.cell]:
                found[sample.cell] = number
        return found

    @cached_property
    def sampled(self) -> int:
        """Cells with one sample or more."""
        return int(np.count_nonzero(self.order))

    @cached_property
    def span(self) -> Span:
        """Least and greatest value of field and reconstruction, for one scale of both."""
        matrices = [m for m in (self.field, self.reconstruction) if m is not None]
        values = np.concatenate([matrix[np.isfinite(matrix)] for matrix in matrices])
        if not values.size:
            return (0.0, 1.0)
        low, high = float(values.min()), float(values.max())
        return (low, high) if high > low else (low - 0.5, high + 0.5)

    @cached_property
    def error(self) -> FloatArray | None:
        """Reconstruction less field; None where the field is not known."""
        return None if self.field is None else self.reconstruction - self.field

    def robot(self, address: int) -> SurveyRobot | None:
        """The robot with an address."""
        return next((robot for robot in self.robots if robot.address == address), None)


def root_mean_square(values: FloatArray) -> float | None:
    """Of all values that are finite; None without any."""
    finite = values[np.isfinite(values)]
    return math.sqrt(float(np.mean(finite**2))) if finite.size else None
