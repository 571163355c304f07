"""How strongly an effect shows: λ, the expected gain in twice the log-likelihood of knowing it.

The same experiment is swum twice in the same restless water, healthy and with the effect. Both are
predicted by the believed model with gains that were designed once, on the healthy one; the
difference Δ of their whitened innovations is what the effect alone does to them. Instruments
neither round nor are noisy here: a step that is taken a sample earlier, or the noise of a frame
that is shown again, is no information. What nuisances within their tolerances can imitate is taken
out (``tools.diagnosis.evidence``):

    λ = ΔᵀΔ − ΔᵀJ (JᵀJ + P)⁻¹ JᵀΔ

with J the sensitivities to the nuisances and P their priors' precisions. Where the nuisances follow
farther than J is straight, λ is the least of ‖Δ(η)‖² + ηᵀPη, found in a few steps with that J.

A size with a wanted λ is found by secants on logarithms: λ goes with nearly the square of the size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from plant.errors import DivergedError
from plant.robots import wang2014
from tools.diagnosis.calibration import chord
from tools.diagnosis.evidence import (
    Nuisances,
    Problem,
    cosines,
    neutral,
    nuisances,
    project,
    sums_of_squares,
)
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray, Noise, Run, Values
from tools.diagnosis.workers import Workers
from tools.practice.experiment import (
    DURATION_S,
    RUNS,
    Effect,
    laboratory,
    plan,
    shape_of,
    swim_experiment,
    water,
)
from tools.practice.hidden import HIDDEN
from tools.practice.instruments import (
    CENTROID_STEP_M,
    COMPASS_NOISE_RAD,
    COMPASS_STEP_RAD,
    GYRO_NOISE_RAD_S,
    GYRO_STEP_RAD_S,
    LED_BASELINE_M,
    LED_NOISE_M,
)
from tools.records.data import Series

CHANNELS = ("x_m", "y_m", "heading_rad", "gyro_z_rad_s", "compass_rad")
EVALUATIONS = 12
"""No more sizes are tried; four do, but where an effect sets in at a threshold."""
FOLLOWED = 3
"""Steps in which the nuisances follow an effect."""
NEAR = 0.10
"""A size is good enough whose λ is within this share of what is wanted."""
_LEAST_SHARE = 1e-3  # of `first`, below which no size is tried
_ENOUGH = 0.01
_FAR = 30.0  # λ this far off tells nothing of the size but its side
_FASTEST = 8.0  # no step is larger than this factor


@dataclass(frozen=True, slots=True)
class Whitening:
    """The healthy experiment of a seed: its whitening, residuals and nuisances.

    ``inverse``: (JᵀJ + P)⁻¹.
    """

    problem: Problem
    residuals: tuple[FloatArray, ...]
    given: Nuisances
    inverse: FloatArray


def measured_runs(
    seed: int, swum: Mapping[str, Mapping[str, Series]], duration_s: float = DURATION_S
) -> tuple[Run, ...]:
    """Return what was swum as runs of the model, with the commands as they were recorded."""
    runs = []
    for number, (name, samples) in enumerate(swum.items()):
        present = [(index, samples[c]) for index, c in enumerate(CHANNELS)]
        time_s = np.concatenate([series.time_s for _, series in present])
        value = np.concatenate([series.value for _, series in present])
        channel = np.concatenate(
            [np.full(series.time_s.size, index, dtype=np.int64) for index, series in present]
        )
        order = np.argsort(time_s, kind="stable")
        programme = plan(seed, number, duration_s).programme
        starts = tuple(float(t) for t in samples["tail_bias_rad"].time_s)
        told = replace(programme, starts_s=starts)
        runs.append(Run(name, time_s[order], channel[order], value[order], FishInputs(told)))
    return tuple(runs)


@lru_cache(maxsize=4)
def whitening(seed: int, runs: int = RUNS, duration_s: float = DURATION_S) -> Whitening:
    """Return the whitening of a seed's healthy experiment, with the noise that it truly has."""
    model = FishModel(wang2014(), CHANNELS)
    swum = swim_experiment(seed, (), runs, duration_s, exact=True)
    healthy = measured_runs(seed, swum, duration_s)
    starts = tuple(() for _ in healthy)
    bare = Problem(model, healthy, starts, true_noise(seed), (), Workers(1), {}, ())
    point = neutral(bare)
    problem = bare.with_noise(bare.noise, point)
    residuals = tuple(problem.residuals(point))
    given = nuisances(problem, point, residuals, {})
    return Whitening(problem, residuals, given, chord(given, point).inverse)


