"""Body and tail accelerations together: a symmetric block system, the tail eliminated first.

With q = (u̇, v̇, ṙ), ä the accelerations of the bend, s the share of body motion in the tail forces,

    (D + s A) q + B ä = f          body: D its own inertia, A the water's that the tail carries
     s Bᵀ q + C ä = h              tail: C symmetric positive definite

For s = 1 this is symmetric positive definite; for s < 1 the tail feels less of the body than the
body of the tail, and only the Schur complement (D + s(A − B C⁻¹ Bᵀ)) q = f − B C⁻¹ h is symmetric.
So C is factored as L Δ Lᵀ, and L⁻¹ taken of the rows of B and of h on the way.
"""

from typing import Any

from plant.compiled import compiled
from plant.flexible.layout import (
    ALPHA,
    ALPHA_DDOT,
    ALPHA_DOT,
    B_R,
    B_U,
    B_V,
    FORCE_X,
    FORCE_Y,
    HINGE_MOMENT,
    LOOSE,
    MEAN,
    SERVO,
    C,
    H,
)
from plant.hull import drift
from plant.layout import Packed, State, TailMotion
from plant.tail_input import sincos


@compiled
def solve_blocks(
    n: int,
    share: float,
    work: Any,
    a: tuple[float, float, float, float, float, float],
    f: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return q; ä is left in row ``H`` of ``work``.

    ``work``: the rows of B and h, and from row ``C`` on the lower triangle of C; overwritten.
    ``a``: D + s A as (uu, uv, ur, vv, vr, rr). One array and no views of it: in compiled code a
    view costs as much as ten multiplications.
    """
    a11, a12, a13, a22, a23, a33 = a
    f1, f2, f3 = f
    for k in range(n):
        for i in range(k):
            # l = C[k, i] − Σ_j<i L[k, j] Δ_j L[i, j]; kept undivided by Δ_i until row k is done
            value = work[C + k, i]
            for j in range(i):
                value -= work[C + k, j] * work[C + i, j]
            work[C + k, i] = value
        pivot = work[C + k, k]
        b0, b1, b2, b3 = work[B_U, k], work[B_V, k], work[B_R, k], work[H, k]
        for i in range(k):
            undivided = work[C + k, i]
            factor = undivided * work[C + i, i]  # the diagonal holds 1/Δ
            work[C + k, i] = factor
            pivot -= undivided * factor
            b0 -= factor * work[B_U, i]
            b1 -= factor * work[B_V, i]
            b2 -= factor * work[B_R, i]
            b3 -= factor * work[H, i]
        inverse = 1.0 / pivot
        work[C + k, k] = inverse
        work[B_U, k], work[B_V, k], work[B_R, k], work[H, k] = b0, b1, b2, b3
        p0, p1, p2 = b0 * inverse, b1 * inverse, b2 * inverse
        f1 -= p0 * b3
        f2 -= p1 * b3
        f3 -= p2 * b3
        a11 -= share * p0 * b0
        a12 -= share * p0 * b1
        a13 -= share * p0 * b2
        a22 -= share * p1 * b1
        a23 -= share * p1 * b2
        a33 -= share * p2 * b2
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
    for k in range(n - 1, -1, -1):
        body = work[B_U, k] * u_dot + work[B_V, k] * v_dot + work[B_R, k] * r_dot
        value = (work[H, k] - share * body) * work[C + k, k]
        for i in range(k + 1, n):
            value -= work[C + i, k] * work[H, i]
        work[H, k] = value
    return u_dot, v_dot, r_dot


@compiled
def write_rates(
    p: Packed,
    s: State,
    base: TailMotion,
    body: tuple[float, float, float],
    loads: tuple[float, float, float],
    out: Any,
    end: int,
) -> None:
    """Write into ``out`` the rates of body and servo, and from ``end`` on the loads.

    ``body``: u̇, v̇, ṙ; ``loads``: F_hx, F_hy, M_A.
    """
    sine, cosine = sincos(s.psi)
    current_x, current_y = drift(p, s.x, s.y)
    out[0] = s.u * cosine - s.v * sine + current_x
    out[1] = s.u * sine + s.v * cosine + current_y
    out[2] = s.r
    out[3], out[4], out[5] = body
    out[6] = base.servo_dot
    out[7] = base.servo_ddot
    out[8] = (base.alpha - base.mean) * p.bias_forgetting
    out[9] = base.loose_dot
    out[10] = base.loose_ddot
    out[end + ALPHA] = base.alpha
    out[end + ALPHA_DOT] = base.alpha_dot
    out[end + ALPHA_DDOT] = base.alpha_ddot
    out[end + MEAN] = base.mean
    out[end + SERVO] = base.servo
    out[end + LOOSE] = base.loose
    out[end + FORCE_X], out[end + FORCE_Y], out[end + HINGE_MOMENT] = loads
