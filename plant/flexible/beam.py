"""Right-hand side of the beam tail in its modes (4.1–4.17), with or without the body's motion.

The beam is displaced by w(τ) = Σ φ_i(τ) η_i along the normal n̂ of its tangent at the base, which
the servo holds at the angle α. As published the robot is anchored (share s = 0): v⊥ = α̇ τ + ẇ,

    M_i (η̈_i + 2 ξ_i ω_i η̇_i + ω_i² η_i) = −∫ m τ φ_i dτ α̈            (4.11–4.13)
    f = −m v̇⊥ n̂ + m v⊥ α̇ m̂,   tip −½ m v_L² m̂                         (4.16)

With the body's motion, V_0 = s(u, v − r c), Ω = α̇ + s r, the normal and the tangent of the
*deflected* tail are n̂ − w′ m̂ and m̂ + w′ n̂ to first order in the slope, and the terms up to second
order in the deflection are

    v⊥ = V_0·(n̂ − w′ m̂) + Ω τ + ẇ = w_0 + Ω τ + ẇ − w′ v∥,   v∥ = V_0·m̂
    F_n = −∫ m v̇⊥ dτ + m_L v_L v∥
    F_m = ∫ m (w′ v̇⊥ + v⊥ (Ω + ẇ′)) dτ − ½ m_L v_L² − m_L v_L v∥ w′_L
    M_A = −∫ m v̇⊥ τ dτ + L m_L v_L v∥
    Q_i = −∫ m v̇⊥ φ_i dτ + φ_i(L) m_L v_L v∥ = Σ_j (K_ij η_j + κ K_ij η̇_j)

−w′ v∥ is the convective term of slender-body theory, the tip force loads every mode, and the tilt
of the normal makes the beam agree with segments at small amplitude. w′ stands here times s: at
s = 0 the published form is left, whose mean thrust is the same to second order. What the water
carries is ∫ m a aᵀ dτ, a = ∂v⊥/∂(velocities) = (n̂ − w′ m̂, τ, φ_i): symmetric again.
"""

from typing import Any

from plant.compiled import compiled, fixed_tuple
from plant.flexible.layout import B_R, B_U, B_V, BEND, C, H
from plant.flexible.solve import solve_blocks, write_rates
from plant.hull import hull_forces
from plant.layout import STATE, Drive, Packed, State
from plant.servo import tail_motion
from plant.tail_input import sincos

HEADER, WITH_1, WITH_TAU, SLOPE_1, SLOPE_TAU, TIP, TIP_SLOPE, MATRICES = range(8)
"""Rows of the table: (∫m, ∫mτ, ∫mτ², L, m(L)); ∫mφ_i; ∫mτφ_i; ∫mφ_i′; ∫mτφ_i′; φ_i(L); φ_i′(L);
then the matrices ∫mφ_iφ_j, ∫mφ_i′φ_j, ∫mφ_i′φ_j′, ∫EIφ_i″φ_j″, and κ times that."""

GX, GY, GR = range(3)
"""Rows of scratch space: what couples each mode with V_0 and Ω."""


