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
from tools.diagnosis.unexplained import Remaining, explain, remaining
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
    division = split(runs, options.held_out_share)
    choice = _choose(model, division.open_runs, sizes, options, progress, workers, clock)
    progress("Judging held-out runs", 0.0)
    division = informed(division, choice.final, options)
    end = _judge(choice, division, sizes, options, progress)
    found, law, rest = end.found, choice.law, end.rest
    clock.lap("held out")
    threshold = max(law.statistic(options.alarm_p), options.least_gain)
    # where tolerances stood in for what was found, the first screen is of a robot that cannot be
    selection = choice.selection
    around = () if selection is None else (selection.final, *selection.bases)
    summary = Report(
        verdict=end.verdict,
        causes=end.causes,
        confusable=end.groups,
        proposed_experiment=None,
        held_out=end.told.figures,
        smallest_detectable=_detectable(around or (choice.first,), threshold),
        remaining_structure=RemainingStructure(rest.found, rest.where),
        extended_model=None,
        seed=options.seed,
        notes=end.notes,
    )
    ranking = _ranking(choice.first, selection, law)
    names, matrix = map_of([each.screen for each in (*around, choice.first)])
    clock.lap("report")
    return Diagnosis(
        summary,
        {p.name: found.after.shared.get(p.name, 0.0) for p in free_of(found.stage.members)},
        found.before,
        found.after,
        found.stage,
        selection,
        law,
        choice.calibration,
        threshold,
        ranking,
        names,
        matrix,
        _traces(found, end.told, division),
        clock.seconds,
    )


@dataclass(frozen=True, slots=True)
class _Choice:
    """What the open runs show: ``top`` is the best robust gain of any candidate alone."""

    first: Stage
    selection: Selection | None
    calibration: Calibration
    law: NullLaw
    top: float

    @property
    def final(self) -> Stage:
        """The stage with what was chosen included."""
        return self.first if self.selection is None else self.selection.final


def _choose(
    model: Model,
    runs: Sequence[Run],
    sizes: dict[str, float],
    options: Options,
    progress: Progress,
    workers: Workers,
    clock: _Clock,
) -> _Choice:
    """Estimate noise, screen, calibrate, and choose causes if anything is significant."""
    progress("Estimating noise", 0.0)
    problem = start_problem(model, runs, workers)
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
    threshold = max(law.statistic(options.alarm_p), options.least_gain)
    if strained(first):
        threshold = options.least_gain  # the law is that of a robot that cannot be
    if top < threshold:
        progress("Looking again", 0.0)
        top = max(top, second_look(first, sizes, options))
    if top < threshold:
        clock.lap("selection")
        return _Choice(first, None, calibration, law, top)
    selection = select(first, prior, sizes, options, calibration, calibrated, progress)
    clock.lap("selection")
    calibration = selection.calibration
    return _Choice(first, selection, calibration, calibration.best_of(), top)


@dataclass(frozen=True, slots=True)
class _End:
    """The verdict, and what it rests on: the comparison on held-out runs, and what remains."""

    verdict: Verdict
    causes: list[NamedCause]
    groups: list[list[str]]
    notes: list[str]
    rest: Remaining
    found: Comparison
    told: Told


def _judge(
    choice: _Choice, division: Split, sizes: dict[str, float], options: Options, progress: Progress
) -> _End:
    """Judge what was chosen by what it leaves and by held-out runs; describe what has no name."""
    first, selection, final, law = choice.first, choice.selection, choice.final, choice.law
    found = compare(final, division, sizes, options)
    rest = remaining(final, choice.calibration, law, options)
    notes = ([division.note] if division.note else []) + doubts(final.problem)
    verdict: Verdict = "nothing_wrong"
    causes: list[NamedCause] = []
    groups: list[list[str]] = []
    if selection is not None:
        verdict, groups = judged(selection, rest, found, options, notes)
    elif rest.shapeless:
        verdict = "unexplained"
        notes.append("What is left is not noise, but no single cause or force of the tables fits.")
    if verdict == "unexplained":
        progress("Looking for unknown forces", 0.0)
        terms = explain(final, first, division, sizes, options)
        if terms is not None:
            causes = [unknown_cause(terms.comparison, min(law.p_value(choice.top), rest.alarm_p))]
            return _End(verdict, causes, [], notes, rest, terms.comparison, terms.told)
        notes.append("No cause and no sparse force explains it on held-out runs.")
        rest = remaining(first, choice.calibration, law, options)
        found = compare(first, division, sizes, options)
    elif selection is not None:
        causes = named_causes(selection, found, groups, law)
        if rest.structure_p > options.structure_p:
            rest = replace(rest, found=False, where="")  # too little beside the gain to matter
    return _End(verdict, causes, groups, notes, rest, found, report(found, division, options))


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
