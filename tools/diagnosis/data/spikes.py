"""Samples that no robot can have made: spikes far beyond what lies around them.

A tracker that takes a lamp for the robot, a bit that flips in a record: one such cell outweighs a
whole run in a sum of squares. A sample is a spike if it lies away from the median of those around
it (``AROUND`` on either side) by more than

- the robot could have moved while these were taken, generously: ``LARGEST`` and ``FASTEST``; and
- ``SCATTERS`` times what samples of this channel so near to each other usually differ by,

or from the median of all of the run by ``RANGES`` times the range of nearly all samples, which
finds longer excursions. Both are away and back: what stays where it went has moved the median
along. Healthy data do not come near either: the limits are tens of times what robots of this size
do, and angles may jump by a turn where they are wrapped, which is less than their limit.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tools.diagnosis.model import FloatArray

AROUND = 5
"""Samples on either side: a spike is at most as many long, unless it is beyond all range."""
SCATTERS = 50.0
RANGES = 1e4
MOST = 0.01
"""Share of a channel's samples that may be spikes; more is an instrument that does not work."""

_TURN = 400.0
"""rad: more than by what wrapped angles jump, also where they are degrees as yet. Nearer spikes in
an angle are errors of half a turn at most, modulo 2π."""

LARGEST: Mapping[str, float] = {
    "x_m": 1.0,
    "y_m": 1.0,
    "gps_x_m": 100.0,
    "gps_y_m": 100.0,
    "heading_rad": _TURN,
    "compass_rad": _TURN,
    "tail_angle_rad": 6.0,
    "gyro_z_rad_s": 50.0,
    "accel_x_m_s2": 200.0,
    "accel_y_m_s2": 200.0,
    "battery_v": 50.0,
}
"""How far a sample may lie from its neighbours, in the channel's unit: a body length or several
for a camera that sees the wrong end, ten times the ranges of the robot's own instruments (LPY503AL:
5.2 rad/s, LSM303DLH: 20 m/s²), and of a consumer's GPS receiver with a bad sky."""

FASTEST: Mapping[str, float] = {
    "x_m": 5.0,
    "y_m": 5.0,
    "gps_x_m": 5.0,
    "gps_y_m": 5.0,
    "heading_rad": 20.0,
    "compass_rad": 20.0,
}
"""How fast it may move on meanwhile, in units per second: no small robot swims or spins so fast."""


def spikes(name: str, time_s: FloatArray, values: FloatArray) -> np.ndarray:
    """Return which samples (n,) of a channel are spikes; ``time_s`` rises, values are finite."""
    if values.size <= 2 * AROUND:
        return np.zeros(values.size, dtype=bool)
    largest = LARGEST[name]
    with np.errstate(over="ignore"):  # what overflows is far away all the same
        away = np.abs(values - np.median(_neighbours(values), axis=1))
        low, high = np.quantile(values, (0.1, 0.9))
        beyond = np.abs(values - np.median(values)) > RANGES * (high - low + largest)
    ends = np.clip(np.arange(values.size)[:, None] + (-AROUND, AROUND), 0, values.size - 1)
    spent_s = np.diff(time_s[ends], axis=1)[:, 0]
    possible = largest + FASTEST.get(name, 0.0) * spent_s
    usual = float(np.median(np.abs(values[AROUND:] - values[:-AROUND]))) / 0.6745
    found: np.ndarray = beyond | (away > np.maximum(possible, SCATTERS * usual))
    return found


def _neighbours(values: FloatArray) -> FloatArray:
    """Return each sample among those around it (n, 2 AROUND + 1), mirrored at the ends."""
    padded = np.pad(values, AROUND, mode="reflect")
    windows: FloatArray = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    return windows