@compiled
def beam_rates(
    p: Packed, drive: Drive, time_s: float, y: Any, out: Any, parts: Any, modes: int, work: Any
) -> None:
    """Write the rates of state ``y`` and the loads into ``out`` (layout: ``flexible.layout``)."""
    n = modes
    m0, m1, m2 = parts[0, 0], parts[0, 1], parts[0, 2]
    length, tip_mass = parts[0, 3], parts[0, 4]
    s = State(*fixed_tuple(y, STATE))
    u, v, r = s.u, s.v, s.r
    base = tail_motion(p, drive, time_s, s)
    alpha, alpha_dot, alpha_ddot = base.alpha, base.alpha_dot, base.alpha_ddot
    share, hinge = p.body_motion, p.hinge
    sine, cosine = sincos(alpha)
    vx, vy = share * u, share * (v - r * hinge)
    across = vx * sine - vy * cosine  # w_0
    along = -vx * cosine - vy * sine  # v∥
    omega = alpha_dot + share * r
    mass, mixed, slopes = MATRICES, MATRICES + n, MATRICES + 2 * n
    stiffness, damping = MATRICES + 3 * n, MATRICES + 4 * n

    # integrals over the deflection; a slope stands times s
    tilt_1 = tilt_tau = tilt_2 = 0.0  # ∫m w′, ∫mτ w′, ∫m w′²
    turn_1 = turn_tau = turn_2 = 0.0  # ∫m ẇ′, ∫mτ ẇ′, ∫m w′ ẇ′
    bend_1 = bend_turn = 0.0  # ∫m ẇ, ∫m ẇ ẇ′
    tip_rate = tip_slope = 0.0
    for i in range(n):
        eta, eta_dot = share * y[BEND + i], y[BEND + n + i]
        tilt_1 += parts[SLOPE_1, i] * eta
        tilt_tau += parts[SLOPE_TAU, i] * eta
        turn_1 += parts[SLOPE_1, i] * (share * eta_dot)
        turn_tau += parts[SLOPE_TAU, i] * (share * eta_dot)
        bend_1 += parts[WITH_1, i] * eta_dot
        tip_rate += parts[TIP, i] * eta_dot
        tip_slope += parts[TIP_SLOPE, i] * eta
        tilt_i = turn_i = 0.0  # ∫m w′ φ_i, ∫m ẇ′ φ_i
        slope_i = slope_dot_i = 0.0  # ∫m w′ φ_i′, ∫m ẇ′ φ_i′
        for j in range(n):
            eta_j, eta_dot_j = share * y[BEND + j], share * y[BEND + n + j]
            tilt_i += parts[mixed + j, i] * eta_j
            turn_i += parts[mixed + j, i] * eta_dot_j
            slope_i += parts[slopes + i, j] * eta_j
            slope_dot_i += parts[slopes + i, j] * eta_dot_j
        tilt_2 += slope_i * eta
        turn_2 += slope_dot_i * eta
        bend_turn += turn_i * eta_dot
        # ∫m φ_i v̇⊥ without the unknown part, and what couples φ_i with the body
        known = -(alpha_dot * parts[WITH_1, i] + turn_i) * along
        known += parts[WITH_TAU, i] * alpha_ddot - tilt_i * alpha_dot * across
        work[H, i] = -known
        work[GX, i] = parts[WITH_1, i] * sine + tilt_i * cosine
        work[GY, i] = tilt_i * sine - parts[WITH_1, i] * cosine
        work[GR, i] = parts[WITH_TAU, i]
    tip = across + omega * length + tip_rate - tip_slope * along
    tip_force = tip_mass * tip * along

    # forces without the unknown part
    swing = alpha_dot * across
    normal = (alpha_dot * m0 + turn_1) * along + tilt_1 * swing - m1 * alpha_ddot + tip_force
    moment = (alpha_dot * m1 + turn_tau) * along + tilt_tau * swing - m2 * alpha_ddot
    moment += length * tip_force
    tension = tilt_tau * alpha_ddot - (alpha_dot * tilt_1 + turn_2) * along - tilt_2 * swing
    tension += omega * (across * m0 + omega * m1 + bend_1 - tilt_1 * along)
    tension += across * turn_1 + omega * turn_tau + bend_turn - along * turn_2
    tension -= 0.5 * tip_mass * tip * tip + tip_force * tip_slope
    fx = normal * sine - tension * cosine
    fy = -normal * cosine - tension * sine

    # ∫m a aᵀ over V_0 and Ω: a = (n̂ − w′ m̂, τ)
    sxx = m0 * sine * sine + 2.0 * tilt_1 * sine * cosine + tilt_2 * cosine * cosine
    sxy = (tilt_2 - m0) * sine * cosine + tilt_1 * (sine * sine - cosine * cosine)
    syy = m0 * cosine * cosine - 2.0 * tilt_1 * sine * cosine + tilt_2 * sine * sine
    gx_sum = m1 * sine + tilt_tau * cosine
    gy_sum = tilt_tau * sine - m1 * cosine
    for i in range(n):
        for j in range(i + 1):
            work[C + i, j] = parts[mass + i, j]
        pull = 0.0
        for j in range(n):
            pull += parts[stiffness + i, j] * y[BEND + j] + parts[damping + i, j] * y[BEND + n + j]
        work[H, i] += parts[TIP, i] * tip_force - pull
        work[B_U, i], work[B_V, i] = work[GX, i], work[GY, i]
        work[B_R, i] = work[GR, i] - hinge * work[GY, i]

    h1, h2, h3 = hull_forces(p, s.x, s.y, s.psi, u, v, r, base.mean)
    a13 = gx_sum - hinge * sxy
    a23 = gy_sum - hinge * syy
    a33 = hinge * hinge * syy - 2.0 * hinge * gy_sum + m2
    u_dot, v_dot, r_dot = solve_blocks(
        n,
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
        (h1 + fx, h2 + fy, h3 + moment - hinge * fy),
    )

    # loads with the unknown part; derivatives
    dx, dy = share * u_dot, share * (v_dot - hinge * r_dot)
    dr = share * r_dot
    fx -= sxx * dx + sxy * dy + gx_sum * dr
    fy -= sxy * dx + syy * dy + gy_sum * dr
    moment -= gx_sum * dx + gy_sum * dy + m2 * dr
    for i in range(n):
        value = work[H, i]
        fx -= work[GX, i] * value
        fy -= work[GY, i] * value
        moment -= work[GR, i] * value
        out[BEND + i] = y[BEND + n + i]
        out[BEND + n + i] = value
    write_rates(p, s, base, (u_dot, v_dot, r_dot), (fx, fy, moment), out, BEND + 2 * n)
