"""(5.34) solved with a bracket: against its own three equations, and against (5.30)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from plant.averaging.average import scaled_forces
from plant.averaging.dynamics import ORIGINAL, PUBLISHED, Scaling, reduced
from plant.averaging.equilibrium import NoEquilibriumError, equilibrium
from plant.averaging.turning import steady_turning
from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))


@pytest.mark.parametrize("bias", [3, 20, 40, 50])
@pytest.mark.parametrize("amplitude", [10, 30])
def test_the_three_equations_of_5_34_hold(bias: float, amplitude: float) -> None:
    beat = TailBeat.degrees(bias, amplitude, 0.9)
    turn = steady_turning(ROBOT, beat)
    x, y, moment = scaled_forces(ROBOT, beat, PUBLISHED)
    omega, beta = 2.0 * math.pi / turn.turn_period_s, turn.attack_rad
    speed = omega * turn.turn_radius_m
    assert speed == pytest.approx(turn.speed_m_s, rel=1e-12)
    pressure = 0.5 * 1000 * 0.0108 * speed**2
    assert x * math.cos(beta) + y * math.sin(beta) == pytest.approx(pressure * 0.386, rel=1e-10)
    across = -x * math.sin(beta) + y * math.cos(beta) - pressure * 4.5 * beta
    assert across + 0.311 * omega**2 * turn.turn_radius_m == pytest.approx(0.0, abs=1e-10 * x)
    assert abs(moment) == pytest.approx(7.82e-4 * omega**2, rel=1e-10)


def test_a_solver_with_a_lucky_start_finds_the_same() -> None:
    beat = TailBeat.degrees(30, 15, 0.9)
    x, y, moment = scaled_forces(ROBOT, beat, PUBLISHED)
    m_b, c1, c2 = 0.311, 0.5 * 1000 * 0.0108 * 0.386, 0.5 * 1000 * 0.0108 * 4.5

    def equations(unknown: tuple[float, float, float]) -> list[float]:
        radius, omega, beta = unknown
        speed = omega * radius
        return [
            (x * math.cos(beta) + y * math.sin(beta) - c1 * speed**2) * 1e4,
            (y * math.cos(beta) - x * math.sin(beta) - c2 * speed**2 * beta) * 1e4
            + m_b * omega**2 * radius * 1e4,
            (abs(moment) - 7.82e-4 * omega**2) * 1e5,
        ]

    radius, omega, beta = fsolve(equations, (0.2, 0.15, 0.1), xtol=1e-13)
    turn = steady_turning(ROBOT, beat)
    assert turn.turn_radius_m == pytest.approx(radius, rel=1e-9)
    assert turn.turn_period_s == pytest.approx(2.0 * math.pi / omega, rel=1e-9)
    assert turn.attack_rad == pytest.approx(beta, rel=1e-9)


def test_with_the_added_masses_it_is_the_equilibrium_of_the_average_model() -> None:
    for bias in (-45.0, -5.0, 10.0, 35.0):
        beat = TailBeat.degrees(bias, 20, 1.0)
        turn, at = steady_turning(ROBOT, beat, added_mass=True), equilibrium(ROBOT, beat)
        assert turn.turn_radius_m == pytest.approx(at.turn_radius_m, rel=1e-9)
        assert turn.turn_period_s == pytest.approx(at.turn_period_s, rel=1e-9)
        assert turn.attack_rad == pytest.approx(at.attack_rad, rel=1e-9)


def test_the_solution_is_the_only_one() -> None:
    # what the bracket rests on: the imbalance falls all the way
    p = reduced(ROBOT, 0.0, ORIGINAL)
    beta = np.linspace(0.0, 1.07, 500)
    for bias in (5.0, 25.0, 50.0):
        x, y, moment = scaled_forces(ROBOT, TailBeat.degrees(bias, 20, 1.0), PUBLISHED)
        speed = np.sqrt((x * np.cos(beta) + y * np.sin(beta)) / p.c1)
        h = -p.c2 * speed * beta + (y * np.cos(beta) - x * np.sin(beta)) / speed
        assert (np.diff(h) < 0.0).all()
        assert h[0] + 0.311 * math.sqrt(abs(moment) / 7.82e-4) > 0.0


def test_of_two_solutions_with_the_added_masses_the_smaller_angle_is_found() -> None:
    # no fish: 7 kg of water go sideways with 0.1 kg of body
    robot = replace(
        ROBOT,
        body=replace(
            ROBOT.body,
            mass_kg=0.0928,
            yaw_inertia_kg_m2=1.4e-4,
            added_mass_surge_kg=0.4114,
            added_mass_sway_kg=7.097,
        ),
        hydrodynamics=replace(
            ROBOT.hydrodynamics, drag=0.04339, lift=52.06, yaw_drag_n_m_s2=9.913e-4
        ),
    )
    beat = TailBeat(bias_rad=0.8545, amplitude_rad=0.03574, frequency_hz=1.0)
    x, y, moment = scaled_forces(robot, beat, PUBLISHED)
    omega = math.sqrt(abs(moment) / 9.913e-4)
    m1, m2 = 0.0928 + 0.4114, 0.0928 + 7.097
    c1, c2 = 0.5 * 1000 * 0.0108 * 0.04339, 0.5 * 1000 * 0.0108 * 52.06
    beta = np.radians(np.linspace(0.001, 61.0, 60_000))
    sine, cosine = np.sin(beta), np.cos(beta)
    # along: c1 V² + (m2 − m1) V ω sin β cos β = thrust
    along = (m2 - m1) * omega * sine * cosine
    speed = (np.sqrt(along**2 + 4 * c1 * (x * cosine + abs(y) * sine)) - along) / (2 * c1)
    lift = -c2 * speed**2 * beta + abs(y) * cosine - x * sine
    left = lift + (m1 * cosine**2 + m2 * sine**2) * speed * omega
    roots = beta[1:][np.diff(np.sign(left)) != 0.0]
    assert len(roots) == 2
    turn = steady_turning(robot, beat, added_mass=True, most_attack_rad=math.radians(61.0))
    assert turn.attack_rad == pytest.approx(roots[0], abs=2e-5)
    below = math.degrees(roots[0]) - 0.1
    with pytest.raises(NoEquilibriumError, match="lift cannot balance"):
        steady_turning(robot, beat, added_mass=True, most_attack_rad=math.radians(below))


def test_no_solution_is_told_with_its_reason() -> None:
    beat = TailBeat.degrees(20, 15, 1.0)
    with pytest.raises(NoEquilibriumError, match="up to an angle of attack of 3°"):
        steady_turning(ROBOT, beat, most_attack_rad=math.radians(3.0))
    weak = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, lift=0.2))
    with pytest.raises(NoEquilibriumError, match="lift cannot balance"):
        steady_turning(weak, TailBeat.degrees(40, 15, 1.0))
    with pytest.raises(NoEquilibriumError, match="needs thrust and a moment"):
        steady_turning(ROBOT, TailBeat.degrees(0, 15, 1.0))
    with pytest.raises(NoEquilibriumError, match="needs thrust and a moment"):
        steady_turning(ROBOT, beat, Scaling(0.8485, -0.1))
    with pytest.raises(InvalidParameterError):
        steady_turning(ROBOT, beat, most_attack_rad=1.5)
