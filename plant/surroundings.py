"""What differs from place to place in the water: a sheared current, and the walls of the tank.

A steady sheared current U(x) = U₀ + G x, with G = ((0, s_x), (s_y, 0)), carries vorticity s_y − s_x
and strain (s_x + s_y)/2. The body's velocity is V + U(x), V = (u, v) through the water, and that of
the fluid changes along with it by DU/Dt = G U. For a neutrally buoyant hull (it displaces its own
mass m_b) in a flow that hardly changes over its length:

- its inertia is m_b d(V + U)/dt = m_b (dV/dt + G (V + U)); the pressure gradient that drives the
  water drives the displaced volume, too, with m_b G U. What is left beside m_b dV/dt on the left
  is a force −m_b G V on the right;
- the momentum of the water that moves with it, P = M_A V, feels −Gᵀ P, as in Kirchhoff's
  equations for a weakly non-uniform flow. With it a body held in a pure strain feels
  G (m_b + M_A) U, the gradient of the energy ½ U·(m_b + M_A) U, which is G. I. Taylor's result
  (1928), exact for irrotational flow. Where the flow has vorticity, Auton's lift on a sphere
  (1987) gives the same form.

Yaw drag acts on the turning through the water, r − (s_y − s_x)/2. The strain's moment on the hull
and the differences of the current along the tail are left out: G times a body length is small
against V in any tank.

Walls: the drag rises towards them, and a soft contact may push the body back (``Walls``). The
contact is that of Hunt and Crossley, K δ (1 + χ δ̇): continuous at touch, dissipative, never
sticking.
"""

from plant.compiled import compiled, compiled_apart
from plant.layout import Packed
from plant.tail_input import exp, sincos

WALL_REACH_M = 0.1
"""Distance over which a wall's influence on the drag falls by e."""

_CONTACT_LOSS_S_M = 5.0  # χ: a robot at 5 cm/s loses about a third of its speed (assumed)


@compiled_apart
def shear_force(p: Packed, psi: float, u: float, v: float) -> tuple[float, float]:
    """Force of a sheared current on the hull in body axes, N: −m_b G V − Gᵀ M_A V."""
    sine, cosine = sincos(psi)
    mixed = (p.shear_x + p.shear_y) * sine * cosine
    across = p.shear_x * cosine * cosine - p.shear_y * sine * sine  # ∂U_bx/∂y_b
    along = p.shear_y * cosine * cosine - p.shear_x * sine * sine  # ∂U_by/∂x_b
    surge = (p.m1 - p.mass) * u
    sway = (p.m2 - p.mass) * v
    return (
        -p.mass * (mixed * u + across * v) - (mixed * surge + along * sway),
        -p.mass * (along * u - mixed * v) - (across * surge - mixed * sway),
    )


@compiled
def wall_distance(p: Packed, x: float, y: float) -> float:
    """Distance from a point to the nearest wall, m; zero beyond it."""
    return max(0.0, min(min(x - p.x_min, p.x_max - x), min(y - p.y_min, p.y_max - y)))


@compiled_apart
def wall_drag_factor(p: Packed, x: float, y: float) -> float:
    """By what the drag is multiplied at a place: 1 + k exp(−d/0.1 m)."""
    distance = wall_distance(p, x, y)
    if distance > 700.0 * WALL_REACH_M:  # infinite, too
        return 1.0
    return 1.0 + p.wall_drag * exp(-distance / WALL_REACH_M)


@compiled
def push(p: Packed, overlap: float, approach: float) -> float:
    """Force of one wall, N: nothing before touch, and never a pull."""
    if overlap <= 0.0:
        return 0.0
    return p.wall_stiffness * overlap * max(0.0, 1.0 + _CONTACT_LOSS_S_M * approach)


@compiled_apart
def wall_force(
    p: Packed, x: float, y: float, psi: float, u: float, v: float
) -> tuple[float, float]:
    """Force of the walls on the disc around the body centre, in body axes, N."""
    sine, cosine = sincos(psi)
    x_dot = u * cosine - v * sine + p.current_x + p.shear_x * y
    y_dot = u * sine + v * cosine + p.current_y + p.shear_y * x
    reach = p.hinge
    fx = push(p, p.x_min + reach - x, -x_dot) - push(p, x - (p.x_max - reach), x_dot)
    fy = push(p, p.y_min + reach - y, -y_dot) - push(p, y - (p.y_max - reach), y_dot)
    return fx * cosine + fy * sine, fy * cosine - fx * sine
