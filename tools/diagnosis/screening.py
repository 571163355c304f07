"""Screening: what each candidate could explain, from sensitivities alone.

A candidate's sensitivity is a secant of a size that matters: what adds about fifty to twice the
log-likelihood after nuisances are taken out. So causes with thresholds or one sign are seen where
they would be found. Several secants of a cause (both signs, several sizes, pairs of parameters) are
several candidates with one owner.

Terms without a name form families too (all forces on one axis, all errors of one sensor): an effect
that no single term resembles may still be a sum of many. `judging` says what all of them gain.
"""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tools.diagnosis.evidence import (
    Nuisances,
    Point,
    Problem,
    Projection,
    columns,
    project,
    responses,
    time_blocks,
)
from tools.diagnosis.model import Cause, FloatArray, IntArray, Parameter, Run, Values

RAW_TARGET = 5.0
"""Length of the change of the residuals by a first secant, in standard deviations."""
LEAST_RAW, MOST_RAW = 0.4, 40.0
"""Shares of it within which a first secant serves (unnamed terms are linear: longer and shorter
ones do)."""
TARGET = math.sqrt(50.0)
"""The same after nuisances are taken out, by the secants that are used."""
LARGER = 2.5
"""One-sided parameters are tried at this multiple too."""
LONGEST = 400.0
"""No secant changes the residuals by more, however well nuisances imitate it: it would not be
straight."""
POWERS = {"share": "", "square": "²", "cube": "³"}
"""By the unit of an error that follows a channel."""
ADAPTED = 14
"""Rounds in which the sizes of secants are adapted: a limit on speed shows at nothing less than the
fastest beat, and is far too long a per cent later."""
NEIGHBOURS = 3
"""The sandwich is taken over blocks, and over groups of so many: errors stay for a while."""
SPANNED = 1e-3
"""Directions of a family whose information is a smaller share of the largest are left out."""
ANY_FORCE = "any force"
"""The family of all forces."""
VISIBLE = 1e-2
"""Candidates whose secant is shorter than this after nuisances are taken out are not judged."""


class Kind(enum.Enum):
    """What a candidate is: a named cause, an unexplained force, an unexplained sensor error."""

    CAUSE = "cause"
    FORCE = "unknown force"
    SENSOR = "unknown sensor error"


@dataclass(frozen=True, slots=True)
class Secant:
    """One column: a step of one owner."""

    owner: str
    kind: Kind
    step: Values


@dataclass(frozen=True, slots=True)
class Candidate:
    """Columns that one owner uses together; ``inverse`` of their information, and its ``rank``."""

    owner: str
    kind: Kind
    columns: tuple[int, ...]
    positive: tuple[bool, ...]
    inverse: FloatArray
    rank: int


@dataclass(frozen=True, slots=True)
class Screen:
    """Everything about the candidates at one point that does not depend on what was measured.

    ``first_rows``: per run, the first row of each time block; ``block_information`` (blocks,
    columns). ``groups``: first blocks of groups of one block, and of several neighbours of a run;
    none where nothing can be correlated in time.
    ``families``: all unnamed terms of a kind together, whether or not any is visible.
    """

    secants: tuple[Secant, ...]
    candidates: tuple[Candidate, ...]
    projection: Projection
    first_rows: tuple[IntArray, ...]
    block_information: FloatArray
    owners: tuple[str, ...]
    kinds: tuple[Kind, ...]
    groups: tuple[IntArray, ...]
    families: tuple[Candidate, ...]


def _room(parameter: Parameter, here: float, sign: float) -> float:
    """Return how far a parameter can go in one direction."""
    return parameter.most - here if sign > 0.0 else here - parameter.least


@dataclass(slots=True)
class _Try:
    """A secant whose size is being found; ``beside`` are values that are set with it."""

    owner: str
    kind: Kind
    parameter: Parameter
    here: float
    sign: float
    size: float
    most: float
    key: str
    beside: Values = field(default_factory=dict)

    def step(self) -> dict[str, float]:
        """Return the step at the present size."""
        return {**self.beside, self.parameter.name: self.here + self.sign * self.size}


