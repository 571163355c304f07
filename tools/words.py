"""Words that the lines on the terminal about boards, trackers and motes have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def ms(seconds: float) -> str:
    """Return a time in milliseconds."""
    return f"{seconds * 1e3:.2f} ms"


def pace(clock: Mapping[str, Any]) -> str:
    """Return how fast a clock goes; `clock` is a `ClockFit` of a summary."""
    drift, uncertainty = clock["drift_ppm"], clock["drift_uncertainty_ppm"]
    return f"{drift:+.1f} ± {uncertainty:.1f} ppm to this machine's"


def away(outages: Mapping[str, Any]) -> str:
    """Return for how long a line was away; `outages` is an `OutageLog.summary`."""
    return f"{outages['down_s']:.2f} s in all, longest {outages['longest_s']:.2f} s"
