"""The right-hand side against one written from the equations with quadrature; published figures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from plant.integrate import simulate
from plant.layout import Drive, State
from plant.metrics import mean_thrust_n, steady_motion
from plant.packing import pack
from plant.parameters import Hydrodynamics, PlantParameters, Servo, Tail, Water
from plant.rigid_tail import rates
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
Vector = NDArray[np.float64]


def tail_wrench(
    p: PlantParameters, motion: Vector, q: Vector, tail: tuple[float, float, float]
) -> Vector:
    """F_hx, F_hy, M_hz and M_A by quadrature of (3.14) and the tip (3.9), for given q."""
    u, v, r = motion
    alpha, alpha_dot, alpha_ddot = tail
    c, length = p.body.hinge_distance_m, p.tail.length_m
    m = 0.25 * math.pi * p.water.density_kg_m3 * p.tail.depth_m**2
    m_hat = np.array([-math.cos(alpha), -math.sin(alpha)])
    n_hat = np.array([math.sin(alpha), -math.cos(alpha)])
    hinge = np.array([-c, 0.0])
    turn = alpha_dot + r

    def normal_velocity(tau: float, u: float, v: float, r: float, alpha: float) -> float:
        n = np.array([math.sin(alpha), -math.cos(alpha)])
        return float(np.array([u, v - r * c]) @ n + (alpha_dot + r) * tau)

    def derivative(tau: float) -> float:
        # chain rule; α̇ enters the last term by its own derivative
        du, dv, dr = q
        by_alpha = u * math.cos(alpha) + (v - r * c) * math.sin(alpha)
        return float(
            du * math.sin(alpha)
            - (dv - dr * c) * math.cos(alpha)
            + by_alpha * alpha_dot
            + (alpha_ddot + dr) * tau
        )

    force, moment, about_joint = np.zeros(2), 0.0, 0.0
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        tau = 0.5 * length * (node + 1.0)
        f = -m * derivative(tau) * n_hat + m * normal_velocity(tau, u, v, r, alpha) * turn * m_hat
        arm = hinge + tau * m_hat
        part = 0.5 * length * weight
        force = force + part * f
        moment += part * (arm[0] * f[1] - arm[1] * f[0])
        about_joint += part * tau * (m_hat[0] * f[1] - m_hat[1] * f[0])
    across = normal_velocity(length, u, v, r, alpha)
    along = float(np.array([u, v - r * c]) @ m_hat)
    tip_force = -0.5 * m * across**2 * m_hat + m * across * along * n_hat
    arm = hinge + length * m_hat
    force = force + tip_force
    moment += arm[0] * tip_force[1] - arm[1] * tip_force[0]
    about_joint += length * (m_hat[0] * tip_force[1] - m_hat[1] * tip_force[0])
    return np.array([force[0], force[1], moment, about_joint])


def reference_accelerations(
    p: PlantParameters, motion: Vector, tail: tuple[float, float, float]
) -> tuple[Vector, Vector]:
    """u̇, v̇, ṙ from (3.5–3.24), the tail's part in q found by evaluating it at unit vectors."""
    u, v, r = motion
    b, h = p.body, p.hydrodynamics
    m1, m2 = b.mass_kg + b.added_mass_surge_kg, b.mass_kg + b.added_mass_sway_kg
    j3 = b.yaw_inertia_kg_m2 + b.added_inertia_yaw_kg_m2
    speed, beta = math.hypot(u, v), math.atan2(v, u)
    pressure = 0.5 * p.water.density_kg_m3 * speed**2 * b.wetted_area_m2
    drag, lift = pressure * h.drag, pressure * h.lift * beta
    free = np.array(
        [
            m2 * v * r - drag * math.cos(beta) + lift * math.sin(beta),
            -m1 * u * r - drag * math.sin(beta) - lift * math.cos(beta),
            (m1 - m2) * u * v - h.yaw_drag_n_m_s2 * r * r * np.sign(r),
        ]
    )
    at_zero = tail_wrench(p, motion, np.zeros(3), tail)[:3]
    columns = [tail_wrench(p, motion, e, tail)[:3] - at_zero for e in np.eye(3)]
    mass = np.diag([m1, m2, j3]) - np.array(columns).T
    q: Vector = np.linalg.solve(mass, free + at_zero).astype(np.float64)
    return q, tail_wrench(p, motion, q, tail)


def constant_tail(alpha: float) -> Drive:
    return Drive(alpha, 0.0, 0.0, 0.0, 0.0)


SPEEDS = st.floats(-0.5, 0.5)


