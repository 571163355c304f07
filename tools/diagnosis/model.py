"""What the engine knows of a system: parameters, causes, runs, and a model that predicts.

A measured run is a list of scalar measurements in the order of their times, each of one channel, so
channels may have any rates. A model predicts each of them from those before: with the gains of a
state estimator that was designed once, around the believed model, and is then the same for all that
is tried (``Filter``). The whitened innovations of two sets of values can therefore be compared:
half the difference of their sums of squares is a log-likelihood ratio.

Values are a mapping from parameter names to numbers; what is missing is neutral, and the neutral
value of everything is zero. So ``{}`` is the believed model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
Values: TypeAlias = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number that may be wrong; neutral at zero, possible in [least, most].

    ``prior_sd``: standard deviation that is expected of it before any data (a tolerance); infinite
    where nothing is known. ``scale``: a size at which it begins to matter, from which differences
    are taken (the engine adapts it).
    """

    name: str
    unit: str
    least: float = -math.inf
    most: float = math.inf
    prior_sd: float = math.inf
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Cause:
    """A named change of the believed model.

    ``statement`` is one sentence with the parameters in braces by their short names, such as "The
    water flows at {cx_m_s:.3f} m/s east.". Parameters are called ``NAME.SHORT``.

    Where people speak of other numbers than those in which the model is nearly linear (amplitude
    and phase, say, of what is estimated as two components), ``shown`` declares them, ``show``
    makes them and ``read`` makes the parameters of them; the statement's are those shown.

    ``costly``: its predictions take tens of times as long as others; noise is not estimated beside
    it before it is included.
    """

    name: str
    description: str
    parameters: tuple[Parameter, ...]
    statement: str
    shown: tuple[Parameter, ...] = ()
    show: Callable[[Sequence[float]], tuple[float, ...]] | None = None
    read: Callable[[Sequence[float]], tuple[float, ...]] | None = None
    costly: bool = False

    @property
    def reported(self) -> tuple[Parameter, ...]:
        """Parameters as they are reported."""
        return self.shown or self.parameters

    def report(self, numbers: Sequence[float]) -> tuple[float, ...]:
        """Return the reported numbers of values in the order of ``parameters``."""
        return tuple(numbers) if self.show is None else self.show(numbers)

    def reads(self, numbers: Sequence[float]) -> dict[str, float]:
        """Return the values of numbers as they are reported, in the order of ``reported``."""
        return self.values(*(numbers if self.read is None else self.read(numbers)))

    def values(self, *numbers: float) -> dict[str, float]:
        """Return values for its parameters, in their order."""
        return {p.name: x for p, x in zip(self.parameters, numbers, strict=True)}


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity.

    ``angle``: differences are taken modulo 2π. ``sigma``: of its noise; None: to be estimated.
    """

    name: str
    unit: str
    angle: bool = False
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class Run:
    """One measured run.

    ``time_s`` (n,) not decreasing, ``channel`` (n,) indices into the model's channels, ``value``
    (n,) finite. ``inputs`` is what the model needs to perform the same programme. ``held_out``
    None: the engine decides. ``sealed``: held out by the user, and seen by nothing before the end.
    """

    name: str
    time_s: FloatArray
    channel: IntArray
    value: FloatArray
    inputs: Any
    at_rest: bool = True
    held_out: bool | None = None
    sealed: bool = False


@dataclass(frozen=True, slots=True)
class Noise:
    """What is random.

    ``sigma`` (channels,) of the measurements; ``disturbance`` (d,) stationary standard deviations
    of first-order coloured disturbances, with ``correlation_s`` (d,).
    """

    sigma: FloatArray
    disturbance: FloatArray
    correlation_s: FloatArray


@dataclass(frozen=True, slots=True)
class Filter:
    """Fixed gains (n, states) and innovation variances (n,) for the measurements of one run."""

    gain: FloatArray
    variance: FloatArray


class Model(Protocol):
    """A system as the engine sees it. Methods are pure, and may be called by several threads."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What can be measured."""

    @property
    def tolerances(self) -> tuple[Parameter, ...]:
        """Nuisances that all runs share, each with a finite ``prior_sd``."""

    @property
    def causes(self) -> tuple[Cause, ...]:
        """What may be wrong and has a name."""

    @property
    def library(self) -> tuple[Parameter, ...]:
        """Terms of unexplained forces, for what no cause explains; may be empty."""

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Names of the coloured disturbances, in the order of ``Noise.disturbance``."""

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        """Nuisances of one run's initial state, as corrections of a first guess from its data."""

    def first_noise(self, runs: Sequence[Run]) -> Noise:
        """Return a rough start for the estimation of the noise."""

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        """Design the estimator (extended Kalman filter) along this run."""

    def innovations(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        """Measured minus predicted (n,), in the units of the channels, angles wrapped."""

    def responses(
        self, run: Run, values: Values, fixed: Filter, terms: Sequence[str], errors: FloatArray
    ) -> FloatArray:
        """Return the change of innovations per unit of terms of the library, and by errors.

        ``errors`` (n, k) are taken from the readings. Columns (n, terms + k); one of NaN where only
        a difference of innovations tells.
        """

    def replay(self, run: Run, values: Values, fixed: Filter | None = None) -> FloatArray:
        """Return what the run would have measured without noise or disturbance (n,).

        Open loop from its estimated start: what people call simulating it. With a filter, with what
        happened in this very run as far as the values let it happen (commands that were lost).
        """

    def signals(self, run: Run, values: Values) -> Mapping[str, FloatArray | IntArray]:
        """Return named series at the measurements (n,): inputs and replayed states.

        Whole numbers are labels of regimes, such as the place. In the series the engine says where
        what remains is: at large bias, at low speed, late in a run.
        """

    def draw(self, run: Run, values: Values, noise: Noise, generator: np.random.Generator) -> Run:
        """Return a run with the same times and inputs that this model has performed.

        With disturbance and noise.
        """


def by_differences(terms: Sequence[str], errors: FloatArray) -> FloatArray:
    """Return responses (n, terms + k) that leave everything to differences of innovations."""
    return np.full((errors.shape[0], len(terms) + errors.shape[1]), np.nan)


Progress: TypeAlias = Callable[[str, float], None]
"""Told what is being done and the share of it that is done, 0 to 1."""
