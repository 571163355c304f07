"""What a diagnosis gains on its held-out runs, beside a fit that knows what was hidden.

Four models are judged by the squared innovations that they leave on the runs that the diagnosis
held out: the believed one; the extended one, as the diagnosis handed it over; the oracle's, which
knows the true causes by name and estimates them on the same training runs; and the one with the
true values. A run's start is fitted on that run, for each of them.

The measure belongs to none of them: gains and whitening are those of the noise that the generator
truly made. Under a diagnosis' own noise, an effect that it did not find counts as noise, and the
oracle would gain next to nothing by it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tools.diagnosis.evidence import Point, neutral, sums_of_squares
from tools.diagnosis.model import Noise, Parameter
from tools.diagnosis.refit import Fit, fit
from tools.diagnosis.selection import free_of, table
from tools.diagnosis.workers import Workers

if TYPE_CHECKING:
    from tools.diagnosis.model import Cause
    from tools.diagnosis.result import Diagnosis


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Whitened squared errors on the held-out runs, in twice the log-likelihood; see the module."""

    believed: float
    extended: float
    oracle: float
    truth: float


def judge(
    diagnosis: Diagnosis, effects: Sequence[Mapping[str, Any]], noise: Noise, workers: int | None
) -> HeldOut:
    """Judge a diagnosis of whole runs; ``effects`` as an answer holds them, ``noise`` the true one.

    Fits begin from the believed values and from where the diagnosis left the tolerances; the lower
    minimum counts.
    """
    flags = diagnosis.traces.held_out
    held = tuple(i for i, flag in enumerate(flags) if flag)
    train = tuple(i for i, flag in enumerate(flags) if not flag)
    with Workers(workers) as crew:
        problem = replace(diagnosis.problem, workers=crew)
        problem = problem.with_noise(noise, neutral(problem))
        rows = table(problem)
        members = [rows[effect["name"]] for effect in effects]
        true: dict[str, float] = {}
        for member, effect in zip(members, effects, strict=True):
            true |= true_values(member.cause, effect["parameters"])
        sizes: dict[str, float] = {}

        def trained(starts: Sequence[Point], free: Sequence[Parameter] = ()) -> Fit:
            fits = [fit(problem, start, free, sizes, runs=train) for start in starts]
            return min(fits, key=lambda each: each.objective)

        def left(point: Point) -> float:
            placed = fit(problem, point, (), sizes, runs=held, frozen=True)
            return sums_of_squares(placed.residuals)

        starts = (neutral(problem), diagnosis.before)
        believed = trained(starts)
        truth = trained([start.moved(true) for start in starts])
        oracle = trained([truth.point], free_of(members))
        return HeldOut(
            left(believed.point), left(diagnosis.after), left(oracle.point), left(truth.point)
        )


def true_values(cause: Cause, numbers: Mapping[str, float]) -> dict[str, float]:
    """Return the values of a cause from the numbers that an answer tells.

    Of an amplitude with a phase the model's values are the two components.
    """
    if cause.show is None:
        return {f"{cause.name}.{short}": x for short, x in numbers.items()}
    size, angle = numbers.values()
    return cause.values(size * math.cos(angle), size * math.sin(angle))