def _tries(
    problem: Problem,
    point: Point,
    causes: Sequence[Cause],
    unnamed: Sequence[tuple[Kind, Parameter]],
    sizes: dict[str, float],
) -> list[_Try]:
    found = []
    groups = [(cause.name, Kind.CAUSE, p) for cause in causes for p in cause.parameters]
    groups += [(p.name, kind, p) for kind, p in unnamed]
    for owner, kind, parameter in groups:
        here = point.shared.get(parameter.name, 0.0)
        for sign in (1.0, -1.0) if kind is Kind.CAUSE else (1.0,):
            room = _room(parameter, here, sign)
            if room <= 0.0:
                continue
            key = f"screen/{parameter.name}/{sign:+.0f}"
            size = min(sizes.get(key, parameter.scale), room)
            found.append(_Try(owner, kind, parameter, here, sign, size, room, key))
    return found


def unnamed_terms(problem: Problem) -> list[tuple[Kind, Parameter]]:
    """Return the terms that have no name: the model's library of forces, and sensors' errors."""
    terms = [(Kind.FORCE, parameter) for parameter in problem.model.library]
    for name, shift in problem.sensor.items():
        channel = problem.model.channels[shift.channel]
        size = 10.0 * float(problem.noise.sigma[shift.channel])
        unit = "1" if shift.shape == "scale" else channel.unit
        if shift.other is not None or shift.shape == "cube":
            source = problem.model.channels[
                shift.channel if shift.other is None else shift.other
            ].unit
            unit = f"{channel.unit}/({source}){POWERS[shift.shape]}"
        terms.append((Kind.SENSOR, Parameter(name, unit, scale=size)))
    return terms


def _lengths(changes: Sequence[FloatArray]) -> FloatArray:
    total = sum(np.einsum("ij,ij->j", change, change) for change in changes)
    return np.sqrt(np.asarray(total, dtype=np.float64))


def build(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    given: Nuisances,
    sizes: dict[str, float],
    block_s: float,
    causes: Sequence[Cause],
    unnamed: Sequence[tuple[Kind, Parameter]],
) -> Screen:
    """Find the secants of all causes, force terms and sensor errors at a point, and project them.

    ``sizes`` remembers suitable sizes between calls.
    """
    tries = _tries(problem, point, causes, unnamed, sizes)
    changes, straight = _straight(problem, point, tries)
    again = [i for i in range(len(tries)) if i not in straight]
    _replace(problem, point, residuals, tries, again, changes)
    for _ in range(4):
        lengths = _lengths(changes)
        again = [i for i in again if not _suitable(tries[i], float(lengths[i]))]
        if not again:
            break
        for i in again:
            factor = float(np.clip(RAW_TARGET / max(lengths[i], 1e-9), 1e-4, 10.0))
            tries[i].size = min(tries[i].size * factor, tries[i].most)
        _replace(problem, point, residuals, tries, again, changes)
    lengths = _lengths(changes)
    # Without effect alone: a parameter that only modulates another one of its cause (a phase).
    silent = {item.parameter.name for i, item in enumerate(tries) if lengths[i] < 1e-6}
    _adapt(problem, point, residuals, given, tries, changes)
    for item in tries:
        if item.parameter.name not in silent:
            sizes[item.key] = item.size
    extra = _extra(problem, point, causes, tries, silent)
    more = columns(problem, point, residuals, [item.step() for item in extra])
    tries += extra
    changes = [np.column_stack([a, b]) for a, b in zip(changes, more, strict=True)]
    return _screen(problem, causes, point, tries, changes, given, block_s)


def _straight(
    problem: Problem, point: Point, tries: Sequence[_Try]
) -> tuple[list[FloatArray], set[int]]:
    """Return the changes (n, tries) per run, filled where slopes are known, and which these are.

    Their sizes are set, in place: as long as first secants should be.
    """
    changes = [np.zeros((run.time_s.size, len(tries))) for run in problem.runs]
    unnamed = [i for i, item in enumerate(tries) if item.kind is not Kind.CAUSE]
    slopes = responses(problem, point, [tries[i].parameter.name for i in unnamed])
    known = [k for k in range(len(unnamed)) if all(np.isfinite(s[:, k]).all() for s in slopes)]
    length = _lengths(slopes)
    for k in known:
        i = unnamed[k]
        if length[k] > 0.0:
            tries[i].size = min(RAW_TARGET / float(length[k]), tries[i].most)
        for change, slope in zip(changes, slopes, strict=True):
            change[:, i] = tries[i].size * slope[:, k]
    return changes, {unnamed[k] for k in known}


