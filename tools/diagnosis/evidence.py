"""Whitened residuals, their sensitivities, and the linear algebra that judges candidates with them.

A model with values θ predicts each measurement with gains that were fixed once; the innovations
divided by their standard deviations are the residuals r(θ). With Gaussian priors of the nuisances
η, twice the log-likelihood is −Σ r² − Σ η²/sd² + const, so everything is least squares. Around a
point, r(θ + δ) ≈ r + J δ, where the columns of J are secants at sizes that matter.

Nuisances are eliminated by the Schur complement: with H = Jₙᵀ Jₙ + P (P the priors' precisions),

    information  I = JᵀJ − JᵀJₙ H⁻¹ JₙᵀJ,      score  s = −(Jᵀr − JᵀJₙ H⁻¹ (Jₙᵀr + P η)),

and a candidate's gain in twice the log-likelihood is sᵀ I⁻¹ s: the score test of Rao (1948), which
for linear Gaussian models is the likelihood ratio. The starts of a run are its own, so they are
eliminated run by run; what all runs share is eliminated from the sum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tools.diagnosis.model import Filter, FloatArray, IntArray, Model, Noise, Parameter, Run, Values
from tools.diagnosis.workers import Workers

LARGE = 1e4
"""What stands for the residual of a prediction that is not finite: worse than any that is."""


@dataclass(frozen=True, slots=True)
class Point:
    """Values: ``shared`` by all runs (tolerances, causes), and each run's ``starts``."""

    shared: Values
    starts: tuple[Values, ...]

    def values(self, run: int) -> dict[str, float]:
        """Return all values of one run."""
        return {**self.shared, **self.starts[run]}

    def moved(self, shared: Values) -> Point:
        """Return this point with some shared values replaced."""
        return Point({**self.shared, **shared}, self.starts)


@dataclass(frozen=True, slots=True)
class Shift:
    """An error of one channel's sensor, per unit: a constant, a drift over the run, a sine...

    ``other``: the channel that it follows, where that is not its own.
    """

    channel: int
    shape: str
    other: int | None = None

    def error(self, run: Run, predicted: FloatArray, size: float) -> FloatArray:
        """Return the sensor's error (n,).

        It follows what was predicted, never the measurement itself: that holds the very noise. Of
        another channel it is the prediction before, for the next one knows of this measurement.
        """
        mine = run.channel == self.channel
        followed = predicted
        if self.other is not None:
            theirs = np.flatnonzero(run.channel == self.other)
            if not theirs.size:
                return np.zeros_like(predicted)
            before = np.searchsorted(theirs, np.arange(predicted.size)) - 1
            followed = predicted[theirs[np.maximum(before, 0)]]
        return np.where(mine, size * SHAPES[self.shape](run.time_s, followed), 0.0)


def _drift(time_s: FloatArray, _predicted: FloatArray) -> FloatArray:
    length = max(float(time_s[-1] - time_s[0]), 1e-9)
    drift: FloatArray = (time_s - time_s[0]) / length
    return drift


SHAPES: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "offset": lambda time_s, _predicted: np.ones(time_s.size),
    "drift": _drift,
    "scale": lambda _time_s, predicted: predicted,
    "cube": lambda _time_s, predicted: predicted**3,
    "sine": lambda _time_s, predicted: np.sin(predicted),
    "cosine": lambda _time_s, predicted: np.cos(predicted),
    "sine of twice": lambda _time_s, predicted: np.sin(2.0 * predicted),
    "cosine of twice": lambda _time_s, predicted: np.cos(2.0 * predicted),
    "share": lambda _time_s, predicted: predicted,
    "square": lambda _time_s, predicted: predicted**2,
}
ALWAYS, OF_OTHERS = ("offset", "drift"), ("share", "square")
OF_ANGLES = ("sine", "cosine", "sine of twice", "cosine of twice")
OF_LENGTHS = ("scale", "cube")
"""Shapes for any channel, of any other that is no angle, of an angle itself, of anything else."""


def sensor_terms(model: Model, runs: Sequence[Run]) -> dict[str, Shift]:
    """Return the errors that any measured channel may have, by the names of their parameters."""
    present = [
        index
        for index in range(len(model.channels))
        if any((run.channel == index).any() for run in runs)
    ]
    terms = {}
    for index in present:
        channel = model.channels[index]
        for shape in ALWAYS + (OF_ANGLES if channel.angle else OF_LENGTHS):
            terms[f"{channel.name}: {shape}"] = Shift(index, shape)
        for other in present:
            followed = model.channels[other]
            if other != index and not followed.angle:
                for shape in OF_OTHERS:
                    name = f"{channel.name}: {shape} of {followed.name}"
                    terms[name] = Shift(index, shape, other)
    return terms