@given(u=SPEEDS, v=SPEEDS, r=st.floats(-3.0, 3.0), bias=st.floats(-1.0, 1.0), t=st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_closed_form_integrals_agree_with_quadrature(
    u: float, v: float, r: float, bias: float, t: float
) -> None:
    p = wang2014()
    omega, amplitude = 2 * math.pi * 0.9, math.radians(15)
    phase = omega * t
    tail = (
        bias + amplitude * math.sin(phase),
        amplitude * omega * math.cos(phase),
        -amplitude * omega**2 * math.sin(phase),
    )
    q, loads = reference_accelerations(p, np.array([u, v, r]), tail)
    got = rates(
        pack(p),
        Drive(bias, amplitude, omega, 0.0, 0.0),
        t,
        State(0.0, 0.0, 0.4, u, v, r, 0.0, 0.0, 0.0),
    )
    assert [got.u_dot, got.v_dot, got.r_dot] == pytest.approx(q, rel=1e-9, abs=1e-11)
    ours = [got.force_x, got.force_y, got.hinge_moment]
    assert ours == pytest.approx(loads[[0, 1, 3]], rel=1e-9, abs=1e-12)


def test_agrees_with_scipy_on_the_equations_as_written() -> None:
    p = wang2014()
    omega, amplitude, bias = 2 * math.pi * 0.9, math.radians(15), math.radians(20)

    def rhs(t: float, s: Vector) -> list[float]:
        phase = omega * t
        tail = (
            bias + amplitude * math.sin(phase),
            amplitude * omega * math.cos(phase),
            -amplitude * omega**2 * math.sin(phase),
        )
        q, _ = reference_accelerations(p, s[3:], tail)
        psi, u, v = s[2], s[3], s[4]
        return [
            u * math.cos(psi) - v * math.sin(psi),
            u * math.sin(psi) + v * math.cos(psi),
            s[5],
            *q,
        ]

    start = Start(u_m_s=0.02)
    reference = solve_ivp(
        rhs, (0.0, 2.0), list(start.state()[:6]), method="DOP853", rtol=1e-11, atol=1e-13
    )
    ours = simulate(p, TailProgramme.steady(TailBeat(bias, amplitude, 0.9)), 2.0, start=start)
    assert ours.rows[-1, :6] == pytest.approx(reference.y[:, -1], rel=1e-8, abs=1e-9)


# Published figures (chapter 3)


@pytest.mark.parametrize(("share", "published_n"), [(0.0, 1.188e-3), (1.0, 0.755e-3)])
def test_mean_thrust(share: float, published_n: float) -> None:
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(body_motion_in_tail=share))
    run = simulate(p, TailProgramme.steady(TailBeat.degrees(0, 15, 0.9)), 100.0)
    assert mean_thrust_n(run, 0.9) == pytest.approx(published_n, rel=0.005)


def test_turning_radius_at_20_degrees() -> None:
    run = simulate(wang2014(), TailProgramme.steady(TailBeat.degrees(20, 15, 0.9)), 200.0)
    motion = steady_motion(run.time_s, run.x_m, run.y_m, run.heading_rad, 0.9, beats=60)
    assert motion.turn_radius_m == pytest.approx(0.275, rel=0.01)
    # an independent program got 27.46 cm
    assert motion.turn_radius_m == pytest.approx(0.2746, rel=0.001)


# Table 5.2, column "Original": frequency, amplitude, speed. Chapter 5 neglects the coupling and
# ignores the body motion in the tail forces; the table prints six decimals.
TABLE_5_2 = [
    (3.1181, 18.7749, 0.112114),
    (1.0955, 17.6312, 0.036991),
    (1.8308, 25.3103, 0.088677),
    (1.1385, 25.9040, 0.056431),
    (1.2914, 13.7375, 0.033976),
    (3.4704, 19.7953, 0.131556),
    (3.0845, 18.9117, 0.111713),
    (1.9513, 22.9263, 0.085645),
    (3.8507, 24.1873, 0.178275),
    (1.1033, 25.0937, 0.052984),
]


@pytest.mark.parametrize(("frequency", "amplitude", "published"), TABLE_5_2)
def test_surge_speeds_of_table_5_2(frequency: float, amplitude: float, published: float) -> None:
    p = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-5"])
    steps, beats = 400, 200
    programme = TailProgramme.steady(TailBeat.degrees(0, amplitude, frequency))
    step = 1 / frequency / steps
    run = simulate(p, programme, beats / frequency, step, save_every=steps)
    speed = math.hypot(run.x_m[-1] - run.x_m[-11], run.y_m[-1] - run.y_m[-11]) * frequency / 10
    assert abs(round(speed * 1e6) - round(published * 1e6)) <= 1  # units of the last digit
    # and the table tells both simplifications apart
    coupled = replace(p, hydrodynamics=replace(p.hydrodynamics, munk_coupling=1.0))
    other = simulate(coupled, programme, beats / frequency, step, save_every=steps)
    assert abs(other.x_m[-1] - run.x_m[-1]) > 1e-5


