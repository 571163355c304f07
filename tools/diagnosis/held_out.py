"""What the extension gains on data that its fit never saw.

Causes and what all runs share are fitted on the training runs; a held-out run's start is fitted on
that run, everything else stays. Runs that the user has flagged are sealed: neither the choice of
causes nor the noise has seen them. Where runs are split here, the choice has seen all of them, or a
third of what they tell of the cause would be wasted; the numbers have not.

The gain is the share of the whitened squared error above the noise floor that the extension
removes, (before − after) / (before − floor), where after − floor is what candidates of any kind
still explain. Its interval is a bootstrap over blocks of time (Künsch 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.evidence import Point, Problem, project, solved, start_problem, time_blocks
from tools.diagnosis.model import FloatArray, Run, Values
from tools.diagnosis.options import Options
from tools.diagnosis.refit import Fit, fit
from tools.diagnosis.result import HeldOut
from tools.diagnosis.selection import Stage, free_of, stage, without

RESAMPLES = 2000
FLOOR_DRAWS = 8
UNEVEN = 0.2
"""The training part's share of what runs tell of a parameter may be off by so much."""
VISIBLE = 0.5
"""Candidates that change the held-out residuals by less in all (in deviations) are not asked."""
DISTINCT = 0.5
"""Least eigenvalue of a direction that several candidates of unit length span together."""


@dataclass(frozen=True, slots=True)
class Split:
    """Which of the runs train and which are held out; with one run, a mask of its rows does it.

    ``sealed``: the user has flagged those that are held out.
    """

    runs: tuple[Run, ...]
    train: tuple[int, ...]
    held: tuple[int, ...]
    masks: tuple[FloatArray, ...] | None = None
    note: str = ""
    sealed: bool = False

    @property
    def open_runs(self) -> tuple[Run, ...]:
        """The runs from which causes may be chosen."""
        return tuple(self.runs[i] for i in self.train) if self.sealed else self.runs


def split(measured: Sequence[Run], share: float) -> Split:
    """Split by the runs' flags; without any, hold out about ``share`` of the time by whole runs.

    Runs are taken in turn, so that both parts hold runs from the beginning and the end. A single
    run is split in time, and the note says so.
    """
    runs = tuple(measured)
    flagged = [i for i, run in enumerate(runs) if run.held_out]
    if flagged and len(flagged) < len(runs):
        rest = tuple(i for i in range(len(runs)) if i not in flagged)
        sealed = any(runs[i].sealed for i in flagged)
        return Split(runs, rest, tuple(flagged), sealed=sealed)
    if len(runs) == 1:
        run = runs[0]
        edge = run.time_s[0] + (1.0 - share) * (run.time_s[-1] - run.time_s[0])
        mask = (run.time_s <= edge).astype(np.float64)
        note = (
            f"There is one run only, so its last {share:.0%} of the time are held out; "
            "a second run would tell more."
        )
        return Split(runs, (0,), (0,), (mask,), note)
    free = [i for i, run in enumerate(runs) if run.held_out is None] or list(range(len(runs)))
    length = [float(run.time_s[-1] - run.time_s[0]) for run in runs]
    wanted = share * sum(length)
    held: list[int] = []
    step = max(round(1.0 / share), 2)
    order = [i for first in range(step) for i in free[step - 1 - first :: step]]
    taken = 0.0
    for i in order:
        if len(held) + 1 < len(runs) and (
            not held or abs(taken + length[i] - wanted) < abs(taken - wanted)
        ):
            held.append(i)
            taken += length[i]
    rest = tuple(i for i in range(len(runs)) if i not in held)
    return Split(runs, rest, tuple(sorted(held)))


