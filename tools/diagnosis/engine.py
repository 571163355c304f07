"""The diagnosis: from a model that is believed and measured runs to a verdict with its evidence.

In order: noise and nuisances of the believed model; screening of everything; how large the best
becomes in healthy data; if it is significant, which causes (``selection``); what they gain on runs
that they were not fitted to; whether what is left is noise; and the verdict (``verdict``).
`docs/diagnosis-method.md` has the equations and sources.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.calibration import Calibration, NullLaw, calibrate
from tools.diagnosis.confusability import map_of
from tools.diagnosis.detectable import smallest_detectable
from tools.diagnosis.evidence import neutral, start_problem
from tools.diagnosis.held_out import Comparison, Split, Told, compare, informed, report, split
from tools.diagnosis.model import Model, Progress, Run
from tools.diagnosis.noise import contradicted, doubts
from tools.diagnosis.options import Options
from tools.diagnosis.result import (
    Diagnosis,
    NamedCause,
    Ranked,
    RemainingStructure,
    Report,
    Traces,
    Verdict,
)
from tools.diagnosis.screening import Kind
from tools.diagnosis.selection import (
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
from tools.diagnosis.unexplained import explain, remaining
from tools.diagnosis.verdict import judged, named_causes, unknown_cause
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
    division = split(runs, options.held_out_share)
    problem = start_problem(model, division.open_runs, workers)
    prior = problem.noise
    problem, noise, point = settle(problem, (), neutral(problem), prior, sizes)
    wrong = contradicted(problem, point, prior)
    if wrong:
        problem, noise, point = settle(replace(problem, doubted=wrong), (), point, prior, sizes)
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
    division = informed(division, final, options)
    found = compare(final, division, sizes, options)
    rest = remaining(final, calibration, law, options)
    verdict: Verdict = "nothing_wrong"
    causes: list[NamedCause] = []
    groups: list[list[str]] = []
    notes = [division.note] if division.note else []
    notes += doubts(final.problem)
    if selection is not None:
        verdict, groups = judged(selection, rest, found, options, notes)
    elif rest.shapeless:
        verdict = "unexplained"
        notes.append("What is left is not noise, but no single cause or force of the tables fits.")
    told: Told | None = None
    if verdict == "unexplained":
        progress("Looking for unknown forces", 0.0)
        terms = explain(final, first, division, sizes, options)
        if terms is not None:
            found, told = terms.comparison, terms.told
            causes = [unknown_cause(found, min(law.p_value(top), rest.alarm_p))]
        else:
            notes.append("No cause and no sparse force explains it on held-out runs.")
            rest = remaining(first, calibration, law, options)
            found = compare(first, division, sizes, options)
    elif selection is not None:
        causes = named_causes(selection, found, groups, law)
        if rest.structure_p > options.structure_p:
            rest = replace(rest, found=False, where="")  # too little beside the gain to matter
    told = told or report(found, division, options)
    # where tolerances stood in for what was found, the first screen is of a robot that cannot be
    around = () if selection is None else (selection.final, *selection.bases)
    clock.lap("held out")
    threshold = max(law.statistic(options.alarm_p), options.least_gain)
    summary = Report(
        verdict=verdict,
        causes=causes,
        confusable=groups,
        proposed_experiment=None,
        held_out=told.figures,
        smallest_detectable=_detectable(around or (first,), threshold),
        remaining_structure=RemainingStructure(rest.found, rest.where),
        extended_model=None,
        seed=options.seed,
        notes=notes,
    )
    ranking = _ranking(first, selection, law)
    names, matrix = map_of([each.screen for each in (*around, first)])
    clock.lap("report")
    return Diagnosis(
        summary,
        {p.name: found.after.shared.get(p.name, 0.0) for p in free_of(found.stage.members)},
        found.before,
        found.after,
        found.stage,
        selection,
        law,
        calibration,
        threshold,
        ranking,
        names,
        matrix,
        _traces(found, told, division),
        clock.seconds,
    )


def _traces(found: Comparison, told: Told, division: Split) -> Traces:
    """Return what a page draws of each run."""
    problem = found.stage.problem
    every = range(len(problem.runs))
    return Traces(
        tuple(i in division.held for i in every),
        tuple(problem.residual(i, found.before.values(i)) for i in every),
        tuple(problem.residual(i, found.after.values(i)) for i in every),
        tuple(told.replays[0]),
        tuple(told.replays[1]),
        tuple(told.spread),
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
        causes = each.problem.model.causes
        own = smallest_detectable(each.screen, each.judgement.inflation, threshold, causes)
        found = own | found
    return found