def _adapt(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    given: Nuisances,
    tries: Sequence[_Try],
    changes: Sequence[FloatArray],
) -> None:
    """Change the sizes of causes' secants until they are as long as they should be, in place.

    Where an effect sets in at a threshold its length goes with a high power of the size: once there
    are sizes on both sides, the next lies between.
    """
    open_ = [i for i, length in enumerate(_lengths(changes)) if length >= 1e-6]
    open_ = [i for i in open_ if tries[i].kind is Kind.CAUSE]
    short, long = dict.fromkeys(open_, 0.0), dict.fromkeys(open_, math.inf)
    for _ in range(ADAPTED):
        chosen = [change[:, open_] for change in changes]
        raw, left = _lengths(chosen), _lengths(project(given, chosen).columns)
        again = []
        for i, length, rest in zip(open_, raw.tolist(), left.tolist(), strict=True):
            item = tries[i]
            factor = min(TARGET / max(rest, 1e-9), LONGEST / max(length, 1e-9))
            if 0.4 <= factor <= 2.5 or (factor > 1.0 and item.size >= item.most):
                continue
            if factor > 1.0:
                short[i] = item.size
            else:
                long[i] = item.size
            between = math.sqrt(short[i] * long[i]) if short[i] > 0.0 else math.inf
            step = item.size * min(max(factor, 0.02), 50.0)
            item.size = min(between if math.isfinite(between) else step, item.most)
            again.append(i)
        if not again:
            return
        _replace(problem, point, residuals, tries, again, changes)
        open_ = again
    left = _lengths(project(given, [change[:, open_] for change in changes]).columns)
    steep = [
        i
        for i, rest in zip(open_, left.tolist(), strict=True)
        if rest < 0.4 * TARGET and math.isfinite(long[i])
    ]
    for i in steep:  # better too long than without effect: refits begin at shares of it
        tries[i].size = long[i]
    _replace(problem, point, residuals, tries, steep, changes)


def _suitable(item: _Try, length: float) -> bool:
    """Tell whether a first secant is long enough to go on from, and not absurd."""
    if length < RAW_TARGET and item.size >= item.most:
        return True
    least = LEAST_RAW if item.kind is Kind.CAUSE else LEAST_RAW / MOST_RAW
    return least * RAW_TARGET <= length <= MOST_RAW * RAW_TARGET


def _replace(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    tries: Sequence[_Try],
    again: Sequence[int],
    changes: Sequence[FloatArray],
) -> None:
    """Take some secants anew, at the sizes that their tries have now."""
    fresh = columns(problem, point, residuals, [tries[i].step() for i in again])
    for change, new in zip(changes, fresh, strict=True):
        change[:, list(again)] = new


def _extra(
    problem: Problem,
    point: Point,
    causes: Sequence[Cause],
    tries: Sequence[_Try],
    silent: set[str],
) -> list[_Try]:
    """Return larger secants of one-sided parameters, and those of modulating parameters."""
    extra = []
    by_name = {p.name: cause for cause in causes for p in cause.parameters}
    for item in tries:
        parameter = item.parameter
        if item.kind is not Kind.CAUSE or parameter.name in silent:
            continue
        cause = by_name[parameter.name]
        one_sided = parameter.least >= 0.0 and len(cause.parameters) == 1
        size = min(LARGER * item.size, item.most)
        if one_sided and item.here == 0.0 and size > 1.2 * item.size:
            extra.append(replace(item, size=size, key=""))
        for other in cause.parameters:
            if other.name not in silent or item.sign < 0.0:
                continue
            there = point.shared.get(other.name, 0.0)
            width = other.most - other.least
            turn = 0.25 * width if math.isfinite(width) else other.scale
            if there + turn > other.most:
                turn = -turn
            extra.append(replace(item, key="turned", beside={other.name: there + turn}))
    return extra