def informed(division: Split, final: Stage, options: Options) -> Split:
    """Exchange runs of a split until both of its parts can show what is included.

    Nothing is learnt of a wall from runs in the open, nor tested by them. What a run tells of a
    parameter is in the sensitivities; how well anything fits there is not looked at. Runs whose
    parts the user has named stay, and those of a split in which each part has its share already.
    """
    runs = final.problem.runs
    fixed = division.masks is not None or any(run.held_out is not None for run in division.runs)
    if fixed or not final.fit.free:
        return division
    cleaned = project(final.fit.nuisances, final.fit.columns).columns
    told = np.array([np.einsum("ij,ij->j", c, c) for c in cleaned])
    told /= np.maximum(told.sum(axis=0), 1e-300)
    wanted = 1.0 - options.held_out_share

    def uneven(held: Sequence[int]) -> float:
        away = np.abs(1.0 - told[list(held)].sum(axis=0) - wanted)
        return float(np.sum(np.maximum(away - UNEVEN, 0.0) ** 2))

    held = list(division.held)
    while True:
        others = [i for i in range(len(runs)) if i not in held]
        swaps = [sorted({*held, new} - {old}) for old in held for new in others]
        best = min(swaps, key=uneven, default=held)
        if uneven(best) >= uneven(held) - 1e-9:
            break
        held = best
    rest = tuple(i for i in range(len(runs)) if i not in held)
    return replace(division, train=rest, held=tuple(held))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Fits on the training part, and points with all starts (for the held-out part too).

    ``stage`` is that of all runs, also those that were sealed.
    ``evidence`` is the gain in twice the log-likelihood on the held-out part, ``change`` the
    squared distance of the two predictions there: if the extension is right the evidence has this
    mean. Its variance is four times ``change`` by noise, and as much more as the training part
    left its estimates uncertain: ``deviation`` is the root of both.
    """

    stage: Stage
    before: Point
    after: Point
    training: Fit
    evidence: float
    change: float
    deviation: float
    squares_before: FloatArray
    squares_after: FloatArray
    residuals_after: tuple[FloatArray, ...]


def _unsealed(found: Stage, division: Split, options: Options) -> tuple[Stage, dict[str, float]]:
    """Return a stage of the open runs with the sealed ones beside them, and the steps it took."""
    model, workers = found.problem.model, found.problem.workers
    starts: list[Values] = [{} for _ in division.runs]
    for i, values in zip(division.train, found.point.starts, strict=True):
        starts[i] = values
    point = Point(found.point.shared, tuple(starts))
    problem = start_problem(model, division.runs, workers).with_noise(found.problem.noise, point)
    problem = replace(problem, doubted=found.problem.doubted)
    sizes: dict[str, float] = {}
    return stage(problem, found.noise, found.members, point, sizes, options), sizes


def compare(
    chosen: Stage, division: Split, sizes: dict[str, float], options: Options
) -> Comparison:
    """Fit the believed and the extended model on the training part; judge both on the other."""
    final, sizes = _unsealed(chosen, division, options) if division.sealed else (chosen, sizes)
    problem, members = final.problem, final.members
    training = replace(problem, masks=division.masks)
    after = fit(training, final.point, free_of(members), sizes, runs=division.train)
    start = without(after.point, members)
    before = fit(training, start, [], sizes, runs=division.train)
    if division.masks is None:
        points = [
            fit(problem, f.point, [], sizes, runs=division.held, frozen=True).point
            for f in (before, after)
        ]
    else:
        points = [before.point, after.point]
    pairs = [
        (problem.residual(run, points[0].values(run)), problem.residual(run, points[1].values(run)))
        for run in division.held
    ]
    if division.masks is not None:
        pairs = [(b * (1.0 - division.masks[0]), a * (1.0 - division.masks[0])) for b, a in pairs]
    rows = [time_blocks(problem.runs[run], options.block_s) for run in division.held]
    squares_before = np.concatenate(
        [np.add.reduceat(b * b, r) for (b, _), r in zip(pairs, rows, strict=True)]
    )
    squares_after = np.concatenate(
        [np.add.reduceat(a * a, r) for (_, a), r in zip(pairs, rows, strict=True)]
    )
    gain = float(np.sum(squares_before) - np.sum(squares_after))
    moved = [b - a for b, a in pairs]
    change = sum(float(d @ d) for d in moved)
    return Comparison(
        final,
        points[0],
        points[1],
        after,
        gain,
        change,
        2.0 * float(np.sqrt(change + _uncertain(final, division, moved))),
        squares_before,
        squares_after,
        tuple(a for _, a in pairs),
    )


def _uncertain(final: Stage, division: Split, moved: Sequence[FloatArray]) -> float:
    """Return dᵀ J C Jᵀ d: changes d of predictions, as uncertain as the training part left them.

    C is the covariance of nuisances and free parameters by the training part and the priors.
    """
    count = len(final.given.shared)
    matrix = np.diag(final.given.shared_precision)
    for run in division.train:
        columns = final.given.columns[run][:, :count]
        if division.masks is not None:
            columns = columns * division.masks[0][:, None]
        matrix = matrix + columns.T @ columns
    slope = np.zeros(count)
    for run, d in zip(division.held, moved, strict=True):
        slope += final.given.columns[run][:, :count].T @ d
    return max(float(slope @ solved(matrix, slope[:, None])[:, 0]), 0.0)


def left_by_pairs(found: Comparison, division: Split, options: Options) -> FloatArray:
    """Return (blocks, blocks): what candidates still explain, as products of different blocks.

    Held-out residuals of each time block are projected on everything that was screened and on what
    is included. Noise of different blocks is independent, so it adds nothing to the sum of products
    of different blocks, whatever its colour within one: that sum estimates without bias how much
    an effect that lasts has left. The diagonal is zero.
    """
    final = found.stage
    own = project(final.fit.nuisances, final.fit.columns).columns
    every = [np.column_stack([own[r], final.screen.projection.columns[r]]) for r in division.held]
    if division.masks is not None:
        every = [c * (1.0 - division.masks[0])[:, None] for c in every]
    gram = np.sum([c.T @ c for c in every], axis=0)
    length = np.sqrt(np.diag(gram))
    usable = np.flatnonzero(length > VISIBLE)
    unit = gram[np.ix_(usable, usable)] / np.outer(length[usable], length[usable])
    values, vectors = np.linalg.eigh(unit)
    kept = values > DISTINCT
    basis = vectors[:, kept] / np.sqrt(values[kept]) / length[usable, None]
    scores = np.concatenate(
        [
            np.add.reduceat(
                (c[:, usable] @ basis) * residual[:, None],
                time_blocks(final.problem.runs[run], options.block_s),
            )
            for run, c, residual in zip(division.held, every, found.residuals_after, strict=True)
        ]
    )
    pairs: FloatArray = scores @ scores.T
    np.fill_diagonal(pairs, 0.0)
    return pairs


def gain_with_interval(
    removed: FloatArray, pairs: FloatArray, generator: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Return the gain and its 95 % interval by resampling blocks (Künsch 1989).

    ``removed``: squared error (blocks,) that the extension removes; ``pairs``: what is left, of
    `left_by_pairs`. The gain is removed / (removed + left), where less than nothing cannot be left.
    """
    count = removed.size

    def share(times: FloatArray) -> FloatArray:
        gone = times @ removed
        left = np.sum((times @ pairs) * times, axis=1) * count / max(count - 1.0, 1.0)
        whole = np.maximum(gone + np.maximum(left, 0.0), 1e-9)
        found: FloatArray = np.clip(gone / whole, -1.0, 1.0)
        return found

    point = float(share(np.ones((1, count)))[0])
    picked = generator.multinomial(count, np.full(count, 1.0 / count), RESAMPLES)
    several = share(picked.astype(np.float64))
    low, high = np.quantile(several, [0.025, 0.975])
    return point, (float(min(low, point)), float(max(high, point)))


