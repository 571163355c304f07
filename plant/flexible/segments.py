"""Right-hand side of the multi-segment tail (4.18–4.29), with or without the body's motion.

N rigid segments of length l, segment i at the angle α_i to the −x axis; α_1 is the servo's. With
m̂_i = (−cos α_i, −sin α_i), n̂_i = (sin α_i, −cos α_i), the share s of body motion (0: anchored, as
published), V_0 = s(u, v − r c) the velocity of the joint at the body and Ω_i = s r + α̇_i:

    w_i = V_{i−1}·n̂_i,   p_i = V_{i−1}·m̂_i,   V_i = V_{i−1} + l Ω_i n̂_i,
    v⊥(τ) = w_i + Ω_i τ,   v̇⊥(τ) = ẇ_i + Ω̇_i τ,   ẇ_i = V̇_{i−1}·n̂_i − α̇_i p_i,
    V̇_i = V̇_{i−1} + l Ω̇_i n̂_i − l Ω_i α̇_i m̂_i          (components in body axes)

(for s = 0 this is (4.20, 4.21)). With M0, M1, M2 = ∫m, ∫mτ, ∫mτ² of a segment, its force along n̂,
along m̂ and its moment about its joint are (4.21, 4.22)

    N_i = −M0 ẇ_i − M1 Ω̇_i,   T_i = Ω_i (w_i M0 + Ω_i M1),   −M1 ẇ_i − M2 Ω̇_i,

and the tip adds −½ m(L) v_L² m̂ + m(L) v_L p_N n̂ to the last (4.25). Tail and joints are massless:
segment i ≥ 2 turns so that its moment, the forces beyond (4.23, 4.24) and the springs balance
(4.27, 4.28). The part of all this in the accelerations is the mass matrix of the water,
∫ m a aᵀ dτ with a = ∂v⊥/∂(velocities). With S_k = Σ_{i>k} M0_i n̂_i n̂_iᵀ and
G_k = l S_k n̂_k + M1_k n̂_k

    M_kk = l² n̂_kᵀ S_k n̂_k + M2_k,   M_jk = l n̂_j·G_k (j < k),   coupling with V̇_0: G_k,

so one pass outwards and one inwards give everything in O(N²).
"""

from typing import Any

import numpy as np

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.compiled import compiled, fixed_tuple
from plant.flexible.layout import B_R, B_U, B_V, BEND, C, H
from plant.flexible.solve import solve_blocks, write_rates
from plant.hull import hull_forces
from plant.layout import STATE, Drive, Packed, State
from plant.packing import virtual_mass_kg_m
from plant.parameters import PlantParameters
from plant.profile import factor_at, moments
from plant.servo import tail_motion
from plant.tail_input import sincos

M0, M1, M2, STIFFNESS, DAMPING = range(5)
"""Columns of the table; stiffness and damping are those of the joint at the segment's base."""

SINE, COSINE, FORWARD, SIDE = range(4)
"""Rows of scratch space, a column for each segment: direction, and force in body axes. When these
are used up, the first and the last two hold what couples the bend with yaw, surge and sway."""

_STIFFEST_PER_S = 1e13


def joint_stiffness_n_m(parameters: PlantParameters, joint: int) -> float:
    """Stiffness K_S of joint 1 … N − 1, N·m/rad: E d h³/(12 l) (4.18) with d and h at the joint.

    A stiffness given directly stands for a uniform tail and follows the profiles alike.
    """
    tail = parameters.tail
    part = joint / tail.segments
    shape = factor_at(tail.depth_profile, part) * factor_at(tail.thickness_profile, part) ** 3
    if tail.joint_stiffness_n_m > 0.0:
        return tail.joint_stiffness_n_m * shape
    length = tail.length_m / tail.segments
    second_moment = tail.depth_m * tail.thickness_m**3 / 12.0
    return tail.modulus_pa * second_moment / length * shape


