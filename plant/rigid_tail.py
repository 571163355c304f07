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

Where the depth varies, m₁, m₂, m₃ are the integrals ∫m, ∫mτ, ∫mτ², m at the tip is m(L), and the
cancellation leaves T = −½ m(L) w² + Ω (w (m₁ − m(L) L) + Ω (m₂ − ½ m(L) L²)).

g is also the direction in which N acts on the body's three equations, (n_x, n_y, −c n_y), and e
that of M_A. Moving the part in q to the left gives a symmetric positive definite mass matrix

    diag(m_b − X_u̇, m_b − Y_v̇, J_bz − N_ṙ) + m₁ g gᵀ + m₂ (g eᵀ + e gᵀ) + m₃ e eᵀ,

solved by LDLᵀ. A share s < 1 of body motion scales u, v, r and q in these forces; s = 0 is (3.30).
Equation numbers are the source's.
"""

from plant.compiled import compiled
from plant.hull import drift, hull_forces
from plant.layout import Drive, Packed, Rates, State
from plant.servo import tail_motion
from plant.tail_input import sincos


@compiled
def rates(p: Packed, drive: Drive, time_s: float, s: State) -> Rates:
    """Rates of the state and loads of the tail; ``time_s`` counts from the drive's beginning."""
    u, v, r = s.u, s.v, s.r
    tail = tail_motion(p, drive, time_s, s)
    alpha, alpha_dot, alpha_ddot, mean = tail.alpha, tail.alpha_dot, tail.alpha_ddot, tail.mean

    # tail forces without the part in q
    sine, cosine = sincos(alpha)
    share = p.body_motion
    hinge = p.hinge
    mass, length = p.tail_mass, p.tail_length
    first, second, third = p.tail_first, p.tail_second, p.tail_third
    u_t = share * u
    sway_t = share * (v - r * hinge)
    omega = alpha_dot + share * r
    w = u_t * sine - sway_t * cosine
    along = -u_t * cosine - sway_t * sine
    tip = w + omega * length
    turning = alpha_dot * along
    normal = first * turning - second * alpha_ddot + mass * tip * along
    tangential = -0.5 * mass * w * w
    if p.taper_first != 0.0:
        tangential += omega * (w * p.taper_first + omega * p.taper_second)
    moment = second * turning - third * alpha_ddot + mass * length * tip * along

    # right-hand side
    h1, h2, h3 = hull_forces(p, s.x, s.y, s.psi, u, v, r, mean)
    forward = -tangential * cosine + normal * sine
    side = -tangential * sine - normal * cosine
    f1 = h1 + forward
    f2 = h2 + side
    f3 = h3 + moment - hinge * side

    # mass matrix and LDLᵀ
    g3 = hinge * cosine
    first_s, second_s = share * first, share * second
    a11 = p.m1 + first_s * sine * sine
    a12 = -first_s * sine * cosine
    a13 = first_s * sine * g3 + second_s * sine
    a22 = p.m2 + first_s * cosine * cosine
    a23 = -first_s * cosine * g3 - second_s * cosine
    a33 = p.j3 + first_s * g3 * g3 + 2.0 * second_s * g3 + share * third
    inverse1 = 1.0 / a11
    l21 = a12 * inverse1
    l31 = a13 * inverse1
    inverse2 = 1.0 / (a22 - l21 * a12)
    b23 = a23 - l31 * a12
    l32 = b23 * inverse2
    y2 = f2 - l21 * f1
    y3 = f3 - l31 * f1 - l32 * y2
    r_dot = y3 / (a33 - l31 * a13 - l32 * b23)
    v_dot = y2 * inverse2 - l32 * r_dot
    u_dot = f1 * inverse1 - l21 * v_dot - l31 * r_dot

    # loads, with the part in q
    at_hinge = share * (sine * u_dot - cosine * v_dot + g3 * r_dot)
    normal -= first * at_hinge + second * (share * r_dot)
    moment -= second * at_hinge + third * (share * r_dot)

    sin_psi, cos_psi = sincos(s.psi)
    current_x, current_y = drift(p, s.x, s.y)
    return Rates(
        u * cos_psi - v * sin_psi + current_x,
        u * sin_psi + v * cos_psi + current_y,
        r,
        u_dot,
        v_dot,
        r_dot,
        tail.servo_dot,
        tail.servo_ddot,
        (alpha - mean) * p.bias_forgetting,
        tail.loose_dot,
        tail.loose_ddot,
        alpha,
        alpha_dot,
        alpha_ddot,
        mean,
        tail.servo,
        tail.loose,
        -tangential * cosine + normal * sine,
        -tangential * sine - normal * cosine,
        moment,
    )
