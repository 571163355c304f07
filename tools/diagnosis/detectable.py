"""The smallest effect of each cause that these data would have shown.

A cause of a size whose secant has the projected information λ (in twice the log-likelihood) has a
score of mean √λ and variance one. With the sandwich's factor f it exceeds the calibrated threshold
T with probability 90 % where √λ = √(f T) + 1.2816. Sizes are scaled linearly from the secant that
stands nearest to that size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tools.diagnosis.model import Cause, FloatArray
from tools.diagnosis.screening import Kind, Screen

POWER_90 = 1.2816
"""The normal quantile of 90 %."""


def smallest_detectable(
    screen: Screen, inflation: FloatArray, threshold: float, causes: Sequence[Cause]
) -> dict[str, float | None]:
    """Return per screened cause the smallest detectable size of its (first) parameter.

    None: no size within its bounds would show. ``inflation``: the sandwich's factor per column.
    """
    kinds = dict(zip(screen.owners, screen.kinds, strict=True))
    information = np.diag(screen.projection.information)
    bounds = {cause.name: cause.parameters[0] for cause in causes if cause.parameters}
    sizes: dict[str, list[tuple[float, float]]] = {
        owner: [] for owner, kind in kinds.items() if kind is Kind.CAUSE
    }
    for candidate in screen.candidates:
        if candidate.owner not in bounds or len(candidate.columns) != 1:
            continue
        (column,) = candidate.columns
        step = screen.secants[column].step
        first = bounds[candidate.owner]
        if set(step) != {first.name}:
            continue
        length = math.sqrt(float(inflation[column]) * max(threshold, 0.0)) + POWER_90
        share = length / math.sqrt(max(float(information[column]), 1e-300))
        needed = share * step[first.name]
        if first.least <= needed <= first.most:
            sizes[candidate.owner].append((abs(math.log(share)), abs(needed)))
    return {owner: min(found)[1] if found else None for owner, found in sizes.items()}
