"""What the water does to the hull alone: inertia, drag, lift, Munk moment (3.5–3.7, 3.19–3.24).

Shared by every kind of tail. β = atan2(v, u) is the source's: a body going astern has an angle of
attack near π and a lift without meaning; forward swimming, which this is for, never does. With the
surrogate (3.34) the bias takes the place of β. Adapted drag that falls with the bias ends at zero:
beyond the biases it was fitted to it would drive the robot.

What a parameter adds to the source's model stands behind a test of its neutral value, or adds an
exact zero, so that the source's model keeps its bits.
"""

import math

from plant.compiled import compiled, compiled_apart
from plant.elementary import atan2 as _atan2
from plant.layout import Packed
from plant.surroundings import shear_force, wall_drag_factor, wall_force

atan2 = compiled(_atan2)


@compiled
def hull_forces(
    p: Packed, x: float, y: float, psi: float, u: float, v: float, r: float, mean: float
) -> tuple[float, float, float]:
    """Right-hand sides of the three body equations without the tail: N, N, N·m.

    They hold the terms of the rotating axes, so that with the tail's part added they stand on the
    right of (m₁ u̇, m₂ v̇, J₃ ṙ). ``x``, ``y``, ``psi``: pose in the tank; ``mean``: the tail-beat
    bias that the adapted drag and the surrogate lift depend on.
    """
    m1, m2 = p.m1, p.m2
    pressure = p.half_rho_s * math.sqrt(u * u + v * v)
    drag = pressure * max(0.0, p.drag + p.drag_bias * (mean * mean)) + p.linear_drag
    lift = pressure * p.lift * atan2(v, u)
    if p.lift_bias != 0.0:
        lift += pressure * p.lift_bias * mean
    yaw_drag = max(0.0, p.yaw_drag + p.yaw_drag_bias * abs(mean))
    if p.placed != 0.0:
        return placed_forces(p, x, y, psi, u, v, r, (drag, lift, yaw_drag))
    return (
        m2 * v * r - drag * u + lift * v,
        -m1 * u * r - drag * v - lift * u,
        p.munk * (m1 - m2) * u * v - yaw_drag * r * abs(r),
    )


@compiled_apart
def placed_forces(
    p: Packed,
    x: float,
    y: float,
    psi: float,
    u: float,
    v: float,
    r: float,
    resistance: tuple[float, float, float],
) -> tuple[float, float, float]:
    """``hull_forces`` where they depend on the place; ``resistance``: drag, lift, yaw drag.

    A wall raises the whole drag along the path, the linear part, too; not lift and yaw drag.
    """
    m1, m2 = p.m1, p.m2
    drag, lift, yaw_drag = resistance
    drag *= wall_drag_factor(p, x, y)
    wall_x, wall_y = wall_force(p, x, y, psi, u, v)
    shear_x, shear_y = shear_force(p, psi, u, v)
    turning = r - 0.5 * (p.shear_y - p.shear_x)
    return (
        m2 * v * r - drag * u + lift * v + wall_x + shear_x,
        -m1 * u * r - drag * v - lift * u + wall_y + shear_y,
        p.munk * (m1 - m2) * u * v - yaw_drag * turning * abs(turning),
    )


@compiled
def drift(p: Packed, x: float, y: float) -> tuple[float, float]:
    """Velocity of the undisturbed water at a place, tank frame, m/s."""
    if p.placed != 0.0:
        return p.current_x + p.shear_x * y, p.current_y + p.shear_y * x
    return p.current_x, p.current_y
