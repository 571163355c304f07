"""Bounded nonlinear least squares over nuisances and the parameters of causes.

The steps are Levenberg's (1944) and Marquardt's (1963), with parameters that press against a bound
held there. Sensitivities to nuisances barely change along a fit, so they are taken once and the
minimum is approached as by a chord (the residuals are always those of the full nonlinear model);
at the end they are taken anew and the fit goes on until it does not gain any more. Sensitivities
to the causes are taken anew in every iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tools.diagnosis.evidence import Nuisances, Point, Problem, nuisances, sums_of_squares
from tools.diagnosis.model import FloatArray, IntArray, Parameter

ENOUGH = 0.02
"""A step that promises less than this in twice the log-likelihood is not taken any more."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A minimum: ``objective`` is Σ r² + Σ η²/sd² over the runs that were fitted.

    ``residuals`` of the fitted runs, in their order; ``covariance`` (free, free) of the free
    parameters after nuisances are taken out; ``columns``: per fitted run, their sensitivities.
    """

    point: Point
    objective: float
    residuals: tuple[FloatArray, ...]
    nuisances: Nuisances
    free: tuple[Parameter, ...]
    covariance: FloatArray
    runs: tuple[int, ...]
    columns: tuple[FloatArray, ...]

    def estimates(self) -> dict[str, float]:
        """Return the free parameters' values."""
        return {p.name: self.point.shared.get(p.name, 0.0) for p in self.free}


def prior_cost(point: Point, given: Nuisances, runs: Sequence[int], shared: bool = True) -> float:
    """Return Σ η²/sd² of the shared nuisances (if asked) and of the runs' starts."""
    cost = 0.0
    if shared:
        for p in given.shared:
            cost += (point.shared.get(p.name, 0.0) / p.prior_sd) ** 2
    for run in runs:
        for p in given.starts[run]:
            cost += (point.starts[run].get(p.name, 0.0) / p.prior_sd) ** 2
    return cost


def cost_at(problem: Problem, point: Point, given: Nuisances) -> float:
    """Return the objective of all runs at a point that is not fitted."""
    every = range(len(problem.runs))
    return sums_of_squares(problem.residuals(point)) + prior_cost(point, given, every)


def costs_beside(problem: Problem, points: Sequence[Point], given: Nuisances) -> list[float]:
    """Return the objectives at points once the nuisances follow, as far as they are straight.

    What stands in for a cause before it is included must give way to it, or the cause seems to cost
    more the nearer it comes to its place.
    """
    every = range(len(problem.runs))
    equations = _Equations.of(given, every, frozen=False)
    active = np.flatnonzero(np.diag(equations.matrix) > 0.0)
    inner = equations.matrix[np.ix_(active, active)]
    scale = np.sqrt(np.diag(inner))
    inner = inner / np.outer(scale, scale)
    found = []
    for point in points:
        residuals = problem.residuals(point)
        slope = equations.slope(residuals, point)[active] / scale
        follow = float(slope @ np.linalg.solve(inner, slope))
        found.append(sums_of_squares(residuals) + prior_cost(point, given, every) - follow)
    return found


def _free_columns(
    problem: Problem,
    point: Point,
    residuals: Sequence[FloatArray],
    runs: Sequence[int],
    free: Sequence[Parameter],
    sizes: dict[str, float],
) -> list[FloatArray]:
    """Return per run (n, free) the sensitivities to the free parameters, per unit."""
    result = [np.zeros((residual.size, len(free))) for residual in residuals]
    for index, parameter in enumerate(free):
        here = point.shared.get(parameter.name, 0.0)
        size = sizes.get(f"free/{parameter.name}", 0.3 * parameter.scale)
        for attempt in range(5):
            step = size if here + size <= parameter.most else -size
            moved_point = point.moved({parameter.name: here + step})
            moved = problem.residuals(moved_point, runs)
            change = [m - r for m, r in zip(moved, residuals, strict=True)]
            length = float(np.sqrt(sums_of_squares(change)))
            for column, one in zip(result, change, strict=True):
                column[:, index] = one / step
            if 0.5 <= length <= 8.0 or attempt == 4:
                break
            size = min(
                size * float(np.clip(3.0 / max(length, 1e-9), 1e-4, 8.0)), 10.0 * parameter.scale
            )
        sizes[f"free/{parameter.name}"] = size
    return result


