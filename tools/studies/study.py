"""What a study of a published figure or table yields: numbers beside numbers, and curves.

A study computes; it draws nothing and prints nothing, so that the command line, the report page,
the documentation and the tests all read the same result. Everything here is a frozen record that
crosses a process border by pickling.

A published number that the published equations cannot give (a misprint, or a statement that the
source's own parameters contradict) stays in the result as a check with its reason in
``known_difference``: it is measured and listed apart, and no tolerance is widened to hide it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[float], None]
"""Told the share of a study that is done, 0 to 1."""

Style = Literal["line", "dashed", "dotted", "marks"]


@dataclass(frozen=True, slots=True)
class Check:
    """One published number beside ours.

    ``tolerance`` is relative to the published value, or in ``unit`` where ``absolute``. A check
    with a ``known_difference`` (the misprint, or why the numbers cannot agree) never fails the
    command. Raises ``ValueError`` for a check that could not fail or not be computed.
    """

    what: str
    published: float
    computed: float
    unit: str
    tolerance: float
    absolute: bool = False
    known_difference: str = ""

    def __post_init__(self) -> None:
        """Refuse a tolerance that everything or nothing passes, and a relative error to zero."""
        if not 0.0 < self.tolerance < math.inf:
            raise ValueError(f"{self.what}: tolerance must be above 0, got {self.tolerance!r}")
        if not math.isfinite(self.published):
            raise ValueError(f"{self.what}: no published number: {self.published!r}")
        if self.published == 0.0 and not self.absolute:
            raise ValueError(f"{self.what}: an error relative to zero; make it absolute")

    @property
    def error(self) -> float:
        """Computed less published: in ``unit`` where absolute, else as a share of the published."""
        difference = self.computed - self.published
        return difference if self.absolute else difference / abs(self.published)

    @property
    def ok(self) -> bool:
        """Whether the error is within the tolerance (a NaN never is)."""
        return abs(self.error) <= self.tolerance

    @property
    def failed(self) -> bool:
        """Whether the numbers part without a known reason."""
        return not self.ok and not self.known_difference


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """What we computed: ``x`` and ``y`` of one length, in the panel's units.

    ``error``: half lengths of error bars, where measured marks have some.
    """

    label: str
    x: FloatArray
    y: FloatArray
    style: Style = "line"
    error: FloatArray | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn as one curve."""
        if self.x.ndim != 1 or self.x.shape != self.y.shape:
            raise ValueError(f"curve {self.label!r}: x {self.x.shape} and y {self.y.shape}")
        if self.error is not None and self.error.shape != self.y.shape:
            raise ValueError(f"curve {self.label!r}: y {self.y.shape}, error {self.error.shape}")


@dataclass(frozen=True, slots=True)
class Mark:
    """A published number at its place in the plot."""

    x: float
    y: float
    label: str


@dataclass(frozen=True, slots=True)
class Band:
    """A published range of the vertical axis."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class Ribbon:
    """A range around a curve: ``low`` to ``high`` at each ``x``."""

    label: str
    x: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes; ``equal``: one metre is as long across as up.

    ``y_range`` fixes the vertical axis where the source's own says something.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    marks: tuple[Mark, ...] = ()
    bands: tuple[Band, ...] = ()
    ribbons: tuple[Ribbon, ...] = ()
    equal: bool = False
    y_range: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """``z`` (rows along ``y``, columns along ``x``) over a grid."""

    title: str
    x_label: str
    y_label: str
    z_label: str
    x: FloatArray
    y: FloatArray
    z: FloatArray

    def __post_init__(self) -> None:
        """Refuse a grid whose shape is not that of its axes."""
        if self.z.shape != (self.y.size, self.x.size):
            raise ValueError(f"surface {self.title!r}: z {self.z.shape}, x {self.x.shape}")


@dataclass(frozen=True, slots=True, eq=False)
class Cells(Surface):
    """A surface drawn as cells about its grid points, blank where ``z`` is NaN.

    ``z_range``: what the colours reach over, so that pictures compare.
    """

    z_range: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of the source, by its number there, such as "Fig. 3.4"."""

    name: str
    caption: str
    panels: tuple[Panel | Surface, ...]


@dataclass(frozen=True, slots=True)
class Result:
    """What a study found; ``notes`` say how it was computed where the source leaves that open."""

    checks: tuple[Check, ...] = ()
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Study:
    """A published figure or table ("fig-3.4", "table-5.2") and how to compute it again."""

    name: str
    description: str
    compute: Callable[[Progress], Result]
