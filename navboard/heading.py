"""Heading from gyro, compass and GPS course: a Kalman filter of two states.

    ψ̇ = Ω − b,   ḃ = white noise;   compass: ψ + noise;   GPS course: ψ + noise, when fast enough

The gyro carries the heading from tick to tick, the compass corrects it and in doing so finds the
gyro's bias. Variances are kept in closed form (2 × 2). A reading that is implausible by four sigma
is dropped, unless a whole second of them is: then the filter starts again from the compass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_TURN = 2.0 * math.pi


def wrap(angle_rad: float) -> float:
    """Return the angle in [−π, π)."""
    return (angle_rad + math.pi) % _TURN - math.pi


@dataclass(frozen=True, slots=True)
class HeadingTuning:
    """Noise that the filter believes in: chosen from the chips' figures, with margin."""

    gyro_sigma_rad_s: float = 0.01
    bias_walk_rad_s: float = 5e-5
    """Growth of the bias's standard deviation per √s."""
    bias_sigma_rad_s: float = 0.03
    """Standard deviation of the bias at the start."""
    compass_sigma_rad: float = 0.03
    course_sigma_rad: float = 0.2
    least_course_speed_m_s: float = 0.5
    """Below it the GPS course says nothing."""
    gate_sigma: float = 4.0
    restart_after: int = 15
    """Dropped compass readings in a row after which the filter starts again."""


class HeadingFilter:
    """State and covariance; `heading_rad` is None until the first compass reading."""

    __slots__ = (
        "_bias_walk",
        "_p00",
        "_p01",
        "_p11",
        "_rejected",
        "_tuning",
        "bias_rad_s",
        "heading_rad",
    )

    def __init__(self, tuning: HeadingTuning) -> None:
        self._tuning = tuning
        self.heading_rad: float | None = None
        self.bias_rad_s = 0.0
        self._p00 = 0.0
        self._p01 = 0.0
        self._p11 = tuning.bias_sigma_rad_s**2
        self._rejected = 0
        self._bias_walk = tuning.bias_walk_rad_s**2

    @property
    def sigma_rad(self) -> float:
        """Standard deviation that the filter gives its heading."""
        return math.sqrt(self._p00)

    @property
    def bias_sigma_rad_s(self) -> float:
        """Standard deviation that the filter gives its gyro bias."""
        return math.sqrt(self._p11)

    def predict(self, rate_rad_s: float, dt_s: float) -> None:
        """Carry the heading on by a gyro reading."""
        heading = self.heading_rad
        if heading is None:
            return
        heading += (rate_rad_s - self.bias_rad_s) * dt_s
        self.heading_rad = (heading + math.pi) % _TURN - math.pi  # wrap, at every tick
        p01, p11 = self._p01, self._p11
        noise = self._tuning.gyro_sigma_rad_s * dt_s
        self._p00 += dt_s * (dt_s * p11 - 2.0 * p01) + noise * noise
        self._p01 = p01 - dt_s * p11
        self._p11 = p11 + self._bias_walk * dt_s

    def compass(self, heading_rad: float) -> None:
        """Correct by a compass reading."""
        if self.heading_rad is None:
            self._begin(heading_rad)
        elif not self._update(heading_rad, self._tuning.compass_sigma_rad):
            self._rejected += 1
            if self._rejected >= self._tuning.restart_after:
                self._begin(heading_rad)
        else:
            self._rejected = 0

    def course(self, course_rad: float, speed_m_s: float) -> bool:
        """Correct by a GPS course, if the robot is fast enough; return whether it was used."""
        if self.heading_rad is None or speed_m_s < self._tuning.least_course_speed_m_s:
            return False
        return self._update(course_rad, self._tuning.course_sigma_rad)

    def _begin(self, heading_rad: float) -> None:
        self.heading_rad = wrap(heading_rad)
        self._p00 = self._tuning.compass_sigma_rad**2
        self._p01 = 0.0
        self._p11 = self._tuning.bias_sigma_rad_s**2
        self._rejected = 0

    def _update(self, measured_rad: float, sigma_rad: float) -> bool:
        assert self.heading_rad is not None
        innovation = wrap(measured_rad - self.heading_rad)
        variance = self._p00 + sigma_rad * sigma_rad
        gate = self._tuning.gate_sigma
        if innovation * innovation > gate * gate * variance:
            return False
        k0, k1 = self._p00 / variance, self._p01 / variance
        self.heading_rad = wrap(self.heading_rad + k0 * innovation)
        self.bias_rad_s += k1 * innovation
        p01 = self._p01
        self._p00 *= 1.0 - k0
        self._p01 = p01 * (1.0 - k0)
        self._p11 -= k1 * p01
        return True
