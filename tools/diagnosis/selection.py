"""Which causes, and how many: forward with rescreening, exchange of members, sets that are alike.

A set of causes is judged by its evidence: −Σ (log S + e²/S) − Σ η²/sd² at its refitted minimum, of
an estimator designed around it, less a price for each parameter (Schwarz 1978) and a further price
for terms without a name, all under the same noise. After a cause is included the noise is estimated
again, for a wrong model looks like disturbance; then everything is screened again, and each member
may be exchanged for something better. Sets within a margin of the best by posterior odds are alike,
and reported as such.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from tools.diagnosis.calibration import Calibration, NullLaw
from tools.diagnosis.confusability import guises
from tools.diagnosis.evidence import (
    Nuisances,
    Point,
    Problem,
    neutral,
    prior_pull,
    score,
    with_free,
)
from tools.diagnosis.judging import Judgement, inflation, judge, one_parameter_scale
from tools.diagnosis.model import Cause, Noise, Parameter, Progress, Values
from tools.diagnosis.noise import NoiseEstimate, estimate, pack
from tools.diagnosis.options import Options
from tools.diagnosis.refit import Fit, cost_at, costs_beside, fit
from tools.diagnosis.refit import prior_cost as nuisance_cost
from tools.diagnosis.screening import Kind, Screen, build, unnamed_terms
from tools.diagnosis.sparse import forward

SETTLED = 0.7
"""Noise has settled when no logarithm has moved by more (a factor of two) since the last fit."""
SETTLED_ROUNDS = 3
MOST_BESIDE, ENTRY_BESIDE = 4, 5.0
"""The noise is estimated beside so many candidates, of so much gain each."""
CLEARED = 0.15
"""It is another noise if some logarithm has moved by this much."""
STRAINED_P = 1e-5
"""How improbable the tolerances of a fit are that no healthy robot has."""
WILD = 1.5
"""Healthy data are drawn again where they would alarm only so much later than they should."""
RUNGS = (0.05, 0.1, 0.2, 0.3, 0.45, 0.65, 1.0, 1.5, 2.5)
"""Shares of its best secant from which a cause with one parameter is refitted: its effect may have
a threshold, or be far from straight where nuisances stood in for it."""


@dataclass(frozen=True, slots=True)
class Member:
    """Something that is or may be included: a cause, or an unnamed term in its guise."""

    cause: Cause
    kind: Kind


@dataclass(frozen=True, slots=True)
class Stage:
    """A set of causes, fitted, with everything else screened around it."""

    problem: Problem
    noise: NoiseEstimate
    members: tuple[Member, ...]
    fit: Fit
    given: Nuisances
    screen: Screen
    judgement: Judgement

    @property
    def point(self) -> Point:
        """Where the set was fitted."""
        return self.fit.point

    def gain(self, owner: str) -> float:
        """Return the robust gain of a candidate that is not a member."""
        return float(self.judgement.by_owner[self.screen.owners.index(owner)])

    def plain_ranking(self) -> list[str]:
        """Return the candidates by their gains without the sandwich, best first."""
        order = np.argsort(-self.judgement.plain, kind="stable")
        return [self.screen.owners[i] for i in order]

    def ranking(self) -> list[str]:
        """Return the candidates, best first."""
        order = np.argsort(-self.judgement.by_owner, kind="stable")
        return [self.screen.owners[i] for i in order]


@dataclass(frozen=True, slots=True)
class Alternative:
    """A set of causes and its evidence (more is better)."""

    members: tuple[Member, ...]
    fit: Fit
    evidence: float

    @property
    def names(self) -> tuple[str, ...]:
        """The members' names."""
        return tuple(member.cause.name for member in self.members)


def table(problem: Problem) -> dict[str, Member]:
    """Return everything that may be included, by name."""
    found = {cause.name: Member(cause, Kind.CAUSE) for cause in problem.model.causes}
    for kind, parameter in unnamed_terms(problem):
        cause = Cause(parameter.name, f"{kind.value}: {parameter.name}", (parameter,), "")
        found[parameter.name] = Member(cause, kind)
    return found


def free_of(members: Sequence[Member]) -> list[Parameter]:
    """Return all parameters of the members."""
    return [parameter for member in members for parameter in member.cause.parameters]


