"""What no cause explains: where it stands, and a sparse description if one pays.

Terms come from the model's library of forces and from errors of any sensor. They enter one by one
by their gain (orthogonal least squares, Chen, Billings and Luo 1989), and are kept if they enter in
most of many random halves of the time blocks too (stability selection, Meinshausen and Bühlmann
2010). The description is accepted only if it predicts held-out runs better than the believed model.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tools.diagnosis.calibration import Calibration, NullLaw, null_law
from tools.diagnosis.held_out import Comparison, Split, Told, compare, report
from tools.diagnosis.judging import block_scores
from tools.diagnosis.model import FloatArray
from tools.diagnosis.options import Options
from tools.diagnosis.screening import Kind, Screen
from tools.diagnosis.selection import Stage, settle, stage, strained, table, without
from tools.diagnosis.sparse import ENTRY, forward
from tools.diagnosis.whiteness import (
    Statistic,
    describe,
    structure,
    structure_statistics,
    tone,
)

UNKNOWN = "unknown_force"
HALVES = 60
STABLE = 0.6
MOST_TERMS = 3
PAYS = 6.0
"""Gain in twice the log-likelihood on held-out data that makes a description worth having."""
LEAST_SHARE = 0.2
"""What removes less of the held-out error above noise describes nothing."""
FARTHER = 1.5
"""Replayed from the start, no channel of the held-out runs may be off by so much more."""


@dataclass(frozen=True, slots=True)
class Remaining:
    """Whether structure is left: best ``gain`` of any further candidate, and its p-value.

    ``structure_p`` is that of whiteness and cross-correlations, for the number of statistics.
    ``shapeless``: these, families of unnamed terms, or tolerances that had to be stretched say so,
    whatever single candidates do. ``alarm_p``: how often healthy data look as odd in any of this.
    """

    found: bool
    where: str
    gain: float
    p_value: float
    structure_p: float
    shapeless: bool
    alarm_p: float


def remaining(final: Stage, calibration: Calibration, law: NullLaw, options: Options) -> Remaining:
    """Judge what a stage leaves: by all further candidates, whiteness, correlations, and families.

    Families count only where nothing is included: beside a cause they hold its small errors.
    """
    gain = float(np.max(final.judgement.by_owner, initial=0.0))
    p_value = law.p_value(gain)
    problem = final.problem
    signals = [
        problem.model.signals(run, final.point.values(i)) for i, run in enumerate(problem.runs)
    ]
    asked = structure(problem, signals)
    statistics = structure_statistics(problem, final.fit.residuals, signals)
    tones = [each.kind == "tone" for each in asked]  # the tail of a maximum is known
    p_values = _p_values(calibration.structure, statistics, tones)
    least = int(np.argmin(p_values))
    structure_p = min(float(p_values[least]) * p_values.size, 1.0)
    families = final.judgement.families
    of_families = _p_values(calibration.families, families, [False] * families.size)
    top = int(np.argmin(of_families)) if of_families.size else 0
    family_p = 1.0
    if of_families.size and not final.members:
        family_p = min(float(of_families[top]) * of_families.size, 1.0)
    limit = options.rest_p if final.members else options.alarm_p
    together = family_p <= options.family_p
    strain = strained(final)
    alarm_p = min(p_value, structure_p, family_p)
    shapeless = structure_p <= options.structure_p or together or bool(strain)
    if p_value > limit and not shapeless:
        return Remaining(False, "", gain, p_value, structure_p, shapeless, alarm_p)
    most = asked[least]
    where = [describe(problem, final.fit.residuals, signals, most.channels[0])]
    if structure_p <= options.structure_p:
        where += _followed(final, most)
    if p_value <= limit:
        where.append(f"most like {final.ranking()[0]}")
    elif together:
        where.append(f"like a sum of terms of {final.screen.families[top].owner}")
    if strain:
        where.append(_stretched(final, strain))
    return Remaining(True, "; ".join(where), gain, p_value, structure_p, shapeless, alarm_p)


def _followed(final: Stage, most: Statistic) -> list[str]:
    """Return what the innovations of some channels follow, if it has a name."""
    if most.kind == "tone":
        named = " and ".join(final.problem.model.channels[index].name for index in most.channels)
        hertz = tone(final.problem, final.fit.residuals, most.channels)[1]
        return [f"there is a tone of {hertz:.2g} Hz in {named}"]
    return [f"it follows {most.signal}"] if most.signal else []


def _stretched(final: Stage, name: str) -> str:
    """Return how far a tolerance is out."""
    size = final.point.shared[name]
    sd = next(p.prior_sd for p in final.fit.nuisances.shared if p.name == name)
    return f"the fit stretches {name} to {size:.3g}, {abs(size) / sd:.1f} times what is usual"


def _p_values(draws: FloatArray, statistics: FloatArray, known: Sequence[bool]) -> FloatArray:
    laws = [null_law(column, known=tail) for column, tail in zip(draws.T, known, strict=True)]
    pairs = zip(laws, statistics.tolist(), strict=True)
    return np.array([law.p_value(x) for law, x in pairs])


@dataclass(frozen=True, slots=True)
class Terms:
    """An accepted description: the stage with its terms included, and what it is worth."""

    stage: Stage
    comparison: Comparison
    told: Told


def stable_terms(
    screen: Screen, residuals: Sequence[FloatArray], generator: np.random.Generator
) -> list[str]:
    """Return the unnamed terms that enter, and do so in most random halves of the blocks."""
    mine = [i for i, s in enumerate(screen.secants) if s.kind is not Kind.CAUSE]
    visible = {c.columns[0] for c in screen.candidates if len(c.columns) == 1}
    mine = [i for i in mine if i in visible]
    if not mine:
        return []
    scores = block_scores(screen, residuals)[:, mine]
    grams = []
    for cleaned, rows in zip(screen.projection.columns, screen.first_rows, strict=True):
        edges = [*(int(r) for r in rows), cleaned.shape[0]]
        for a, b in itertools.pairwise(edges):
            part = cleaned[a:b, mine]
            grams.append(part.T @ part)
    gram = np.array(grams)
    entered = forward(gram.sum(axis=0), scores.sum(axis=0), MOST_TERMS, ENTRY)
    if not entered:
        return []
    counts = np.zeros(len(mine))
    blocks = gram.shape[0]
    for _ in range(HALVES):
        half = generator.permutation(blocks)[: max(blocks // 2, 1)]
        again = forward(
            gram[half].sum(axis=0), scores[half].sum(axis=0), MOST_TERMS + 1, 0.25 * ENTRY
        )
        counts[again] += 1.0
    kept = [i for i in entered if counts[i] >= STABLE * HALVES] or entered[:1]
    return [screen.secants[mine[i]].owner for i in kept]


def explain(
    included: Stage,
    first: Stage,
    division: Split,
    sizes: dict[str, float],
    options: Options,
) -> Terms | None:
    """Return a sparse description of what is unexplained, or None if none pays on held-out data."""
    base = included
    if included.members:
        start = without(included.point, included.members)
        base = stage(included.problem, included.noise, (), start, sizes, options)
    generator = np.random.default_rng([options.seed, 0x57AB])
    names = stable_terms(base.screen, base.fit.residuals, generator)
    if not names:
        return None
    rows = table(base.problem)
    members = [rows[name] for name in names]
    problem, noise, point = settle(base.problem, members, base.point, first.problem.noise, sizes)
    final = stage(problem, noise, members, point, sizes, options)
    found = compare(final, division, sizes, options)
    told = report(found, division, options)
    return Terms(final, found, told) if found.evidence > PAYS and _swims(told) else None


def _swims(told: Told) -> bool:
    """Whether a description describes: it removes enough, and a simulation with it stays near."""
    before, after = told.figures.rmse_before, told.figures.rmse_after
    near = all(after[name] <= FARTHER * before[name] for name in before)
    finite = all(np.all(np.isfinite(replay)) for replay in told.replays[1])
    return told.figures.gain >= LEAST_SHARE and near and finite
