"""Terms that enter one by one: orthogonal least squares (Chen, Billings and Luo 1989).

All of it happens on Gram matrices, so that many subsets of data can be tried at little cost.
"""

from __future__ import annotations

import numpy as np

from tools.diagnosis.model import FloatArray

ENTRY = 15.0
"""Gain that a term must add to enter: above the best of a few dozen in noise."""


def forward(information: FloatArray, scores: FloatArray, most: int, entry: float) -> list[int]:
    """Return the columns that enter one by one, each while it adds at least ``entry``."""
    chosen: list[int] = []
    for _ in range(most):
        left, slope = information, scores
        if chosen:
            inner = np.linalg.pinv(information[np.ix_(chosen, chosen)], hermitian=True)
            follow = information[:, chosen] @ inner
            left = information - follow @ information[chosen]
            slope = scores - follow @ scores[chosen]
        own = np.diag(left)
        usable = own > 1e-3 * np.maximum(np.diag(information), 1e-12)
        gains = np.where(usable, slope**2 / np.where(usable, own, 1.0), 0.0)
        gains[chosen] = 0.0
        best = int(np.argmax(gains))
        if gains[best] < entry:
            break
        chosen.append(best)
    return chosen
