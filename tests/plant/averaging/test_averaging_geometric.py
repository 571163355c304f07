"""First-order averaging: its shift, its averages and its steady turn against independent ways."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from plant.averaging.average import forcing
from plant.averaging.dynamics import AVERAGE, ORIGINAL, SIMPLIFIED, Dynamics, reduced, tail_part
from plant.averaging.geometric import (
    average_equilibrium,
    average_rates,
    first_order_path,
    first_order_turn,
    forced,
    published_rates,
)
from plant.averaging.motion import steady_turn
from plant.errors import InvalidParameterError
from plant.metrics import fit_circle
from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat
from plant.trajectory import Start

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))
COUPLED = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, munk_coupling=0.3))
BEAT = TailBeat.degrees(20, 15, 1.0)


@pytest.mark.parametrize("dynamics", [ORIGINAL, SIMPLIFIED])
@pytest.mark.parametrize("beat", [BEAT, TailBeat.degrees(-40, 30, 2.7)])
def test_the_shift_is_the_integral_of_the_oscillating_part(
    dynamics: Dynamics, beat: TailBeat
) -> None:
    p, f = reduced(ROBOT, beat.bias_rad, dynamics), forcing(ROBOT, beat, dynamics)
    ours = forced(ROBOT, beat, dynamics)
    n = ours.shift.shape[1]
    for sample in (0, n // 5, n // 2, n - 3):
        end = sample / n / beat.frequency_hz
        for i in range(3):
            whole, _ = quad(lambda t, i=i: tail_part(p, f, t)[i], 0.0, end, epsabs=1e-13)
            assert ours.shift[i, sample] == pytest.approx(whole - ours.mean[i] * end, abs=1e-11)


def test_the_shift_of_the_rate_has_the_coefficients_of_5_22() -> None:
    a0, a, w = BEAT.bias_rad, BEAT.amplitude_rad, 2.0 * math.pi
    j3, m, length, c = 0.311 * 0.14**2 / 12 + 1.0413e-4, math.pi * 1000 * 0.025**2 / 4, 0.08, 0.07
    k17 = length**2 / (4 * j3) * m * c * a * w**2
    k18, k19, k20, k21 = 2 - a0**2, a0 * a, a**2, length**3 * m / (3 * j3) * a * w**2
    k22, k23, k24 = k17 * k18 - 0.75 * k17 * k20 + k21, k17 * k19 / 2, k17 * k20 / 12
    k25 = k17 * k18 - 0.75 * k17 * k20 + k21 + k17 * k20 / 12
    ours = forced(ROBOT, BEAT)
    tau = 2.0 * np.pi * np.arange(ours.shift.shape[1]) / ours.shift.shape[1]
    printed = (-k22 * np.cos(tau) + k23 * np.sin(2 * tau) - k24 * np.cos(3 * tau) + k25) / w
    assert ours.shift[2] == pytest.approx(printed, abs=1e-13)
    assert ours.k22 == pytest.approx(k22, rel=1e-12)
    # "two orders of magnitude bigger"
    assert max(k23, k24, abs(k22 - k25)) < 0.02 * k22


@pytest.mark.parametrize("robot", [ROBOT, COUPLED])
@pytest.mark.parametrize("dynamics", [ORIGINAL, SIMPLIFIED])
def test_the_average_is_the_mean_over_many_phases(
    robot: PlantParameters, dynamics: Dynamics
) -> None:
    p, f = reduced(robot, BEAT.bias_rad, dynamics), forced(robot, BEAT, dynamics)
    n = f.shift.shape[1]
    spectrum = np.fft.rfft(f.shift, axis=1)
    fine = 64 * n
    h = np.fft.irfft(spectrum, fine, axis=1) * (fine / n)
    for z in ((0.03, 0.005, -0.55), (0.05, 0.0, 0.3), (0.04, 0.02, -1.7), (0.03, 0.0, -1.1)):
        u, v, r = np.array(z)[:, None] + h
        if dynamics.full_attack:
            speed, attack = np.hypot(u, v), np.arctan(v / u)
        else:
            speed, attack = u, v / u
        slope = [
            (p.m2 * v * r - p.c1 * speed * u + p.c2 * speed * attack * v).mean() / p.m1,
            (-p.m1 * u * r - p.c1 * speed * v - p.c2 * speed * attack * u).mean() / p.m2,
            (p.munk * (p.m1 - p.m2) / p.j3 * u * v - p.c4 * r * np.abs(r)).mean(),
        ]
        ours = average_rates(robot, BEAT, np.array(z), dynamics)
        assert ours == pytest.approx(slope + f.mean, rel=1e-7, abs=1e-9)


def test_the_published_closed_form_is_the_average_with_its_approximation() -> None:
    f = forced(ROBOT, BEAT)
    n = 64 * f.shift.shape[1]
    tau = 2.0 * np.pi * np.arange(n) / n
    h3 = f.k22 / f.omega * (1.0 - np.cos(tau))
    p = reduced(ROBOT, BEAT.bias_rad, SIMPLIFIED)
    for z3 in (-2.0, -0.9, -0.6, -0.2, 0.4):
        mean = np.mean((z3 + h3) * np.abs(z3 + h3))
        z = np.array([0.03, 0.004, z3])
        published, exact = published_rates(ROBOT, BEAT, z), average_rates(ROBOT, BEAT, z)
        assert published[2] == pytest.approx(f.mean[2] - p.c4 * mean, rel=1e-8)
        assert np.abs(published[:2] - exact[:2]).max() < 3e-5  # of 0.035 m/s²
        assert published != pytest.approx(exact, rel=1e-9)


def test_published_first_order_average() -> None:
    turn = first_order_turn(ROBOT, BEAT, published=True)
    assert turn.turn_period_s == pytest.approx(60.0873, rel=2e-4)
    assert turn.outer_radius_m == pytest.approx(0.270276, rel=0.01)
    exact = first_order_turn(ROBOT, BEAT)
    assert exact.turn_period_s == pytest.approx(60.0873, rel=1e-3)
    assert exact.turn_period_s != pytest.approx(turn.turn_period_s, rel=1e-5)


@pytest.mark.parametrize("dynamics", [ORIGINAL, SIMPLIFIED])
@pytest.mark.parametrize("beat", [BEAT, TailBeat.degrees(45, 25, 1.0)])
def test_the_first_order_average_predicts_the_turn(dynamics: Dynamics, beat: TailBeat) -> None:
    average, original = first_order_turn(ROBOT, beat, dynamics), steady_turn(ROBOT, beat, dynamics)
    for name in ("turn_radius_m", "outer_radius_m", "path_radius_m", "turn_period_s", "speed_m_s"):
        assert getattr(average, name) == pytest.approx(getattr(original, name), rel=0.025)
    # and unlike classical averaging it needs no scaling
    scaled = steady_turn(ROBOT, beat, AVERAGE)
    assert scaled.turn_period_s != pytest.approx(average.turn_period_s, rel=1e-3)


def test_straight_swimming() -> None:
    beat = TailBeat.degrees(0, 20, 1.0)
    average, original = first_order_turn(ROBOT, beat), steady_turn(ROBOT, beat, SIMPLIFIED)
    assert average.turn_period_s is None
    assert average.outer_radius_m is None
    assert average.speed_m_s == pytest.approx(original.speed_m_s, rel=0.02)


def test_a_path_ends_in_the_steady_turn() -> None:
    path = first_order_path(ROBOT, BEAT, 100.0, start=Start(1.0, 2.0, 0.5, 0.03))
    turn = first_order_turn(ROBOT, BEAT)
    assert path.rows[0] == pytest.approx([1.0, 2.0, 0.5, 0.03, 0.0, 0.0])
    last = path.time_s >= 100.0 - round(turn.turn_period_s or 0.0)
    x, y, radius = fit_circle(path.x_m[last], path.y_m[last])
    assert radius == pytest.approx(turn.turn_radius_m, rel=1e-3)
    reach = np.hypot(path.x_m[last] - x, path.y_m[last] - y).max()
    assert reach == pytest.approx(turn.outer_radius_m, rel=1e-3)
    turned = path.heading_rad[-1] - path.heading_rad[last][0]
    rate = turned / (path.time_s[-1] - path.time_s[last][0])
    assert rate == pytest.approx(turn.turn_rate_rad_s, rel=1e-4)
    assert average_equilibrium(ROBOT, BEAT) == pytest.approx(turn.settled)


def test_what_cannot_be_averaged_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="nothing left to average"):
        forced(ROBOT, BEAT, AVERAGE)
    with pytest.raises(InvalidParameterError):
        first_order_turn(ROBOT, TailBeat.degrees(20, 0, 1.0))
