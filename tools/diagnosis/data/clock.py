"""Clocks that count in another unit than seconds."""

from __future__ import annotations

import numpy as np

from tools.diagnosis.data.notice import DataError
from tools.diagnosis.model import FloatArray


def check_clock(file: str, time_s: FloatArray, column: str = "time_s") -> None:
    """Refuse times that are counted in milliseconds or microseconds."""
    if time_s.size < 3:
        return
    usual = float(np.median(np.diff(time_s)))
    if usual <= 2.0 or time_s[-1] - time_s[0] < 1000.0:
        return
    scale, unit = (1e-3, "milliseconds") if usual < 2000.0 else (1e-6, "microseconds")
    raise DataError(
        f"{file}, column {column}: {usual:g} s between two samples, and a run of "
        f"{time_s[-1] - time_s[0]:g} s: these are {unit}; add [channels.time_s] scale = {scale:g} "
        "to experiment.toml"
    )
