"""Rigid-tail dynamics of chapter 3, with the body motion in the tail forces.

Along the tail (τ from the joint, 0…L) the velocity normal to it is linear in τ,

    v⊥(τ) = w + Ω τ,   w = u sin α − (v − r c) cos α,   Ω = α̇ + r,
    v∥ = −u cos α − (v − r c) sin α,

and with q = (u̇, v̇, ṙ), g = (sin α, −cos α, c cos α), e = (0, 0, 1) its derivative is

    v̇⊥(τ) = g·q − α̇ v∥ + (α̈ + e·q) τ.

So the integrals of (3.14) over τ close. With m₁ = mL, m₂ = ½mL², m₃ = ⅓mL³ and v_L = w + Ω L the
force along the normal n̂, along the tail m̂, and the moment about the joint are

    N = −m₁ (g·q − α̇ v∥) − m₂ (α̈ + e·q) + m v_L v∥            (distributed, and tip (3.9))
    T = mΩ(wL + ½ΩL²) − ½ m v_L² = −½ m w²                      (all but the joint's own w cancels)
    M_A = −m₂ (g·q − α̇ v∥) − m₃ (α̈ + e·q) + m L v_L v∥.

g is also the direction in which N acts on the body's three equations, (n_x, n_y, −c n_y), and e
that of M_A. Moving the part in q to the left gives a symmetric positive definite mass matrix

    diag(m_b − X_u̇, m_b − Y_v̇, J_bz − N_ṙ) + m₁ g gᵀ + m₂ (g eᵀ + e gᵀ) + m₃ e eᵀ,

solved by LDLᵀ. A share s < 1 of body motion scales u, v, r and q in these forces; s = 0 is (3.30).
Equation numbers are the source's; signs of (3.7) are used with its coupling term as a share.
"""

import math

from plant.compiled import compiled
from plant.elementary import atan2 as _atan2
from plant.layout import Column, Drive, Packed
from plant.parameters import FloatArray
from plant.servo import tail_acceleration
from plant.tail_input import beat, sincos

atan2 = compiled(_atan2)


@compiled
def rates(p: FloatArray, drive: FloatArray, time_s: float, s: FloatArray, out: FloatArray) -> None:
    """Rates of the state and loads of the tail.

    ``p``: ``layout.Packed``; ``drive``: ``layout.Drive``; ``time_s`` since the drive began;
    ``s``: state, columns X…ALPHA_MEAN; ``out``: the columns of a row that follow the state.
    An ideal tail has no state of its own: its angle and speed are *written into* ``s``.
    """
    psi, u, v, r = s[Column.PSI], s[Column.U], s[Column.V], s[Column.R]
    target, target_dot, target_ddot = beat(drive, time_s)
    if p[Packed.SERVO_IDEAL] != 0.0:
        alpha, alpha_dot, alpha_ddot = target, target_dot, target_ddot
        s[Column.ALPHA] = alpha
        s[Column.ALPHA_DOT] = alpha_dot
        s[Column.ALPHA_MEAN] = drive[Drive.BIAS]
    else:
        alpha, alpha_dot = s[Column.ALPHA], s[Column.ALPHA_DOT]
        alpha_ddot = tail_acceleration(p, drive, target, alpha, alpha_dot)
    mean = s[Column.ALPHA_MEAN]

    # tail forces without the part in q
    sine, cosine = sincos(alpha)
    share = p[Packed.BODY_MOTION]
    hinge = p[Packed.HINGE]
    mass, length = p[Packed.TAIL_MASS], p[Packed.TAIL_LENGTH]
    first, second, third = p[Packed.TAIL_FIRST], p[Packed.TAIL_SECOND], p[Packed.TAIL_THIRD]
    u_t = share * u
    sway_t = share * (v - r * hinge)
    omega = alpha_dot + share * r
    w = u_t * sine - sway_t * cosine
    along = -u_t * cosine - sway_t * sine
    tip = w + omega * length
    turning = alpha_dot * along
    normal = first * turning - second * alpha_ddot + mass * tip * along
    tangential = -0.5 * mass * w * w
    moment = second * turning - third * alpha_ddot + mass * length * tip * along

    # right-hand side: tail, drag, lift, coupling (3.5–3.7, 3.19–3.24)
    m1, m2, j3 = p[Packed.M1], p[Packed.M2], p[Packed.J3]
    speed = math.sqrt(u * u + v * v)
    pressure = p[Packed.HALF_RHO_S] * speed
    drag = pressure * (p[Packed.DRAG] + p[Packed.DRAG_BIAS] * (mean * mean))
    lift = pressure * p[Packed.LIFT] * atan2(v, u)
    yaw_drag = p[Packed.YAW_DRAG] + p[Packed.YAW_DRAG_BIAS] * abs(mean)
    side = -tangential * sine - normal * cosine
    f1 = m2 * v * r - tangential * cosine + normal * sine - drag * u + lift * v
    f2 = -m1 * u * r + side - drag * v - lift * u
    f3 = p[Packed.MUNK] * (m1 - m2) * u * v + moment - hinge * side - yaw_drag * r * abs(r)

    # mass matrix and LDLᵀ
    g3 = hinge * cosine
    first_s, second_s = share * first, share * second
    a11 = m1 + first_s * sine * sine
    a12 = -first_s * sine * cosine
    a13 = first_s * sine * g3 + second_s * sine
    a22 = m2 + first_s * cosine * cosine
    a23 = -first_s * cosine * g3 - second_s * cosine
    a33 = j3 + first_s * g3 * g3 + 2.0 * second_s * g3 + share * third
    l21 = a12 / a11
    l31 = a13 / a11
    d2 = a22 - l21 * a12
    l32 = (a23 - l31 * a12) / d2
    d3 = a33 - l31 * a13 - l32 * l32 * d2
    y2 = f2 - l21 * f1
    y3 = f3 - l31 * f1 - l32 * y2
    r_dot = y3 / d3
    v_dot = y2 / d2 - l32 * r_dot
    u_dot = f1 / a11 - l21 * v_dot - l31 * r_dot

    # loads, with the part in q
    at_hinge = share * (sine * u_dot - cosine * v_dot + g3 * r_dot)
    normal -= first * at_hinge + second * (share * r_dot)
    moment -= second * at_hinge + third * (share * r_dot)

    sin_psi, cos_psi = sincos(psi)
    out[0] = u * cos_psi - v * sin_psi + p[Packed.CURRENT_X]
    out[1] = u * sin_psi + v * cos_psi + p[Packed.CURRENT_Y]
    out[2] = r
    out[3] = u_dot
    out[4] = v_dot
    out[5] = r_dot
    out[6] = alpha_dot
    out[7] = alpha_ddot
    out[8] = (alpha - mean) / p[Packed.BIAS_MEMORY]
    out[9] = -tangential * cosine + normal * sine
    out[10] = -tangential * sine - normal * cosine
    out[11] = moment
