"""Clocks that count in another unit than seconds."""

from __future__ import annotations

import numpy as np

from tools.diagnosis.data.notice import DataError
from tools.diagnosis.model import FloatArray

FRAME_S = 2e-3
"""No camera over a tank takes pictures more often."""

_SLOW_S, _RUN_S = 2.0, 1000.0
_SLOWISH_S, _DAY_S = 0.5, 20000.0
"""Nobody samples a fish that beats its tail every second so rarely, for so long."""


def check_clock(file: str, time_s: FloatArray, column: str = "time_s") -> None:
    """Refuse times that are counted in milliseconds or microseconds."""
    if time_s.size < 3:
        return
    usual = float(np.median(np.diff(time_s)))
    span = float(time_s[-1] - time_s[0])
    slow = usual > _SLOW_S and span >= _RUN_S
    if not slow and not (usual >= _SLOWISH_S and span >= _DAY_S):
        return
    scale, unit = (1e-3, "milliseconds") if usual < 2000.0 else (1e-6, "microseconds")
    raise DataError(
        f"{file}, column {column}: {usual:g} s between two samples, and a run of "
        f"{span:g} s: these are {unit}; add [channels.time_s] scale = {scale:g} "
        "to experiment.toml"
    )
