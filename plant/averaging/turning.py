"""Steady turning from three algebraic equations (5.34), as one scalar equation with a bracket.

With the mean forces X, Y (5.32) and β the angle of attack, (5.33, 5.34) give V and ω at once,

    c₁V² = X cos β + Y sin β,      K_D ω|ω| = M,

and leave one equation for β, divided here by V:

    h(β) = −c₂Vβ + (Y cos β − X sin β)/V + m|ω| = 0.

For X, Y > 0 its derivative −(c₂/(c₁V))(T + βN/2) − c₁V − N²/(2c₁V³), T = X cos β + Y sin β,
N = Y cos β − X sin β, is negative as long as tan β < 2/β (β < 61.7°), and h(0) > 0. So there is at
most one solution, and it exists exactly where h is negative at the upper limit: no start has to be
guessed. The source searched [0°, 20°] with a solver that needs a start.

``m`` is the mass that is carried round. The source prints m_b; the average model carries the water
along, m₁cos²β + m₂sin²β, and pushes the body by (m₂ − m₁)Vω sin β cos β on its way. Both are here,
told apart by ``added_mass``; with it the solution is the equilibrium of (5.30). But m then grows
with β, h need not fall all the way, and there may be two solutions. So h is scanned from 0 on, and
the smallest one is taken.
"""

import math
from dataclasses import dataclass

from scipy.optimize import brentq

from plant.averaging.average import scaled_forces
from plant.averaging.dynamics import PUBLISHED, Dynamics, Scaling, reduced
from plant.averaging.equilibrium import NoEquilibriumError
from plant.checks import check_number
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat

MOST_ATTACK_RAD = math.radians(20.0)
"""Upper limit of the angle of attack in the source."""

_SCAN_RAD = math.radians(0.5)
"""Steps of the scan; two solutions that are closer are not seen."""


@dataclass(frozen=True, slots=True)
class Turning:
    """Radius (m), period (s), angle of attack (rad, with the sign of the bias) and speed (m/s)."""

    turn_radius_m: float
    turn_period_s: float
    attack_rad: float
    speed_m_s: float


def steady_turning(
    parameters: PlantParameters,
    beat: TailBeat,
    scaling: Scaling = PUBLISHED,
    added_mass: bool = False,
    most_attack_rad: float = MOST_ATTACK_RAD,
) -> Turning:
    """Solve (5.34) for a beat with a bias.

    ``added_mass``: whether the water that moves with the body turns with it; (5.34) has m_b alone.
    Without it the solution is the only one; with it, the one of smallest angle of attack.
    Raises ``NoEquilibriumError`` where no angle of attack up to ``most_attack_rad``
    balances the forces, and where the beat does not turn.
    """
    check_number("steady_turning.most_attack_rad", most_attack_rad, above=0.0, most=1.07)
    force = scaled_forces(parameters, beat, scaling)
    p = reduced(parameters, beat.bias_rad, Dynamics())
    x, y = force.x, abs(force.y)
    if x <= 0.0 or y == 0.0 or force.moment * beat.bias_rad >= 0.0:
        raise NoEquilibriumError(
            f"{beat}: a steady turn needs thrust and a moment against the bias, got "
            f"{force.x:.4g} N and {force.moment:.4g} N·m"
        )
    omega = math.sqrt(abs(force.moment) / (p.c4 * p.j3))

    def speed(beta: float) -> float:
        sine, cosine = math.sin(beta), math.cos(beta)
        thrust = x * cosine + y * sine
        # the way is turned by −ω: the added masses brake by half of this
        brake = 0.5 * (p.m2 - p.m1) * omega * sine * cosine if added_mass else 0.0
        return (math.sqrt(brake * brake + p.c1 * thrust) - brake) / p.c1

    def imbalance(beta: float) -> float:
        sine, cosine = math.sin(beta), math.cos(beta)
        mass = parameters.body.mass_kg
        if added_mass:
            mass = p.m1 * cosine * cosine + p.m2 * sine * sine
        v = speed(beta)
        return -p.c2 * v * beta + (y * cosine - x * sine) / v + mass * omega

    # without the added masses one interval is enough: h falls all the way
    intervals = math.ceil(most_attack_rad / _SCAN_RAD) if added_mass else 1
    for k in range(1, intervals + 1):
        low, high = most_attack_rad * (k - 1) / intervals, most_attack_rad * k / intervals
        if imbalance(high) <= 0.0:
            break
    else:
        raise NoEquilibriumError(
            f"{beat}: lift cannot balance the turn up to an angle of attack of "
            f"{math.degrees(most_attack_rad):.4g}°; {imbalance(most_attack_rad):.4g} kg/s is left"
        )
    beta = float(brentq(imbalance, low, high, xtol=1e-15, rtol=1e-14))
    v = speed(beta)
    return Turning(v / omega, 2.0 * math.pi / omega, math.copysign(beta, beat.bias_rad), v)
