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
from tools.diagnosis.held_out import Comparison, Split, compare
from tools.diagnosis.model import FloatArray
from tools.diagnosis.options import Options
from tools.diagnosis.screening import Kind, Screen, block_scores
from tools.diagnosis.selection import Selection, Stage, settle, stage, table, without
from tools.diagnosis.sparse import ENTRY, forward
from tools.diagnosis.whiteness import describe, structure_names, structure_statistics

UNKNOWN = "unknown_force"
HALVES = 60
STABLE = 0.6
MOST_TERMS = 3
PAYS = 6.0
"""Gain in twice the log-likelihood on held-out data that makes a description worth having."""


@dataclass(frozen=True, slots=True)
class Remaining:
    """Whether structure is left: best ``gain`` of any further candidate, and its p-value.

    ``structure_p`` is that of whiteness and cross-correlations, for the number of statistics.
    """

    found: bool
    where: str
    gain: float
    p_value: float
    structure_p: float


def remaining(final: Stage, calibration: Calibration, law: NullLaw, options: Options) -> Remaining:
    """Judge what a stage leaves: by all further candidates, and by whiteness and correlations."""
    gain = float(np.max(final.judgement.by_owner, initial=0.0))
    p_value = law.p_value(gain)
    problem = final.problem
    signals = [
        problem.model.signals(run, final.point.values(i)) for i, run in enumerate(problem.runs)
    ]
    names = structure_names(problem, signals)
    statistics = structure_statistics(problem, final.fit.residuals, signals)
    p_values = np.array(
        [
            null_law(calibration.structure[:, k]).p_value(float(statistics[k]))
            for k in range(statistics.size)
        ]
    )
    least = int(np.argmin(p_values))
    structure_p = min(float(p_values[least]) * p_values.size, 1.0)
    limit = options.rest_p if final.members else options.alarm_p
    found = p_value <= limit or structure_p <= options.structure_p
    if not found:
        return Remaining(False, "", gain, p_value, structure_p)
    index = names[least][0]
    channel = [c.name for c in problem.model.channels].index(index)
    where = describe(problem, final.fit.residuals, signals, channel)
    if names[least][1]:
        where += f"; it follows {names[least][1]}"
    if p_value <= limit:
        where += f"; most like {final.ranking()[0]}"
    return Remaining(True, where, gain, p_value, structure_p)


@dataclass(frozen=True, slots=True)
class Terms:
    """An accepted description: the stage with its terms included, and its held-out figures."""

    stage: Stage
    comparison: Comparison


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
    selection: Selection,
    first: Stage,
    division: Split,
    sizes: dict[str, float],
    options: Options,
) -> Terms | None:
    """Return a sparse description of what is unexplained, or None if none pays on held-out data."""
    included = selection.final
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
    found = compare(final, members, division, sizes, options)
    return Terms(final, found) if found.evidence > PAYS else None