def stiffest_joint(parameters: PlantParameters, step_s: float) -> tuple[float, float]:
    """Stiffness of the joint that is hardest to integrate, and the most it may have; N·m/rad.

    A joint's angle is the difference of two that are rounded at 1e-16 or so, and what its torque
    makes of that in a step is h K_S/M2 times as much in the rate of the segment beyond (moment of
    inertia M2). Newton's method settles below its own tolerance while h K_S/M2 ≤ 1e13/s (found by
    trial: 5, 20 and 64 segments, 1 and 10 ms, either servo); aluminium 1 cm thick has 4e12/s with
    64 segments at 10 ms, and the five of the flexible robot 80/s.
    """
    rows = table(parameters)[1:-1]
    worst = rows[np.argmax(rows[:, STIFFNESS] / rows[:, M2])]
    return float(worst[STIFFNESS]), _STIFFEST_PER_S * float(worst[M2]) / step_s


def modulus_from_bending_pa(
    length_m: float, width_m: float, thickness_m: float, load_n: float, deflection_m: float
) -> float:
    """Young's modulus E = L³P/(3 I w) of a strip clamped at one end and loaded at the other (4.30).

    ``width_m`` is the strip's other side, the tail's depth.
    """
    for name, value in (
        ("width_m", width_m),
        ("thickness_m", thickness_m),
        ("deflection_m", deflection_m),
    ):
        check_number(f"modulus_from_bending.{name}", value, above=0.0)
    second_moment = width_m * thickness_m**3 / 12.0
    return length_m**3 * load_n / (3.0 * second_moment * deflection_m)


def table(parameters: PlantParameters) -> FloatArray:
    """Make the (N + 1, 5) table: a row for each segment, then (l, m(L), 0, 0, 0)."""
    tail = parameters.tail
    count = tail.segments
    per_length = virtual_mass_kg_m(parameters)
    result = np.zeros((count + 1, 5))
    for i in range(count):
        depth = tail.depth_profile
        begin, end = i / count, (i + 1) / count
        if depth:
            result[i, :3] = moments(per_length, tail.length_m, depth, begin, end)
        else:  # equal segments are equal to the bit
            result[i, :3] = moments(per_length, tail.length_m / count, ())
        if i:
            stiffness = joint_stiffness_n_m(parameters, i)
            result[i, STIFFNESS] = stiffness
            result[i, DAMPING] = tail.damping_s * stiffness
    tip = per_length * factor_at(tail.depth_profile, 1.0) ** 2
    result[count, :2] = tail.length_m / count, tip
    return result


