"""Maximum likelihood of what is random: sensor noise, disturbances and their correlation times.

The innovations e_k with variances S_k of the filter give −2 log L = Σ (log S_k + e_k²/S_k)
(Schweppe 1965). It is minimised over logarithms, with weak log-normal priors around the model's
first guess, by Fisher's method of scoring: with differences of log S and of e for each parameter,

    slope_i = Σ ((1 − e²/S) ∂ᵢlog S + 2 e ∂ᵢe / S),   F_ij = Σ (½ ∂ᵢlog S ∂ⱼlog S + ∂ᵢe ∂ⱼe / S),

so one filter per parameter and iteration suffices, and a few iterations. The differences barely
change along the way, so they are taken anew only after a long step. F⁻¹ is the uncertainty of the
estimates, from which healthy data are drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.evidence import Point, Problem
from tools.diagnosis.model import Filter, FloatArray, IntArray, Noise, Run

PRIOR_SIGMA = 1.5
PRIOR_DISTURBANCE = 1.5
PRIOR_CORRELATION = 0.7
"""Standard deviations of the logarithms around the model's first guess: weak."""
MOST_SIGMA = 20.0
MOST_DISTURBANCE = 8.0
MOST_CORRELATION = 5.0
"""How many times larger or smaller than the first guess they may be. Without a bound, what a wrong
model leaves looks like a disturbance that is as large and as lasting as one likes."""
LEAST_DISTURBANCE = 1.0 / 50.0
"""Still water may be as still as it likes."""
DIFFERENCE = 0.1
"""Size of the steps in the logarithms from which derivatives are taken."""
ENOUGH = 0.5
"""An iteration that gains less in twice the log-likelihood is the last one."""
LONGEST_STEP = 1.0
"""No logarithm moves further in one iteration."""
SHARES = (1.0, 0.4, 0.1)
"""Shares of a step that are tried, one after the other, until one gains."""
DOUBTED = 1.5
"""A given sigma is doubted where the data say another by this factor."""
NEAR = 0.8
"""Differences serve until some logarithm has moved further than this from where they were taken."""


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """The estimate; ``covariance`` of the ``free`` logarithms, in the order of `pack`."""

    noise: Noise
    free: IntArray
    covariance: FloatArray


def pack(noise: Noise) -> FloatArray:
    """Return the logarithms of sigma, disturbances and correlation times, in this order."""
    numbers = np.concatenate([noise.sigma, noise.disturbance, noise.correlation_s])
    packed: FloatArray = np.log(np.maximum(numbers, 1e-300))
    return packed


def unpack(logarithms: FloatArray, like: Noise) -> Noise:
    """Return the noise of these logarithms."""
    channels, count = like.sigma.size, like.disturbance.size
    numbers = np.exp(logarithms)
    return Noise(
        numbers[:channels], numbers[channels : channels + count], numbers[channels + count :]
    )


def _innovations(
    problem: Problem, point: Point, noise: Noise, run: int
) -> tuple[FloatArray, FloatArray]:
    values = point.values(run)
    measured: Run = problem.runs[run]
    fixed: Filter = problem.model.filter(measured, problem.believed(values), noise)
    innovation = problem.model.innovations(measured, values, fixed)
    return np.nan_to_num(innovation, nan=1e6, posinf=1e6, neginf=-1e6), fixed.variance


def minus_twice_log_likelihood(
    innovations: Sequence[tuple[FloatArray, FloatArray]],
) -> float:
    """Return Σ (log S + e²/S), without the constant n log 2π."""
    return float(sum(np.sum(np.log(s) + e * e / s) for e, s in innovations))


def prior_cost(noise: Noise, first: Noise) -> float:
    """Return the squared distance of the logarithms from the model's first guess, in deviations."""
    return float(np.sum(((pack(noise) - pack(first)) / _prior_sd(first)) ** 2))


def _prior_sd(first: Noise) -> FloatArray:
    return np.concatenate(
        [
            np.full(first.sigma.size, PRIOR_SIGMA),
            np.full(first.disturbance.size, PRIOR_DISTURBANCE),
            np.full(first.correlation_s.size, PRIOR_CORRELATION),
        ]
    )


def _bounds(first: Noise) -> tuple[FloatArray, FloatArray]:
    """Return the least and the most that the logarithms may be."""
    shares = (
        (1.0 / MOST_SIGMA, MOST_SIGMA, first.sigma.size),
        (LEAST_DISTURBANCE, MOST_DISTURBANCE, first.disturbance.size),
        (1.0 / MOST_CORRELATION, MOST_CORRELATION, first.correlation_s.size),
    )
    least = np.concatenate([np.full(size, np.log(low)) for low, _, size in shares])
    most = np.concatenate([np.full(size, np.log(high)) for _, high, size in shares])
    return pack(first) + least, pack(first) + most


