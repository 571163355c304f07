"""Linear drag, surrogate lift, shear and walls against closed forms and inertial axes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from plant.errors import DivergedError, InvalidParameterError
from plant.hull import hull_forces
from plant.integrate import simulate
from plant.layout import Column, Drive, State
from plant.metrics import steady_motion
from plant.packing import pack
from plant.parameters import Hydrodynamics, PlantParameters, Servo, Tail, Walls, Water
from plant.rigid_tail import rates
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.surroundings import shear_force
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from plant.vehicle import FS_PER_S, Vehicle

STILL = TailProgramme.steady(TailBeat())
BEAT = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
MS = FS_PER_S // 1000
Vector = NDArray[np.float64]


def bare(**others: object) -> PlantParameters:
    """A hull without drag and lift, and hardly a tail."""
    plant = PlantParameters(
        tail=Tail(depth_m=1e-9),
        hydrodynamics=Hydrodynamics(drag=0.0, lift=0.0, yaw_drag_n_m_s2=0.0),
        servo=Servo(ideal=True),
    )
    return replace(plant, **others)  # type: ignore[arg-type]


# The hull


def test_linear_drag_alone_is_an_exponential_decay() -> None:
    b = 0.05
    hydro = replace(bare().hydrodynamics, linear_drag_n_s_m=b)
    run = simulate(bare(hydrodynamics=hydro), STILL, 10.0, start=Start(u_m_s=0.1))
    mass = 0.311 + 0.0621
    np.testing.assert_allclose(run.u_m_s, 0.1 * np.exp(-b * run.time_s / mass), rtol=1e-9)
    sway = simulate(bare(hydrodynamics=hydro), STILL, 10.0, start=Start(v_m_s=0.1))
    mass = 0.311 + 0.2299
    np.testing.assert_allclose(sway.v_m_s, 0.1 * np.exp(-b * run.time_s / mass), rtol=1e-9)


@pytest.mark.parametrize("bias", [20.0, -20.0])
def test_the_surrogate_lift_has_the_sign_of_the_lift_that_it_stands_for(bias: float) -> None:
    beat = TailBeat.degrees(bias, 15, 0.9)
    motions = []
    for name in ("chapter-3", "chapter-3-surrogate"):
        plant = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS[name])
        run = simulate(plant, TailProgramme.steady(beat), 400.0, 5e-3, save_every=4)
        late = run.time_s > 400.0 - 20 / 0.9
        drift = np.arctan2(run.v_m_s[late], run.u_m_s[late]).mean()
        motions.append(steady_motion(run.time_s, run.x_m, run.y_m, run.heading_rad, 0.9))
        if name == "chapter-3":
            assert math.copysign(1.0, drift) == math.copysign(1.0, bias)
    assert math.copysign(1.0, motions[0].turn_rate_rad_s) == -math.copysign(1.0, bias)  # clockwise
    # identified from the same turns of the same robot
    assert motions[1].turn_radius_m == pytest.approx(motions[0].turn_radius_m, rel=0.03)
    assert motions[1].turn_period_s == pytest.approx(motions[0].turn_period_s, rel=0.03)


def test_the_surrogate_is_a_force_across_the_motion_in_proportion_to_the_bias() -> None:
    plant = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-3-surrogate"])
    without = replace(
        plant, hydrodynamics=replace(COEFFICIENT_SETS["chapter-3-surrogate"], lift_per_bias=0.0)
    )
    u, v, bias = 0.04, 0.01, 0.35
    with_lift, none = (
        np.array(hull_forces(pack(p), 0.0, 0.0, 0.0, u, v, 0.1, bias)) for p in (plant, without)
    )
    lift = 0.5 * 1000 * 0.0108 * (u * u + v * v) * 0.935 * bias
    speed = math.hypot(u, v)
    assert with_lift - none == pytest.approx([lift * v / speed, -lift * u / speed, 0.0])


@pytest.mark.parametrize("bias", [85.0, -85.0])
def test_drag_that_falls_with_the_bias_never_drives(bias: float) -> None:
    hydro = replace(
        wang2014().hydrodynamics, drag_per_bias_squared=-0.2, yaw_drag_per_bias_n_m_s2=-1.07e-3
    )
    p = pack(replace(wang2014(), hydrodynamics=hydro))
    for u, v, r in ((0.05, 0.0, 0.5), (0.03, -0.04, -2.0), (0.1, 0.02, 9.0)):
        x, y, n = hull_forces(p, 0.0, 0.0, 0.0, u, v, r, math.radians(bias))
        munk = p.munk * (p.m1 - p.m2) * u * v
        assert x * u + y * v - (p.m2 - p.m1) * u * v * r <= 1e-15
        assert (n - munk) * r <= 0.0


# Sheared currents


def field(water: Water) -> tuple[Vector, Vector]:
    gradient = np.array([[0.0, water.shear_x_per_y_s], [water.shear_y_per_x_s, 0.0]])
    return np.array([water.current_x_m_s, water.current_y_m_s]), gradient


@pytest.mark.parametrize(("sx", "sy"), [(0.3, 0.0), (0.0, -0.4), (0.2, 0.2), (0.3, -0.3)])
def test_a_free_hull_in_a_shear_is_the_motion_in_inertial_axes(sx: float, sy: float) -> None:
    water = Water(current_x_m_s=0.02, current_y_m_s=-0.01, shear_x_per_y_s=sx, shear_y_per_x_s=sy)
    plant = bare(water=water)
    start = Start(x_m=0.1, y_m=-0.2, heading_rad=0.7, u_m_s=0.05, v_m_s=0.02, r_rad_s=0.8)
    run = simulate(plant, STILL, 4.0, start=start)
    uniform, gradient = field(water)
    body = plant.body
    m = body.mass_kg
    added = np.diag([body.added_mass_surge_kg, body.added_mass_sway_kg])
    inertia = body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2

    def rotation(psi: float) -> Vector:
        return np.array([[math.cos(psi), -math.sin(psi)], [math.sin(psi), math.cos(psi)]])

    def rate(_t: float, y: Vector) -> Vector:
        # tank axes: position, heading, momentum q = (m + M_A(ψ)) V of the motion through the
        # water, spin momentum
        position, psi, q = y[:2], y[2], y[3:5]
        turn = rotation(psi)
        added_here = turn @ added @ turn.T
        through = np.linalg.solve(m * np.eye(2) + added_here, q)
        u, v = turn.T @ through
        q_dot = -m * gradient @ through - gradient.T @ added_here @ through
        munk = (body.added_mass_surge_kg - body.added_mass_sway_kg) * u * v
        moved = through + uniform + gradient @ position
        return np.array([*moved, y[5] / inertia, *q_dot, munk])

    turn = rotation(0.7)
    first = (m * np.eye(2) + turn @ added @ turn.T) @ turn @ np.array([0.05, 0.02])
    solved = solve_ivp(
        rate,
        (0.0, 4.0),
        [0.1, -0.2, 0.7, *first, 0.8 * inertia],
        t_eval=run.time_s[::100],
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(run.x_m[::100], solved.y[0], atol=2e-8)
    np.testing.assert_allclose(run.y_m[::100], solved.y[1], atol=2e-8)
    np.testing.assert_allclose(run.heading_rad[::100], solved.y[2], atol=2e-7)


def test_a_neutral_speck_moves_as_the_water_accelerates_it() -> None:
    # without added mass, m ẍ = m DU/Dt: in a single shear DU/Dt = G U₀, a parabola
    body = replace(
        bare().body, added_mass_surge_kg=0.0, added_mass_sway_kg=0.0, added_inertia_yaw_kg_m2=0.0
    )
    water = Water(current_x_m_s=0.03, current_y_m_s=0.05, shear_x_per_y_s=0.4)
    run = simulate(bare(body=body, water=water), STILL, 3.0, start=Start(y_m=0.2, u_m_s=0.1))
    t = run.time_s
    x = (0.1 + 0.03 + 0.4 * 0.2) * t + 0.5 * 0.4 * 0.05 * t**2
    np.testing.assert_allclose(run.x_m, x, atol=1e-9)
    np.testing.assert_allclose(run.y_m, 0.2 + 0.05 * t, atol=1e-9)


@pytest.mark.parametrize("psi", [0.0, 0.4, 2.0])
def test_a_hull_held_in_a_strain_feels_taylors_force(psi: float) -> None:
    # G. I. Taylor 1928: the gradient of ½ U·(m_f + M_A) U on a body at rest in an irrotational flow
    water = Water(current_x_m_s=0.1, current_y_m_s=0.03, shear_x_per_y_s=0.2, shear_y_per_x_s=0.2)
    plant = bare(water=water)
    body = plant.body
    masses = (
        body.mass_kg + body.added_mass_surge_kg,
        body.mass_kg + body.added_mass_sway_kg,
    )
    cosine, sine = math.cos(psi), math.sin(psi)

    def stream(x: float, y: float) -> tuple[float, float]:
        cx, cy = water.current_m_s(x, y)
        return cx * cosine + cy * sine, cy * cosine - cx * sine

    def energy(x: float, y: float) -> float:
        return sum(0.5 * m * c * c for m, c in zip(masses, stream(x, y), strict=True))

    h = 1e-3
    up_x = (energy(h, 0.0) - energy(-h, 0.0)) / (2 * h)
    up_y = (energy(0.0, h) - energy(0.0, -h)) / (2 * h)
    u, v = (-c for c in stream(0.0, 0.0))
    force = shear_force(pack(plant), psi, u, v)
    assert force[0] == pytest.approx(up_x * cosine + up_y * sine, rel=1e-9)
    assert force[1] == pytest.approx(up_y * cosine - up_x * sine, rel=1e-9)


def test_in_a_vortex_the_yaw_drag_ends_at_the_waters_own_turning() -> None:
    water = Water(shear_x_per_y_s=-0.5, shear_y_per_x_s=0.5)
    hydro = replace(bare().hydrodynamics, yaw_drag_n_m_s2=0.05)
    run = simulate(bare(water=water, hydrodynamics=hydro), STILL, 60.0, 5e-3)
    assert run.r_rad_s[-1] == pytest.approx(0.5, abs=2e-3)
    assert run.r_rad_s[0] == 0.0


def test_at_rest_means_at_rest_in_the_tank_where_it_is() -> None:
    water = Water(current_x_m_s=0.1, shear_x_per_y_s=0.3, shear_y_per_x_s=-0.2)
    start = Start.at_rest(water, 0.5, -0.4, 1.1)
    run = simulate(replace(wang2014(), water=water), STILL, 0.01, start=start)
    assert run.column(Column.X_DOT)[0] == pytest.approx(0.0, abs=1e-15)
    assert run.column(Column.Y_DOT)[0] == pytest.approx(0.0, abs=1e-15)


def test_the_accelerometer_feels_the_second_derivative_of_the_path_in_a_shear() -> None:
    water = Water(current_x_m_s=0.05, shear_x_per_y_s=0.5, shear_y_per_x_s=-0.3)
    vehicle = Vehicle(replace(wang2014(), water=water), history_fs=MS)
    vehicle.set_tail_beat(0, TailBeat.degrees(20, 15, 0.9))
    truth = vehicle.truth(2000 * MS)
    x, y, psi = truth[:, 1], truth[:, 2], truth[:, 3]
    ax, ay = ((c[2:] - 2 * c[1:-1] + c[:-2]) * 1e6 for c in (x, y))
    cosine, sine = np.cos(psi[1:-1]), np.sin(psi[1:-1])
    np.testing.assert_allclose(truth[1:-1, -2], ax * cosine + ay * sine, atol=1e-4)
    np.testing.assert_allclose(truth[1:-1, -1], ay * cosine - ax * sine, atol=1e-4)
    other = Vehicle(replace(wang2014(), water=water), history_fs=MS)
    other.set_tail_beat(0, TailBeat.degrees(20, 15, 0.9))
    for k in (500, 1500):
        assert other.body_acceleration_x(k * MS) == pytest.approx(truth[k, -2], abs=1e-12)
        assert other.body_acceleration_y(k * MS) == pytest.approx(truth[k, -1], abs=1e-12)


# Walls


def walled(drag_rise: float = 0.0, stiffness: float = 0.0) -> Walls:
    return Walls(drag_rise, stiffness, x_min_m=-1.0, y_min_m=-0.5, x_max_m=1.0, y_max_m=0.5)


@pytest.mark.parametrize(
    ("x", "y", "distance"), [(0.0, 0.0, 0.5), (0.9, 0.1, 0.1), (0.0, -0.45, 0.05), (3.0, 0.0, 0.0)]
)
def test_near_a_wall_the_drag_is_higher_by_its_exponential(
    x: float, y: float, distance: float
) -> None:
    plain = np.array(hull_forces(pack(bare()), x, y, 0.3, 0.05, 0.01, 0.0, 0.0))
    dragged = bare(hydrodynamics=replace(bare().hydrodynamics, drag=0.2))
    away, near = (
        np.array(hull_forces(pack(p), x, y, 0.3, 0.05, 0.01, 0.0, 0.0)) - plain
        for p in (dragged, replace(dragged, walls=walled(0.7)))
    )
    assert near[:2] == pytest.approx(away[:2] * (1 + 0.7 * math.exp(-distance / 0.1)))


def test_a_wall_raises_drag_and_not_lift_or_yaw_drag() -> None:
    free = wang2014()
    near = replace(free, walls=walled(0.7))
    x, y, u, v, r = 0.9, 0.1, 0.05, 0.02, 0.8
    factor = 0.7 * math.exp(-0.1 / 0.1)
    plain, raised = (np.array(hull_forces(pack(p), x, y, 0.3, u, v, r, 0.0)) for p in (free, near))
    drag = 0.5 * 1000 * free.body.wetted_area_m2 * math.hypot(u, v) * free.hydrodynamics.drag
    assert raised - plain == pytest.approx([-factor * drag * u, -factor * drag * v, 0.0], abs=1e-15)


@pytest.mark.parametrize("current", [0.04, -0.04])
def test_a_wall_feels_the_speed_over_the_floor(current: float) -> None:
    plant = replace(bare(walls=walled(0.0, 50.0)), water=Water(current_x_m_s=current))
    u = 0.03
    overlap = 0.01
    x = 1.0 - plant.body.hinge_distance_m + overlap
    force = hull_forces(pack(plant), x, 0.0, 0.0, u, 0.0, 0.0, 0.0)[0]
    assert force == pytest.approx(-50.0 * overlap * (1.0 + 5.0 * (u + current)), rel=1e-9)


def test_open_water_has_no_walls() -> None:
    open_water = replace(wang2014(), walls=Walls(drag_rise=5.0, stiffness_n_m=100.0))
    one, other = (simulate(p, BEAT, 3.0) for p in (open_water, wang2014()))
    np.testing.assert_array_equal(one.rows, other.rows)


@pytest.mark.parametrize(("stiffness", "step_s"), [(20.0, 1e-3), (1000.0, 5e-3), (1000.0, 0.02)])
def test_a_soft_wall_throws_the_body_back_and_never_adds_energy(
    stiffness: float, step_s: float
) -> None:
    plant = bare(walls=walled(0.0, stiffness))
    start = Start(x_m=0.7, heading_rad=0.3, u_m_s=0.08)
    run = simulate(plant, STILL, 60.0, step_s, start)
    body = plant.body
    m1, m2 = body.mass_kg + body.added_mass_surge_kg, body.mass_kg + body.added_mass_sway_kg
    j = body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2
    kinetic = 0.5 * (m1 * run.u_m_s**2 + m2 * run.v_m_s**2 + j * run.r_rad_s**2)
    assert run.x_m.max() > 0.93  # it has touched
    assert np.all(np.abs(run.x_m) < 1.0 + 0.03)
    assert np.all(np.abs(run.y_m) < 0.5 + 0.03)
    assert kinetic.max() <= kinetic[0] * (1 + 1e-3)
    assert kinetic[-1] < 0.9 * kinetic[0]


def test_a_wall_that_does_nothing_lets_the_robot_through() -> None:
    run = simulate(bare(walls=walled()), STILL, 10.0, start=Start(u_m_s=0.5))
    assert run.x_m[-1] == pytest.approx(5.0)


def test_walls_without_water_between_them_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match=r"walls\.x_max_m"):
        Walls(x_min_m=1.0, x_max_m=1.0)
    with pytest.raises(InvalidParameterError, match=r"walls\.y_max_m"):
        Walls(y_min_m=math.nan)


def test_a_diverging_motion_still_stops_with_the_time_and_the_state() -> None:
    water = Water(shear_x_per_y_s=10.0, shear_y_per_x_s=10.0)
    with pytest.raises(DivergedError) as caught:
        simulate(bare(water=water), STILL, 60.0, start=Start(u_m_s=0.1))
    assert 0.0 < caught.value.time_s < 60.0
    assert all(math.isfinite(value) for value in caught.value.state)


def test_neutral_terms_stand_behind_a_test() -> None:
    # at rest, where a zero has a sign: the very bits of the source's model
    p = pack(wang2014())
    got = rates(p, Drive(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, State(*(0.0,) * 10))
    assert [math.copysign(1.0, value) for value in got[:2]] == [1.0, 1.0]