@dataclass(frozen=True, slots=True)
class _Equations:
    """Normal equations over shared nuisances and the starts of the fitted runs.

    ``matrix``: of these, with their priors; they stay while sensitivities do. ``rows``: per fitted
    run, its columns that are fitted, and their places in the matrix. Free parameters come last.
    """

    matrix: FloatArray
    rows: tuple[tuple[FloatArray, IntArray], ...]
    labels: tuple[tuple[int, Parameter], ...]

    @classmethod
    def of(cls, given: Nuisances, runs: Sequence[int], frozen: bool) -> _Equations:
        """Assemble them; ``frozen`` leaves the shared nuisances out."""
        labels = _labels(given, runs, (), frozen)
        shared, count = len(given.shared), 0 if frozen else len(given.shared)
        precision = [p.prior_sd**-2.0 for _, p in labels]
        matrix = np.diag(np.array(precision)) if labels else np.zeros((0, 0))
        rows, offset = [], count
        for run in runs:
            width = len(given.starts[run])
            place = np.concatenate([np.arange(count), np.arange(offset, offset + width)])
            columns = given.columns[run]
            mine = columns[:, shared:] if frozen else columns
            matrix[np.ix_(place, place)] += mine.T @ mine
            rows.append((mine, place))
            offset += width
        return cls(matrix, tuple(rows), tuple(labels))

    def bordered(self, free: Sequence[FloatArray]) -> FloatArray:
        """Return the matrix with the free parameters, whose columns these are per fitted run."""
        size, width = self.matrix.shape[0], free[0].shape[1]
        whole = np.zeros((size + width, size + width))
        whole[:size, :size] = self.matrix
        for (mine, place), own in zip(self.rows, free, strict=True):
            whole[place, size:] += mine.T @ own
            whole[size:, size:] += own.T @ own
        whole[size:, :size] = whole[:size, size:].T
        return whole

    def slope(
        self, residuals: Sequence[FloatArray], point: Point, free: Sequence[FloatArray] = ()
    ) -> FloatArray:
        """Return half the slope of the objective at a point with these residuals."""
        pull = np.array([_value(point, label) * label[1].prior_sd ** -2.0 for label in self.labels])
        for (mine, place), residual in zip(self.rows, residuals, strict=True):
            pull[place] += mine.T @ residual
        own = [
            columns.T @ residual for columns, residual in zip(free, residuals, strict=bool(free))
        ]
        return np.concatenate([pull, np.sum(own, axis=0)]) if free else pull


def _labels(
    given: Nuisances, runs: Sequence[int], free: Sequence[Parameter], frozen: bool
) -> list[tuple[int, Parameter]]:
    """Return for each unknown the run it belongs to (-1: shared) and its parameter."""
    labels = [] if frozen else [(-1, p) for p in given.shared]
    for run in runs:
        labels += [(run, p) for p in given.starts[run]]
    return labels + [(-1, p) for p in free]


def _value(point: Point, label: tuple[int, Parameter]) -> float:
    run, parameter = label
    values = point.shared if run < 0 else point.starts[run]
    return float(values.get(parameter.name, 0.0))


def _stepped(point: Point, labels: Sequence[tuple[int, Parameter]], numbers: FloatArray) -> Point:
    shared = dict(point.shared)
    starts = [dict(values) for values in point.starts]
    for (run, parameter), number in zip(labels, numbers, strict=True):
        (shared if run < 0 else starts[run])[parameter.name] = float(number)
    return Point(shared, tuple(starts))


