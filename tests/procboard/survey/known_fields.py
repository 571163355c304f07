"""Fields of a known rank, and a survey that is told them."""

from __future__ import annotations

import numpy as np

from procboard.survey.algebra import FloatArray
from procboard.survey.expansion import Expansion


def low_rank(rng: np.random.Generator, shape: tuple[int, int], rank: int) -> FloatArray:
    """A product of Gaussian factors: every block has the rank that its size allows."""
    field: FloatArray = rng.standard_normal((shape[0], rank)) @ rng.standard_normal(
        (rank, shape[1])
    )
    return field


def late_rank(rng: np.random.Generator, side: int, rank: int, late: int) -> FloatArray:
    """Rank ``rank`` whose leading ``late`` × ``late`` block has one less; a row brings the last."""
    left = rng.standard_normal((side, rank))
    left[:late, -1] = 0.0
    field: FloatArray = left @ rng.standard_normal((rank, side))
    return field


def swim(survey: Expansion, field: FloatArray) -> list[tuple[int, int]]:
    """Tell a survey what it wants until it is done; the cells in the order of the visit."""
    path = []
    while not survey.done:
        wanted = survey.wanted()
        assert len(set(wanted)) == len(wanted) > 0
        for cell in wanted:
            survey.tell(cell, float(field[cell]))
        path += wanted
    assert survey.wanted() == ()
    return path