def evidence(problem: Problem, found: Fit, members: Sequence[Member], options: Options) -> float:
    """Return the evidence of a fitted set, with an estimator of its own."""
    price = options.price * len(free_of(members))
    price += options.unnamed_price * sum(member.kind is not Kind.CAUSE for member in members)
    nuisances = nuisance_cost(found.point, found.nuisances, found.runs)
    return -problem.likelihood(found.point) - nuisances - price


def without(point: Point, members: Sequence[Member]) -> Point:
    """Return the point with the members' parameters neutral."""
    return point.moved({parameter.name: 0.0 for parameter in free_of(members)})


def better_start(problem: Problem, final: Stage, member: Member, first: Stage) -> Point:
    """Return where to begin a fit without one member: near all of them, or near none.

    Nuisances that stood in for a strong cause are far from where they stand beside it.
    """
    near = without(final.point, [member])
    rest = [m for m in final.members if m is not member]
    far = first.point.moved(values_of(rest, final.point))
    return min(near, far, key=lambda at: cost_at(problem, at, final.fit.nuisances))


def settle(
    problem: Problem,
    members: Sequence[Member],
    point: Point,
    first: Noise,
    sizes: dict[str, float],
    rounds: int = SETTLED_ROUNDS,
) -> tuple[Problem, NoiseEstimate, Point]:
    """Alternate fits of the nuisances and members with estimates of the noise, till they stay."""
    noise = NoiseEstimate(problem.noise, np.zeros(0, dtype=np.int64), np.zeros((0, 0)))
    for _ in range(rounds):
        found = fit(problem, point, free_of(members), sizes, refresh=False)
        point = found.point
        before = pack(problem.noise)
        noise = estimate(problem, point, first, problem.noise)
        problem = problem.with_noise(noise.noise, point)
        if float(np.max(np.abs(pack(noise.noise) - before)[noise.free], initial=0.0)) < SETTLED:
            break
    return problem, noise, point


def stage(
    problem: Problem,
    noise: NoiseEstimate,
    members: Sequence[Member],
    point: Point,
    sizes: dict[str, float],
    options: Options,
    only: Collection[str] | None = None,
) -> Stage:
    """Fit a set of causes under the problem's whitening, and screen all others around it.

    ``only``: screen none but these.
    """
    found = fit(problem, point, free_of(members), sizes)
    known = with_free(found.nuisances, found.free, found.columns)
    names = {member.cause.name for member in members}
    rows = [c for c in problem.model.causes if c.name not in names and (not only or c.name in only)]
    terms = [
        (kind, p)
        for kind, p in unnamed_terms(problem)
        if p.name not in names and (not only or p.name in only)
    ]
    screen = build(
        problem, found.point, found.residuals, known, sizes, options.block_s, rows, terms
    )
    judged = judge(screen, found.residuals, known, found.point)
    return Stage(problem, noise, tuple(members), found, known, screen, judged)


def promising(screened: Stage, options: Options) -> set[str]:
    """Return the candidates that gain most in a stage: what may compete for a place."""
    rows = table(screened.problem)
    ranking = screened.plain_ranking()
    causes = [name for name in ranking if rows[name].kind is Kind.CAUSE]
    terms = [name for name in ranking if rows[name].kind is not Kind.CAUSE]
    return {*causes[: 2 * options.refitted], *terms[: options.refitted]}


def begin(
    problem: Problem, owner: str, screen: Screen, judged: Judgement, most: int = 2
) -> list[dict[str, float]]:
    """Return starts for a refit of one owner, best first, from its best secants."""
    order = sorted(
        (i for i, c in enumerate(screen.candidates) if c.owner == owner),
        key=lambda i: -float(judged.gain[i]),
    )
    found: list[dict[str, float]] = []
    for i in order:
        if judged.gain[i] <= 0.0 or len(found) == most:
            break
        candidate = screen.candidates[i]
        start: dict[str, float] = {}
        for column, size in zip(candidate.columns, judged.sizes[i], strict=True):
            for name, value in screen.secants[column].step.items():
                start[name] = max(float(size), 0.0) * value if size >= 0.0 else float(size) * value
        found.append(start)
    return found


