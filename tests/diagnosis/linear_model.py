"""A linear Gaussian model whose every answer is known in closed form: the oracle of these tests.

Measurements are y = Φ θ + w_c d(t) + noise, with one Ornstein-Uhlenbeck disturbance d. ``inputs``
of a run is a mapping from parameter names to columns of Φ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

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

WEIGHT = np.array([1.0, 0.5])
"""How the disturbance shows in the two channels."""


@dataclass(frozen=True, slots=True)
class Kalman(Filter):
    decay: FloatArray


GUESS = Noise(np.array([0.3, 0.3]), np.array([0.5]), np.array([1.0]))


@dataclass(frozen=True)
class LinearModel:
    causes: tuple[Cause, ...]
    tolerances: tuple[Parameter, ...] = ()
    library: tuple[Parameter, ...] = ()
    start: tuple[Parameter, ...] = ()
    channels: tuple[Channel, ...] = (Channel("one", "m"), Channel("two", "m"))
    guess: Noise = GUESS
    disturbances: tuple[str, ...] = ("d",)

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self.start

    def first_noise(self, runs: Sequence[Run]) -> Noise:
        return self.guess

    def mean(self, run: Run, values: Values) -> FloatArray:
        total = np.zeros(run.time_s.size)
        for name, size in values.items():
            if name in run.inputs:
                total = total + size * run.inputs[name]
        return total

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        gaps = np.diff(run.time_s, prepend=run.time_s[0])
        decay = np.exp(-gaps / noise.correlation_s[0])
        n = run.time_s.size
        gain, variance = np.zeros((n, 1)), np.zeros(n)
        own = noise.disturbance[0] ** 2
        p = own
        for k in range(n):
            p = decay[k] ** 2 * p + own * (1.0 - decay[k] ** 2)
            w = WEIGHT[run.channel[k]]
            variance[k] = w * w * p + noise.sigma[run.channel[k]] ** 2
            gain[k, 0] = p * w / variance[k]
            p *= 1.0 - gain[k, 0] * w
        return Kalman(gain, variance, decay)

    def innovations(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        assert isinstance(fixed, Kalman)
        left = run.value - self.mean(run, values)
        found = np.zeros_like(left)
        d = 0.0
        for k in range(left.size):
            d *= fixed.decay[k]
            found[k] = left[k] - WEIGHT[run.channel[k]] * d
            d += fixed.gain[k, 0] * found[k]
        return found

    def responses(
        self, run: Run, values: Values, fixed: Filter, terms: Sequence[str], errors: FloatArray
    ) -> FloatArray:
        return by_differences(terms, errors)

    def replay(self, run: Run, values: Values) -> FloatArray:
        return self.mean(run, values)

    def signals(self, run: Run, values: Values) -> Mapping[str, FloatArray]:
        return {"time": run.time_s}

    def draw(self, run: Run, values: Values, noise: Noise, generator: np.random.Generator) -> Run:
        covariance = self.covariance(run, noise)
        white = generator.standard_normal(run.time_s.size)
        return replace(run, value=self.mean(run, values) + np.linalg.cholesky(covariance) @ white)

    def covariance(self, run: Run, noise: Noise) -> FloatArray:
        """Return the dense covariance (n, n) of a run's measurements."""
        apart = np.abs(run.time_s[:, None] - run.time_s[None])
        weight = WEIGHT[run.channel]
        own = noise.disturbance[0] ** 2 * np.exp(-apart / noise.correlation_s[0])
        dense: FloatArray = own * np.outer(weight, weight) + np.diag(noise.sigma[run.channel] ** 2)
        return dense


def one(name: str, **more: float) -> Cause:
    """A cause of one parameter."""
    parameter = Parameter(f"{name}.k", "1", **more)
    return Cause(name, f"what {name} does", (parameter,), f"{name} is {{k:.3g}}.")


def empty_runs(
    names: Sequence[str], count: int = 4, samples: int = 150, seed: int = 0
) -> list[Run]:
    """Runs of two interleaved channels with smooth random columns for the given parameters."""
    generator = np.random.default_rng(seed)
    runs = []
    for index in range(count):
        time_s = np.sort(generator.uniform(0.0, 30.0, samples))
        channel = generator.integers(0, 2, samples)
        columns = {}
        for name in names:
            frequency, phase = generator.uniform(0.05, 1.0), generator.uniform(0.0, 6.0)
            sway = np.sin(2.0 * np.pi * frequency * time_s + phase)
            columns[name] = sway * np.where(channel == 0, *generator.uniform(-1.0, 1.0, 2))
        runs.append(Run(f"run{index}", time_s, channel, np.zeros(samples), columns))
    return runs


def drawn(
    model: LinearModel, runs: Sequence[Run], values: Values, noise: Noise, seed: int
) -> list[Run]:
    """Runs with data."""
    generator = np.random.default_rng([seed, 77])
    return [model.draw(run, values, noise, generator) for run in runs]
