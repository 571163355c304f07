"""Algorithm 1 of the source's chapter 6: completion by inexact augmented Lagrange multipliers.

Of all matrices A that agree with the samples D on Ω, the one of least nuclear norm (6.1). With E
for what is not sampled (6.2) the augmented Lagrangian (6.3) is minimised over A, then over E, once
each before the multipliers Y move: Z. Lin, M. Chen, Y. Ma, "The augmented Lagrange multiplier
method for exact recovery of corrupted low-rank matrices", arXiv:1009.5055 (2010), Algorithm 6.
Start, growth and end of the penalty µ are theirs; the source prints none. In line 7 of the
source's print the bar over Ω is lost: E is what lies outside the samples.

For comparison only: it wants samples at random places, and needs more of them than a robot likes.
LAPACK computes the singular values here, so the last bits are the machine's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray

BoolArray = npt.NDArray[np.bool_]

FEASIBLE: Final = 1e-7
"""ε₁ of the paper: ‖D − A − E‖ / ‖D‖ (Frobenius norms) at the end."""
SETTLED: Final = 1e-6
"""ε₂: min(µ, √µ) ‖ΔE‖ / ‖D‖; µ grows once it is below, and the end asks for it, too."""
GROWTH: Final = (1.2172, 1.8588)
"""ρ = 1.2172 + 1.8588 |Ω|/(mn): the paper's fit of the best growth over the share of samples."""
MOST_ITERATIONS: Final = 2000
"""Ours, several times what a field in 8 bits takes. ε₂ depends on the unit, as published: values
about 1 are held to a stricter end than values about 100, and may need all of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Completion:
    """What Algorithm 1 found: A (m, n) in the samples' unit."""

    matrix: FloatArray
    iterations: int
    converged: bool


def complete(
    samples: FloatArray, mask: BoolArray, *, most_iterations: int = MOST_ITERATIONS
) -> Completion:
    """Complete a matrix (m, n) from its entries where ``mask``; the others are never looked at.

    Raises ``SurveyError`` for shapes that differ, no samples, and samples that are not finite.
    """
    if samples.ndim != 2 or samples.shape != mask.shape:
        raise SurveyError(f"completion: samples {samples.shape} and mask {mask.shape} must agree")
    if not mask.any():
        raise SurveyError("completion: no samples")
    d = np.where(mask, samples, 0.0)
    if not np.isfinite(d).all():
        raise SurveyError("completion: a sample is not finite")
    size = float(np.linalg.norm(d))
    if size == 0.0:
        return Completion(d, 0, True)

    mu = 1.0 / float(np.linalg.norm(d, 2))  # µ₀ = 1/‖D‖₂, page 12 of the paper
    rho = GROWTH[0] + GROWTH[1] * float(mask.mean())
    e, y = np.zeros_like(d), np.zeros_like(d)
    for k in range(1, most_iterations + 1):
        u, s, vt = np.linalg.svd(d - e + y / mu, full_matrices=False)  # line 4
        a = (u * np.maximum(s - 1.0 / mu, 0.0)) @ vt  # line 5: soft thresholding
        before, e = e, np.where(mask, 0.0, d - a + y / mu)  # line 7
        rest = d - a - e
        y = y + mu * rest  # line 8
        moved = min(mu, mu**0.5) * float(np.linalg.norm(e - before)) / size
        if float(np.linalg.norm(rest)) < FEASIBLE * size and moved < SETTLED:
            return Completion(a, k, True)
        if moved < SETTLED:  # line 9
            mu *= rho
    return Completion(a, most_iterations, False)
