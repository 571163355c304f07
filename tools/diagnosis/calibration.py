"""How large the best of many candidates becomes when nothing is wrong: by simulation.

The gain of the best of many correlated candidates has no textbook distribution. So healthy data
sets are drawn from the believed model as it was fitted, with noise as uncertain as its estimate is;
each goes through the same pipeline with the same gains, whitening and sensitivities; and the
largest robust gain of each is kept. Beyond the draws the tail is exponential: excesses over a high
threshold follow a generalised Pareto law (Pickands 1975), whose shape is zero for χ²; its scale is
no less than two, the scale of χ² itself.

Results are kept in the user's cache directory under a digest of all that they depend on, so a
second diagnosis of the same runs does not draw again. Files are written beside and moved into
place; one that cannot be read is drawn anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from tools.diagnosis.evidence import Nuisances, Point, Problem, prior_pull, pulled
from tools.diagnosis.judging import block_scores, judge_families, judge_many
from tools.diagnosis.model import FloatArray, Progress
from tools.diagnosis.noise import NoiseEstimate, drawn
from tools.diagnosis.screening import Screen
from tools.diagnosis.whiteness import structure, structure_statistics
from tools.diagnosis.workers import Workers

VERSION = 13
"""Part of the cache key: to be raised when the method changes."""
TAIL = 0.25
"""Share of the draws to which the tail is fitted."""
LEAST_SCALE = 2.0
"""Scale of the exponential tail of χ²."""


@dataclass(frozen=True, slots=True)
class NullLaw:
    """Distribution of a statistic in healthy data: draws, and an exponential tail beyond them."""

    draws: FloatArray
    threshold: float
    scale: float

    def p_value(self, statistic: float) -> float:
        """Return the probability of at least this much in healthy data."""
        count = self.draws.size
        if statistic >= self.threshold:
            share = float(np.mean(self.draws >= self.threshold))
            return float(share * np.exp(-(statistic - self.threshold) / self.scale))
        return float((np.sum(self.draws >= statistic) + 1.0) / (count + 1.0))

    def statistic(self, p_value: float) -> float:
        """Return what is exceeded with this probability."""
        share = float(np.mean(self.draws >= self.threshold))
        if p_value < share:
            return float(self.threshold + self.scale * np.log(share / p_value))
        return float(np.quantile(self.draws, 1.0 - p_value))


def null_law(draws: FloatArray, *, known: bool = False) -> NullLaw:
    """Fit the law to draws; the scale is raised by its own standard error, to be careful.

    ``known``: it is that of χ² by theory, if the draws do not tell otherwise by two such errors.
    """
    threshold = float(np.quantile(draws, 1.0 - TAIL))
    excess = draws[draws > threshold] - threshold
    error = max(excess.size, 1) ** -0.5
    mean = float(np.mean(excess)) if excess.size else 0.0
    scale = max(LEAST_SCALE, mean * (1.0 + error))
    if known and mean <= LEAST_SCALE * (1.0 + 2.0 * error):
        scale = LEAST_SCALE
    return NullLaw(np.sort(draws), threshold, scale)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Robust gains (draws, owners or families) and structure statistics of healthy data."""

    gains: FloatArray
    families: FloatArray
    structure: FloatArray
    cached: bool = False
    note: str = ""
    """What the user should know of how it was come by."""

    def best_of(self, owners: Sequence[int] | None = None) -> NullLaw:
        """Return the law of the best of some owners (all of them by default)."""
        chosen = self.gains if owners is None else self.gains[:, list(owners)]
        return null_law(np.max(chosen, axis=1))


@dataclass(frozen=True, slots=True)
class Centre:
    """Where the priors of a drawn data set stand: P times the centre, as `prior_pull` has it.

    Data are drawn where the nuisances were estimated, and their priors around them, as far away as
    tolerances allow: for a linear model that is the same as to draw the nuisances, and it stays
    where the sensitivities were taken.
    """

    shared: FloatArray
    starts: tuple[FloatArray, ...]

    def pull(self, given: Nuisances, point: Point) -> tuple[FloatArray, list[FloatArray]]:
        """Return P (η − centre)."""
        shared, starts = prior_pull(given, point)
        return shared - self.shared, [a - b for a, b in zip(starts, self.starts, strict=True)]