def fit(
    problem: Problem,
    point: Point,
    free: Sequence[Parameter],
    sizes: dict[str, float],
    *,
    runs: Sequence[int] | None = None,
    given: Nuisances | None = None,
    frozen: bool = False,
    refresh: bool = True,
    iterations: int = 12,
) -> Fit:
    """Minimise over nuisances and ``free``; ``frozen`` keeps the shared ones where they are.

    ``given`` are sensitivities from a point nearby (taken here where absent); ``refresh`` takes
    them anew when their minimum is reached. ``sizes`` remembers suitable steps between calls.
    """
    chosen = tuple(range(len(problem.runs)) if runs is None else runs)
    every: list[FloatArray] = [np.zeros(run.time_s.size) for run in problem.runs]

    def evaluate(at: Point) -> list[FloatArray]:
        return problem.residuals(at, chosen)

    def jacobian(at: Point, residuals: Sequence[FloatArray]) -> Nuisances:
        full = list(every)
        for run, residual in zip(chosen, residuals, strict=True):
            full[run] = residual
        return nuisances(problem, at, full, sizes, chosen)

    residuals = evaluate(point)
    stale = given is not None
    known = given if given is not None else jacobian(point, residuals)
    equations = _Equations.of(known, chosen, frozen)
    labels = _labels(known, chosen, free, frozen)
    least = np.array([p.least for _, p in labels])
    most = np.array([p.most for _, p in labels])
    objective = sums_of_squares(residuals) + prior_cost(point, known, chosen, not frozen)
    damping = 1e-3
    columns: list[FloatArray] | None = None
    for _ in range(iterations):
        if columns is None:
            columns = _free_columns(problem, point, residuals, chosen, free, sizes)
        matrix, slope = equations.bordered(columns), equations.slope(residuals, point, columns)
        here = np.array([_value(point, label) for label in labels])
        pressed = ((here <= least) & (slope > 0)) | ((here >= most) & (slope < 0))
        active = np.flatnonzero(~pressed & (np.diag(matrix) > 0.0))
        if active.size == 0:
            break
        inner = matrix[np.ix_(active, active)]
        scale = np.sqrt(np.diag(inner))
        damped = inner / np.outer(scale, scale) + damping * np.eye(active.size)
        step = -np.linalg.solve(damped, slope[active] / scale) / scale
        target = here.copy()
        target[active] += step
        target = np.clip(target, least, most)
        taken = target - here
        promise = -(2.0 * slope @ taken + taken @ matrix @ taken)
        if promise < ENOUGH:
            if stale and refresh:
                known, stale, columns = jacobian(point, residuals), False, None
                equations = _Equations.of(known, chosen, frozen)
                continue
            break
        candidate = _stepped(point, labels, target)
        tried = evaluate(candidate)
        cost = sums_of_squares(tried) + prior_cost(candidate, known, chosen, not frozen)
        if cost < objective:
            better = objective - cost
            point, residuals, objective = candidate, tried, cost
            damping = max(damping * 0.2, 1e-6)
            columns = None
            if better < 0.5 * ENOUGH and not (stale and refresh):
                break
        else:
            damping = max(damping * 8.0, 1e-2)
            if damping > 1e6:
                if stale and refresh:
                    known, stale, damping, columns = jacobian(point, residuals), False, 1e-3, None
                    equations = _Equations.of(known, chosen, frozen)
                    continue
                break
    if columns is None:
        columns = _free_columns(problem, point, residuals, chosen, free, sizes)
    covariance = _covariance(equations.bordered(columns), len(free))
    return Fit(
        point, objective, tuple(residuals), known, tuple(free), covariance, chosen, tuple(columns)
    )


def _covariance(matrix: FloatArray, count: int) -> FloatArray:
    """Return the covariance of the last ``count`` unknowns."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inner = matrix / np.outer(scale, scale)
    inverse = np.linalg.pinv(inner, rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    size = scale.size
    found: FloatArray = inverse[size - count :, size - count :]
    return found