@compiled
def segment_rates(
    p: Packed, drive: Drive, time_s: float, y: Any, out: Any, parts: Any, work: Any
) -> None:
    """Write the rates of state ``y`` and the loads into ``out`` (layout: ``flexible.layout``)."""
    n = parts.shape[0] - 1
    bend = n - 1
    length, tip_mass = parts[n, 0], parts[n, 1]
    s = State(*fixed_tuple(y, STATE))
    u, v, r = s.u, s.v, s.r
    base = tail_motion(p, drive, time_s, s)
    alpha, alpha_dot, alpha_ddot = base.alpha, base.alpha_dot, base.alpha_ddot
    first_moment = 0.0
    share, hinge = p.body_motion, p.hinge
    turn = share * r

    # outwards: velocities, and accelerations without the unknown part
    vx, vy = share * u, share * (v - r * hinge)
    ax = ay = 0.0
    angle, rate, acceleration = alpha, alpha_dot, alpha_ddot
    for i in range(n):
        if i > 0:
            angle, rate, acceleration = y[BEND + i - 1], y[BEND + bend + i - 1], 0.0
        sine, cosine = sincos(angle)
        work[SINE, i], work[COSINE, i] = sine, cosine
        across = vx * sine - vy * cosine
        along = -vx * cosine - vy * sine
        omega = rate + turn
        across_dot = ax * sine - ay * cosine - rate * along
        m0, m1, m2 = parts[i, 0], parts[i, 1], parts[i, 2]
        normal = -m0 * across_dot - m1 * acceleration
        tangential = omega * (across * m0 + omega * m1)
        moment = -m1 * across_dot - m2 * acceleration
        if i == n - 1:
            end = across + omega * length
            normal += tip_mass * end * along
            tangential -= 0.5 * tip_mass * end * end
            moment += length * (tip_mass * end * along)
        work[FORWARD, i] = normal * sine - tangential * cosine
        work[SIDE, i] = -normal * cosine - tangential * sine
        if i > 0:
            work[H, i - 1] = moment
        else:
            first_moment = moment
        ax += length * (acceleration * sine + omega * rate * cosine)
        ay += length * (omega * rate * sine - acceleration * cosine)
        vx += length * omega * sine
        vy -= length * omega * cosine

    # inwards: forces beyond, mass matrix; sums over all segments for the body's share
    fx = fy = total = 0.0
    sxx = sxy = syy = 0.0
    gx_sum = gy_sum = m_sum = 0.0
    pull = 0.0  # torque of the joint at the outer end of the segment on it
    for i in range(n - 1, -1, -1):
        sine, cosine = work[SINE, i], work[COSINE, i]
        m0, m1, m2 = parts[i, 0], parts[i, 1], parts[i, 2]
        moment = first_moment if i == 0 else work[H, i - 1]
        moment += length * (fx * sine - fy * cosine)
        total += moment
        nx = length * (sxx * sine - sxy * cosine)
        ny = length * (sxy * sine - syy * cosine)
        diagonal = length * (nx * sine - ny * cosine) + m2
        gx = nx + m1 * sine
        gy = ny - m1 * cosine
        gx_sum += gx
        gy_sum += gy
        m_sum += diagonal
        if i > 0:
            inner, inner_dot = alpha, alpha_dot
            if i > 1:
                inner, inner_dot = y[BEND + i - 2], y[BEND + bend + i - 2]
            torque = parts[i, 3] * (y[BEND + i - 1] - inner)
            torque += parts[i, 4] * (y[BEND + bend + i - 1] - inner_dot)
            k = i - 1
            work[H, k] = moment + pull - torque
            pull = torque
            work[B_U, k], work[B_V, k] = gx, gy
            work[B_R, k] = diagonal - hinge * gy
            work[C + k, k] = diagonal
            for j in range(i):
                coupling = length * (work[SINE, j] * gx - work[COSINE, j] * gy)
                m_sum += 2.0 * coupling
                work[B_R, k] += coupling
                if j > 0:
                    work[C + k, j - 1] = coupling
        fx += work[FORWARD, i]
        fy += work[SIDE, i]
        sxx += m0 * sine * sine
        sxy -= m0 * sine * cosine
        syy += m0 * cosine * cosine
    # row sums of M: what stands to the left of the diagonal is added above, the rest here
    for k in range(bend):
        for j in range(k):
            work[B_R, j] += work[C + k, j]

    h1, h2, h3 = hull_forces(p, s.x, s.y, s.psi, u, v, r, base.mean)
    a13 = gx_sum - hinge * sxy
    a23 = gy_sum - hinge * syy
    a33 = hinge * hinge * syy - 2.0 * hinge * gy_sum + m_sum
    for k in range(bend):
        work[FORWARD, k], work[SIDE, k] = work[B_U, k], work[B_V, k]
        work[SINE, k] = work[B_R, k]
    u_dot, v_dot, r_dot = solve_blocks(
        bend,
        share,
        work,
        (
            p.m1 + share * sxx,
            share * sxy,
            share * a13,
            p.m2 + share * syy,
            share * a23,
            p.j3 + share * a33,
        ),
        (h1 + fx, h2 + fy, h3 + total - hinge * fy),
    )

    # loads with the unknown part; derivatives
    dx, dy = share * u_dot, share * (v_dot - hinge * r_dot)
    dr = share * r_dot
    fx -= sxx * dx + sxy * dy + gx_sum * dr
    fy -= sxy * dx + syy * dy + gy_sum * dr
    total -= gx_sum * dx + gy_sum * dy + m_sum * dr
    for k in range(bend):
        value = work[H, k]
        fx -= work[FORWARD, k] * value
        fy -= work[SIDE, k] * value
        total -= (work[SINE, k] + hinge * work[SIDE, k]) * value
        out[BEND + k] = y[BEND + bend + k]
        out[BEND + bend + k] = value
    write_rates(p, s, base, (u_dot, v_dot, r_dot), (fx, fy, total), out, BEND + 2 * bend)