@dataclass(frozen=True, slots=True)
class Problem:
    """A model with measured runs, and the whitening under which all candidates are judged."""

    model: Model
    runs: tuple[Run, ...]
    starts: tuple[tuple[Parameter, ...], ...]
    noise: Noise
    filters: tuple[Filter, ...]
    workers: Workers
    sensor: Mapping[str, Shift]
    predicted: tuple[FloatArray, ...]
    masks: tuple[FloatArray, ...] | None = None
    """Per run, one where a row counts and zero where it does not; None: all count."""
    doubted: frozenset[int] = frozenset()
    """Channels whose given sigma the data contradict: it is estimated like that of others."""

    def residual(self, run: int, values: Values) -> FloatArray:
        """Return the whitened innovations of one run (n,), finite.

        Values of sensor terms are taken out of the measurements; the model sees the others.
        """
        measured, values = self.measured(run, values)
        innovation = self.model.innovations(measured, values, self.filters[run])
        bounded = _bounded(innovation / np.sqrt(self.filters[run].variance))
        return bounded if self.masks is None else bounded * self.masks[run]

    def measured(self, run: int, values: Values) -> tuple[Run, dict[str, float]]:
        """Return a run without the errors of sensors among some values, and the other values."""
        measured = self.runs[run]
        for name in (n for n in self.sensor if n in values):
            error = self.sensor[name].error(self.runs[run], self.predicted[run], values[name])
            measured = replace(measured, value=measured.value - error)
        return measured, {name: x for name, x in values.items() if name not in self.sensor}

    def residuals(self, point: Point, runs: Sequence[int] | None = None) -> list[FloatArray]:
        """Return the residuals of some runs (all of them by default) at a point."""
        chosen = range(len(self.runs)) if runs is None else runs
        return self.workers.map(lambda run: self.residual(run, point.values(run)), chosen)

    def believed(self, values: Values) -> dict[str, float]:
        """Return the nuisances among values of a run: what the estimator is designed around.

        Were it designed around a candidate, that one would have an advantage over all others.
        """
        known = {p.name for p in self.model.tolerances}
        known.update(p.name for starts in self.starts for p in starts)
        return {name: x for name, x in values.items() if name in known}

    def likelihood(self, point: Point) -> float:
        """Return −2 log L of a point with an estimator of its own, less what all points share.

        Fixed gains are good enough to look around; but gains that were made for another model
        belittle those that are far from it. On the scale of Σ r² with the fixed ones.
        """

        def one(run: int) -> float:
            measured, values = self.measured(run, point.values(run))
            own = self.model.filter(measured, values, self.noise)
            innovation = self.model.innovations(measured, values, own)
            white = _bounded(innovation / np.sqrt(own.variance))
            terms = white * white + np.log(own.variance / self.filters[run].variance)
            return float(np.sum(terms if self.masks is None else terms * self.masks[run]))

        return sum(self.workers.map(one, range(len(self.runs))))

    def with_noise(self, noise: Noise, point: Point) -> Problem:
        """Return the problem with filters designed anew for this noise, around this point."""
        filters = design(self, noise, point)
        values = [
            {k: x for k, x in point.values(i).items() if k not in self.sensor}
            for i in range(len(self.runs))
        ]
        predicted = tuple(
            self.runs[i].value - self.model.innovations(self.runs[i], values[i], filters[i])
            for i in range(len(self.runs))
        )
        return replace(self, noise=noise, filters=filters, predicted=predicted)


def _bounded(white: FloatArray) -> FloatArray:
    """Return whitened innovations that are finite."""
    finite = np.nan_to_num(white, nan=LARGE, posinf=LARGE, neginf=-LARGE)
    bounded: FloatArray = np.clip(finite, -LARGE, LARGE)
    return bounded


def design(problem: Problem, noise: Noise, point: Point) -> tuple[Filter, ...]:
    """Return a filter per run, designed around the nuisances of ``point``."""
    return tuple(
        problem.workers.map(
            lambda run: problem.model.filter(
                problem.runs[run], problem.believed(point.values(run)), noise
            ),
            range(len(problem.runs)),
        )
    )


def neutral(problem: Problem) -> Point:
    """Return the believed model."""
    return Point({}, tuple({} for _ in problem.runs))


def start_problem(model: Model, runs: Sequence[Run], workers: Workers) -> Problem:
    """Return the problem with a rough first noise, around the believed model."""
    every = tuple(runs)
    noise = model.first_noise(every)
    starts = tuple(model.starts(run) for run in every)
    bare = Problem(model, every, starts, noise, (), workers, sensor_terms(model, every), ())
    return bare.with_noise(noise, neutral(bare))


