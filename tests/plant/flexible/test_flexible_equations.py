"""The right-hand sides against ones written from the printed equations with quadrature.

The normal velocity along the tail is written as a function of the velocities and angles, (4.20)
with the body's motion, and differentiated in the complex plane; forces are summed over Gauss
points, and moments taken about each joint over everything beyond it (4.22–4.28), in Cartesian
components.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from plant.flexible import modes, segments
from plant.flexible.layout import FORCE_X, FORCE_Y, HINGE_MOMENT, LOADS, work_shape
from plant.flexible.rates import flexible_rates
from plant.flexible.segments import joint_stiffness_n_m
from plant.integrate import simulate
from plant.layout import ROW, STATE, Drive, State
from plant.packing import pack
from plant.parameters import PlantParameters, Tail
from plant.rigid_tail import rates
from plant.robots import flexible_tail, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme

Vector = NDArray[np.float64]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
TINY = 1e-30  # a complex step has no cancellation


def with_share(p: PlantParameters, share: float) -> PlantParameters:
    return replace(p, hydrodynamics=replace(p.hydrodynamics, body_motion_in_tail=share))


def across(a: Any, b: Any) -> Any:
    return a[0] * b[1] - a[1] * b[0]


def hull(p: PlantParameters, motion: Vector) -> tuple[Vector, Vector]:
    """Own masses (3,) and the right-hand sides of (3.5–3.7) without the tail."""
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
            (m1 - m2) * u * v - h.yaw_drag_n_m_s2 * r * abs(r),
        ]
    )
    return np.array([m1, m2, j3]), free


def mass_at(p: PlantParameters, part: float) -> float:
    profile = p.tail.depth_profile
    factor = np.interp(part, np.linspace(0, 1, len(profile)), profile) if profile else 1.0
    return float(0.25 * math.pi * p.water.density_kg_m3 * (p.tail.depth_m * factor) ** 2)


def points(p: PlantParameters, begin: float, end: float) -> list[tuple[float, float]]:
    """Gauss points (part of the length) and weights between the kinks of the profile."""
    kinks = np.linspace(0, 1, max(2, len(p.tail.depth_profile)))
    edges = [begin, *(float(k) for k in kinks if begin < k < end), end]
    return [
        (0.5 * (low + high) + 0.5 * (high - low) * float(x), 0.5 * (high - low) * float(w))
        for low, high in pairwise(edges)
        for x, w in zip(NODES, WEIGHTS, strict=True)
    ]


def segment_loads(
    p: PlantParameters, q: Vector, motion: Vector, angles: Vector, speeds: Vector
) -> tuple[Vector, Vector, Vector]:
    """Force and moment on the body, and the moments about each joint, for accelerations q.

    q: u̇, v̇, ṙ, α̈_1 … α̈_N.
    """
    n, share, c = p.tail.segments, p.hydrodynamics.body_motion_in_tail, p.body.hinge_distance_m
    length = p.tail.length_m / n
    m_hat = np.stack((-np.cos(angles), -np.sin(angles)), axis=1)
    n_hat = np.stack((np.sin(angles), -np.cos(angles)), axis=1)
    joints = np.concatenate(([[0.0, 0.0]], np.cumsum(length * m_hat, axis=0)))

    def normal_velocity(i: int, tau: float, x: NDArray[np.complex128]) -> Any:
        """v⊥ of a point; x: u, v, r, α_1 …, α̇_1 …, complex."""
        u, v, r = x[:3]
        a, rate = x[3 : 3 + n], x[3 + n :]
        result = share * (u * np.sin(a[i]) - (v - r * c) * np.cos(a[i]))
        for k in range(i):
            result = result + length * (rate[k] + share * r) * np.cos(a[k] - a[i])
        return result + tau * (rate[i] + share * r)

    now = np.concatenate((motion, angles, speeds))
    by_time = np.concatenate((q[:3], speeds, q[3:]))
    pieces: list[tuple[Vector, Vector, int]] = []
    for i in range(n):
        for part, weight in points(p, i / n, (i + 1) / n):
            tau = p.tail.length_m * part - i * length
            value = normal_velocity(i, tau, now + 1j * TINY * by_time)
            m = mass_at(p, part) * weight * p.tail.length_m
            turn = speeds[i] + share * motion[2]
            force = -m * value.imag / TINY * n_hat[i] + m * value.real * turn * m_hat[i]
            pieces.append((joints[i] + tau * m_hat[i], force, i))
    end = normal_velocity(n - 1, length, now.astype(complex)).real
    velocity = share * np.array([motion[0], motion[1] - motion[2] * c])
    velocity = velocity + sum(length * (speeds[k] + share * motion[2]) * n_hat[k] for k in range(n))
    tip = mass_at(p, 1.0)
    along = float(velocity @ m_hat[-1])
    pieces.append(
        (joints[n], -0.5 * tip * end**2 * m_hat[-1] + tip * end * along * n_hat[-1], n - 1)
    )
    force = np.sum([f for _, f, _ in pieces], axis=0)
    about_hinge = sum(across(at, f) for at, f, _ in pieces)
    about = np.array(
        [sum(across(at - joints[j], f) for at, f, i in pieces if i >= j) for j in range(1, n)]
    )
    body = np.array([force[0], force[1], about_hinge - c * force[1]])
    return body, about, np.array([force[0], force[1], about_hinge])


def segment_reference(
    p: PlantParameters, motion: Vector, angles: Vector, speeds: Vector, base: float
) -> tuple[Vector, Vector]:
    """u̇, v̇, ṙ, α̈_2 … by solving for what makes (3.5–3.7) and (4.27) hold; and the loads."""
    n = p.tail.segments
    own, free = hull(p, motion)
    stiffness = np.array([joint_stiffness_n_m(p, j) for j in range(1, n)])
    springs = stiffness * (np.diff(angles) + p.tail.damping_s * np.diff(speeds))

    def unbalance(z: Vector) -> Vector:
        q = np.concatenate((z[:3], [base], z[3:]))
        body, about, _ = segment_loads(p, q, motion, angles, speeds)
        return np.concatenate((own * z[:3] - free - body, about - springs))

    at_zero = unbalance(np.zeros(n + 2))
    columns = np.array([unbalance(e) - at_zero for e in np.eye(n + 2)]).T
    z: Vector = np.linalg.solve(columns, -at_zero)
    q = np.concatenate((z[:3], [base], z[3:]))
    return z, segment_loads(p, q, motion, angles, speeds)[2]


def our_rates(
    p: PlantParameters, y: Vector, beat: tuple[float, float, float, float], time_s: float
) -> tuple[Vector, Vector]:
    bend = p.tail.modes or p.tail.segments - 1
    out = np.zeros(STATE + 2 * bend + LOADS)
    make: Callable[[PlantParameters], Any] = modes.table if p.tail.modes else segments.table
    flexible_rates(
        pack(p),
        Drive(*beat, 0.0),
        time_s,
        y,
        out,
        make(p),
        p.tail.modes,
        np.zeros(work_shape(bend)),
    )
    end = STATE + 2 * bend
    return out[:end], out[end:]


TAPERED = {"depth_profile": (1.2, 1.0, 0.6), "thickness_profile": (1.5, 0.5)}


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("profile", [{}, TAPERED])
@pytest.mark.parametrize("n", [2, 5])
def test_segments_obey_the_equations_as_printed(
    n: int, profile: dict[str, Any], share: float
) -> None:
    p = with_share(wang2014_flexible(replace(flexible_tail(n), **profile)), share)
    random = np.random.default_rng(n)
    for _ in range(3):
        motion = random.uniform(-1.0, 1.0, 3) * (0.3, 0.3, 2.0)
        angles = random.uniform(-0.8, 0.8, n)
        speeds = random.uniform(-5.0, 5.0, n)
        omega, amplitude = 6.0, 0.3
        # a drive that passes here with the wanted angle and rate
        phase = random.uniform(0.0, 6.0)
        speeds[0] = amplitude * omega * math.cos(phase)
        base = -amplitude * omega**2 * math.sin(phase)
        bias = angles[0] - amplitude * math.sin(phase)
        state = State(0.1, 0.2, 0.4, *motion, 0.0, 0.0, 0.0)
        y = np.concatenate((state, angles[1:], speeds[1:]))
        got, loads = our_rates(p, y, (bias, amplitude, omega, phase), 0.0)
        wanted, wanted_loads = segment_reference(p, motion, angles, speeds, base)
        accelerations = np.concatenate((got[3:6], got[STATE + n - 1 :]))
        assert accelerations == pytest.approx(wanted, rel=1e-8, abs=1e-9)
        ours = loads[[FORCE_X, FORCE_Y, HINGE_MOMENT]]
        assert ours == pytest.approx(wanted_loads, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("profile", [{}, {"depth_profile": (1.3, 0.9, 0.4)}])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_one_segment_is_the_rigid_tail(share: float, profile: dict[str, Any]) -> None:
    p = with_share(replace(wang2014_flexible(), tail=Tail(**profile)), share)
    y = np.array(State(0.1, 0.2, 0.3, 0.2, -0.1, 1.1, 0.0, 0.0, 0.0))
    drive = (0.3, 0.2, 5.0, 0.4)
    got, loads = our_rates(p, y, drive, 0.3)
    wanted = rates(pack(p), Drive(*drive, 0.0), 0.3, State(*y.tolist()))
    assert got[3:6] == pytest.approx([wanted.u_dot, wanted.v_dot, wanted.r_dot], rel=1e-12)
    ours = loads[[FORCE_X, FORCE_Y, HINGE_MOMENT]]
    assert ours == pytest.approx(
        [wanted.force_x, wanted.force_y, wanted.hinge_moment], rel=1e-12, abs=1e-16
    )


def test_agrees_with_scipy_on_the_equations_as_printed() -> None:
    p = with_share(wang2014_flexible(flexible_tail(2)), 1.0)
    bias, amplitude, omega = 0.2, math.radians(13.6), 2 * math.pi * 0.9

    def rhs(t: float, s: Vector) -> Vector:
        phase = omega * t
        angles = np.array([bias + amplitude * math.sin(phase), s[6]])
        speeds = np.array([amplitude * omega * math.cos(phase), s[7]])
        base = -amplitude * omega**2 * math.sin(phase)
        z, _ = segment_reference(p, s[3:6], angles, speeds, base)
        psi, u, v = s[2], s[3], s[4]
        place = (u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi), s[5])
        return np.concatenate((place, z[:3], speeds[1:], z[3:]))

    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, bias, amplitude * omega])
    end = 0.25
    reference = solve_ivp(rhs, (0.0, end), start, method="DOP853", rtol=1e-9, atol=1e-11)
    beat = TailBeat(bias, amplitude, omega / (2 * math.pi))
    ours = simulate(p, TailProgramme.steady(beat), end, 1e-3)
    got = ours.rows[-1, [0, 1, 2, 3, 4, 5, *range(ROW, ROW + 2)]]
    scale = np.abs(reference.y).max(axis=1)
    assert np.abs(got - reference.y[:, -1]) / scale == pytest.approx(np.zeros(8), abs=2e-8)