def starts_of(member: Member, base: Stage) -> list[dict[str, float]]:
    """Return starts within bounds for a refit of a member beside those of ``base``."""
    cause = member.cause
    found = begin(base.problem, cause.name, base.screen, base.judgement)
    turning = [p for p in cause.parameters if _turns(p, base)]
    if turning:
        found = [
            {**start, turning[0].name: angle}
            for start in _amplitudes(cause, base)
            for angle in _angles(turning[0])
        ]
    if not found:
        found = [{p.name: min(p.scale, p.most) for p in cause.parameters}]
    if len(cause.parameters) == 1:
        found += _ladder(cause, base)
    bounds = {p.name: p for p in cause.parameters}
    return [
        {
            name: float(np.clip(x, bounds[name].least, bounds[name].most))
            for name, x in start.items()
        }
        for start in found
    ]


def _ladder(cause: Cause, base: Stage) -> list[dict[str, float]]:
    """Return shares and multiples of the best secant of a cause with one parameter."""
    mine = [i for i, c in enumerate(base.screen.candidates) if c.owner == cause.name]
    if not mine:
        return []
    best = max(mine, key=lambda i: float(base.judgement.gain[i]))
    step = base.screen.secants[base.screen.candidates[best].columns[0]].step
    return [{name: rung * size for name, size in step.items()} for rung in RUNGS]


def _turns(parameter: Parameter, base: Stage) -> bool:
    """Tell whether a parameter only modulates others: it is set beside another one's secant."""
    return any(
        parameter.name in secant.step and len(secant.step) > 1 for secant in base.screen.secants
    )


def _amplitudes(cause: Cause, base: Stage) -> list[dict[str, float]]:
    mine = [s for s in base.screen.secants if s.owner == cause.name and len(s.step) > 1]
    first = next(iter(mine)).step
    return [dict(first)]


def _angles(parameter: Parameter) -> list[float]:
    width = parameter.most - parameter.least
    if not np.isfinite(width):
        return [k * parameter.scale for k in range(-4, 5)]
    return [parameter.least + width * (k + 0.5) / 8.0 for k in range(8)]


def refit_member(
    member: Member, base: Stage, sizes: dict[str, float], options: Options
) -> Alternative:
    """Refit ``base`` with one more member from several starts; return the best.

    Nuisances begin where they stand without it, where they may stand in for it, or at zero, and
    starts are compared by what is left once these have given way.
    """
    members = (*base.members, member)
    free = free_of(members)
    alone = neutral(base.problem).moved(values_of(base.members, base.point))
    points = [at.moved(start) for start in starts_of(member, base) for at in (base.point, alone)]
    costs = costs_beside(base.problem, points, base.fit.nuisances)
    best_first = sorted(range(len(points)), key=costs.__getitem__)
    fits = [
        fit(
            base.problem,
            point,
            free,
            sizes,
            given=base.fit.nuisances,
            refresh=False,
            iterations=10,
        )
        for point in (points[i] for i in best_first[:2])
    ]
    best = min(fits, key=lambda item: item.objective)
    return Alternative(members, best, evidence(base.problem, best, members, options))


def refine(
    alternative: Alternative, base: Stage, sizes: dict[str, float], options: Options
) -> Alternative:
    """Take sensitivities anew at a refitted set, and go on from there."""
    free = free_of(alternative.members)
    better = fit(base.problem, alternative.fit.point, free, sizes, iterations=6)
    if better.objective > alternative.fit.objective:
        return alternative
    own = evidence(base.problem, better, alternative.members, options)
    return Alternative(alternative.members, better, own)


def alternatives(
    base: Stage, sizes: dict[str, float], options: Options, wanted: Sequence[str] = ()
) -> list[Alternative]:
    """Return sets with one more member than ``base``, refitted, best evidence first.

    The best candidates of the screening are tried, causes before unnamed terms, and those
    ``wanted``; not terms that are but another guise of a cause, and gain hardly more than it.
    """
    members = table(base.problem)
    plain = dict(zip(base.screen.owners, base.judgement.plain, strict=True))
    ranking = base.plain_ranking()
    top = max(plain.values(), default=0.0)
    causes = [n for n in ranking if members[n].kind is Kind.CAUSE]
    resembled = guises(base.screen, options.alike)
    terms = [
        n
        for n in ranking
        if members[n].kind is not Kind.CAUSE
        and all(plain[n] > plain[c] + options.alike_margin for c in resembled.get(n, ()))
    ]
    near = [n for n in causes[: options.refitted] if plain[n] > 0.1 * top]
    near += [n for n in terms[:2] if plain[n] > 0.5 * top]
    chosen = list(dict.fromkeys([*(n for n in wanted if n in members), *near]))
    found = [refit_member(members[name], base, sizes, options) for name in chosen]
    found.sort(key=lambda item: -item.evidence)
    if found:
        close = found[0].evidence - 2.0 * options.margin
        found = [
            refine(item, base, sizes, options) if item.evidence >= close else item for item in found
        ]
    return sorted(found, key=lambda item: -item.evidence)


