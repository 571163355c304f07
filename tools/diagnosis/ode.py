"""A model from two plain Python functions: ``rates(t, x, u, p)`` and ``outputs(t, x, u, p)``.

``rates`` returns the time derivatives of the states as a tuple of floats, ``outputs`` what the
channels would read. ``x`` and ``u`` are arrays, ``p`` a named tuple of the believed parameters.
Everything else that the engine needs is made from these: an extended Kalman filter whose
derivatives are differences, a predictor with its gains fixed, replay and draws. Named states are
disturbed by first-order coloured noise on their rates (an Ornstein-Uhlenbeck process each), which
the filter estimates beside the states.

The functions are compiled by Numba where it can; if it cannot, they run as they are, slower and
with the same results. Integration is Runge-Kutta of fourth order in substeps; inputs hold between
their times, and are read at the start of each substep.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from tools.diagnosis.model import (
    Cause,
    Channel,
    Filter,
    FloatArray,
    IntArray,
    Noise,
    Parameter,
    Run,
    Values,
    by_differences,
)
from tools.diagnosis.ode_kernels import Kernels, build

Change: TypeAlias = Callable[[dict[str, float], float], None]
"""Changes the believed parameters in place by a cause's number."""


@dataclass(frozen=True, slots=True)
class State:
    """One state: ``start_sd`` of its unknown start, ``rest_sd`` where the run starts at rest.

    ``disturbance_sd`` (per second) and ``correlation_s`` of what disturbs its rate; zero: nothing.
    """

    name: str
    unit: str
    start_sd: float
    rest_sd: float | None = None
    disturbance_sd: float = 0.0
    correlation_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a run was driven with: ``values`` (m, inputs) hold from each of ``time_s`` (m,).

    ``start`` (states,) is a first guess of the states at the first measurement.
    """

    time_s: FloatArray
    values: FloatArray
    start: FloatArray


@dataclass(frozen=True, slots=True)
class OdeCause:
    """A cause and what each of its parameters does to the believed ones."""

    cause: Cause
    changes: tuple[Change, ...]


def added(name: str) -> Change:
    """Return the change that adds the number to the believed parameter ``name``."""

    def change(p: dict[str, float], number: float) -> None:
        p[name] += number

    return change


def scaled(name: str) -> Change:
    """Return the change that multiplies the believed parameter ``name`` by 1 + the number."""

    def change(p: dict[str, float], number: float) -> None:
        p[name] *= 1.0 + number

    return change


def measured(
    name: str,
    time_s: FloatArray,
    readings: FloatArray,
    inputs: Inputs,
    *,
    at_rest: bool = True,
    held_out: bool | None = None,
) -> Run:
    """Return a run from a table: ``readings`` (n, channels), NaN where a channel has none."""
    row, channel = np.nonzero(np.isfinite(readings))
    return Run(
        name,
        time_s[row],
        channel.astype(np.int64),
        readings[row, channel],
        inputs,
        at_rest,
        held_out,
    )


@dataclass(frozen=True)
class OdeModel:
    """A `Model` of ordinary differential equations. See the module, and docs/diagnosis-engine.md.

    ``tolerances`` maps believed parameters to the relative standard deviation expected of them;
    ``substep_s`` is the longest integration step.
    """

    rates: Callable[[float, FloatArray, FloatArray, Any], Any]
    outputs: Callable[[float, FloatArray, FloatArray, Any], Any]
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    believed: Mapping[str, float]
    channels: tuple[Channel, ...]
    rows: tuple[OdeCause, ...]
    tolerated: Mapping[str, float] = field(default_factory=dict)
    substep_s: float = 0.02

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """The table of causes."""
        return tuple(row.cause for row in self.rows)

    @cached_property
    def tolerances(self) -> tuple[Parameter, ...]:
        """Relative deviations of the believed parameters."""
        return tuple(
            Parameter(f"tolerance.{name}", "1", least=-0.9, prior_sd=sd, scale=sd)
            for name, sd in self.tolerated.items()
        )

    @cached_property
    def disturbances(self) -> tuple[str, ...]:
        """The states whose rates are disturbed."""
        return tuple(state.name for state in self.states if state.disturbance_sd > 0.0)

    @cached_property
    def library(self) -> tuple[Parameter, ...]:
        """Rate terms of the disturbed states: a constant, each state x, x|x|, and each input."""
        terms = ["1"]
        terms += [state.name for state in self.states]
        terms += [f"{state.name}·|{state.name}|" for state in self.states]
        terms += list(self.inputs)
        units = {state.name: state.unit for state in self.states}
        return tuple(
            Parameter(f"d({name})/dt: {term}", f"{units[name]}/s", scale=sd)
            for name, sd in (
                (s.name, s.disturbance_sd) for s in self.states if s.name in self.disturbances
            )
            for term in terms
        )

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        """Corrections of the guessed starting states."""
        return tuple(
            Parameter(f"start.{s.name}", s.unit, prior_sd=sd, scale=sd)
            for s in self.states
            if (sd := s.rest_sd if run.at_rest and s.rest_sd is not None else s.start_sd) > 0.0
        )

    def first_noise(self, runs: Sequence[Run]) -> Noise:
        """Return given sigmas, else a spread of second differences; disturbances as configured."""
        sigma = []
        for index, channel in enumerate(self.channels):
            if channel.sigma is not None:
                sigma.append(channel.sigma)
                continue
            steps = [np.diff(run.value[run.channel == index], 2) for run in runs]
            every = np.concatenate(steps) if steps else np.zeros(0)
            spread = (
                float(np.median(np.abs(every))) / 0.6745 / math.sqrt(6.0) if every.size else 0.0
            )
            sigma.append(max(spread, 1e-9))
        disturbed = [state for state in self.states if state.disturbance_sd > 0.0]
        return Noise(
            np.array(sigma),
            np.array([state.disturbance_sd for state in disturbed]),
            np.array([state.correlation_s for state in disturbed]),
        )

    @cached_property
    def _kernels(self) -> Kernels:
        return build(self.rates, self.outputs, len(self.states), self._where)

    @cached_property
    def _where(self) -> IntArray:
        """Index of each disturbed state."""
        names = [state.name for state in self.states]
        return np.array([names.index(name) for name in self.disturbances], dtype=np.int64)

    @cached_property
    def _tuple(self) -> Any:
        return namedtuple("Believed", list(self.believed))

    @cached_property
    def _changes(self) -> dict[str, Change]:
        changes = {
            parameter.name: change
            for row in self.rows
            for parameter, change in zip(row.cause.parameters, row.changes, strict=True)
        }
        return changes | {f"tolerance.{name}": scaled(name) for name in self.tolerated}

    @cached_property
    def _angle(self) -> FloatArray:
        return np.array([1.0 if channel.angle else 0.0 for channel in self.channels])

    def _physics(self, values: Values) -> tuple[Any, FloatArray]:
        """Return the believed parameters as changed, and the library's coefficients."""
        p = {name: float(number) for name, number in self.believed.items()}
        for name, change in self._changes.items():
            number = values.get(name, 0.0)
            if number != 0.0:
                change(p, number)
        coefficients = np.array([values.get(term.name, 0.0) for term in self.library])
        return self._tuple(**p), coefficients.reshape(len(self.disturbances), -1)

    def _start(self, run: Run, values: Values) -> FloatArray:
        return np.array(
            [
                guess + values.get(f"start.{state.name}", 0.0)
                for guess, state in zip(run.inputs.start, self.states, strict=True)
            ]
        )

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        """Design an extended Kalman filter along the run; the start is the nuisances' affair."""
        p, library = self._physics(values)
        gain, variance = self._kernels.design(
            run.time_s,
            run.channel,
            run.value,
            self._angle,
            run.inputs.time_s,
            run.inputs.values,
            self._start(run, values),
            p,
            library,
            noise.sigma,
            noise.disturbance,
            noise.correlation_s,
            self.substep_s,
        )
        # What the filter believed of the disturbance's correlation goes with its gains.
        return OdeFilter(gain, variance, noise.correlation_s)

    def innovations(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        """Predict with fixed gains; return measured minus predicted."""
        assert isinstance(fixed, OdeFilter)
        return self._predict(run, values, fixed.gain, fixed.correlation_s)[0]

    def responses(
        self, _run: Run, _values: Values, _fixed: Filter, terms: Sequence[str], errors: FloatArray
    ) -> FloatArray:
        """Leave them to differences."""
        return by_differences(terms, errors)

    def replay(self, run: Run, values: Values) -> FloatArray:
        """Simulate from the start without looking at the measurements."""
        gain = np.zeros((run.time_s.size, len(self.states) + len(self.disturbances)))
        return self._predict(run, values, gain, np.ones(len(self.disturbances)))[1]

    def _predict(
        self, run: Run, values: Values, gain: FloatArray, correlation_s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        p, library = self._physics(values)
        innovation, predicted, states = self._kernels.predict(
            run.time_s,
            run.channel,
            run.value,
            self._angle,
            run.inputs.time_s,
            run.inputs.values,
            self._start(run, values),
            p,
            library,
            gain,
            correlation_s,
            self.substep_s,
        )
        return innovation, predicted, states

    def signals(self, run: Run, values: Values) -> dict[str, FloatArray]:
        """Return the inputs and the replayed states at the measurements."""
        gain = np.zeros((run.time_s.size, len(self.states) + len(self.disturbances)))
        states = self._predict(run, values, gain, np.ones(len(self.disturbances)))[2]
        row = np.searchsorted(run.inputs.time_s, run.time_s, side="right") - 1
        held = run.inputs.values[np.maximum(row, 0)]
        found = {name: held[:, i] for i, name in enumerate(self.inputs)}
        return found | {state.name: states[:, i] for i, state in enumerate(self.states)}

    def draw(self, run: Run, values: Values, noise: Noise, generator: np.random.Generator) -> Run:
        """Perform the run's programme with disturbance and measurement noise."""
        p, library = self._physics(values)
        gaps = np.diff(run.time_s, prepend=run.time_s[:1])
        steps = int(np.sum(np.maximum(np.ceil(gaps / self.substep_s), 1.0)))
        count = len(self.disturbances)
        first = noise.disturbance * generator.standard_normal(count)
        shocks = generator.standard_normal((steps, count))
        predicted = self._kernels.perform(
            run.time_s,
            run.channel,
            run.inputs.time_s,
            run.inputs.values,
            self._start(run, values),
            p,
            library,
            first,
            shocks,
            noise.disturbance,
            noise.correlation_s,
            self.substep_s,
        )
        value = predicted + noise.sigma[run.channel] * generator.standard_normal(predicted.size)
        wrapped = (value + math.pi) % math.tau - math.pi
        return replace(run, value=np.where(self._angle[run.channel] > 0.0, wrapped, value))


@dataclass(frozen=True, slots=True)
class OdeFilter(Filter):
    """Fixed gains, and the correlation times of the disturbances that the filter estimates."""

    correlation_s: FloatArray