def draw_centre(given: Nuisances, point: Point, generator: np.random.Generator) -> Centre:
    """Draw centres: tolerances uniform with their standard deviation, starts normal."""
    shared, starts = prior_pull(given, point)
    wide = generator.uniform(-np.sqrt(3.0), np.sqrt(3.0), shared.size)
    moved = shared + wide * np.sqrt(given.shared_precision)
    own = [
        pull + generator.standard_normal(pull.size) * np.sqrt(given.start_precision(run))
        for run, pull in enumerate(starts)
    ]
    return Centre(moved, tuple(own))


@dataclass(frozen=True, slots=True)
class Chord:
    """Solves for the nuisances of a data set with sensitivities that are fixed."""

    inverse: FloatArray
    given: Nuisances
    point: Point

    def solved(
        self,
        residuals: Sequence[FloatArray],
        rounds: int,
        problem: Problem,
        centre: Centre,
    ) -> tuple[Point, list[FloatArray]]:
        """Return the nuisances' point of these data, and the residuals there."""
        point, current = self.point, list(residuals)
        for _ in range(rounds):
            pull, pulls = centre.pull(self.given, point)
            count = len(self.given.shared)
            slopes = [
                columns.T @ residual
                for columns, residual in zip(self.given.columns, current, strict=True)
            ]
            shared = pull + sum(slope[:count] for slope in slopes)
            own = [slope[count:] + p for slope, p in zip(slopes, pulls, strict=True)]
            step = -self.inverse @ np.concatenate([shared, *own])
            values = dict(point.shared)
            for parameter, number in zip(self.given.shared, step[:count], strict=True):
                values[parameter.name] = values.get(parameter.name, 0.0) + float(number)
            starts, offset = [], count
            for run, parameters in enumerate(self.given.starts):
                mine = dict(point.starts[run])
                for parameter in parameters:
                    mine[parameter.name] = mine.get(parameter.name, 0.0) + float(step[offset])
                    offset += 1
                starts.append(mine)
            point = Point(values, tuple(starts))
            current = [problem.residual(run, point.values(run)) for run in range(len(current))]
        return point, current


def chord(given: Nuisances, point: Point) -> Chord:
    """Return the solver for these sensitivities."""
    count = len(given.shared)
    size = count + sum(len(starts) for starts in given.starts)
    matrix = np.zeros((size, size))
    matrix[np.arange(count), np.arange(count)] = given.shared_precision
    offset = count
    for run, starts in enumerate(given.starts):
        index = np.concatenate([np.arange(count), np.arange(offset, offset + len(starts))])
        matrix[np.ix_(index, index)] += given.columns[run].T @ given.columns[run]
        rows = np.arange(offset, offset + len(starts))
        matrix[rows, rows] += given.start_precision(run)
        offset += len(starts)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inner = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return Chord(inner / np.outer(scale, scale), given, point)


LOST = 100.0
"""Standard deviations that no healthy innovation reaches. A draw with one has swum out of what the
predictor can follow, such as backwards, where lift has no meaning: it says nothing of healthy data
that are like the measured ones, and is left out."""


