"""Figures of merit from the true path, by whole tail-beats.

Within a beat the body yaws and sways; between two moments of equal phase it has only gone ahead.
Positions and headings are therefore read at whole beats before the end. In a steady turn these
points lie on a circle, and its radius follows from one chord and the angle turned between its
ends, R = d / (2 sin(Δψ/2)): no fit that could be biased by the oscillation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tools.records.data import FloatArray

BEATS = 10
"""The contract's window for the speed."""

TURNING_RAD = 0.05
"""Less than this in ten beats (3°) is no turn but the remainder of a transient."""

STEADY = 0.2
"""The two halves of a steady turn differ by less than this fraction."""


def path_metrics(
    truth: Mapping[str, FloatArray], beat_frequency_hz: float
) -> dict[str, float | None]:
    """`speed_m_s`, `turn_radius_m`, `turn_period_s`, `path_length_m` of the contract."""
    none: dict[str, float | None] = dict.fromkeys(
        ("speed_m_s", "turn_radius_m", "turn_period_s", "path_length_m")
    )
    time = truth["time_s"]
    if time.size < 2:
        return none
    steps = np.hypot(np.diff(truth["x_m"]), np.diff(truth["y_m"]))
    none["path_length_m"] = float(steps.sum())
    marks = beat_times(time, beat_frequency_hz, BEATS)
    if marks.size < 2:
        return none
    x, y = (np.interp(marks, time, truth[name]) for name in ("x_m", "y_m"))
    heading = np.interp(marks, time, np.unwrap(truth["heading_rad"]))
    span = float(marks[-1] - marks[0])
    none["speed_m_s"] = math.hypot(x[-1] - x[0], y[-1] - y[0]) / span
    turned = float(heading[-1] - heading[0])
    if marks.size < BEATS + 1 or abs(turned) < TURNING_RAD:
        return none
    half = float(heading[BEATS // 2] - heading[0])
    if abs(2 * half - turned) > STEADY * abs(turned):
        return none
    chords = np.hypot(np.diff(x), np.diff(y))
    per_beat = turned / BEATS
    none["turn_radius_m"] = float(chords.mean()) / abs(2 * math.sin(per_beat / 2))
    none["turn_period_s"] = 2 * math.pi / abs(turned) * span
    return none


def beat_times(time: FloatArray, frequency_hz: float, beats: int) -> FloatArray:
    """Moments a whole number of beats before the end, rising; at most `beats` of them."""
    if frequency_hz <= 0 or time.size < 2:
        return np.empty(0)
    fit = int((float(time[-1] - time[0])) * frequency_hz + 1e-9)
    count = min(beats, fit)
    return np.asarray(float(time[-1]) - np.arange(count, -1, -1) / frequency_hz, dtype=np.float64)


def beat_average(
    time: FloatArray, values: FloatArray, frequency_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Running mean over exactly one beat; returns the times of its centres and the means.

    The mean is the difference of the trapezoidal integral, so that the window is exact even where
    a beat is no whole number of samples.
    """
    if frequency_hz <= 0 or time.size < 3 or time[-1] - time[0] <= 1 / frequency_hz:
        return time, values
    beat = 1 / frequency_hz
    areas = (values[1:] + values[:-1]) / 2 * np.diff(time)
    integral = np.concatenate(([0.0], np.cumsum(areas)))
    centres = time[(time >= time[0] + beat / 2) & (time <= time[-1] - beat / 2)]
    high = np.interp(centres + beat / 2, time, integral)
    low = np.interp(centres - beat / 2, time, integral)
    return centres, (high - low) / beat