def columns(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    steps: Sequence[Values],
) -> list[FloatArray]:
    """Return, per run, the change of the residuals (n, steps) when shared values are set so."""
    tasks = [(run, step) for run in range(len(problem.runs)) for step in steps]

    def change(task: tuple[int, Values]) -> FloatArray:
        run, step = task
        return problem.residual(run, {**point.values(run), **step}) - residuals[run]

    found = problem.workers.map(change, tasks)
    width = len(steps)
    return [
        np.column_stack(found[run * width : (run + 1) * width])
        if width
        else np.zeros((residuals[run].size, 0))
        for run in range(len(problem.runs))
    ]


def responses(problem: Problem, point: Point, names: Sequence[str]) -> list[FloatArray]:
    """Return, per run, the slopes (n, names) of the residuals to terms without a name.

    A column of NaN where only a difference tells.
    """
    forces = [name for name in names if name not in problem.sensor]
    sensors = [name for name in names if name in problem.sensor]
    place = [names.index(name) for name in (*forces, *sensors)]

    def one(run: int) -> FloatArray:
        measured, values = problem.measured(run, point.values(run))
        fixed = problem.filters[run]
        errors = np.zeros((measured.time_s.size, len(sensors)))
        for column, name in enumerate(sensors):
            errors[:, column] = problem.sensor[name].error(measured, problem.predicted[run], 1.0)
        told = problem.model.responses(measured, values, fixed, forces, errors)
        found = np.empty_like(told)
        found[:, place] = told / np.sqrt(fixed.variance)[:, None]
        return found if problem.masks is None else found * problem.masks[run][:, None]

    return problem.workers.map(one, range(len(problem.runs)))


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Sensitivities to what is known only within tolerances, at one point.

    ``shared`` and ``starts``: their parameters. ``columns``: per run, (n, shared + its starts), per
    unit of the parameters.
    """

    shared: tuple[Parameter, ...]
    starts: tuple[tuple[Parameter, ...], ...]
    columns: tuple[FloatArray, ...]

    @property
    def shared_precision(self) -> FloatArray:
        """Prior precisions of the shared ones."""
        return np.array([p.prior_sd**-2.0 for p in self.shared])

    def start_precision(self, run: int) -> FloatArray:
        """Prior precisions of one run's start."""
        return np.array([p.prior_sd**-2.0 for p in self.starts[run]])


def nuisances(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    sizes: dict[str, float],
    runs: Sequence[int] | None = None,
) -> Nuisances:
    """Return the sensitivities to all nuisances; ``sizes`` remembers steps that were suitable.

    A step is as large as changes the residuals by about two standard deviations in all, and no
    larger than the tolerance: large enough to see over kinks, small enough to be straight.
    """
    chosen = list(range(len(problem.runs)) if runs is None else runs)
    shared = problem.model.tolerances
    tasks: list[tuple[int, Parameter, str]] = []
    for run in chosen:
        tasks += [(run, parameter, parameter.name) for parameter in shared]
        tasks += [(run, p, f"{run}/{p.name}") for p in problem.starts[run]]

    def change(task: tuple[int, Parameter, str]) -> tuple[FloatArray, float]:
        run, parameter, key = task
        values = point.values(run)
        here = values.get(parameter.name, 0.0)
        most = parameter.prior_sd if np.isfinite(parameter.prior_sd) else np.inf
        size = sizes.get(f"{run}/{key}", min(parameter.scale, most))
        if here + size > parameter.most:
            size = -size
        moved = np.zeros_like(residuals[run])
        for _ in range(4):
            moved = problem.residual(run, {**values, parameter.name: here + size}) - residuals[run]
            length = float(np.linalg.norm(moved))
            if length <= 6.0 and (length >= 0.3 or abs(size) >= most * 0.999):
                break
            size *= min(2.0 / max(length, 1e-6), 1e3)
            size = float(np.clip(size, -most, most))
        return moved / size, abs(size)

    found = problem.workers.map(change, tasks)
    for (run, _, key), (_, size) in zip(tasks, found, strict=True):
        sizes[f"{run}/{key}"] = size
    by_run: dict[int, list[FloatArray]] = {run: [] for run in chosen}
    for (run, _, _), (column, _) in zip(tasks, found, strict=True):
        by_run[run].append(column)
    stacked = []
    for run, residual in enumerate(residuals):
        parts = by_run.get(run, [])
        width = len(shared) + len(problem.starts[run])
        empty = np.zeros((residual.size, width))
        stacked.append(np.column_stack(parts) if parts else empty)
    return Nuisances(shared, problem.starts, tuple(stacked))


def with_free(
    given: Nuisances, free: Sequence[Parameter], columns_: Sequence[FloatArray]
) -> Nuisances:
    """Return the nuisances with free parameters (no prior) beside the shared ones."""
    if not free:
        return given
    count = len(given.shared)
    stacked = tuple(
        np.column_stack([old[:, :count], new, old[:, count:]])
        for old, new in zip(given.columns, columns_, strict=True)
    )
    return Nuisances(
        (*given.shared, *(replace(p, prior_sd=np.inf) for p in free)), given.starts, stacked
    )


