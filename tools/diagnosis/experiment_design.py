"""The experiment that separates explanations which the data at hand cannot tell apart.

Two explanations predict different whitened innovations, Δ apart, on data that the first has made.
What nuisances and the explanations' own uncertain parameters can imitate of it is projected out;
the rest, Δᵀ M Δ, is what twice the log-likelihood ratio will be in the mean (T-optimality, Atkinson
and Fedorov 1975). Segments of a manoeuvre are simulated one by one, and their Gram matrices add up,
so that choosing a programme is small linear algebra: beginning with the best segment, then by
exchange of one segment for another as long as that gains (Fedorov 1972). Of several explanations
the pair that is separated least counts. The chosen programme is simulated once more as a whole: the
separation that is reported is that one's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.evidence import solved
from tools.diagnosis.model import FloatArray, Model, Noise, Run, Values

ENOUGH = 16.5
"""Expected twice log-likelihood ratio λ at which odds of 20 to 1 are reached in nine cases of ten.

The ratio has mean λ and standard deviation 2√λ; λ − 1.28 · 2√λ is 6 there."""
MOST_REPEATS = 5
"""A programme is worth swimming several times, but not more often."""
_STEP_SD = 0.3
"""Sensitivities to nuisances are differences over this share of their standard deviation."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """A model that would explain the data: its values, and standard errors of what was fitted."""

    name: str
    values: Values
    spread: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Choice:
    """A segment on offer: how long it takes, and its Gram matrix; ``first``: only to begin with."""

    duration_s: float
    gram: FloatArray
    first: bool = False


def simulated(model: Model, blank: Run, explanation: Explanation) -> Run:
    """Return the run as an explanation would perform it, without noise."""
    return replace(blank, value=model.replay(blank, explanation.values))


def gram(
    model: Model, blank: Run, noise: Noise, explanations: Sequence[Explanation]
) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrix of one run, and prior precisions of its nuisances.

    Columns: tolerances, then the parameters of every explanation, then the differences of the other
    explanations from the first; all in the whitening of the first.
    """
    first = explanations[0]
    run = simulated(model, blank, first)
    fixed = model.filter(run, first.values, noise)
    scale = np.sqrt(fixed.variance)

    def white(values: Values) -> FloatArray:
        found: FloatArray = model.innovations(run, values, fixed) / scale
        return np.nan_to_num(found)

    base = [white(each.values) for each in explanations]
    columns, precision = [], []

    def slope(
        at: Explanation, start: FloatArray, name: str, sd: float, bounds: tuple[float, float]
    ) -> None:
        here = at.values.get(name, 0.0)
        step = _STEP_SD * sd
        if here + step > bounds[1]:
            step = -step
        columns.append((white({**at.values, name: here + step}) - start) / step)
        precision.append(sd**-2.0)

    for p in model.tolerances:
        slope(first, base[0], p.name, p.prior_sd, (p.least, p.most))
    bounds = {p.name: (p.least, p.most) for c in model.causes for p in c.parameters}
    for each, start in zip(explanations, base, strict=True):
        for name, sd in each.spread.items():
            if math.isfinite(sd) and sd > 0.0:
                slope(each, start, name, sd, bounds.get(name, (-math.inf, math.inf)))
    columns += [other - base[0] for other in base[1:]]
    matrix = np.column_stack(columns)
    return matrix.T @ matrix, np.array(precision)


def separations(total: FloatArray, precision: FloatArray) -> FloatArray:
    """Return Δᵀ M Δ of every pair of explanations, those with the first one first."""
    count = precision.size
    inner = total[:count, :count] + np.diag(precision)
    cross = total[:count, count:]
    left = total[count:, count:] - cross.T @ solved(inner, cross)
    own = np.diag(left)
    others = own.size
    pairs = [float(own[i]) for i in range(others)]
    pairs += [
        float(own[i] + own[k] - 2.0 * left[i, k])
        for i in range(others)
        for k in range(i + 1, others)
    ]
    found: FloatArray = np.maximum(np.array(pairs), 0.0)
    return found


def classes(total: FloatArray, precision: FloatArray, least: float) -> list[list[int]]:
    """Return which explanations are alike: chains of pairs that are separated by less."""
    count = total.shape[0] - precision.size + 1
    pairs = [*((0, i) for i in range(1, count)), *itertools.combinations(range(1, count), 2)]
    kinds = list(range(count))
    for (a, b), apart in zip(pairs, separations(total, precision), strict=True):
        if apart < least:
            kinds = [kinds[a] if kind == kinds[b] else kind for kind in kinds]
    return [[i for i in range(count) if kinds[i] == kind] for kind in dict.fromkeys(kinds)]


def exchange(choices: Sequence[Choice], precision: FloatArray, longest_s: float) -> tuple[int, ...]:
    """Return the segments of the best programme of at most ``longest_s``, in order of their choice.

    Segments that can only come first are first. Ties are settled by the order of the choices.
    """

    def value(picked: Sequence[int]) -> float:
        return float(
            np.min(separations(np.sum([choices[i].gram for i in picked], axis=0), precision))
        )

    def fits(picked: Sequence[int]) -> bool:
        if sum(choices[i].first for i in picked) > 1:
            return False
        return sum(choices[i].duration_s for i in picked) <= longest_s + 1e-9

    picked: list[int] = []
    best = 0.0
    while True:
        moves = [[*picked, i] for i in range(len(choices))]
        for place in range(len(picked)):
            rest = picked[:place] + picked[place + 1 :]
            moves += [[*rest, i] for i in range(len(choices)) if i != picked[place]]
        rated = [(value(move), move) for move in moves if fits(move)]
        if not rated:
            break
        top, move = max(rated, key=lambda item: item[0])
        longer = len(move) > len(picked)
        if top <= best * (1.0 + 1e-6) + 1e-9 and not (longer and not picked):
            break
        picked, best = move, top
    return tuple(sorted(picked, key=lambda i: (not choices[i].first, picked.index(i))))


def repeats(separation: float) -> int:
    """Return how often a programme must be swum to be decisive."""
    return max(1, math.ceil(ENOUGH / max(separation, 1e-9)))
