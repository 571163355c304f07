"""Paths with few points that are nowhere farther from the true ones than a stated distance.

Top-down splitting by the synchronised distance (N. Meratnia and R. A. de By, Spatiotemporal
compression techniques for moving point objects, EDBT 2004): a stretch of the path becomes a
straight line at even speed, and is split where the robot was farthest from where that line has it
*at the same moment*. So the error holds for a film and not only for a drawing.
"""

from __future__ import annotations

import numpy as np

from tools.records.data import FloatArray
from tools.report.survey_view import CountArray


def thinned(time_s: FloatArray, x_m: FloatArray, y_m: FloatArray, tolerance_m: float) -> CountArray:
    """Return the indices that are kept, the first and the last among them.

    Between them, at each of the times given, the line is within ``tolerance_m`` of the path.
    """
    if time_s.size < 3:
        return np.arange(time_s.size)
    keep = {0, time_s.size - 1}
    stretches = [(0, time_s.size - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        part = (time_s[inside] - time_s[first]) / (time_s[last] - time_s[first])
        dx, dy = (
            way[inside] - (way[first] + part * (way[last] - way[first])) for way in (x_m, y_m)
        )
        off = np.hypot(dx, dy)
        worst = int(off.argmax())
        if off[worst] > tolerance_m:
            split = first + 1 + worst
            keep.add(split)
            stretches += [(first, split), (split, last)]
    return np.array(sorted(keep))
