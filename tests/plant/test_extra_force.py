"""A force that nothing else explains: neutral by default, and the equations with it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.errors import InvalidParameterError
from plant.extra_force import AXES, PLACES, TERMS, ExtraForce, extra_force
from plant.integrate import RigidMotion, motion_of, simulate
from plant.layout import Column, Drive, Packed, State
from plant.orbit import periodic_orbit
from plant.packing import pack
from plant.parameters import PlantParameters, Tail
from plant.pushed import coefficients, pushes
from plant.rigid_tail import rates
from plant.robots import fishbed_robot, wang2014
from plant.tail_input import TailBeat, TailProgramme, drive_of

BEAT = TailBeat.degrees(20, 15, 0.9)
FORCE = {"surge:u|u|": -0.08, "surge:1": 2e-4, "sway:a": 1e-3, "yaw:a_dot": 2e-6, "yaw:t": 1e-7}


def bent() -> PlantParameters:
    tail = Tail(segments=3, modulus_pa=1.48e9, thickness_m=0.3e-3, damping_s=0.079)
    return replace(wang2014(), tail=tail)


@pytest.mark.parametrize("robot", [wang2014(), fishbed_robot(), bent()])
def test_without_it_the_robot_moves_by_the_same_code(robot: PlantParameters) -> None:
    neutral = replace(robot, force=extra_force(**{"surge:u": 0.0}))
    assert neutral == robot
    assert type(motion_of(neutral, 1e-3)) is type(motion_of(replace(robot), 1e-3))
    assert not ExtraForce((("yaw:1", 0.0),)).acting
    assert isinstance(motion_of(wang2014(), 1e-3), RigidMotion)


def with_force(robot: PlantParameters, scale: float = 1.0) -> PlantParameters:
    return replace(robot, force=extra_force(**{name: scale * x for name, x in FORCE.items()}))


def test_it_is_the_solution_of_the_pushed_equations() -> None:
    """An adaptive method of order eight on the right-hand side and the forces, written apart."""
    robot = with_force(wang2014())
    p = Packed(*(float(x) for x in pack(robot)))
    omega = 2.0 * math.pi * BEAT.frequency_hz
    drive = drive_of(BEAT, 0.0, 0.0, 0.0, math.inf, None, 0.0)

    def slope(t: float, y: np.ndarray) -> list[float]:
        s = State(*y.tolist(), 0.0, 0.0, 0.0)
        k = rates(p, drive, t, s)
        a = BEAT.bias_rad + BEAT.amplitude_rad * math.sin(omega * t)
        a_dot = BEAT.amplitude_rad * omega * math.cos(omega * t)
        u = y[3]
        return [
            k.x_dot,
            k.y_dot,
            k.psi_dot,
            k.u_dot + (-0.08 * u * abs(u) + 2e-4) / p.m1,
            k.v_dot + 1e-3 * a / p.m2,
            k.r_dot + (2e-6 * a_dot + 1e-7 * t) / p.j3,
        ]

    end = solve_ivp(slope, (0.0, 8.0), np.zeros(6), method="DOP853", rtol=1e-10, atol=1e-12).y[
        :, -1
    ]
    errors = []
    for step_s in (4e-3, 2e-3, 1e-3):
        row = simulate(robot, TailProgramme.steady(BEAT), 8.0, step_s, save_every=100).rows[-1]
        errors.append(float(np.abs(row[:6] - end).max()))
    assert errors[-1] < 2e-6
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]  # of second order, with kinks


def test_saved_rates_are_those_of_the_motion() -> None:
    run = simulate(with_force(wang2014()), TailProgramme.steady(BEAT), 4.0, 1e-3)
    for value, rate in (
        (Column.U, Column.U_DOT),
        (Column.V, Column.V_DOT),
        (Column.R, Column.R_DOT),
    ):
        slope = np.gradient(run.rows[:, value], 1e-3)[500:-1]
        saved = run.rows[500:-1, rate]
        assert np.abs(slope - saved).max() < 1e-3 * np.abs(saved).max()


@pytest.mark.parametrize("robot", [fishbed_robot(), bent()])
def test_any_robot_can_be_pushed(robot: PlantParameters) -> None:
    plain = simulate(robot, TailProgramme.steady(BEAT), 3.0, 2e-3)
    ways = [
        simulate(with_force(robot, scale), TailProgramme.steady(BEAT), 3.0, 2e-3).rows[-1, 3:6]
        - plain.rows[-1, 3:6]
        for scale in (1e-3, 2e-3)
    ]
    assert np.all(np.abs(ways[0]) > 0.0)
    assert ways[1] == pytest.approx(2.0 * ways[0], rel=0.01)


def test_marching_in_pieces_is_marching_at_once() -> None:
    robot = with_force(wang2014())
    drive = np.array(drive_of(BEAT, 0.0, 0.0, 0.0, math.inf, None, 0.0))
    ends = []
    for cuts in ((0, 500), (0, 1, 137, 500)):
        motion = motion_of(robot, 1e-3)
        state = motion.state(np.zeros(len(State._fields)))
        rows = np.empty((501, motion.width))
        for first, last in itertools.pairwise(cuts):
            assert motion.march(drive, 0, first, last, state, rows, 0, 1) == last
        ends.append(rows.tobytes())
    assert ends[0] == ends[1]


def test_every_coefficient_is_a_term_of_its_axis() -> None:
    p = Packed(*(float(x) for x in pack(wang2014())))
    drive = Drive(0.3, 0.2, 5.0, 0.4, math.inf, 2.0)
    u, v, r, t = 0.04, -0.02, 0.3, 0.7
    a = 0.3 + 0.2 * math.sin(0.4 + 5.0 * t)
    a_dot = 1.0 * math.cos(0.4 + 5.0 * t)
    names = {"u": u, "v": v, "r": r, "a": a, "a_dot": a_dot, "t": t + 2.0}
    x, y, psi = 0.4, -0.7, 0.6
    names |= {"x": x, "y": y}
    state = State(x, y, psi, u, v, r, 0.0, 0.0, 0.0)
    inertia = np.array((p.m1, p.m2, p.j3))
    turned = (
        *np.eye(3),
        np.array((math.cos(psi), -math.sin(psi), 0.0)),
        np.array((math.sin(psi), math.cos(psi), 0.0)),
    )
    for (name, _), direction in zip(AXES, turned, strict=True):
        for term, _ in TERMS:
            expected = 1.0
            for factor in written_out(term):
                expected *= abs(names[factor[1:]]) if factor[0] == "|" else names[factor]
            found = pushes(p, drive, t, state, coefficients(extra_force(**{f"{name}:{term}": 1.0})))
            assert found * inertia == pytest.approx(expected * direction, rel=1e-12)


def written_out(term: str) -> list[str]:
    """The factors of a term; those within bars have one in front."""
    found = []
    for part, text in enumerate(term.split("|")):
        for word in text.split():
            letters = [word] if word == "a_dot" else list(word)
            found += [f"|{x}" if part == 1 else x for x in letters if x != "1"]
    return found


def test_wrong_names_and_numbers_are_refused_with_a_remedy() -> None:
    with pytest.raises(InvalidParameterError, match=r"force\.surge:w.*terms are 1, u, v"):
        extra_force(**{"surge:w": 1.0})
    with pytest.raises(InvalidParameterError, match=r"write surge:TERM or sway:TERM or yaw:TERM"):
        ExtraForce((("heave:1", 1.0),))
    with pytest.raises(InvalidParameterError, match=r"force\.yaw:1: must be finite"):
        extra_force(**{"yaw:1": math.nan})
    with pytest.raises(InvalidParameterError, match="steady motion of a pushed robot"):
        periodic_orbit(with_force(wang2014()), BEAT)
    assert len(PLACES) == len(AXES) * len(TERMS)
