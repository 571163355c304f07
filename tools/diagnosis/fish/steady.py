"""Steady motion as the engine sees it: tables of turning radius, turning period and speed.

A row of a table is one measurement of each of its columns: no state is carried from one to the
next, so gains are empty and innovations are what was measured minus the steady motion of the row's
beat (``plant.orbit``). What steady motion does not know cannot be found: delays, biases of
instruments that a table has forgotten, lost commands. Currents and walls would have to be known by
place; a table is taken in open, still water.

Where the table gives no standard deviations (``…_sd``), the noise is a share of each value, by the
table's own scatter (``scatter``).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from plant.effects import EFFECTS
from plant.errors import InvalidParameterError, PlantError
from plant.orbit import periodic_orbit
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.fish.model import LOST, possible
from tools.diagnosis.fish.nuisances import (
    PREFIX,
    TOLERANCE,
    made_straight,
    straight,
    tolerances,
    within_tolerances,
)
from tools.diagnosis.fish.scatter import Scatter, own_scatter
from tools.diagnosis.fish.setup import Setup
from tools.diagnosis.model import (
    Cause,
    Channel,
    Filter,
    FloatArray,
    Noise,
    Parameter,
    Run,
    Values,
    by_differences,
)

CHANNELS = (
    Channel("turn_radius_m", "m"),
    Channel("turn_period_s", "s"),
    Channel("speed_m_s", "m/s"),
)
RADIUS, PERIOD, SPEED = range(len(CHANNELS))

CAUSES_OF_STEADY_MOTION = (
    *(
        name
        for name in EFFECTS
        if name not in ("water_current", "tail_fade", "servo_delay", "wall_effect")
    ),
    "camera_scale",
    "clock_drift",
)
"""What moves steady motion; the camera's scale and the clock are those of who made the table."""

_TOLERANCES = ("gyro_bias", "gyro_scale", "compass_offset", "camera_rotation", "camera_delay")
"""Tolerances that a table knows nothing of."""

STEP_S = 5e-3
STRAIGHT_M, STRAIGHT_S = 1e3, 1e5
"""Radius and period of what does not turn."""

FIRST_SHARE = 0.03


@dataclass(frozen=True, slots=True)
class SteadyInputs:
    """Rows of a table: ``beats`` (rows), ``row`` (n,) of each measurement, ``sd`` (n,) or NaN."""

    beats: tuple[TailBeat, ...]
    row: np.ndarray[tuple[int], np.dtype[np.int64]]
    sd: FloatArray


