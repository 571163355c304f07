"""Steady metrics of a path: speed, turning radius and period, thrust.

A tail beat moves the body to and fro, so the path is averaged over one beat first; what is left
of a steady motion is a straight line or a circle. Turning rate is the slope of the heading over
whole beats; the radius is that of the circle fitted to the averaged path (Kåsa's algebraic fit,
exact for points on a circle, and steady under the noise of a camera), and where the path covers
too little of a circle for a fit, speed over turning rate.
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.errors import InvalidParameterError
from plant.trajectory import Trajectory

LEAST_TURN_RATE_RAD_S = 5e-3
"""Below this (a full turn in 21 minutes) a path counts as straight."""

_LEAST_ARC_RAD = 0.5  # less than this of a circle is not fitted


@dataclass(frozen=True, slots=True)
class SteadyMotion:
    """What the last beats of a run amount to.

    ``speed_m_s``: net displacement over the last beats / time. ``path_speed_m_s``: along the
    beat-averaged path. Radius and period are None where the path does not turn.
    """

    speed_m_s: float
    path_speed_m_s: float
    turn_rate_rad_s: float
    turn_radius_m: float | None
    turn_period_s: float | None


def path_length_m(x_m: FloatArray, y_m: FloatArray) -> float:
    """Length of the path through all samples."""
    return float(np.hypot(np.diff(x_m), np.diff(y_m)).sum())


def net_speed_m_s(
    time_s: FloatArray, x_m: FloatArray, y_m: FloatArray, frequency_hz: float, beats: float = 10.0
) -> float:
    """Net displacement over the last ``beats`` beats (or all there are) / time."""
    if time_s.size < 2:
        return 0.0
    begin = time_s[-1] - beats / frequency_hz if frequency_hz > 0.0 else time_s[0]
    begin = max(float(begin), float(time_s[0]))
    dx = x_m[-1] - np.interp(begin, time_s, x_m)
    dy = y_m[-1] - np.interp(begin, time_s, y_m)
    return float(math.hypot(dx, dy) / (time_s[-1] - begin))


def fit_circle(x_m: FloatArray, y_m: FloatArray) -> tuple[float, float, float]:
    """Centre and radius of the circle with the least algebraic error (Kåsa 1976)."""
    mean_x, mean_y = float(x_m.mean()), float(y_m.mean())
    x, y = x_m - mean_x, y_m - mean_y
    square = x * x + y * y
    xx, yy, xy = float((x * x).sum()), float((y * y).sum()), float((x * y).sum())
    xs, ys = float((x * square).sum()), float((y * square).sum())
    determinant = xx * yy - xy * xy
    if determinant <= 0.0:
        return mean_x, mean_y, math.inf
    a = (xs * yy - ys * xy) / (2.0 * determinant)
    b = (ys * xx - xs * xy) / (2.0 * determinant)
    return mean_x + a, mean_y + b, math.sqrt(a * a + b * b + (xx + yy) / x.size)


def beat_average(
    time_s: FloatArray, value: FloatArray, period_s: float
) -> tuple[FloatArray, FloatArray]:
    """Mean over one beat centred at each sample that has half a beat on both sides.

    Returns the times of those samples and the means. The window is exact even where a beat is no
    whole number of samples, because the integral is interpolated, not the samples counted.
    """
    steps = np.diff(time_s)
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (value[1:] + value[:-1]) * steps)))
    inside = (time_s >= time_s[0] + 0.5 * period_s) & (time_s <= time_s[-1] - 0.5 * period_s)
    centre = time_s[inside]
    after = np.interp(centre + 0.5 * period_s, time_s, integral)
    before = np.interp(centre - 0.5 * period_s, time_s, integral)
    averaged: FloatArray = (after - before) / period_s
    return centre, averaged


def steady_motion(
    time_s: FloatArray,
    x_m: FloatArray,
    y_m: FloatArray,
    heading_rad: FloatArray,
    frequency_hz: float,
    beats: float = 10.0,
) -> SteadyMotion:
    """Metrics over the last ``beats`` whole beats; samples need not be evenly spaced.

    Heading unwrapped. Raises ``InvalidParameterError`` where the record is shorter than two beats.
    """
    check_number("steady_motion.frequency_hz", frequency_hz, above=0.0)
    period = 1.0 / frequency_hz
    duration = float(time_s[-1] - time_s[0]) if time_s.size > 1 else 0.0
    count = min(math.floor(beats), math.floor(duration * frequency_hz + 1e-9))
    if count < 2:
        raise InvalidParameterError("steady_motion.time_s", "the record is shorter than two beats")
    window = count * period
    kept = time_s >= time_s[-1] - window - 1e-9 * period
    t, x, y, psi = time_s[kept], x_m[kept], y_m[kept], heading_rad[kept]
    # averaged at both ends of the window, so that the phase within a beat does not matter
    centre, psi_mean = beat_average(t, psi, period)
    x_mean, y_mean = beat_average(t, x, period)[1], beat_average(t, y, period)[1]
    covered = float(centre[-1] - centre[0])
    turn = float(psi_mean[-1] - psi_mean[0])
    rate = turn / covered
    path_speed = path_length_m(x_mean, y_mean) / covered
    radius: float | None = None
    turn_period: float | None = None
    if abs(rate) >= LEAST_TURN_RATE_RAD_S:
        turn_period = 2.0 * math.pi / abs(rate)
        if abs(turn) >= _LEAST_ARC_RAD:
            radius = fit_circle(x_mean, y_mean)[2]
        else:
            radius = path_speed / abs(rate)
    return SteadyMotion(
        speed_m_s=net_speed_m_s(time_s, x_m, y_m, frequency_hz, count),
        path_speed_m_s=path_speed,
        turn_rate_rad_s=rate,
        turn_radius_m=radius,
        turn_period_s=turn_period,
    )


def mean_thrust_n(trajectory: Trajectory, frequency_hz: float, beats: int = 10) -> float:
    """Mean thrust of the tail over the last whole beats (3.29).

    F_hx cos(ψ − ψ̄) − F_hy sin(ψ − ψ̄), ψ̄ the mean heading of each beat.
    """
    check_number("mean_thrust.frequency_hz", frequency_hz, above=0.0)
    t = trajectory.time_s
    period = 1.0 / frequency_hz
    if t[-1] - t[0] < beats * period - 1e-9:
        raise InvalidParameterError("mean_thrust.beats", "the record is shorter than that")
    total = 0.0
    for beat in range(beats):
        end = float(t[-1]) - beat * period
        kept = (t > end - period + 1e-9) & (t <= end + 1e-9)
        psi = trajectory.heading_rad[kept]
        turned = psi - psi.mean()
        forward = trajectory.tail_force_x_n[kept] * np.cos(turned)
        forward = forward - trajectory.tail_force_y_n[kept] * np.sin(turned)
        total += float(forward.mean())
    return total / beats