def replays(problem: Problem, point: Point) -> list[FloatArray]:
    """Return what each run would have measured, simulated in the open from its start.

    Errors of sensors that the point holds are part of what is measured.
    """
    found = []
    for i, run in enumerate(problem.runs):
        values = point.values(i)
        bare = {name: x for name, x in values.items() if name not in problem.sensor}
        simulated = problem.model.replay(run, bare, problem.filters[i])
        for name in (n for n in problem.sensor if n in values):
            simulated = simulated + problem.sensor[name].error(
                run, problem.predicted[i], values[name]
            )
        found.append(simulated)
    return found


def errors(problem: Problem, run: int, simulated: FloatArray, value: FloatArray) -> FloatArray:
    """Return measured minus simulated, angles wrapped."""
    difference = value - simulated
    angle = np.array([channel.angle for channel in problem.model.channels])
    wrapped = (difference + np.pi) % (2.0 * np.pi) - np.pi
    found: FloatArray = np.where(angle[problem.runs[run].channel], wrapped, difference)
    return found


def by_channel(
    problem: Problem, held: Sequence[int], squares: Sequence[FloatArray], rows: Sequence[FloatArray]
) -> dict[str, float]:
    """Return the root mean square per channel over some rows of the held-out runs."""
    found = {}
    for index, channel in enumerate(problem.model.channels):
        mine = [
            s[(problem.runs[run].channel == index) & row]
            for run, s, row in zip(held, squares, rows, strict=True)
        ]
        every = np.concatenate(mine) if mine else np.zeros(0)
        if every.size:
            found[channel.name] = float(np.sqrt(np.mean(every)))
    return found


@dataclass(frozen=True, slots=True)
class Told:
    """What a comparison shows: figures; replays [before, after] by run; the bands around these."""

    figures: HeldOut
    replays: tuple[list[FloatArray], list[FloatArray]]
    spread: list[FloatArray]


def report(found: Comparison, division: Split, options: Options) -> Told:
    """Return the figures of a comparison, and what its runs would have been."""
    final, problem = found.stage, found.stage.problem
    generator = np.random.default_rng([options.seed, 0x4E1D])
    both = replays(problem, found.before), replays(problem, found.after)
    bare = {k: v for k, v in found.after.shared.items() if k not in problem.sensor}
    squares: list[list[FloatArray]] = [[] for _ in problem.runs]
    for _ in range(FLOOR_DRAWS):
        for i, run in enumerate(problem.runs):
            values = {**bare, **found.after.starts[i]}
            drawn = problem.model.draw(run, values, problem.noise, generator)
            clean = problem.model.replay(run, values)
            squares[i].append(errors(problem, i, clean, drawn.value) ** 2)
    spread = [np.sqrt(np.mean(s, axis=0)) for s in squares]
    rows = [
        np.ones(problem.runs[run].time_s.size, dtype=bool)
        if division.masks is None
        else division.masks[0] == 0.0
        for run in division.held
    ]
    rmse = [
        by_channel(
            problem,
            division.held,
            [
                errors(problem, run, kind[run], problem.runs[run].value) ** 2
                for run in division.held
            ],
            rows,
        )
        for kind in both
    ]
    floor = by_channel(problem, division.held, [spread[run] ** 2 for run in division.held], rows)
    gain, interval = 0.0, (0.0, 0.0)
    if final.members:
        removed = found.squares_before - found.squares_after
        gain, interval = gain_with_interval(
            removed, left_by_pairs(found, division, options), generator
        )
    names = [problem.runs[run].name for run in division.held]
    return Told(HeldOut(names, rmse[0], rmse[1], gain, interval, floor), both, spread)