class SteadyModel:
    """A robot that is believed to be ``plant``, in steady motion.

    ``known``: channels whose standard deviations the table gives; their sigma is 1, in units of
    these. Of the others it is a share of the value; ``shares`` holds those that are known.
    """

    def __init__(
        self,
        plant: PlantParameters,
        known: Sequence[int] = (),
        shares: Mapping[int, float] | None = None,
        tolerance: float = TOLERANCE,
    ) -> None:
        self.plant = plant
        sigmas = {**(shares or {}), **dict.fromkeys(known, 1.0)}
        self._channels = tuple(
            replace(channel, sigma=sigmas.get(index)) for index, channel in enumerate(CHANNELS)
        )
        self._known = frozenset(known)
        self._tolerances = (
            *(p for p in tolerances(tolerance) if p.name.removeprefix(PREFIX) not in _TOLERANCES),
            *straight(),
        )
        self._causes = tuple(
            possible(CAUSES[name].cause, plant)
            for name in CAUSES
            if name in CAUSES_OF_STEADY_MOTION
        )
        self._orbit = lru_cache(maxsize=4096)(_orbit)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Columns of a table."""
        return self._channels

    @property
    def tolerances(self) -> tuple[Parameter, ...]:
        """Tolerances of the robot, of lengths and of times."""
        return self._tolerances

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Causes that move steady motion."""
        return self._causes

    @property
    def library(self) -> tuple[Parameter, ...]:
        """None: a table has no motion to regress a force on."""
        return ()

    @property
    def disturbances(self) -> tuple[str, ...]:
        """None: what is measured is a mean."""
        return ()

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        """None: steady motion forgets its start."""
        return ()

    def first_noise(self, runs: Sequence[Run]) -> Noise:
        """What is known, and a few percent of each other value."""
        sigma = [FIRST_SHARE if c.sigma is None else c.sigma for c in self._channels]
        return Noise(np.array(sigma), np.empty(0), np.empty(0))

    def setup(self, values: Values) -> Setup:
        """Return the believed robot with some values."""
        setup = within_tolerances(Setup(self.plant), values)
        for name in CAUSES_OF_STEADY_MOTION:
            own = {key: x for key, x in values.items() if key.startswith(f"{name}.")}
            if any(own.values()):
                setup = CAUSES[name].apply(setup, own)
                if name == "drag_vs_bias":
                    setup = made_straight(setup, values)
        return setup

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        """Return variances; there are no gains (n, 0)."""
        return Filter(np.zeros((run.value.size, 0)), self._variance(run, noise))

    def _variance(self, run: Run, noise: Noise) -> FloatArray:
        inputs = run.inputs
        assert isinstance(inputs, SteadyInputs)
        sigma = noise.sigma[run.channel]
        known = np.isin(run.channel, list(self._known))
        size = np.where(known, inputs.sd, np.abs(run.value))
        variance: FloatArray = np.square(sigma * size)
        return variance

    def innovations(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        """Measured minus the steady motion (n,); what makes none is far off."""
        try:
            predicted = self.replay(run, values)
        except InvalidParameterError:
            predicted = np.full(run.value.size, np.nan)
        away = run.value - predicted
        most = LOST * np.sqrt(fixed.variance)
        return np.where(np.isfinite(away), np.clip(away, -most, most), most)

    def responses(
        self, _run: Run, _values: Values, _fixed: Filter, terms: Sequence[str], errors: FloatArray
    ) -> FloatArray:
        """Leave them to differences."""
        return by_differences(terms, errors)

    def replay(self, run: Run, values: Values, _fixed: Filter | None = None) -> FloatArray:
        """Return the steady motion of every row (n,), NaN where there is none."""
        inputs = run.inputs
        assert isinstance(inputs, SteadyInputs)
        setup = self.setup(values)
        motion = np.array([self._orbit(setup.plant, beat) for beat in inputs.beats])
        scale, clock = 1.0 + setup.camera_scale, 1.0 + setup.clock_drift
        motion *= (scale, clock, scale / clock)
        result: FloatArray = motion[inputs.row, run.channel]
        return result

    def signals(self, run: Run, values: Values) -> Mapping[str, FloatArray]:
        """Return the beat of every measurement."""
        inputs = run.inputs
        assert isinstance(inputs, SteadyInputs)
        beats = np.array([(b.bias_rad, b.amplitude_rad, b.frequency_hz) for b in inputs.beats])
        names = ("the bias", "the amplitude", "the frequency")
        return {name: beats[inputs.row, i].copy() for i, name in enumerate(names)}

    def draw(self, run: Run, values: Values, noise: Noise, generator: np.random.Generator) -> Run:
        """Return a table of the same beats."""
        deviates = generator.standard_normal(run.value.size)
        spread = np.sqrt(self._variance(run, noise))
        return replace(run, value=self.replay(run, values) + spread * deviates)


def scatter_of(
    plant: PlantParameters, runs: Sequence[Run], known: Collection[int]
) -> dict[int, Scatter]:
    """Return the scatter of each measured channel that is not ``known``."""
    model = SteadyModel(plant)
    predicted = np.concatenate([model.replay(run, {}) for run in runs])
    measured = np.concatenate([run.value for run in runs])
    channel = np.concatenate([run.channel for run in runs])
    beats = [run.inputs.beats[row] for run in runs for row in run.inputs.row]
    found = {}
    for index in sorted(set(channel.tolist()) - set(known)):
        rows = np.flatnonzero(channel == index)
        found[index] = own_scatter([beats[i] for i in rows], measured[rows], predicted[rows])
    return found


def _orbit(plant: PlantParameters, beat: TailBeat) -> tuple[float, float, float]:
    """Return radius (m), period (s) and speed (m/s) of a beat; NaN where no beat repeats."""
    try:
        orbit = periodic_orbit(plant, beat, STEP_S)
    except InvalidParameterError:
        raise
    except PlantError:
        return math.nan, math.nan, math.nan
    radius, period = orbit.turn_radius_m, orbit.turn_period_s
    return (
        STRAIGHT_M if radius is None else min(radius, STRAIGHT_M),
        STRAIGHT_S if period is None else min(period, STRAIGHT_S),
        orbit.path_speed_m_s,
    )
