"""Chapter 5's dynamics against the plant, against SciPy, and against published figures."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.averaging.dynamics import AVERAGE, CLASSICAL, ORIGINAL, SIMPLIFIED, Dynamics, Scaling
from plant.averaging.motion import steady_turn, swim
from plant.errors import DivergedError, InvalidParameterError, PlantError
from plant.integrate import simulate
from plant.metrics import fit_circle
from plant.orbit import periodic_orbit
from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))
BEAT = TailBeat.degrees(20, 15, 1.0)

# frequency, amplitude, "Original", "Averaged"
TABLE_5_2 = [
    (3.1181, 18.7749, 0.112114, 0.114017),
    (1.0955, 17.6312, 0.036991, 0.037648),
    (1.8308, 25.3103, 0.088677, 0.089746),
    (1.1385, 25.9040, 0.056431, 0.057084),
    (1.2914, 13.7375, 0.033976, 0.034661),
    (3.4704, 19.7953, 0.131556, 0.133695),
    (3.0845, 18.9117, 0.111713, 0.113599),
    (1.9513, 22.9263, 0.085645, 0.086837),
    (3.8507, 24.1873, 0.178275, 0.180581),
    (1.1033, 25.0937, 0.052984, 0.053632),
]


@pytest.mark.parametrize(("frequency", "amplitude", "original", "averaged"), TABLE_5_2)
def test_both_columns_of_table_5_2(
    frequency: float, amplitude: float, original: float, averaged: float
) -> None:
    # the printed numbers are rounded to 1e-6
    beat = TailBeat.degrees(0, amplitude, frequency)
    speed = steady_turn(ROBOT, beat).speed_m_s
    assert abs(round(speed * 1e6) - round(original * 1e6)) <= 1  # units of the last digit
    assert steady_turn(ROBOT, beat, AVERAGE).speed_m_s == pytest.approx(averaged, abs=1e-6)
    assert steady_turn(ROBOT, beat).turn_period_s is None


def test_turn_of_the_simplified_model() -> None:
    turn = steady_turn(ROBOT, BEAT, SIMPLIFIED)
    assert turn.turn_period_s == pytest.approx(59.7734, rel=0.003)
    assert turn.outer_radius_m == pytest.approx(0.26776, rel=0.003)
    assert turn.turn_radius_m == pytest.approx(0.26776, rel=0.003)


def test_the_original_dynamics_are_the_plant_without_body_motion_and_coupling() -> None:
    start = Start(0.1, 0.2, 0.3, 0.02, 0.01, 0.1)
    programme = TailProgramme(
        (BEAT, TailBeat.degrees(-30, 20, 1.0)), starts_s=(0.0, 5.0), phase_rad=0.4
    )
    ours = swim(ROBOT, programme, 10.0, step_s=2e-3, start=start, save_every=50)
    plant = simulate(ROBOT, programme, 10.0, 2e-3, start, save_every=50)
    assert np.allclose(ours.time_s, plant.time_s)
    assert np.allclose(ours.rows, plant.rows[:, :6], rtol=0.0, atol=1e-11)
    with_coupling = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, munk_coupling=1.0))
    ours = swim(with_coupling, programme, 10.0, step_s=2e-3, start=start, save_every=50)
    plant = simulate(with_coupling, programme, 10.0, 2e-3, start, save_every=50)
    assert np.allclose(ours.rows, plant.rows[:, :6], rtol=0.0, atol=1e-11)


def printed_5_18(beat: TailBeat) -> Any:
    """(5.18) with k₁…k₂₁ as the source lists them, for the robot of Table 3.1."""
    m1, m2, j3 = 0.311 + 0.0621, 0.311 + 0.2299, 0.311 * 0.14**2 / 12 + 1.0413e-4
    m, length, c = math.pi * 1000 * 0.025**2 / 4, 0.08, 0.07
    a0, a, w = beat.bias_rad, beat.amplitude_rad, 2 * math.pi * beat.frequency_hz
    k1, k2, k3 = 0.5 * 1000 * 0.0108 * 0.386, 0.5 * 1000 * 0.0108 * 4.5, 7.82e-4 / j3
    k4 = m / (12 * m1) * length**2 * a * w**2 * (3 * a - 1.5 * a0**2 * a - 3 / 8 * a**3)
    k5 = m / (4 * m2) * length**2 * a0 * a**2 * w**2
    k6 = length**2 / (4 * j3) * m * c * a0 * a**2 * w**2
    k7 = m / (12 * m1) * length**2 * a * w**2
    k8, k9, k10 = 6 * a0 - a0**3, 3 * a - 1.5 * a0**2 * a, 3 * a0 * a**2
    k11, k12 = a**3 / 2, a**3 / 8
    k13, k14, k15, k16 = m / (4 * m2) * length**2 * a * w**2, 2 - a0**2, a0 * a, a**2
    k17 = length**2 / (4 * j3) * m * c * a * w**2
    k18, k19, k20, k21 = 2 - a0**2, a0 * a, a**2, length**3 * m / (3 * j3) * a * w**2

    def rates(t: float, x: Any) -> list[float]:
        u, v, r, psi = x[:4]
        s, s3, c2, c4 = math.sin(w * t), math.sin(w * t) ** 3, math.cos(2 * w * t), 0.0
        c4 = math.cos(4 * w * t)
        return [
            m2 / m1 * v * r
            - k1 / m1 * u * u
            + k2 / m1 * v * v
            + k4
            + k7 * (k8 * s - k9 * c2 - k10 * s3 + k11 * c2 - k12 * c4),
            -m1 / m2 * u * r - (k1 + k2) / m2 * u * v + k5 - k13 * (k14 * s + k15 * c2 - k16 * s3),
            -k3 * r * abs(r) - k6 + k17 * (k18 * s + k19 * c2 - k20 * s3) + k21 * s,
            r,
            u * math.cos(psi) - v * math.sin(psi),
            u * math.sin(psi) + v * math.cos(psi),
        ]

    return rates


def test_the_simplified_model_is_5_18_with_its_printed_constants() -> None:
    solved = solve_ivp(
        printed_5_18(BEAT), (0, 8), [0.03, 0, 0, 0, 0, 0], method="DOP853", rtol=1e-11, atol=1e-13
    )
    ours = swim(ROBOT, TailProgramme.steady(BEAT), 8.0, SIMPLIFIED, 1e-3, start=Start(u_m_s=0.03))
    u, v, r, psi, x, y = solved.y[:, -1]
    assert ours.rows[-1] == pytest.approx([x, y, psi, u, v, r], rel=0.0, abs=2e-8)


def test_runge_kutta_has_order_four() -> None:
    # the average model is smooth as long as r keeps its sign
    start = Start(u_m_s=0.05, v_m_s=0.01, r_rad_s=-1.0)
    ends = [
        swim(ROBOT, TailProgramme.steady(BEAT), 4.0, AVERAGE, step, start).rows[-1]
        for step in (0.2, 0.1, 0.05, 0.003125)
    ]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:3]]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("dynamics", [ORIGINAL, SIMPLIFIED])
def test_the_steady_turn_is_that_of_a_long_path(dynamics: Dynamics) -> None:
    turn = steady_turn(ROBOT, BEAT, dynamics)
    assert turn.turn_period_s is not None
    path = swim(
        ROBOT,
        TailProgramme.steady(BEAT),
        60.0 + round(turn.turn_period_s),
        dynamics,
        0.0078125,
        Start(u_m_s=0.02),
    )
    last = path.time_s >= 60.0
    x, y = path.x_m[last], path.y_m[last]
    centre_x, centre_y, radius = fit_circle(x, y)
    reach = np.hypot(x - centre_x, y - centre_y).max()
    assert radius == pytest.approx(turn.turn_radius_m, rel=3e-4)
    assert reach == pytest.approx(turn.outer_radius_m, rel=3e-4)
    length = np.hypot(np.diff(x), np.diff(y)).sum()
    around = length / (path.heading_rad[-1] - path.heading_rad[last][0])
    assert abs(around) == pytest.approx(turn.path_radius_m, rel=1e-3)
    beat = path.rows[-129:, 3:]
    assert beat[:-1].mean(axis=0) == pytest.approx(turn.velocity, rel=1e-5)
    assert path.rows[-1, 3:] == pytest.approx(turn.settled, rel=1e-5)


def test_the_steady_turn_is_the_periodic_orbit() -> None:
    for beat in (BEAT, TailBeat.degrees(-45, 25, 2.0)):
        turn, orbit = steady_turn(ROBOT, beat), periodic_orbit(ROBOT, beat, 1.0 / 256.0)
        assert turn.turn_rate_rad_s == pytest.approx(orbit.turn_rate_rad_s, rel=1e-5)
        assert turn.turn_radius_m == pytest.approx(orbit.turn_radius_m, rel=1e-3)


def test_a_faster_beat_swims_the_same_path() -> None:
    slow = steady_turn(ROBOT, BEAT)
    fast = steady_turn(ROBOT, TailBeat.degrees(20, 15, 3.0))
    assert fast.turn_radius_m == pytest.approx(slow.turn_radius_m, rel=1e-8)
    assert fast.turn_rate_rad_s == pytest.approx(3.0 * slow.turn_rate_rad_s, rel=1e-8)


def test_classical_averaging_is_far_off() -> None:
    original = steady_turn(ROBOT, BEAT)
    classical = steady_turn(ROBOT, BEAT, Dynamics(full_tail=False, scaling=CLASSICAL))
    scaled = steady_turn(ROBOT, BEAT, AVERAGE)
    assert original.turn_radius_m is not None
    assert classical.turn_radius_m == pytest.approx(0.424 * original.turn_radius_m, rel=0.01)
    assert scaled.turn_radius_m == pytest.approx(original.turn_radius_m, rel=0.01)


def test_bias_of_either_sign_turns_the_other_way() -> None:
    left, right = (steady_turn(ROBOT, TailBeat.degrees(b, 15, 1.0), AVERAGE) for b in (-20, 20))
    assert left.turn_rate_rad_s == pytest.approx(-right.turn_rate_rad_s, rel=1e-9)
    assert right.turn_rate_rad_s < 0.0
    assert left.turn_radius_m == pytest.approx(right.turn_radius_m, rel=1e-9)


def test_a_robot_that_chapter_5_does_not_have_is_refused() -> None:
    hydro, body = ROBOT.hydrodynamics, ROBOT.tail
    for robot in (
        replace(ROBOT, tail=replace(body, segments=3, joint_stiffness_n_m=5e-3)),
        replace(ROBOT, tail=replace(body, depth_profile=(1.0, 1.2))),
        replace(ROBOT, hydrodynamics=replace(hydro, lift_per_bias=0.9)),
        replace(ROBOT, hydrodynamics=replace(hydro, linear_drag_n_s_m=0.1)),
        replace(ROBOT, walls=replace(ROBOT.walls, drag_rise=0.5)),
        replace(ROBOT, water=replace(ROBOT.water, shear_y_per_x_s=0.1)),
        replace(ROBOT, linkage=replace(ROBOT.linkage, gain_error=0.1)),
    ):
        with pytest.raises(InvalidParameterError, match="chapter 5 do not have"):
            steady_turn(robot, BEAT)
    moving_water = replace(ROBOT, water=replace(ROBOT.water, current_x_m_s=0.1))
    assert steady_turn(moving_water, BEAT) == steady_turn(ROBOT, BEAT)


def test_what_makes_no_sense_is_refused() -> None:
    for beat in (TailBeat(0.1, 0.0, 1.0), TailBeat(0.1, 0.2, 0.0), TailBeat.degrees(70, 30, 1.0)):
        with pytest.raises(InvalidParameterError):
            steady_turn(ROBOT, beat)
    with pytest.raises(InvalidParameterError):
        Scaling(0.0, 1.0)
    with pytest.raises(InvalidParameterError):
        swim(ROBOT, TailProgramme.steady(BEAT), 1.0, save_every=0)
    with pytest.raises(InvalidParameterError):
        steady_turn(ROBOT, BEAT, steps_per_beat=4)
    with pytest.raises(PlantError, match="no steady motion after 3 beats"):
        steady_turn(ROBOT, BEAT, most_beats=3)
    with pytest.raises(DivergedError):
        swim(ROBOT, TailProgramme.steady(BEAT), 10.0, SIMPLIFIED, 0.5, Start(u_m_s=30.0))
    # 8 steps are too few for the lift of a vast fin
    lifted = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, lift=1000.0))
    with pytest.raises(DivergedError, match="diverged in its first step"):
        steady_turn(lifted, TailBeat.degrees(60, 29, 100.0), steps_per_beat=8)