def _screen(
    problem: Problem,
    causes: Sequence[Cause],
    point: Point,
    tries: Sequence[_Try],
    changes: Sequence[FloatArray],
    given: Nuisances,
    block_s: float,
) -> Screen:
    projection = project(given, changes)
    information = projection.information
    visible = np.sqrt(np.maximum(np.diag(information), 0.0)) > VISIBLE
    secants = tuple(Secant(t.owner, t.kind, t.step()) for t in tries)
    candidates = []
    owners: dict[str, Kind] = {cause.name: Kind.CAUSE for cause in causes}
    by_owner: dict[str, list[int]] = {}
    for i, item in enumerate(tries):
        owners.setdefault(item.owner, item.kind)
        if visible[i]:
            by_owner.setdefault(item.owner, []).append(i)
    for owner, mine in by_owner.items():
        kind = owners[owner]
        positive = kind is Kind.CAUSE
        # A turned secant stands for the sine beside the cosine: both have either sign.
        turned = [i for i in mine if tries[i].key == "turned"]
        candidates += [_candidate(owner, kind, (i,), (positive,), information) for i in mine]
        for i, k in itertools.combinations(mine, 2):
            names = [tries[m].parameter for m in (i, k)]
            pair = k in turned and i not in turned and tries[i].sign > 0.0 and positive
            if positive and names[0] is not names[1] and not turned:
                candidates.append(_candidate(owner, kind, (i, k), (True, True), information))
            elif pair:
                candidates.append(_candidate(owner, kind, (i, k), (False, False), information))
    alone = {n: mine for n, mine in by_owner.items() if owners[n] is not Kind.CAUSE}
    first_rows = tuple(time_blocks(run, block_s) for run in problem.runs)
    return Screen(
        secants,
        tuple(candidates),
        projection,
        first_rows,
        block_information(projection.columns, first_rows),
        tuple(owners),
        tuple(owners.values()),
        _groups(problem.runs, [rows.size for rows in first_rows]),
        tuple(
            _family(name, kind, terms, {n: i for n, (i,) in alone.items()}, information)
            for name, (kind, terms) in families(problem).items()
        ),
    )


def block_information(cleaned: Sequence[FloatArray], first_rows: Sequence[IntArray]) -> FloatArray:
    """Return what each time block contributes to the information of each column (blocks, c)."""
    squares = [
        np.add.reduceat(columns_ * columns_, rows, axis=0)
        for columns_, rows in zip(cleaned, first_rows, strict=True)
    ]
    return np.vstack(squares)


def _groups(runs: Sequence[Run], counts: Sequence[int]) -> tuple[IntArray, ...]:
    """Return the first blocks of groups: of one block each, and of ``NEIGHBOURS`` within a run.

    Runs without a duration, such as rows of a table, have no errors that stay for a while: none.
    """
    if all(run.time_s[-1] == run.time_s[0] for run in runs):
        return ()
    single = np.arange(sum(counts))
    begins = np.cumsum([0, *counts[:-1]])
    several = [
        begin + np.arange(0, count, NEIGHBOURS) for begin, count in zip(begins, counts, strict=True)
    ]
    return single, np.concatenate(several)


def _candidate(
    owner: str,
    kind: Kind,
    mine: tuple[int, ...],
    positive: tuple[bool, ...],
    information: FloatArray,
) -> Candidate:
    inner = information[np.ix_(mine, mine)]
    inverse = np.asarray(np.linalg.pinv(inner, rcond=1e-6, hermitian=True), dtype=np.float64)
    return Candidate(owner, kind, mine, positive, inverse, len(mine))


def families(problem: Problem) -> dict[str, tuple[Kind, list[str]]]:
    """Return the unnamed terms by families: forces by their axis and together, errors by sensor.

    A term's family is its name up to the colon.
    """
    found: dict[str, tuple[Kind, list[str]]] = {}
    for kind, parameter in unnamed_terms(problem):
        whole = [ANY_FORCE] if kind is Kind.FORCE else []
        for family in (parameter.name.partition(":")[0], *whole):
            found.setdefault(family, (kind, []))[1].append(parameter.name)
    return found


def _family(
    name: str, kind: Kind, terms: Sequence[str], seen: Mapping[str, int], information: FloatArray
) -> Candidate:
    """Return a family as a candidate, in the directions that its terms span well."""
    mine = tuple(seen[term] for term in terms if term in seen)
    inner = information[np.ix_(mine, mine)]
    length = np.sqrt(np.diag(inner))
    values, vectors = np.linalg.eigh(inner / np.outer(length, length))
    kept = values > SPANNED * np.max(values, initial=0.0)
    root = vectors[:, kept] / np.sqrt(values[kept]) / length[:, None]
    positive = tuple(False for _ in mine)
    return Candidate(name, kind, mine, positive, root @ root.T, int(np.sum(kept)))
