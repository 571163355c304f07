"""Metrics of paths whose answer is known."""

import math

import numpy as np
import pytest

from plant.errors import InvalidParameterError
from plant.metrics import fit_circle, net_speed_m_s, path_length_m, steady_motion

RATE = 0.09  # rad/s
RADIUS = 0.275


def circle(
    duration_s: float, wobble_m: float = 0.0, noise_m: float = 0.0, sign: float = -1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A circle with a wobble across the path at 0.9 Hz."""
    t = np.arange(0.0, duration_s, 1 / 30)
    angle = sign * RATE * t
    r = RADIUS + wobble_m * np.sin(2 * math.pi * 0.9 * t)
    noise = np.random.default_rng(3).normal(0.0, noise_m, (2, t.size))
    heading = angle + sign * math.pi / 2 + 0.1 * np.sin(2 * math.pi * 0.9 * t)
    return t, 1 + r * np.cos(angle) + noise[0], 2 + r * np.sin(angle) + noise[1], heading


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wobbling_circle(sign: float) -> None:
    motion = steady_motion(*circle(120.0, wobble_m=0.004, sign=sign), 0.9, beats=60)
    assert motion.turn_radius_m == pytest.approx(RADIUS, rel=1e-3)
    assert motion.turn_rate_rad_s == pytest.approx(sign * RATE, rel=1e-3)
    assert motion.turn_period_s == pytest.approx(2 * math.pi / RATE, rel=1e-3)
    assert motion.path_speed_m_s == pytest.approx(RATE * RADIUS, rel=1e-3)


def test_a_camera_s_noise_does_little_to_the_radius() -> None:
    motion = steady_motion(*circle(120.0, 0.004, noise_m=0.002), 0.9, beats=60)
    assert motion.turn_radius_m == pytest.approx(RADIUS, rel=0.01)


def test_a_short_arc_gives_speed_over_turning_rate() -> None:
    motion = steady_motion(*circle(6.0), 0.9, beats=5)
    assert motion.turn_radius_m == pytest.approx(RADIUS, rel=0.01)


def test_a_straight_path_does_not_turn() -> None:
    t = np.linspace(0.0, 30.0, 901)
    x = 0.03 * t + 0.001 * np.sin(2 * math.pi * 1.8 * t)
    motion = steady_motion(t, x, np.zeros_like(t), np.zeros_like(t), 0.9)
    assert motion.turn_radius_m is None
    assert motion.turn_period_s is None
    assert motion.speed_m_s == pytest.approx(0.03, rel=0.01)


def test_net_speed_is_displacement_over_the_last_ten_beats() -> None:
    t = np.linspace(0.0, 20.0, 2001)
    x = np.where(t < 10.0, 0.0, 0.05 * (t - 10.0))
    assert net_speed_m_s(t, x, 0 * x, 1.0) == pytest.approx(0.05)
    assert net_speed_m_s(t, x, 0 * x, 0.5) == pytest.approx(0.025)
    # fewer beats than ten: all there is
    assert net_speed_m_s(t, x, 0 * x, 0.1) == pytest.approx(0.025)
    assert net_speed_m_s(t[:1], x[:1], x[:1], 1.0) == 0.0


def test_circle_fit_is_exact_on_a_circle() -> None:
    angle = np.linspace(0.3, 1.4, 12)
    x, y, r = fit_circle(3 + 2 * np.cos(angle), -1 + 2 * np.sin(angle))
    assert (x, y, r) == pytest.approx((3, -1, 2))
    line = np.linspace(0.0, 1.0, 9)
    assert fit_circle(line, 0 * line)[2] == math.inf


def test_path_length_adds_the_pieces() -> None:
    assert path_length_m(np.array([0.0, 3.0, 3.0]), np.array([0.0, 4.0, 5.0])) == pytest.approx(6.0)


def test_too_short_a_record_is_refused() -> None:
    t = np.linspace(0.0, 1.0, 31)
    with pytest.raises(InvalidParameterError, match="two beats"):
        steady_motion(t, t, t, t, 0.9)
