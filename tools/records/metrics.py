"""Figures of merit of a run's true path, as summary.json has them.

The figures themselves are `plant.metrics`: a path averaged over whole beats, a circle fitted to it.
Here stands only when a figure applies: a run has a turning radius where it turns steadily, which
is where the first and the second half of the last ten beats turn by the same angle.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from plant.metrics import beat_average as averaged
from plant.metrics import path_length_m, steady_motion
from tools.records.data import FloatArray

BEATS = 10
"""The contract's window for the speed."""

TURNING_RAD = 0.05
"""Less than this in ten beats (3°) is no turn but the remainder of a transient."""

STEADY = 0.2
"""The two halves of a steady turn differ by less than this fraction."""

SETTLED = 0.03
"""A turning radius that differs by less between the two halves of the window has settled."""

STILL = 0.05
"""A tail that is slower than this share of its fastest does not beat."""

PATH_METRICS = ("speed_m_s", "turn_radius_m", "turn_period_s", "path_length_m")


def path_metrics(
    truth: Mapping[str, FloatArray], beat_frequency_hz: float
) -> dict[str, float | None]:
    """`speed_m_s`, `turn_radius_m`, `turn_period_s`, `path_length_m` of the contract."""
    found: dict[str, float | None] = dict.fromkeys(PATH_METRICS)
    time, x, y = truth["time_s"], truth["x_m"], truth["y_m"]
    if time.size < 2:
        return found
    found["path_length_m"] = path_length_m(x, y)
    beats = float(time[-1] - time[0]) * beat_frequency_hz
    if beats < 2:
        return found
    heading = np.unwrap(truth["heading_rad"])
    motion = steady_motion(time, x, y, heading, beat_frequency_hz, BEATS)
    found["speed_m_s"] = motion.speed_m_s
    if beats >= BEATS and _turns_steadily(time, heading, beat_frequency_hz):
        found["turn_radius_m"] = motion.turn_radius_m
        found["turn_period_s"] = motion.turn_period_s
    return found


def _turns_steadily(time: FloatArray, heading: FloatArray, beat_frequency_hz: float) -> bool:
    """Whether the last ten beats turn, and both halves of them by the same angle."""
    ends = float(time[-1]) - np.array([BEATS, BEATS / 2, 0.0]) / beat_frequency_hz
    first, second = (float(part) for part in np.diff(np.interp(ends, time, heading)))
    turned = first + second
    return abs(turned) >= TURNING_RAD and abs(first - second) <= STEADY * abs(turned)


def turn_change(truth: Mapping[str, FloatArray], beat_frequency_hz: float) -> float:
    """Change of the turning radius from the first five to the last five of the last ten beats.

    A share of the radius; zero where the run is too short or does not turn.
    """
    time = truth["time_s"]
    if time.size < 2 or float(time[-1] - time[0]) * beat_frequency_hz < BEATS:
        return 0.0
    heading = np.unwrap(truth["heading_rad"])
    radii = []
    for end in (float(time[-1]) - 0.5 * BEATS / beat_frequency_hz, float(time[-1])):
        kept = time <= end
        t, x, y, psi = time[kept], truth["x_m"][kept], truth["y_m"][kept], heading[kept]
        motion = steady_motion(t, x, y, psi, beat_frequency_hz, BEATS / 2)
        if motion.turn_rate_rad_s == 0.0:
            return 0.0
        radii.append(motion.path_speed_m_s / abs(motion.turn_rate_rad_s))
    return radii[1] / radii[0] - 1.0 if radii[0] > 0.0 else 0.0


def unsettled(truth: Mapping[str, FloatArray], beat_frequency_hz: float) -> str:
    """Words for a turning radius that still changes; empty where it has settled."""
    change = turn_change(truth, beat_frequency_hz)
    if abs(change) <= SETTLED:
        return ""
    return f"not settled: {100.0 * change:+.0f} % in the last {BEATS // 2} beats".replace("-", "−")


def beat_average(
    time: FloatArray, values: FloatArray, frequency_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Running mean over one beat with its times; the values themselves where there is no beat."""
    if frequency_hz <= 0 or time.size < 3 or time[-1] - time[0] <= 1 / frequency_hz:
        return time, values
    return averaged(time, values, 1 / frequency_hz)


def last_motion(tail_rate_rad_s: FloatArray) -> int:
    """Index of the last sample at which the tail moved; the very last of a tail that never did."""
    rate = np.abs(tail_rate_rad_s)
    moving = np.flatnonzero(rate > STILL * rate.max(initial=0.0))
    return int(moving[-1]) if moving.size else rate.size - 1
