"""What the water does to the hull alone: inertia, drag, lift, Munk moment (3.5–3.7, 3.19–3.24).

Shared by every kind of tail. β = atan2(v, u) is the source's: a body going astern has an angle of
attack near π and a lift without meaning; forward swimming, which this is for, never does.
"""

import math

from plant.compiled import compiled
from plant.elementary import atan2 as _atan2
from plant.layout import Packed

atan2 = compiled(_atan2)


@compiled
def hull_forces(p: Packed, u: float, v: float, r: float, mean: float) -> tuple[float, float, float]:
    """Right-hand sides of the three body equations without the tail: N, N, N·m.

    They hold the terms of the rotating axes, so that with the tail's part added they stand on the
    right of (m₁ u̇, m₂ v̇, J₃ ṙ). ``mean``: the tail-beat bias that the adapted drag depends on.
    """
    m1, m2 = p.m1, p.m2
    pressure = p.half_rho_s * math.sqrt(u * u + v * v)
    drag = pressure * (p.drag + p.drag_bias * (mean * mean))
    lift = pressure * p.lift * atan2(v, u)
    yaw_drag = p.yaw_drag + p.yaw_drag_bias * abs(mean)
    return (
        m2 * v * r - drag * u + lift * v,
        -m1 * u * r - drag * v - lift * u,
        p.munk * (m1 - m2) * u * v - yaw_drag * r * abs(r),
    )
