"""What the extension gains on data that its fit never saw.

Causes and what all runs share are fitted on the training runs; a held-out run's start is fitted on
that run, everything else stays. The gain is the share of the whitened squared error above the noise
floor that the extension removes, (before − after) / (before − floor). The floor is that of this
very data: what remains when causes and terms of any kind are added that still explain it, corrected
for the squared error that they remove from pure noise (their number). Its interval is a bootstrap
over blocks of time (Künsch 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.evidence import Point, Problem, project, solved, time_blocks
from tools.diagnosis.model import FloatArray, Noise, Run
from tools.diagnosis.options import Options
from tools.diagnosis.refit import Fit, fit
from tools.diagnosis.result import HeldOut
from tools.diagnosis.selection import Member, Stage, free_of, without
from tools.diagnosis.sparse import ENTRY, forward

RESAMPLES = 2000
FLOOR_DRAWS = 8
UNEVEN = 0.2
"""The training part's share of what runs tell of a parameter may be off by so much."""
FLOOR_TERMS = 6


@dataclass(frozen=True, slots=True)
class Split:
    """Which runs train and which are held out; with one run, a mask of its rows does it."""

    train: tuple[int, ...]
    held: tuple[int, ...]
    masks: tuple[FloatArray, ...] | None
    note: str


def split(runs: Sequence[Run], share: float) -> Split:
    """Split by the runs' flags; without any, hold out about ``share`` of the time by whole runs.

    Runs are taken in turn, so that both parts hold runs from the beginning and the end. A single
    run is split in time, and the note says so.
    """
    flagged = [i for i, run in enumerate(runs) if run.held_out]
    if flagged and len(flagged) < len(runs):
        rest = tuple(i for i in range(len(runs)) if i not in flagged)
        return Split(rest, tuple(flagged), None, "")
    if len(runs) == 1:
        run = runs[0]
        edge = run.time_s[0] + (1.0 - share) * (run.time_s[-1] - run.time_s[0])
        mask = (run.time_s <= edge).astype(np.float64)
        note = (
            f"There is one run only, so its last {share:.0%} of the time are held out; "
            "a second run would tell more."
        )
        return Split((0,), (0,), (mask,), note)
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
    return Split(rest, tuple(sorted(held)), None, "")


def informed(division: Split, final: Stage, options: Options) -> Split:
    """Exchange runs of a split until both of its parts can show what is included.

    Nothing is learnt of a wall from runs in the open, nor tested by them. What a run tells of a
    parameter is in the sensitivities; how well anything fits there is not looked at. Runs whose
    parts the user has named stay, and those of a split in which each part has its share already.
    """
    runs = final.problem.runs
    fixed = division.masks is not None or any(run.held_out is not None for run in runs)
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
    return Split(rest, tuple(held), None, division.note)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Fits on the training part, and points with all starts (for the held-out part too).

    ``evidence`` is the gain in twice the log-likelihood on the held-out part, ``change`` the
    squared distance of the two predictions there: if the extension is right the evidence has this
    mean. Its variance is four times ``change`` by noise, and as much more as the training part
    left its estimates uncertain: ``deviation`` is the root of both.
    """

    before: Point
    after: Point
    training: Fit
    evidence: float
    change: float
    deviation: float
    squares_before: FloatArray
    squares_after: FloatArray
    residuals_after: tuple[FloatArray, ...]


def compare(
    final: Stage,
    members: Sequence[Member],
    division: Split,
    sizes: dict[str, float],
    options: Options,
) -> Comparison:
    """Fit the believed and the extended model on the training part; judge both on the other."""
    problem = final.problem
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


def floor_blocks(final: Stage, found: Comparison, division: Split, options: Options) -> FloatArray:
    """Return per held-out block what a rich model still removes after the extension, above chance.

    Candidates of the screening enter one by one, while one of them gains more than chance would.
    """
    cleaned = [final.screen.projection.columns[run] for run in division.held]
    if division.masks is not None:
        cleaned = [c * (1.0 - division.masks[0])[:, None] for c in cleaned]
    gram = np.sum([c.T @ c for c in cleaned], axis=0)
    slope = np.sum([c.T @ r for c, r in zip(cleaned, found.residuals_after, strict=True)], axis=0)
    usable = np.flatnonzero(np.diag(gram) > 0.25)
    if usable.size == 0:
        return np.zeros_like(found.squares_after)
    entered = usable[forward(gram[np.ix_(usable, usable)], slope[usable], FLOOR_TERMS, ENTRY)]
    inner = np.linalg.pinv(gram[np.ix_(entered, entered)], hermitian=True)
    size = inner @ slope[entered]
    blocks = []
    for run, c, residual in zip(division.held, cleaned, found.residuals_after, strict=True):
        left = residual - c[:, entered] @ size
        rows = time_blocks(final.problem.runs[run], options.block_s)
        blocks.append(np.add.reduceat(residual * residual - left * left, rows))
    every = np.concatenate(blocks)
    chance: FloatArray = every - float(entered.size) / every.size
    return chance


def gain_with_interval(
    removed: FloatArray, left: FloatArray, generator: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Return removed / (removed + left), sums over blocks, and its 95 % bootstrap interval."""

    def share(a: FloatArray, b: FloatArray) -> FloatArray:
        whole = np.maximum(a + np.maximum(b, 0.0), 1e-9)
        return np.clip(a / whole, -1.0, 1.0)

    point = float(share(np.array([np.sum(removed)]), np.array([np.sum(left)]))[0])
    pick = generator.integers(0, removed.size, size=(RESAMPLES, removed.size))
    several = share(removed[pick].sum(axis=1), left[pick].sum(axis=1))
    low, high = np.quantile(several, [0.025, 0.975])
    return point, (float(min(low, point)), float(max(high, point)))


def replays(problem: Problem, point: Point) -> list[FloatArray]:
    """Return what each run would have measured, simulated in the open from its start.

    Errors of sensors that the point holds are part of what is measured.
    """
    found = []
    for i, run in enumerate(problem.runs):
        values = point.values(i)
        simulated = problem.model.replay(
            run, {name: x for name, x in values.items() if name not in problem.sensor}
        )
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


def report(
    final: Stage,
    members: Sequence[Member],
    found: Comparison,
    division: Split,
    noise: Noise,
    options: Options,
) -> tuple[HeldOut, list[list[FloatArray]], list[FloatArray]]:
    """Return the figures, the replays [before, after] by run, and the bands around the latter."""
    problem = final.problem
    generator = np.random.default_rng([options.seed, 0x4E1D])
    both = [replays(problem, found.before), replays(problem, found.after)]
    bare = {k: v for k, v in found.after.shared.items() if k not in problem.sensor}
    squares: list[list[FloatArray]] = [[] for _ in problem.runs]
    for _ in range(FLOOR_DRAWS):
        for i, run in enumerate(problem.runs):
            values = {**bare, **found.after.starts[i]}
            drawn = problem.model.draw(run, values, noise, generator)
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
    if members:
        removed = found.squares_before - found.squares_after
        gain, interval = gain_with_interval(
            removed, floor_blocks(final, found, division, options), generator
        )
    names = [problem.runs[run].name for run in division.held]
    return HeldOut(names, rmse[0], rmse[1], gain, interval, floor), both, spread