def _differences(
    here: tuple[FloatArray, FloatArray], moved: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Return ∂log S and ∂e/√S (n, free) of one run, from innovations and variances."""
    e, s = here
    log_s = np.column_stack([np.log(each / s) for _, each in moved]) / DIFFERENCE
    white = np.column_stack([each - e for each, _ in moved]) / (DIFFERENCE * np.sqrt(s)[:, None])
    return log_s, white


def estimate(
    problem: Problem, point: Point, first: Noise, start: Noise, iterations: int = 6
) -> NoiseEstimate:
    """Estimate from ``start``, with priors around ``first``, at fixed values of all parameters.

    A channel's given sigma, if it is not doubted, and a disturbance of zero stay as they are.
    """
    model = problem.model
    prior_sd = _prior_sd(first)
    held = np.concatenate(
        [
            [
                channel.sigma is not None and index not in problem.doubted
                for index, channel in enumerate(model.channels)
            ],
            first.disturbance <= 0.0,
            first.disturbance <= 0.0,
        ]
    )
    present = np.zeros(first.sigma.size, dtype=bool)
    for measured in problem.runs:
        present[np.unique(measured.channel)] = True
    held[: first.sigma.size] |= ~present
    free = np.flatnonzero(~held)
    mean = pack(first)
    least, most = _bounds(first)
    here = np.clip(pack(start), least, most)
    runs = range(len(problem.runs))

    def evaluate(several: Sequence[FloatArray]) -> list[list[tuple[FloatArray, FloatArray]]]:
        tasks = [(logarithms, run) for logarithms in several for run in runs]
        found = problem.workers.map(
            lambda task: _innovations(problem, point, unpack(task[0], first), task[1]), tasks
        )
        return [found[i * len(runs) : (i + 1) * len(runs)] for i in range(len(several))]

    def cost_of(innovations: Sequence[tuple[FloatArray, FloatArray]], at: FloatArray) -> float:
        prior = float(np.sum(((at - mean)[free] / prior_sd[free]) ** 2))
        return minus_twice_log_likelihood(innovations) + prior

    if free.size == 0:
        return NoiseEstimate(unpack(here, first), free, np.zeros((0, 0)))
    current = evaluate([here])[0]
    cost = cost_of(current, here)
    slopes: list[tuple[FloatArray, FloatArray]] = []
    taken = here
    for _ in range(iterations):
        if not slopes or float(np.max(np.abs(here - taken))) > NEAR:
            moved = evaluate([here + DIFFERENCE * np.eye(here.size)[i] for i in free])
            slopes, taken = (
                [_differences(current[run], [m[run] for m in moved]) for run in runs],
                here,
            )
        slope = 2.0 * (here - mean)[free] / prior_sd[free] ** 2
        fisher = np.diag(prior_sd[free] ** -2.0)
        for (e, s), (log_s, white) in zip(current, slopes, strict=True):
            r = e / np.sqrt(s)
            slope += log_s.T @ (1.0 - r * r) + 2.0 * white.T @ r
            fisher += 0.5 * log_s.T @ log_s + white.T @ white
        step = -0.5 * np.linalg.solve(fisher, slope)
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step))), 1e-12))
        promise = -float(slope @ step) * 0.5
        gained = 0.0
        for share in SHARES:
            target = here.copy()
            target[free] += share * step
            target = np.clip(target, least, most)
            tried = evaluate([target])[0]
            tried_cost = cost_of(tried, target)
            if tried_cost < cost:
                gained = cost - tried_cost
                here, current, cost = target, tried, tried_cost
                break
        if gained < ENOUGH or promise < ENOUGH:
            break
    covariance = np.asarray(np.linalg.inv(fisher), dtype=np.float64)
    return NoiseEstimate(unpack(here, first), free.astype(np.int64), covariance)


def contradicted(problem: Problem, point: Point, first: Noise) -> frozenset[int]:
    """Return the channels whose given sigma is far from what their innovations scatter.

    Only beside disturbances: without any, nothing but the given sigma tells noise from error.
    """
    channels = problem.model.channels
    given = frozenset(i for i, channel in enumerate(channels) if channel.sigma is not None)
    if not given or first.disturbance.size == 0:
        return frozenset()
    freed = estimate(replace(problem, doubted=given), point, first, problem.noise)
    return frozenset(i for i in given if _far(float(freed.noise.sigma[i]), channels[i].sigma))


def _far(sigma: float, given: float | None) -> bool:
    return given is not None and not 1.0 / DOUBTED < sigma / given < DOUBTED


def doubts(problem: Problem) -> list[str]:
    """Say which given sigmas the data contradict, by the noise that was estimated in the end."""
    return [
        f"{channel.name}: sigma is given as {channel.sigma:.3g} {channel.unit}, but its noise is "
        f"{problem.noise.sigma[i]:.3g} {channel.unit}, which is used; "
        f"mend [channels.{channel.name}]."
        for i, channel in enumerate(problem.model.channels)
        if i in problem.doubted and _far(float(problem.noise.sigma[i]), channel.sigma)
    ]


def drawn(given: NoiseEstimate, generator: np.random.Generator) -> Noise:
    """Return a noise as uncertain as the estimate is (at most a factor e from it)."""
    if given.free.size == 0:
        return given.noise
    values, vectors = np.linalg.eigh(given.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    step = root @ generator.standard_normal(given.free.size)
    logarithms = pack(given.noise)
    logarithms[given.free] += np.clip(step, -1.0, 1.0)
    return unpack(logarithms, replace(given.noise))
