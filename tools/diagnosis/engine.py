"""The diagnosis: from a model that is believed and measured runs to a verdict with its evidence.

In order: noise and nuisances of the believed model; screening of everything; how large the best
becomes in healthy data; if it is significant, which causes (``selection``); what they gain on runs
that no fit saw; whether what is left is noise; and the verdict. `docs/diagnosis-method.md` has the
equations and sources.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.calibration import Calibration, NullLaw, calibrate
from tools.diagnosis.confusability import cosine, map_of
from tools.diagnosis.detectable import smallest_detectable
from tools.diagnosis.evidence import neutral, start_problem
from tools.diagnosis.held_out import Comparison, Split, compare, informed, report, split
from tools.diagnosis.model import Cause, FloatArray, Model, Progress, Run
from tools.diagnosis.options import Options
from tools.diagnosis.result import (
    Diagnosis,
    Estimate,
    NamedCause,
    Ranked,
    RemainingStructure,
    Report,
    Traces,
    Verdict,
)
from tools.diagnosis.screening import Kind
from tools.diagnosis.selection import (
    Alternative,
    Selection,
    Stage,
    clear,
    free_of,
    likelihood_gain,
    second_look,
    select,
    settle,
    stage,
    strained,
)
from tools.diagnosis.unexplained import UNKNOWN, Remaining, explain, remaining
from tools.diagnosis.workers import Workers


def quiet(_what: str, _share: float) -> None:
    """Report progress to nobody."""


def diagnose(
    model: Model,
    runs: Sequence[Run],
    options: Options | None = None,
    progress: Progress = quiet,
) -> Diagnosis:
    """Diagnose measured runs against a model that is believed; see the module.

    Raises:
        ValueError: There is no run, or one without a measurement.

    """
    if not runs or any(run.time_s.size == 0 for run in runs):
        raise ValueError("a diagnosis needs at least one run, and measurements in each")
    chosen = options or Options()
    with Workers(chosen.workers) as workers:
        return _diagnose(model, runs, chosen, progress, workers)


@dataclass(slots=True)
class _Clock:
    """Wall time of the parts of a diagnosis."""

    seconds: dict[str, float]
    last: float

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now


def _diagnose(
    model: Model, runs: Sequence[Run], options: Options, progress: Progress, workers: Workers
) -> Diagnosis:
    clock = _Clock({}, time.perf_counter())
    sizes: dict[str, float] = {}
    progress("Estimating noise", 0.0)
    problem = start_problem(model, runs, workers)
    prior = problem.noise
    problem, noise, point = settle(problem, (), neutral(problem), prior, sizes)
    clock.lap("noise")
    progress("Screening causes", 0.0)
    first = clear(stage(problem, noise, (), point, sizes, options), prior, sizes, options)
    clock.lap("screening")

    def calibrated(at: Stage) -> Calibration:
        return calibrate(
            at.problem,
            at.point,
            at.given,
            at.screen,
            at.noise,
            options.draws,
            options.seed,
            progress,
            options.cache,
        )

    calibration = calibrated(first)
    clock.lap("calibration")
    law = calibration.best_of()
    top = float(np.max(first.judgement.by_owner, initial=0.0))
    selection: Selection | None = None
    threshold = max(law.statistic(options.alarm_p), options.least_gain)
    if strained(first):
        threshold = options.least_gain  # the law is that of a robot that cannot be
    if top < threshold:
        progress("Looking again", 0.0)
        top = max(top, second_look(first, sizes, options))
    if top >= threshold:
        selection = select(first, prior, sizes, options, calibration, calibrated, progress)
        calibration = selection.calibration
        law = calibration.best_of()
    clock.lap("selection")
    final = first if selection is None else selection.final
    progress("Judging held-out runs", 0.0)
    division = informed(split(runs, options.held_out_share), final, options)
    found = compare(final, final.members, division, sizes, options)
    clock.lap("held out")
    return _conclude(
        final, first, selection, found, division, calibration, law, options, sizes, clock, progress
    )


def _conclude(
    final: Stage,
    first: Stage,
    selection: Selection | None,
    found: Comparison,
    division: Split,
    calibration: Calibration,
    law: NullLaw,
    options: Options,
    sizes: dict[str, float],
    clock: _Clock,
    progress: Progress,
) -> Diagnosis:
    notes = [division.note] if division.note else []
    problem = final.problem
    rest = remaining(final, calibration, law, options)
    verdict: Verdict = "nothing_wrong"
    causes: list[NamedCause] = []
    groups: list[list[str]] = []
    members = final.members
    if selection is not None:
        verdict, groups = _verdict(selection, rest, found, options, notes)
    elif rest.shapeless:
        verdict = "unexplained"
        notes.append("What is left is not noise, but no single cause or force of the tables fits.")
    if verdict == "unexplained":
        progress("Looking for unknown forces", 0.0)
        terms = explain(final, first, division, sizes, options)
        if terms is not None:
            final, found, members = terms.stage, terms.comparison, terms.stage.members
            causes = [_unknown(final, found, law)]
        else:
            notes.append("No cause and no sparse force explains it on held-out runs.")
            final, members = first, ()
            rest = remaining(first, calibration, law, options)
            found = compare(final, members, division, sizes, options)
        problem = final.problem
    elif selection is not None:
        causes = _causes(selection, found, groups, law)
        if rest.structure_p > options.structure_p:
            rest = replace(rest, found=False, where="")  # too little beside the gain to matter
    figures, replay, spread = report(final, members, found, division, final.problem.noise, options)
    clock.lap("held out")
    stages = (first,) if selection is None else (selection.final, *selection.bases)
    threshold = max(law.statistic(options.alarm_p), options.least_gain)
    names, matrix = map_of(first.screen)
    before = [problem.residual(i, found.before.values(i)) for i in range(len(problem.runs))]
    after = [problem.residual(i, found.after.values(i)) for i in range(len(problem.runs))]
    values = {p.name: found.after.shared.get(p.name, 0.0) for p in free_of(members)}
    summary = Report(
        verdict=verdict,
        causes=causes,
        confusable=groups,
        proposed_experiment=None,
        held_out=figures,
        smallest_detectable=_detectable(stages, threshold),
        remaining_structure=RemainingStructure(rest.found, rest.where),
        extended_model=None,
        seed=options.seed,
        notes=notes,
    )
    clock.lap("report")
    held = tuple(i in division.held for i in range(len(problem.runs)))
    traces = Traces(
        held, tuple(before), tuple(after), tuple(replay[0]), tuple(replay[1]), tuple(spread)
    )
    return Diagnosis(
        summary,
        problem,
        values,
        found.before,
        found.after,
        final,
        selection,
        law,
        calibration,
        threshold,
        _ranking(first, selection, law),
        names,
        matrix,
        traces,
        clock.seconds,
    )


def _ranking(first: Stage, selection: Selection | None, law: NullLaw) -> tuple[Ranked, ...]:
    """Return all candidates, best first: by their refits, or by the first screening."""
    gains: dict[str, float] = {}
    kinds: dict[str, Kind] = {}
    stages: tuple[Stage, ...] = (first,)
    if selection is not None:
        for base, rivals in zip(selection.bases, selection.rivals, strict=True):
            for rival in rivals:
                gains.setdefault(rival.names[-1], likelihood_gain(rival, base))
        stages = (*selection.bases, first)
    for base in stages:
        for name, kind in zip(base.screen.owners, base.screen.kinds, strict=True):
            kinds.setdefault(name, kind)
            gains.setdefault(name, base.gain(name))
    lines = [Ranked(name, kinds[name].value, x, law.p_value(x)) for name, x in gains.items()]
    return tuple(sorted(lines, key=lambda line: -line.gain))


def _detectable(stages: Sequence[Stage], threshold: float) -> dict[str, float | None]:
    """Return the smallest detectable size of every cause: by the first stage that screens it."""
    found: dict[str, float | None] = {}
    for each in stages:
        found = smallest_detectable(each.screen, threshold) | found
    return found


def _verdict(
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
    if found.evidence <= min(0.0, found.change - 3.0 * found.deviation):
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


def _causes(
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


def _unknown(final: Stage, found: Comparison, law: NullLaw) -> NamedCause:
    """Return the cause that has no name, with the coefficients of its terms."""
    deviations = np.sqrt(np.diag(found.training.covariance))
    parameters = {
        p.name.removeprefix(f"{UNKNOWN}."): Estimate(
            float(found.after.shared.get(p.name, 0.0)), float(sd), p.unit
        )
        for p, sd in zip(free_of(final.members), deviations, strict=True)
    }
    kinds = {member.kind for member in final.members}
    what = "A force" if kinds == {Kind.FORCE} else "Something"
    listed = ", ".join(f"{name} ({e.estimate:.3g} {e.unit})" for name, e in parameters.items())
    statement = f"{what} that no cause of the table explains follows {listed}."
    return NamedCause(UNKNOWN, parameters, law.p_value(found.evidence), statement)
