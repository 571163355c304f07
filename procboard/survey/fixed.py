"""Surveys whose cells are fixed before: everywhere, and random ones for Algorithm 1.

To compare with, and for fields of which nothing is known. Cells are asked for in bands of a few
rows, so that a board shares out some at a time and not the whole grid. What random cells leave open
Algorithm 1 completes (`procboard.survey.completion`), which is for the base: it takes seconds of a
PC's processor in the worst case, and its last bits are the machine's.
"""

from __future__ import annotations

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray
from procboard.survey.completion import BoolArray, complete
from procboard.survey.expansion import Estimate, Expansion
from procboard.survey.rank import Steps, boustrophedon, sampled_into

BAND = 4
"""Rows that are shared out at a time: one each for as many robots, or two ways and back for two."""


def everywhere(shape: tuple[int, int], sigma: float, *, band: int = BAND) -> Expansion:
    """Sample every cell. ``sigma``: standard deviation of a sample's error."""
    return Expansion(shape, lambda: Fixed(np.ones(shape, np.bool_), sigma, band))


def at_random(
    shape: tuple[int, int], share: float, sigma: float, *, band: int = BAND, seed: int = 0
) -> Expansion:
    """Sample a share of the cells, drawn without repetition, and complete the rest.

    Raises ``SurveyError`` for a share that is not above 0 and at most 1.
    """
    if not 0.0 < share <= 1.0:
        raise SurveyError(f"survey: a share of cells is above 0 and at most 1, got {share}")
    count = shape[0] * shape[1]
    order = np.random.default_rng(seed).permutation(count)
    mask = np.reshape(order < max(1, round(share * count)), shape)
    return Expansion(shape, lambda: Fixed(mask, sigma, band))


class Fixed:
    """Cells of a mask, band by band."""

    def __init__(self, mask: BoolArray, sigma: float, band: int) -> None:
        self._mask, self._sigma, self._band = mask, sigma, band
        self._measured = np.full(mask.shape, np.nan)

    @property
    def lines(self) -> int:
        """None: all that is wanted is sampled."""
        return 0

    def steps(self) -> Steps:
        """Sample a band after the other."""
        rows, columns = self._mask.shape
        for first in range(0, rows, self._band):
            band = boustrophedon(range(first, min(first + self._band, rows)), range(columns))
            yield from sampled_into(
                self._measured, tuple(cell for cell in band if self._mask[cell])
            )

    def estimate(self) -> Estimate:
        """What was sampled, and once that is all, what completes it; of that nothing is stated."""
        known = ~np.isnan(self._measured)
        matrix: FloatArray = self._measured.copy()
        if bool((known == self._mask).all()) and not known.all():
            matrix = np.where(known, matrix, complete(matrix, known).matrix)
        return Estimate(matrix, np.where(known, self._sigma, np.nan))