def draw_healthy(
    problem: Problem,
    point: Point,
    given: Nuisances,
    screen: Screen,
    noise: NoiseEstimate,
    count: int,
    seed: int,
    progress: Progress,
) -> Calibration:
    """Draw healthy data sets and judge each as the measured ones are judged."""
    solver = chord(given, point)
    signals = [problem.model.signals(run, point.values(i)) for i, run in enumerate(problem.runs)]
    serial = replace(problem, workers=Workers(1))

    def one(index: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        generator = np.random.default_rng([seed, 0xCA11, index])
        random = drawn(noise, generator)
        runs = tuple(
            problem.model.draw(run, point.values(i), random, generator)
            for i, run in enumerate(problem.runs)
        )
        healthy = replace(serial, runs=runs)
        first = healthy.residuals(point)
        centre = draw_centre(given, point, generator)
        settled, residuals = solver.solved(first, 1, healthy, centre)
        if max(float(np.max(np.abs(residual))) for residual in residuals) > LOST:
            return None
        blocks = block_scores(screen, residuals)
        scores = pulled(screen.projection, *centre.pull(given, settled)) + blocks.sum(axis=0)
        return scores, blocks, structure_statistics(healthy, residuals, signals)

    gains, families, structures = [], [], []
    batch = 16
    for begin in range(0, count, batch):
        drawn_sets = problem.workers.map(one, range(begin, min(begin + batch, count)))
        found = [each for each in drawn_sets if each is not None]
        if not found:
            continue
        scores, blocks = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        gains.append(judge_many(screen, scores, blocks))
        families.append(judge_families(screen, scores, blocks))
        structures.append(np.array([f[2] for f in found]))
        progress("Drawing healthy data", min(begin + batch, count) / count)
    if not gains:
        raise ValueError("the model follows no data set that it draws: its noise is too large")
    return Calibration(np.vstack(gains), np.vstack(families), np.vstack(structures))


def cache_directory() -> Path:
    """Return where calibrations are kept: XDG_CACHE_HOME, else ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "fishbed" / "diagnosis"


def digest(
    problem: Problem,
    point: Point,
    given: Nuisances,
    screen: Screen,
    noise: NoiseEstimate,
    count: int,
    seed: int,
) -> str:
    """Return the key of a calibration: all that it depends on, but for the programme itself.

    The model and the inputs of its runs are in the sensitivities.
    """
    key = hashlib.sha256()
    signals = [problem.model.signals(run, point.values(i)) for i, run in enumerate(problem.runs)]
    runs = [(run.time_s, run.channel, run.value, run.at_rest) for run in problem.runs]
    filters = [(fixed.gain, fixed.variance) for fixed in problem.filters]
    statistics = structure(problem, signals)
    _feed(key, (VERSION, count, seed, runs, filters, point, given, screen, noise, statistics))
    return key.hexdigest()


def _feed(key: Any, thing: Any) -> None:
    """Feed plain data into a hash, each piece with its kind and size: none runs into another.

    Raises ``TypeError`` for what has no plain data.
    """
    if isinstance(thing, np.ndarray):
        key.update(f"array {thing.dtype.str} {thing.shape} ".encode())
        key.update(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, Enum):
        _feed(key, thing.name)
    elif is_dataclass(thing):
        _feed(key, [type(thing).__name__, *(getattr(thing, f.name) for f in fields(thing))])
    elif isinstance(thing, Mapping):
        _feed(key, sorted(thing.items()))
    elif isinstance(thing, (list, tuple)):
        key.update(f"{len(thing)} of ".encode())
        for each in thing:
            _feed(key, each)
    elif thing is None or isinstance(thing, (str, int, float, np.generic)):
        key.update(f"{type(thing).__name__} {thing!r} ".encode())
    else:
        raise TypeError(f"a calibration that depends on {type(thing).__name__} has no digest")


def calibrate(
    problem: Problem,
    point: Point,
    given: Nuisances,
    screen: Screen,
    noise: NoiseEstimate,
    count: int,
    seed: int,
    progress: Progress,
    directory: Path | None,
) -> Calibration:
    """Return the calibration from the cache ``directory``, or draw it and keep it there."""
    if directory is None:
        return draw_healthy(problem, point, given, screen, noise, count, seed, progress)
    path = directory / f"{digest(problem, point, given, screen, noise, count, seed)}.npz"
    note = ""
    try:
        with path.open("rb") as before, np.load(before) as kept:
            return Calibration(kept["gains"], kept["families"], kept["structure"], cached=True)
    except FileNotFoundError:
        pass
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        note = f"{path}: the kept calibration is damaged; it was drawn anew, and replaced"
    found = draw_healthy(problem, point, given, screen, noise, count, seed, progress)
    found = replace(found, note=note)
    with contextlib.suppress(OSError):  # a cache that cannot be written is no reason to fail
        directory.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=directory, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(
                    file, gains=found.gains, families=found.families, structure=found.structure
                )
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    return found