def test_a_positive_bias_turns_the_body_clockwise() -> None:
    # x forward, y left; α from −x towards −y: a positive bias points the tail to the right, and
    # the body turns clockwise, as in Fig. 5.3 of the source (heading from 0 to −8 rad in 80 s)
    run = simulate(wang2014(), TailProgramme.steady(TailBeat.degrees(20, 15, 0.9)), 30.0)
    assert run.heading_rad[-1] < -1.0


# Closed forms and symmetries


def bare(**hydrodynamics: float) -> PlantParameters:
    """A body with next to no tail and only the given hydrodynamics."""
    none = {"drag": 0.0, "lift": 0.0, "yaw_drag_n_m_s2": 0.0}
    return replace(
        wang2014(), tail=Tail(depth_m=1e-7), hydrodynamics=Hydrodynamics(**(none | hydrodynamics))
    )


def test_coasting_follows_its_closed_form() -> None:
    # m₁ u̇ = −½ρSC_D u²  →  u = u₀ / (1 + k u₀ t)
    p = bare(drag=0.2231)
    run = simulate(p, TailProgramme.steady(TailBeat()), 20.0, start=Start(u_m_s=0.3))
    k = 0.5 * 1000 * 0.0108 * 0.2231 / (0.311 + 0.0621)
    assert run.u_m_s == pytest.approx(0.3 / (1 + k * 0.3 * run.time_s), rel=1e-9)
    assert run.x_m[-1] == pytest.approx(math.log(1 + k * 0.3 * 20) / k, rel=1e-9)


def test_kirchhoff_energy_is_kept_without_tail_and_drag() -> None:
    run = simulate(
        bare(), TailProgramme.steady(TailBeat()), 30.0, start=Start(u_m_s=0.2, v_m_s=0.1, r_rad_s=2)
    )
    p = pack(bare())
    energy = 0.5 * (p.m1 * run.u_m_s**2 + p.m2 * run.v_m_s**2 + p.j3 * run.r_rad_s**2)
    assert energy == pytest.approx(np.full_like(energy, energy[0]), rel=1e-9)
    # and it is no trivial motion: velocities exchange their energy
    assert np.ptp(run.v_m_s) > 0.1


def test_impulse_in_the_tank_frame_is_kept_without_tail_and_drag() -> None:
    run = simulate(
        bare(), TailProgramme.steady(TailBeat()), 10.0, start=Start(u_m_s=0.2, v_m_s=0.1, r_rad_s=2)
    )
    p = pack(bare())
    px = p.m1 * run.u_m_s * np.cos(run.heading_rad) - p.m2 * run.v_m_s * np.sin(run.heading_rad)
    py = p.m1 * run.u_m_s * np.sin(run.heading_rad) + p.m2 * run.v_m_s * np.cos(run.heading_rad)
    assert px == pytest.approx(np.full_like(px, px[0]), rel=1e-8)
    assert py == pytest.approx(np.full_like(py, py[0]), rel=1e-8)


def test_an_anchored_body_leaves_the_tail_forces_of_3_30() -> None:
    # with the body motion ignored the force is −½mL²α̈ along n̂ only: T vanishes with w = 0
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(body_motion_in_tail=0.0))
    drive = Drive(0.3, 0.2, 5.0, 0.7, 0.0)
    state = State(0.0, 0.0, 0.0, 0.2, 0.05, 1.0, 0.0, 0.0, 0.0)
    got = rates(pack(p), drive, 0.1, state)
    alpha, alpha_ddot = 0.3 + 0.2 * math.sin(1.2), -0.2 * 25 * math.sin(1.2)
    normal = -pack(p).tail_second * alpha_ddot
    assert got.force_x == pytest.approx(normal * math.sin(alpha), rel=1e-12)
    assert got.force_y == pytest.approx(-normal * math.cos(alpha), rel=1e-12)
    assert got.hinge_moment == pytest.approx(-pack(p).tail_third * alpha_ddot, rel=1e-12)


def test_the_body_feels_the_tails_added_mass() -> None:
    # tail straight, sway from rest: apparent sway mass grows by mL, and yaw couples by m(cL + ½L²)
    p = pack(bare())
    real = pack(wang2014())
    push = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    beat = Drive(0.0, 0.1, 10.0, math.pi / 2, 0.0)  # α = 0.1, α̇ = 0, α̈ = −10
    ours = rates(real, beat, 0.0, push)
    m, length, c = real.tail_mass, real.tail_length, real.hinge
    g = np.array([math.sin(0.1), -math.cos(0.1), c * math.cos(0.1)])
    e = np.array([0.0, 0.0, 1.0])
    mass = np.diag([p.m1, p.m2, p.j3]) + m * length * np.outer(g, g)
    mass += 0.5 * m * length**2 * (np.outer(g, e) + np.outer(e, g))
    mass += m * length**3 / 3 * np.outer(e, e)
    load = 10.0 * (0.5 * m * length**2 * g + m * length**3 / 3 * e)
    assert [ours.u_dot, ours.v_dot, ours.r_dot] == pytest.approx(np.linalg.solve(mass, load))
    assert np.all(np.linalg.eigvalsh(mass) > 0)


