"""The verdict: what is said of a selection, and the causes with their numbers.

A name is given where the causes are members of the table, gain enough, leave little, and do
not predict held-out runs worse. A wrong name is worse than none.

Standard errors come from slopes at the estimate. Where the likelihood goes in steps (a camera that
repeats whole frames) there are none; then the error is what puts the estimate as far from nothing
as the likelihood does, |θ| / √(gain): the signed root of the deviance (Bates and Watts 1988).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tools.diagnosis.calibration import NullLaw
from tools.diagnosis.confusability import cosine
from tools.diagnosis.held_out import Comparison
from tools.diagnosis.model import Cause, FloatArray
from tools.diagnosis.options import Options
from tools.diagnosis.result import Estimate, NamedCause, Verdict
from tools.diagnosis.screening import Kind
from tools.diagnosis.selection import Alternative, Selection, Stage, free_of, likelihood_gain
from tools.diagnosis.unexplained import UNKNOWN, Remaining

CONTRADICTED = 2.0
"""Held-out evidence below zero and so many deviations below its mean contradicts an extension."""
STEPPED = 0.5
"""An error by slopes is not believed where this share of it is more than the likelihood allows."""


def judged(
    selection: Selection,
    rest: Remaining,
    found: Comparison,
    options: Options,
    notes: list[str],
) -> tuple[Verdict, list[list[str]]]:
    """Return the verdict, and the groups of causes that are alike."""
    final = selection.final
    total = selection.bases[0].fit.objective - final.fit.objective
    if any(member.kind is not Kind.CAUSE for member in final.members):
        return "unexplained", []
    if min(selection.gains()) < options.least_more:
        notes.append("The best named causes gain too little beside the noise that is left.")
        return "unexplained", []
    if rest.found and rest.gain > options.rest_share * total:
        notes.append("The best named causes leave too much unexplained to be believed.")
        return "unexplained", []
    if found.evidence <= min(0.0, found.change - CONTRADICTED * found.deviation):
        notes.append("The best named causes do not predict the held-out runs any better.")
        return "unexplained", []
    groups = []
    for member, base, rivals in zip(final.members, selection.bases, selection.rivals, strict=True):
        alike = _alike(base, rivals, options)
        if len(alike) > 1:
            names = [rival.names[-1] for rival in alike]
            groups.append(sorted(names, key=lambda name: name != member.cause.name))
    return ("ambiguous" if groups else "named"), groups


def _alike(base: Stage, rivals: Sequence[Alternative], options: Options) -> list[Alternative]:
    """Return the sets of named causes that cannot be told from the best."""
    best, *others = [r for r in rivals if r.members[-1].kind is Kind.CAUSE]
    found = [best]
    for rival in others:
        behind = best.evidence - rival.evidence
        alike = cosine(base.screen, best.names[-1], rival.names[-1]) >= options.alike
        if behind <= (options.alike_margin if alike else options.margin):
            found.append(rival)
    return found


def named_causes(
    selection: Selection, found: Comparison, groups: Sequence[Sequence[str]], law: NullLaw
) -> list[NamedCause]:
    """Return members with their training estimates, then those that cannot be told from them."""
    causes = []
    final = selection.final
    offset = 0
    every = {name for group in groups for name in group}
    done = set()
    for index, (member, base) in enumerate(zip(final.members, selection.bases, strict=True)):
        width = len(member.cause.parameters)
        own_part = found.training.covariance[offset : offset + width, offset : offset + width]
        offset += width
        numbers = [found.after.shared.get(p.name, 0.0) for p in member.cause.parameters]
        causes.append(_named(selection.own(index), base, numbers, own_part, law))
        done.add(member.cause.name)
    for base, rivals in zip(selection.bases, selection.rivals, strict=True):
        for rival in rivals:
            cause = rival.members[-1].cause
            if cause.name not in every or cause.name in done:
                continue
            done.add(cause.name)
            width = len(cause.parameters)
            covariance = rival.fit.covariance[-width:, -width:]
            numbers = [rival.fit.point.shared.get(p.name, 0.0) for p in cause.parameters]
            causes.append(_named(rival, base, numbers, covariance, law))
    return causes


def _named(
    own: Alternative,
    base: Stage,
    numbers: Sequence[float],
    covariance: FloatArray,
    law: NullLaw,
) -> NamedCause:
    cause = own.members[-1].cause
    p_value = law.p_value(likelihood_gain(own, base))
    shown = [float(x) for x in cause.report(numbers)]
    spread = _shown_deviations(cause, numbers, covariance)
    if len(shown) == 1:
        by_gain = abs(shown[0]) / np.sqrt(max(base.fit.objective - own.fit.objective, 1.0))
        if not 0.0 < STEPPED * spread[0] <= by_gain:
            spread = [float(by_gain)]
    names = [p.name.removeprefix(f"{cause.name}.") for p in cause.reported]
    parameters = {
        name: Estimate(x, sd, p.unit)
        for name, p, x, sd in zip(names, cause.reported, shown, spread, strict=True)
    }
    statement = cause.statement.format(**dict(zip(names, shown, strict=True)))
    return NamedCause(cause.name, parameters, p_value, statement)


def _shown_deviations(
    cause: Cause, numbers: Sequence[float], covariance: FloatArray
) -> list[float]:
    """Return standard errors of what is reported, by differences (the delta method)."""
    base = np.array(cause.report(numbers))
    slopes = np.zeros((base.size, len(numbers)))
    for i in range(len(numbers)):
        step = 0.1 * float(np.sqrt(covariance[i, i]))
        if step > 0.0:
            moved = [x + step * (k == i) for k, x in enumerate(numbers)]
            slopes[:, i] = (np.array(cause.report(moved)) - base) / step
    return [float(x) for x in np.sqrt(np.diag(slopes @ covariance @ slopes.T))]


def unknown_cause(found: Comparison, p_value: float) -> NamedCause:
    """Return the cause that has no name, with the coefficients of its terms.

    ``p_value``: how often healthy data alarm as much.
    """
    deviations = np.sqrt(np.diag(found.training.covariance))
    parameters = {
        p.name.removeprefix(f"{UNKNOWN}."): Estimate(
            float(found.after.shared.get(p.name, 0.0)), float(sd), p.unit
        )
        for p, sd in zip(free_of(found.stage.members), deviations, strict=True)
    }
    kinds = {member.kind for member in found.stage.members}
    what = "A force" if kinds == {Kind.FORCE} else "Something"
    listed = ", ".join(f"{name} ({e.estimate:.3g} {e.unit})" for name, e in parameters.items())
    statement = f"{what} that no cause of the table explains follows {listed}."
    return NamedCause(UNKNOWN, parameters, p_value, statement)