def values_of(members: Sequence[Member], point: Point) -> Values:
    """Return the members' values at a point."""
    return {p.name: point.shared.get(p.name, 0.0) for p in free_of(members)}


def beside(first: Stage) -> tuple[Member, ...]:
    """Return what fits best of everything that was screened, one by one, whatever it is.

    But for what is costly: others that resemble it take its place.
    """
    pull = prior_pull(first.given, first.point)
    scores = score(first.screen.projection, first.fit.residuals, *pull)
    rows = table(first.problem)
    owners = [rows[secant.owner] for secant in first.screen.secants]
    cheap = np.flatnonzero([not owner.cause.costly for owner in owners])
    information = first.screen.projection.information[np.ix_(cheap, cheap)]
    entered = forward(information, scores[cheap], MOST_BESIDE, ENTRY_BESIDE)
    return tuple({owners[cheap[i]].cause.name: owners[cheap[i]] for i in entered}.values())


def clear(first: Stage, prior: Noise, sizes: dict[str, float], options: Options) -> Stage:
    """Return the stage again, with the noise estimated beside what fits best.

    An effect that resembles a disturbance makes it large and lasting, and then nothing shows before
    it. Whether the effect is one is judged afterwards, under the noise that is left beside it.
    """
    members = beside(first)
    if not members:
        return first
    start: dict[str, float] = {}
    for member in members:
        start |= starts_of(member, first)[0]
    point = first.point.moved(start)
    problem, noise, point = settle(first.problem, members, point, prior, sizes)
    moved = np.abs(pack(problem.noise) - pack(first.problem.noise))[noise.free]
    if float(np.max(moved, initial=0.0)) < CLEARED:
        return first
    alone = (without(point, members), first.point)
    best = min(alone, key=lambda at: cost_at(problem, at, first.fit.nuisances))
    return stage(problem, noise, (), best, sizes, options)


def strained(found: Stage) -> str:
    """Return the tolerance that is farthest out, where chance never stretches them so; else "".

    One of them, or all together. Then something stands behind them, and healthy data around such a
    point are wild.
    """
    given = found.fit.nuisances
    away = {p.name: found.point.shared.get(p.name, 0.0) / p.prior_sd for p in given.shared}
    count = len(away) + sum(len(starts) for starts in given.starts)
    if not away:
        return ""
    pull = nuisance_cost(found.point, given, range(len(given.starts)))
    name = max(away, key=lambda n: abs(away[n]))
    alone = away[name] ** 2 > chi2.isf(STRAINED_P / len(away), 1)
    return name if alone or pull > chi2.isf(STRAINED_P, count) else ""


def second_look(first: Stage, sizes: dict[str, float], options: Options) -> float:
    """Return the best robust gain of refits of the best candidates.

    Where a secant is not straight its score loses what a refit finds, and the sandwich takes the
    difference for noise.
    """
    rows = table(first.problem)
    best = first.plain_ranking()[: options.looked_at]
    found = [refit_member(rows[name], first, sizes, options) for name in best]
    return max((likelihood_gain(each, first) for each in found), default=0.0)


def likelihood_gain(found: Alternative, base: Stage) -> float:
    """Return the gain of the last member of a set beside the others, as refitted.

    On the one-parameter scale, less what the sandwich takes away at the refit.
    """
    refit, width = found.fit, len(found.members[-1].cause.parameters)
    others = [columns[:, :-width] for columns in refit.columns]
    given = with_free(refit.nuisances, refit.free[:-width], others)
    own = [columns[:, -width:] for columns in refit.columns]
    factor = inflation(base.screen, given, own, refit.residuals)
    ratio = base.fit.objective - refit.objective
    return float(one_parameter_scale(np.array([ratio / factor]), width)[0])


