"""What a survey costs: the source's energy models (6.4) and (6.5), and their coefficients.

E = Σ_j (κ₁ Σ_i L_i + κ₂ m_j + κ₃ Σ_i Δθ_i²): way swum, samples taken, and, in (6.5), turns between
one leg and the next. (The text of (6.5) has an n before (Δθ_i)², which nothing explains: here each
step counts once.) The source gives no numbers. `EMULATED` holds those of the emulated robot, whose
account of energy is of every chip; docs/tours.md says how they were measured. `fitted` finds them
from any robots' ways and energies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray


@dataclass(frozen=True, slots=True)
class Effort:
    """What the energy models count: way in m, number of samples, turns in rad²."""

    metres: float = 0.0
    samples: float = 0.0
    square_radians: float = 0.0

    def __add__(self, other: Effort) -> Effort:
        """Return the effort of both."""
        return Effort(
            self.metres + other.metres,
            self.samples + other.samples,
            self.square_radians + other.square_radians,
        )


def effort(path_m: FloatArray, samples: int, heading_rad: float | None = None) -> Effort:
    """Return the effort of a path of straight legs, shape (n, 2), m.

    With a heading, the turn onto the first leg counts. Legs without length turn nobody.
    """
    steps = np.diff(np.asarray(path_m, dtype=np.float64).reshape(-1, 2), axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    headings = np.arctan2(steps[:, 1], steps[:, 0])[lengths > 0.0]
    if heading_rad is not None:
        headings = np.concatenate(([heading_rad], headings))
    turns = np.remainder(np.diff(headings) + math.pi, 2.0 * math.pi) - math.pi
    return Effort(float(lengths.sum()), samples, float(turns @ turns))


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """Coefficients κ₁, κ₂ and κ₃; without the last it is (6.4).

    Raises ``SurveyError`` for a coefficient that is negative or no number: least energy would then
    mean endless ways.
    """

    joules_per_metre: float
    joules_per_sample: float = 0.0
    joules_per_square_radian: float = 0.0

    def __post_init__(self) -> None:
        """Refuse energy out of nothing."""
        for value in (
            self.joules_per_metre, self.joules_per_sample, self.joules_per_square_radian,
        ):  # fmt: skip
            if not 0.0 <= value < math.inf:
                raise SurveyError(f"an energy coefficient is a number from 0 on, got {value!r}")

    def joules(self, effort: Effort) -> float:
        """Energy of an effort, J."""
        return (
            self.joules_per_metre * effort.metres
            + self.joules_per_sample * effort.samples
            + self.joules_per_square_radian * effort.square_radians
        )


EMULATED = EnergyModel(46.0, 3e-4, 3.2)
"""The bundled robot at 15° and 1 Hz, with everything on board switched on: 46 ± 5 J/m, 3.2 ± 0.7
J/rad² (docs/tours.md). It draws 1.4 W whatever it does, so way and turns cost the time that they
take. A sample stored and sent while passing is at most 0.3 mJ more: one that the robot waits for
costs 1.4 J a second."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """Coefficients in the order of the model's fields with their standard errors.

    ``residual_j``: standard deviation of what is left, with the degrees of freedom; NaN, as are the
    errors, where there are no more energies than coefficients.
    """

    coefficients: tuple[float, float, float]
    errors: tuple[float, float, float]
    residual_j: float

    @property
    def model(self) -> EnergyModel:
        """The model. Raises ``SurveyError`` where a coefficient came out negative."""
        return EnergyModel(*self.coefficients)


def fitted(efforts: Sequence[Effort], joules: Sequence[float]) -> Fitted:
    """Fit coefficients to measured energies by least squares.

    What no effort has (no turns, no samples) gets the coefficient 0 with the error 0. Raises
    ``SurveyError`` where efforts and energies are not as many, or where the efforts cannot tell two
    coefficients apart, such as samples that are always as many as metres.
    """
    rows = np.array([(e.metres, e.samples, e.square_radians) for e in efforts]).reshape(-1, 3)
    energies = np.array(joules, dtype=np.float64)
    if len(rows) != len(energies):
        raise SurveyError(f"{len(rows)} efforts and {len(energies)} energies")
    used = np.flatnonzero(rows.any(axis=0))
    scale = np.linalg.norm(rows[:, used], axis=0)
    counted = rows[:, used] / scale
    if used.size == 0 or np.linalg.matrix_rank(counted) < used.size:
        raise SurveyError("these efforts cannot tell the coefficients of energy apart")
    inverse = np.linalg.pinv(counted)
    found, errors = np.zeros(3), np.zeros(3)
    found[used] = inverse @ energies / scale
    rest = energies - rows @ found
    freedom = len(rows) - used.size
    residual = math.sqrt(rest @ rest / freedom) if freedom else math.nan
    errors[used] = residual * np.sqrt((inverse**2).sum(axis=1)) / scale
    way, sample, turn = map(float, found)
    way_error, sample_error, turn_error = map(float, errors)
    return Fitted((way, sample, turn), (way_error, sample_error, turn_error), residual)
