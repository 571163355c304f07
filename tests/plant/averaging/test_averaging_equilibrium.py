"""Equilibria, their linearisation and their reach, against formulas as printed and SciPy."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.averaging.average import forcing
from plant.averaging.basin import basin, grid_of_starts
from plant.averaging.dynamics import (
    AVERAGE,
    ORIGINAL,
    PUBLISHED,
    SIMPLIFIED,
    Scaling,
    hull,
    reduced,
)
from plant.averaging.equilibrium import (
    NoEquilibriumError,
    closed_form,
    equilibria,
    equilibrium,
    jacobian,
    stability,
)
from plant.averaging.motion import steady_turn
from plant.averaging.search import BeatGrid
from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))
COUPLED = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, munk_coupling=0.4))
BEATS = [TailBeat.degrees(b, a, f) for b, a, f in ((20, 15, 1.0), (-35, 20, 0.9), (50, 30, 3.0))]


@pytest.mark.parametrize("bias", [0.0, 0.2, 0.6])
def test_closed_form_as_printed(bias: float) -> None:
    a, w = 0.26, 2.0 * math.pi * 1.4
    m, length, c, area, m1 = math.pi * 1000 * 0.025**2 / 4, 0.08, 0.07, 0.0108, 0.311 + 0.0621
    drag, lift, yaw, k_force, k_moment = 0.386, 4.5, 7.82e-4, 0.8485, -0.0074 + 0.4831 * bias
    q = 3 - 1.5 * bias**2 - 3 / 8 * a**2
    x1 = math.sqrt(k_force * m * length**2 * w**2 * a**2 * q / (6 * 1000 * area * drag))
    turning = math.sqrt(max(0.0, k_moment * m * length**2 * c * w**2 * a**2 * bias / (4 * yaw)))
    x2 = (
        k_force
        * math.sqrt(6 * m * 1000 * area * drag * length**2 * w**2 * a**2 * bias**2)
        / (2 * 1000 * area * (drag + lift) * math.sqrt(k_force * q))
    ) + 2 * m1 / (1000 * area * (drag + lift)) * turning
    at = closed_form(ROBOT, TailBeat(bias, a, 1.4))
    assert (at.u_m_s, at.v_m_s, at.r_rad_s) == pytest.approx((x1, x2, -turning), rel=1e-12)


@pytest.mark.parametrize("robot", [ROBOT, COUPLED])
@pytest.mark.parametrize("beat", BEATS)
def test_the_exact_equilibrium_is_where_the_average_model_ends(
    robot: PlantParameters, beat: TailBeat
) -> None:
    at, end = equilibrium(robot, beat), steady_turn(robot, beat, AVERAGE)
    assert (at.u_m_s, at.v_m_s, at.r_rad_s) == pytest.approx(end.velocity, rel=1e-7)
    assert at.turn_radius_m == pytest.approx(end.turn_radius_m, rel=1e-7)
    p, f = reduced(robot, beat.bias_rad, AVERAGE), forcing(robot, beat, AVERAGE)
    left = np.array(hull(p, at.u_m_s, at.v_m_s, at.r_rad_s)) + np.array([f.x, f.y, f.z])
    assert np.abs(left).max() < 1e-13


def test_the_closed_form_is_good_for_a_small_bias() -> None:
    errors = [
        closed_form(ROBOT, TailBeat.degrees(bias, 15, 1)).speed_m_s
        / equilibrium(ROBOT, TailBeat.degrees(bias, 15, 1)).speed_m_s
        - 1.0
        for bias in (0.0, 5.0, 20.0, 50.0)
    ]
    assert abs(errors[0]) < 1e-12
    assert np.abs(errors).max() < 0.03
    assert sorted(np.abs(errors[:3])) == list(np.abs(errors[:3]))


@pytest.mark.parametrize("beat", BEATS)
def test_there_is_one_equilibrium(beat: TailBeat) -> None:
    assert len(equilibria(ROBOT, beat)) == 1


def rates(robot: PlantParameters, x: Any) -> Any:
    """f₁…f₃ of (5.5), written for complex numbers with u > 0 and r < 0."""
    p = reduced(robot, 0.0, ORIGINAL)
    u, v, r = x
    speed, beta = np.sqrt(u * u + v * v), np.arctan(v / u)
    return np.array(
        [
            p.m2 / p.m1 * v * r - p.c1 / p.m1 * u * speed + p.c2 / p.m1 * v * speed * beta,
            -p.m1 / p.m2 * u * r - p.c1 / p.m2 * v * speed - p.c2 / p.m2 * u * speed * beta,
            p.munk * (p.m1 - p.m2) / p.j3 * u * v + p.c4 * r * r,
        ]
    )


@pytest.mark.parametrize("robot", [ROBOT, COUPLED])
def test_the_jacobian_by_complex_steps(robot: PlantParameters) -> None:
    for u, v, r in ((0.03, 0.002, -0.1), (0.1, -0.05, -2.0), (0.01, 0.08, -0.5)):
        expected = np.empty((3, 3))
        for column in range(3):
            step = np.zeros(3)
            step[column] = 1e-30
            expected[:, column] = rates(robot, np.array([u, v, r]) + 1j * step).imag / 1e-30
        assert jacobian(robot, 0.0, (u, v, r)) == pytest.approx(expected, rel=1e-11, abs=1e-14)


def test_the_jacobian_of_the_simplified_model_by_differences() -> None:
    p = reduced(ROBOT, 0.0, SIMPLIFIED)
    at, h = np.array([0.03, 0.004, -0.2]), 1e-6
    ours = jacobian(ROBOT, 0.0, (0.03, 0.004, -0.2), SIMPLIFIED)
    for column in range(3):
        step = h * np.eye(3)[column]
        plus, minus = np.array(hull(p, *(at + step))), np.array(hull(p, *(at - step)))
        assert (plus - minus) / (2 * h) == pytest.approx(ours[:, column], rel=1e-7, abs=1e-9)


def printed_elements(u: float, v: float, r: float) -> Any:
    """(5.31), element by element as the source prints it."""
    p = reduced(ROBOT, 0.0, ORIGINAL)
    m1, m2, c1, c2, t, s = p.m1, p.m2, p.c1, p.c2, math.atan(v / u), math.sqrt(u * u + v * v)
    s2 = s * s
    return [
        [
            -c1 / m1 * u * u / s + c2 / m1 * u * v / s * t - c1 / m1 * s - c2 / m1 * s * v * v / s2,
            m2 / m1 * r
            - c1 / m1 * u * v / s
            + c2 / m1 * s * t
            + c2 / m1 * v * v / s * t
            + c2 / m1 * s * u * v / s2,
            m2 / m1 * v,
        ],
        [
            -m1 / m2 * r
            - c1 / m2 * u * v / s
            - c2 / m2 * s * t
            - c2 / m2 * u * u / s * t
            + c2 / m2 * s * u * v / s2,
            -c2 / m2 * u * v / s * t - c1 / m2 * v * v / s - c1 / m2 * s - c2 / m2 * s * u * u / s2,
            -m1 / m2 * u,
        ],
        [0.0, 0.0, -2.0 * p.c4 * abs(r)],
    ]


def test_the_printed_elements_are_right_and_the_printed_trace_is_not() -> None:
    u, v, r = 0.05, 0.01, -0.3
    ours = jacobian(ROBOT, 0.0, (u, v, r))
    assert ours == pytest.approx(np.array(printed_elements(u, v, r)), rel=1e-12)
    # "a11 + a22 = −(3c1 + c2)√(x1² + x2²)" lacks the masses; it holds for m1 = m2, divided by them
    speed, p = math.hypot(u, v), reduced(ROBOT, 0.0, ORIGINAL)
    trace = ours[0, 0] + ours[1, 1]
    printed = -(3.0 * p.c1 + p.c2) * speed
    assert trace == pytest.approx(printed / math.sqrt(p.m1 * p.m2), rel=0.15)
    assert abs(trace / printed - 1.0) > 0.9
    same = replace(ROBOT, body=replace(ROBOT.body, added_mass_sway_kg=0.0621))
    equal = jacobian(same, 0.0, (u, v, r))
    assert equal[0, 0] + equal[1, 1] == pytest.approx(printed / p.m1, rel=1e-12)


def test_the_printed_determinant_without_the_terms_in_r() -> None:
    p = reduced(ROBOT, 0.0, ORIGINAL)
    for u, v in ((0.03, 0.002), (0.05, 0.03)):
        m = jacobian(ROBOT, 0.0, (u, v, 0.0))
        attack = math.atan(v / u)
        printed = (2 * p.c1**2 + 2 * p.c1 * p.c2 + 2 * p.c2**2 * attack**2) * (u * u + v * v)
        determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
        assert determinant == pytest.approx(printed / (p.m1 * p.m2), rel=1e-9)


def test_every_equilibrium_of_the_source_is_hurwitz() -> None:
    for beat in BeatGrid(frequencies_hz=(1.0, 5.0)).beats():
        at = equilibrium(ROBOT, beat)
        found = stability(ROBOT, beat, at)
        assert found.hurwitz
        assert 0.0 < found.slowest_s < 15.0


def test_deviations_die_as_the_linearisation_says() -> None:
    beat = BEATS[0]
    at = equilibrium(ROBOT, beat)
    found = stability(ROBOT, beat, at)
    values, vectors = np.linalg.eig(found.matrix)
    p, f = reduced(ROBOT, beat.bias_rad, AVERAGE), forcing(ROBOT, beat, AVERAGE)
    rest = np.array([at.u_m_s, at.v_m_s, at.r_rad_s])
    for value, vector in zip(values.real, vectors.real.T, strict=True):
        start = rest + 1e-6 * vector
        solved = solve_ivp(
            lambda _, x: np.array(hull(p, *x)) + np.array([f.x, f.y, f.z]),
            (0.0, 2.0),
            start,
            method="DOP853",
            rtol=1e-12,
            atol=1e-16,
        )
        shrunk = np.linalg.norm(solved.y[:, -1] - rest) / 1e-6
        assert shrunk == pytest.approx(math.exp(2.0 * value), rel=1e-3)


def test_straight_swimming_has_no_exponential_in_yaw() -> None:
    beat = TailBeat.degrees(0, 15, 1.0)
    at = equilibrium(ROBOT, beat)
    assert (at.v_m_s, at.r_rad_s) == (0.0, 0.0)
    assert at.turn_radius_m == math.inf
    found = stability(ROBOT, beat, at)
    assert not found.hurwitz
    assert found.slowest_s == math.inf
    assert sorted(found.eigenvalues.real)[:2] < [0.0, 0.0]


def test_the_coupling_makes_straight_swimming_unstable() -> None:
    # Munk's moment: a saddle between a turn to either side
    full = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, munk_coupling=1.0))
    beat = TailBeat.degrees(0, 15, 1.0)
    found = equilibria(full, beat)
    rates = sorted(at.r_rad_s for at in found)
    assert len(found) == 3
    assert rates[0] == pytest.approx(-rates[2], rel=1e-9)
    assert rates[1] == pytest.approx(0.0, abs=1e-9)
    for at in found:
        assert stability(full, beat, at).hurwitz == (abs(at.r_rad_s) > 1e-6)
    assert stability(full, beat, equilibrium(full, beat)).hurwitz
    # a small bias leaves both turns; which one is swum, the start decides
    small = TailBeat.degrees(5, 15, 1.0)
    starts = grid_of_starts(0.2, 2.0, 5)
    along, against = equilibria(full, small)[1:]
    ends = basin(full, small, starts).last
    ends_at = [
        np.abs(ends - (at.u_m_s, at.v_m_s, at.r_rad_s)).max(axis=1) < 1e-3
        for at in (along, against)
    ]
    assert (ends_at[0] ^ ends_at[1]).all()
    assert ends_at[0].any()
    assert ends_at[1].any()
    end = steady_turn(full, TailBeat.degrees(0.01, 15, 1.0), AVERAGE)
    assert abs(end.turn_rate_rad_s) == pytest.approx(rates[2], rel=0.05)


def test_no_equilibrium_is_told() -> None:
    with pytest.raises(NoEquilibriumError, match="K_moment is negative"):
        closed_form(ROBOT, TailBeat.degrees(10, 15, 1.0), Scaling(0.8, -0.2, 0.4831))
    with pytest.raises(NoEquilibriumError, match="thrust"):
        closed_form(ROBOT, TailBeat.degrees(82, 5, 1.0))


def test_all_of_the_basin_comes_to_the_equilibrium() -> None:
    starts = grid_of_starts(0.3, 3.0, 7)
    assert starts.shape == (343, 3)
    for beat in BEATS[:2]:
        found = basin(ROBOT, beat, starts)
        assert found.converged.all()
        assert found.time_s.max() < 120.0


def test_straight_swimming_attracts_as_its_yaw_dies() -> None:
    beat = TailBeat.degrees(0, 15, 1.0)
    found = basin(ROBOT, beat, np.array([[0.05, 0.0, 1.0], [0.03, 0.01, -4.0]]))
    assert found.converged.all()
    # ṙ = −c₄ r|r|: 1/r grows by c₄t
    c4 = reduced(ROBOT, 0.0, AVERAGE).c4
    for start, time_s in zip((1.0, 4.0), found.time_s, strict=True):
        assert time_s == pytest.approx((1.0 / 5e-3 - 1.0 / start) / c4, rel=0.01)


def test_the_basin_agrees_with_scipy_and_counts_from_the_start() -> None:
    beat = BEATS[0]
    starts = np.array([[0.2, 0.1, 1.0], [-0.1, 0.02, -1.0]])
    found = basin(ROBOT, beat, starts)
    p, f = reduced(ROBOT, beat.bias_rad, AVERAGE), forcing(ROBOT, beat, AVERAGE)
    target = np.array([found.at.u_m_s, found.at.v_m_s, found.at.r_rad_s])
    near = 1e-3 * np.array([found.at.speed_m_s, found.at.speed_m_s, abs(found.at.r_rad_s)])

    def there(_: float, x: Any) -> float:
        return float(np.max(np.abs(x - target) / near) - 1.0)

    there.terminal = True  # type: ignore[attr-defined]  # solve_ivp reads it from the function
    for start, time_s in zip(starts, found.time_s, strict=True):
        solved = solve_ivp(
            lambda _, x: np.array(hull(p, *x)) + np.array([f.x, f.y, f.z]),
            (0.0, 300.0),
            start,
            method="DOP853",
            events=there,
            rtol=1e-9,
            atol=1e-12,
        )
        assert time_s == pytest.approx(solved.t_events[0][0], abs=0.4)
    short = basin(ROBOT, beat, starts, duration_s=0.1)
    assert not short.converged.any()
    assert np.isinf(short.time_s).all()
    at_once = basin(ROBOT, beat, target[None, :])
    assert at_once.time_s.tolist() == [0.0]


def test_a_basin_of_nonsense_is_refused() -> None:
    for starts in (np.zeros((3, 2)), np.full((1, 3), np.nan)):
        with pytest.raises(InvalidParameterError):
            basin(ROBOT, BEATS[0], starts, PUBLISHED)
    with pytest.raises(InvalidParameterError):
        grid_of_starts(0.1, 1.0, 1)
    assert len(list(itertools.product(range(3), repeat=3))) == len(grid_of_starts(0.1, 1.0, 3))
