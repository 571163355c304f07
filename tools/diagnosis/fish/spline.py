"""A recorded command for an ideal tail: one drive a piece of a cubic spline.

An ideal tail needs the rate and the acceleration of its command, which samples do not have; between
samples that belong together the cubic spline has both, continuously. Where the command jumps the
spline is broken, so that an ideal tail jumps there, without an impulse, as it does with beats.

Behind a first-order lag τ a cubic u becomes the cubic u − τu′ + τ²u″ − τ³u‴ and a rest that dies
out with τ and makes the angle go on: exactly what a ``Drive`` can say.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from plant.layout import DRIVE, Drive
from plant.parameters import Servo
from plant.servo import lag_share
from tools.diagnosis.model import FloatArray

JUMP_RAD = 0.02
JUMP_FACTOR = 4.0
"""A step of a record is a jump if it is that many times its neighbours, and this besides."""

_BIAS, _LIMIT, _START, _TRANSIENT, _CURVED, _OFFSET = (
    Drive._fields.index(name)
    for name in ("bias", "speed_limit", "start", "transient", "curved", "offset")
)


def jumps(angle_rad: FloatArray) -> list[int]:
    """Return the samples at which a recorded command has jumped."""
    step = np.abs(np.diff(angle_rad))
    around = np.zeros(step.size)
    around[1:] = step[:-1]
    around[:-1] = np.maximum(around[:-1], step[1:])
    return [int(i) + 1 for i in np.flatnonzero(step > JUMP_FACTOR * around + JUMP_RAD)]


def smooth(
    time_s: FloatArray, angle_rad: FloatArray, servo: Servo, limit: float, memory_s: float
) -> FloatArray:
    """Return the drives (m, DRIVE) of a record; ``memory_s``: over which its bias is averaged."""
    kept = np.concatenate(([True], np.diff(time_s) > 0.0))
    time_s, angle_rad = time_s[kept], angle_rad[kept]
    broken = jumps(angle_rad)
    begin_s, cubic = _pieces(time_s, angle_rad, broken)
    if servo.command_delay_s > 0.0 or begin_s[0] > 0.0:
        begin_s = np.concatenate(([begin_s[0] - 1.0], begin_s))
        cubic = np.concatenate(([[angle_rad[0], 0.0, 0.0, 0.0]], cubic))
    lag_s = servo.command_lag_s
    if lag_s > 0.0:
        cubic = lagged(cubic, lag_s)
    rows = np.zeros((begin_s.size, DRIVE))
    rows[:, _BIAS] = _running_mean(time_s, angle_rad, begin_s, memory_s)
    rows[:, _LIMIT] = limit
    rows[:, _START] = np.maximum(begin_s + servo.command_delay_s, 0.0)
    rows[0, _START] = 0.0
    rows[:, _CURVED] = 1.0
    rows[:, _OFFSET:] = cubic
    rows[:, _OFFSET] -= rows[:, _BIAS]
    if lag_s > 0.0:
        new = {float(time_s[i]) for i in broken}
        swept, transient = lag_share(servo), 0.0
        for i in range(1, begin_s.size):
            t = rows[i, _START] - rows[i - 1, _START]
            end = float(np.polyval(cubic[i - 1, ::-1], t))
            rest = end + transient * math.exp(-t / lag_s) - cubic[i, 0]
            transient = (swept if float(begin_s[i]) in new else 1.0) * rest
            rows[i, _TRANSIENT] = transient
    return rows


def _pieces(
    time_s: FloatArray, angle_rad: FloatArray, broken: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Return where each piece begins (m,), and its coefficients (m, 4), lowest power first."""
    starts, pieces = [], []
    for first, last in pairwise([0, *broken, time_s.size]):
        t, a = time_s[first:last], angle_rad[first:last]
        if t.size >= 3:
            pieces.append(CubicSpline(t, a).c[::-1].T)
            starts.append(t[:-1])
        else:
            slope = (a[-1] - a[0]) / (t[-1] - t[0]) if t.size == 2 else 0.0
            pieces.append(np.array([[a[0], slope, 0.0, 0.0]]))
            starts.append(t[:1])
    return np.concatenate(starts), np.concatenate(pieces)


def lagged(cubic: FloatArray, lag_s: float) -> FloatArray:
    """Return cubics (m, 4) behind a lag, without what dies out."""
    c0, c1, c2, c3 = cubic.T
    return np.column_stack(
        (
            c0 - lag_s * c1 + 2.0 * lag_s**2 * c2 - 6.0 * lag_s**3 * c3,
            c1 - 2.0 * lag_s * c2 + 6.0 * lag_s**2 * c3,
            c2 - 3.0 * lag_s * c3,
            c3,
        )
    )


def _running_mean(
    time_s: FloatArray, angle_rad: FloatArray, at_s: FloatArray, memory_s: float
) -> FloatArray:
    """Return the running mean of a record: the bias that the adapted drag depends on.

    It begins with the mean of its first memory, as if the beat had gone on since ever.
    """
    step = np.diff(time_s, prepend=time_s[0])
    mean = np.empty(time_s.size)
    now = float(np.mean(angle_rad[time_s <= time_s[0] + memory_s]))
    for i in range(time_s.size):
        now += (1.0 - math.exp(-step[i] / memory_s)) * (float(angle_rad[i]) - now)
        mean[i] = now
    return np.interp(at_s, time_s, mean)