def prior_pull(given: Nuisances, point: Point) -> tuple[FloatArray, list[FloatArray]]:
    """Return P η of the shared nuisances, and of each run's starts."""
    shared = np.array([point.shared.get(p.name, 0.0) for p in given.shared])
    pulls = []
    for run, parameters in enumerate(given.starts):
        here = np.array([point.starts[run].get(p.name, 0.0) for p in parameters])
        pulls.append(here * given.start_precision(run))
    return shared * given.shared_precision, pulls


@dataclass(frozen=True, slots=True)
class Projection:
    """Candidate columns with what nuisances can explain taken out.

    ``columns``: per run (n, c). ``information`` (c, c). ``shared`` (shared, c) and ``starts`` per
    run (starts, c): how the nuisances follow a candidate; ``prior`` (c, c): the part of the
    information that comes from their priors.
    """

    columns: tuple[FloatArray, ...]
    information: FloatArray
    shared: FloatArray
    starts: tuple[FloatArray, ...]
    prior: FloatArray


def solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a symmetric system of rows with very different scales; singular directions stay put."""
    if matrix.size == 0:
        return np.zeros_like(right)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    kept = values > 1e-12 * max(float(values[-1]), 1e-300)
    inner = vectors[:, kept].T @ (right / scale[:, None])
    solved: FloatArray = vectors[:, kept] @ (inner / values[kept, None])
    return solved / scale[:, None]


def project(given: Nuisances, candidates: Sequence[FloatArray]) -> Projection:
    """Take out of candidate columns (per run (n, c)) what the nuisances can explain."""
    count = len(given.shared)
    width = candidates[0].shape[1]
    gram = np.zeros((count + width, count + width))
    gram[:count, :count] = np.diag(given.shared_precision)
    follow = []
    for run, columns_ in enumerate(candidates):
        both = np.column_stack([given.columns[run][:, :count], columns_])
        own = given.columns[run][:, count:]
        cross = own.T @ both
        inner = own.T @ own + np.diag(given.start_precision(run))
        follow.append(solved(inner, cross))
        gram += both.T @ both - cross.T @ follow[run]
    shared = solved(gram[:count, :count], gram[:count, count:])
    information = gram[count:, count:] - gram[count:, :count] @ shared
    cleaned, starts = [], []
    prior = (shared.T * given.shared_precision) @ shared
    for run, columns_ in enumerate(candidates):
        own = follow[run][:, count:] - follow[run][:, :count] @ shared
        starts.append(own)
        prior += (own.T * given.start_precision(run)) @ own
        cleaned.append(columns_ - given.columns[run] @ np.vstack([shared, own]))
    information = 0.5 * (information + information.T)
    return Projection(tuple(cleaned), information, shared, tuple(starts), prior)


def score(
    given: Projection,
    residuals: Sequence[FloatArray],
    pull: FloatArray,
    pulls: Sequence[FloatArray],
) -> FloatArray:
    """Return the score (c,) of each candidate: the slope of the log-likelihood at size zero."""
    total = pulled(given, pull, pulls)
    for columns_, residual in zip(given.columns, residuals, strict=True):
        total = total - columns_.T @ residual
    return total


def pulled(given: Projection, pull: FloatArray, pulls: Sequence[FloatArray]) -> FloatArray:
    """Return the part of the scores (c,) that comes from the nuisances' priors."""
    total: FloatArray = given.shared.T @ pull
    for starts, own in zip(given.starts, pulls, strict=True):
        total = total + starts.T @ own
    return total


def cosines(information: FloatArray) -> FloatArray:
    """Return cosines between candidates after nuisances are taken out, from their information."""
    length = np.sqrt(np.maximum(np.diag(information), 1e-300))
    found: FloatArray = information / np.outer(length, length)
    return found


def time_blocks(run: Run, block_s: float) -> IntArray:
    """Return the first row of each block of a run, of at least ``block_s`` each.

    Rows of a run without a duration, such as a table's, are blocks each: no time connects them.
    """
    length = float(run.time_s[-1] - run.time_s[0])
    if length == 0.0:
        return np.arange(run.time_s.size, dtype=np.int64)
    count = max(int(length / block_s), 1)
    edges = run.time_s[0] + length * np.arange(count) / count
    return np.unique(np.searchsorted(run.time_s, edges, side="left")).astype(np.int64)


def sums_of_squares(residuals: Sequence[FloatArray]) -> float:
    """Return the sum of squares over runs."""
    return float(sum(residual @ residual for residual in residuals))