@dataclass(frozen=True, slots=True)
class Selection:
    """What was chosen: the final stage, and per member the sets that could stand in its place.

    ``bases``: per member, the stage without it, under the final whitening, where only what is
    promising was screened. ``rivals``: per member,
    the sets with something in its place or with itself, best evidence first. ``calibration``:
    by which what is left was judged.
    """

    final: Stage
    bases: tuple[Stage, ...]
    rivals: tuple[tuple[Alternative, ...], ...]
    calibration: Calibration

    def own(self, index: int) -> Alternative:
        """Return the refit of a member in its own place."""
        name = self.final.members[index].cause.name
        return next(rival for rival in self.rivals[index] if rival.names[-1] == name)

    def gains(self) -> list[float]:
        """Return what each member gains beside the others, robust, as refitted."""
        return [likelihood_gain(self.own(i), base) for i, base in enumerate(self.bases)]


def select(
    first: Stage,
    prior: Noise,
    sizes: dict[str, float],
    options: Options,
    calibration: Calibration,
    calibrated: Callable[[Stage], Calibration],
    progress: Progress,
) -> Selection:
    """Choose causes, beginning with a stage without any whose best candidate is significant.

    What a strong effect leaves to the noise makes healthy data wild, so where the first
    calibration has a heavy tail they are drawn again with the causes included. A member that gains
    too little beside the others in the end is left out again.
    """
    best = alternatives(first, sizes, options)[0]
    members, problem, point = best.members, first.problem, best.fit.point
    seen = {frozenset(m.cause.name for m in members)}
    closed = False  # once a member has been left out, none comes in
    while True:
        progress("Including " + " and ".join(m.cause.name for m in members), len(members) / 4.0)
        problem, noise, point = settle(problem, members, point, prior, sizes)
        final = stage(problem, noise, members, point, sizes, options)
        if calibration.best_of().statistic(options.alarm_p) > WILD * options.least_gain:
            calibration = calibrated(final)
        names = {m.cause.name for m in members}
        near = promising(first, options) | promising(final, options)
        bases, rivals = [], []
        for member in members:
            rest = [m for m in members if m is not member]
            start = better_start(problem, final, member, first)
            base = stage(problem, noise, rest, start, sizes, options, near | names)
            bases.append(base)
            rivals.append(tuple(alternatives(base, sizes, options, [member.cause.name])))
        found = Selection(final, tuple(bases), tuple(rivals), calibration)
        better = None if closed else _exchange(members, rivals, seen)
        if better is None and not closed:
            better = _more(final, sizes, options, calibration.best_of())
        if better is not None and frozenset(better.names) not in seen:
            seen.add(frozenset(better.names))
            members, point = better.members, better.fit.point
            continue
        gains = found.gains()
        weakest = gains.index(min(gains))
        if len(members) == 1 or gains[weakest] >= options.least_more:
            return found
        members, point, closed = bases[weakest].members, bases[weakest].point, True


def _exchange(
    members: Sequence[Member],
    rivals: Sequence[Sequence[Alternative]],
    seen: set[frozenset[str]],
) -> Alternative | None:
    """Return the best set with one member exchanged, if it is better than what is included."""
    mine = frozenset(m.cause.name for m in members)
    best = max((r for group in rivals for r in group), key=lambda item: item.evidence)
    return None if frozenset(best.names) == mine or frozenset(best.names) in seen else best


def _more(
    final: Stage, sizes: dict[str, float], options: Options, law: NullLaw
) -> Alternative | None:
    """Return the set with one more member, if what is left is significant and it pays.

    Stretched tolerances may stand in for it so that nothing seems left: then it must pay more.
    """
    left = float(np.max(final.judgement.by_owner, initial=0.0))
    seen = left >= max(law.statistic(options.more_p), options.least_more)
    if len(final.members) >= options.most_causes or not (seen or strained(final)):
        return None
    here = evidence(final.problem, final.fit, final.members, options)
    here += 0.0 if seen else options.least_more
    found = [a for a in alternatives(final, sizes, options) if a.evidence > here]
    return found[0] if found else None