@given(u=SPEEDS, v=SPEEDS, r=st.floats(-3, 3), alpha=st.floats(-1, 1), alpha_dot=st.floats(-5, 5))
@settings(max_examples=100)
def test_left_and_right_are_mirror_images_to_the_bit(
    u: float, v: float, r: float, alpha: float, alpha_dot: float
) -> None:
    assume(v != 0.0 or u >= 0.0)  # straight astern the angle of attack is π or −π, as one likes
    p = pack(replace(wang2014(), servo=Servo()))
    one = rates(
        p, Drive(0.2, 0.0, 0.0, 0.0, 5.0), 0.0, State(0.0, 0.0, 0.5, u, v, r, alpha, alpha_dot, 0.1)
    )
    other = rates(
        p,
        Drive(-0.2, 0.0, 0.0, 0.0, 5.0),
        0.0,
        State(0.0, 0.0, -0.5, u, -v, -r, -alpha, -alpha_dot, -0.1),
    )
    signs = [1, -1, -1, 1, *[-1] * 13, 1, -1, -1]
    assert [s * value for s, value in zip(signs, other, strict=True)] == list(one)


def test_neutral_shares_change_no_bit_and_others_do() -> None:
    state = State(0.1, 0.2, 0.3, 0.05, 0.01, 0.2, 0.0, 0.0, 0.0)
    drive = Drive(0.1, 0.2, 5.0, 0.0, 0.0)
    base = rates(pack(wang2014()), drive, 0.3, state)
    same = replace(wang2014(), water=Water(current_x_m_s=0.0, current_y_m_s=-0.0))
    assert rates(pack(same), drive, 0.3, state) == base
    for field, value in (("munk_coupling", 0.9), ("body_motion_in_tail", 0.9)):
        other = replace(wang2014(), hydrodynamics=Hydrodynamics(**{field: value}))
        assert rates(pack(other), drive, 0.3, state).r_dot != base.r_dot


def test_adapted_drag_uses_the_bias() -> None:
    adapted = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-3-adapted"])
    h, bias = adapted.hydrodynamics, math.radians(30)
    plain = replace(
        adapted,
        hydrodynamics=Hydrodynamics(
            drag=h.drag + h.drag_per_bias_squared * bias**2,
            yaw_drag_n_m_s2=h.yaw_drag_n_m_s2 + h.yaw_drag_per_bias_n_m_s2 * bias,
        ),
    )
    state = State(0.0, 0.0, 0.0, 0.03, 0.01, 0.2, 0.0, 0.0, 0.0)
    drive = Drive(bias, 0.2, 5.0, 0.0, 0.0)
    got, wanted = (rates(pack(p), drive, 0.3, state) for p in (adapted, plain))
    assert got[3:6] == pytest.approx(wanted[3:6], rel=1e-12)


def test_with_a_servo_the_bias_of_the_adapted_drag_is_the_mean_tail_angle() -> None:
    p = replace(wang2014(), servo=Servo(), hydrodynamics=COEFFICIENT_SETS["chapter-3-adapted"])
    run = simulate(p, TailProgramme.steady(TailBeat.degrees(20, 15, 0.9)), 30.0)
    mean = run.rows[-10000:, 8]
    assert mean.mean() == pytest.approx(math.radians(20), rel=0.01)
    assert np.ptp(mean) < math.radians(3.0)


def test_a_uniform_current_only_carries_the_robot_along() -> None:
    beat = TailProgramme.steady(TailBeat.degrees(10, 15, 0.9))
    still = simulate(wang2014(), beat, 10.0)
    flow = simulate(
        replace(wang2014(), water=Water(current_x_m_s=0.03, current_y_m_s=-0.02)), beat, 10
    )
    assert np.array_equal(flow.rows[:, 2:9], still.rows[:, 2:9])
    assert flow.x_m - still.x_m == pytest.approx(0.03 * still.time_s, abs=1e-12)
    assert flow.y_m - still.y_m == pytest.approx(-0.02 * still.time_s, abs=1e-12)


def test_at_rest_in_the_tank_the_current_flows_past() -> None:
    water = Water(current_x_m_s=0.03, current_y_m_s=-0.02)
    start = Start.at_rest(water, 0.0, 0.0, 0.8)
    p = replace(wang2014(), water=water)
    run = simulate(p, TailProgramme.steady(TailBeat()), 0.001, start=start)
    assert run.rows[0, 9] == pytest.approx(0.0, abs=1e-15)
    assert run.rows[0, 10] == pytest.approx(0.0, abs=1e-15)