def true_noise(seed: int) -> Noise:
    """Return what is random in an experiment, in the terms of the model.

    Rounding adds the variance of a step/12 (Bennett 1948). The two equal lags behind the
    disturbances have the integral of the autocorrelation of one lag of twice their time constant.
    """
    restless, body = water(seed), laboratory(seed).parameters.body
    led_m = math.hypot(LED_NOISE_M, CENTROID_STEP_M / math.sqrt(12.0))
    sigma = (
        led_m / math.sqrt(2.0),
        led_m / math.sqrt(2.0),
        led_m * math.sqrt(2.0) / LED_BASELINE_M,
        math.hypot(GYRO_NOISE_RAD_S, GYRO_STEP_RAD_S / math.sqrt(12.0)),
        math.hypot(COMPASS_NOISE_RAD, COMPASS_STEP_RAD / math.sqrt(12.0)),
    )
    disturbance = (
        restless.force_n / (body.mass_kg + body.added_mass_surge_kg),
        restless.force_n / (body.mass_kg + body.added_mass_sway_kg),
        restless.moment_n_m / (body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2),
    )
    return Noise(np.array(sigma), np.array(disturbance), np.full(3, 2.0 * restless.correlation_s))


def strength(
    seed: int, effects: Sequence[Effect], runs: int = RUNS, duration_s: float = DURATION_S
) -> float:
    """Return λ of effects in the experiment of a seed; infinite where nothing can swim so."""
    healthy = whitening(seed, runs, duration_s)
    try:
        swum = swim_experiment(seed, tuple(effects), runs, duration_s, exact=True)
    except DivergedError:
        return math.inf
    other = replace(healthy.problem, runs=measured_runs(seed, swum, duration_s))
    names = [parameter.name for parameter in healthy.given.shared]
    precision = healthy.given.shared_precision
    nuisance, least = np.zeros(len(names)), math.inf
    for _ in range(FOLLOWED + 1):
        point = neutral(other).moved(dict(zip(names, nuisance.tolist(), strict=True)))
        changes = [
            changed - before
            for changed, before in zip(other.residuals(point), healthy.residuals, strict=True)
        ]
        cost = sums_of_squares(changes) + float(nuisance @ (precision * nuisance))
        if not cost < least * (1.0 - _ENOUGH):
            break
        least = cost
        slope = precision * nuisance
        for given, change in zip(healthy.given.columns, changes, strict=True):
            slope = slope + given.T @ change
        nuisance = nuisance - healthy.inverse @ slope
    return least


def sized(
    seed: int, name: str, wanted: float, runs: int = RUNS, duration_s: float = DURATION_S
) -> tuple[float, float]:
    """Return the size with which an effect has a strength in a seed's experiment, and what it has.

    The size is no larger than the largest credible one, where the strength may stay below.
    """
    row, shape = HIDDEN[name], shape_of(name, seed)
    tried: dict[float, float] = {}
    size = row.first
    for _ in range(EVALUATIONS):
        reached = strength(seed, [Effect(name, size, shape)], runs, duration_s)
        tried[size] = reached
        if abs(reached - wanted) <= NEAR * wanted or (size >= row.most and reached < wanted):
            break
        size = _next(tried, wanted, row.first * _LEAST_SHARE, row.most)
        if size in tried:
            break
    best = min(tried, key=lambda s: abs(math.log(max(tried[s], 1e-9) / wanted)))
    return best, tried[best]


def _next(tried: Mapping[float, float], wanted: float, least: float, most: float) -> float:
    """Return the next size: within the bracket where there is one, by a secant on logarithms."""
    below = [s for s, x in tried.items() if x < wanted]
    above = [s for s, x in tried.items() if x >= wanted]
    if below and above:
        a, b = max(below), min(above)
        low, high = max(tried[a], 1e-9), tried[b]
        if b <= a or low < wanted / _FAR or high > wanted * _FAR:
            return math.sqrt(a * b)
        share = math.log(wanted / low) / math.log(high / low)
        return float(a * (b / a) ** min(max(share, 0.1), 0.9))
    here = max(below) if below else min(above)
    reached = tried[here]
    others = [s for s in tried if s != here and 0.0 < tried[s] < math.inf]
    slope = 2.0
    if others and 0.0 < reached < math.inf:
        near = min(others, key=lambda s: abs(math.log(s / here)))
        slope = math.log(tried[near] / reached) / math.log(near / here)
        slope = min(max(slope, 0.7), 6.0)
    if not 0.0 < reached < math.inf:
        factor = 3.0 if reached == 0.0 else 1.0 / 3.0
    else:
        factor = (wanted / reached) ** (1.0 / slope)
    return min(max(here * min(max(factor, 1.0 / _FASTEST), _FASTEST), least), most)


def likeness(
    seed: int,
    effects: Sequence[Effect],
    values: Values,
    runs: int = RUNS,
    duration_s: float = DURATION_S,
) -> float:
    """Return the |cosine| between what effects do and what values of the model undo.

    After the nuisances are taken out of both; one is a perfect disguise.
    """
    healthy = whitening(seed, runs, duration_s)
    swum = swim_experiment(seed, tuple(effects), runs, duration_s, exact=True)
    other = replace(healthy.problem, runs=measured_runs(seed, swum, duration_s))
    here, told = neutral(other), neutral(other).moved(values)
    pairs = [
        np.column_stack((done - before, undone - done))
        for done, undone, before in zip(
            other.residuals(here), other.residuals(told), healthy.residuals, strict=True
        )
    ]
    return float(abs(cosines(project(healthy.given, pairs).information)[0, 1]))
