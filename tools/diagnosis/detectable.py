"""The smallest effect of each cause that these data would have shown.

A cause of a size whose secant has the projected information λ (in twice the log-likelihood) has a
score of mean √λ and variance one. It exceeds the calibrated threshold T with probability 90 % where
√λ = √T + 1.2816. Sizes are scaled linearly from the secant, which stands near that size.
"""

from __future__ import annotations

import math

import numpy as np

from tools.diagnosis.screening import Kind, Screen

POWER_90 = 1.2816
"""The normal quantile of 90 %."""


def smallest_detectable(screen: Screen, threshold: float) -> dict[str, float | None]:
    """Return per cause the smallest detectable size of its (first) parameter; None: none is."""
    length = math.sqrt(max(threshold, 0.0)) + POWER_90
    found: dict[str, float | None] = {
        owner: None
        for owner, kind in zip(screen.owners, screen.kinds, strict=True)
        if kind is Kind.CAUSE
    }
    first: dict[str, str] = {}
    for candidate in screen.candidates:
        if candidate.kind is not Kind.CAUSE or len(candidate.columns) != 1:
            continue
        column = candidate.columns[0]
        step = screen.secants[column].step
        if len(step) != 1:
            continue
        ((name, size),) = step.items()
        if first.setdefault(candidate.owner, name) != name:
            continue
        own = math.sqrt(max(float(np.diag(screen.projection.information)[column]), 1e-300))
        needed = abs(size) * length / own
        known = found[candidate.owner]
        # Of several secants the one nearest to the size that they predict counts.
        if known is None or abs(math.log(length / own)) < 0.3:
            found[candidate.owner] = needed
    return found
