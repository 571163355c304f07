"""Equilibria of the average model (5.30) and their stability (5.31).

The closed form after (5.30) takes V ≈ u and β ≈ v/u *and* drops the small terms (m₂/m₁)vr and
(c₂/m₁)v² from u̇; ``equilibria`` takes nothing: Newton steps with the Jacobian from starts all over
the range of velocities, so that more than one equilibrium would be seen. The Jacobian is (5.31)
with the coupling added; its printed elements are right, the trace that is concluded from them is
not (docs/averaging.md).
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.averaging.average import forcing, scaled_forces
from plant.averaging.dynamics import (
    PUBLISHED,
    Dynamics,
    Forcing,
    Reduced,
    Scaling,
    atan2,
    hull,
    reduced,
)
from plant.compiled import compiled
from plant.errors import PlantError
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat

RESIDUAL = 1e-12
"""Largest acceleration left at an equilibrium, as a share of the forcing's."""

_NEWTON_STEPS = 60
_SAME = 1e-6  # equilibria nearer than this share of their speed are one


class NoEquilibriumError(PlantError, ArithmeticError):
    """The average model has no equilibrium in the range that was asked for."""


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Steady velocities of the average model: u, v (m/s), r (rad/s)."""

    u_m_s: float
    v_m_s: float
    r_rad_s: float

    @property
    def speed_m_s(self) -> float:
        """√(u² + v²)."""
        return math.hypot(self.u_m_s, self.v_m_s)

    @property
    def attack_rad(self) -> float:
        """Angle of attack β."""
        return math.atan2(self.v_m_s, self.u_m_s)

    @property
    def turn_radius_m(self) -> float:
        """Radius of the circle; infinite where it does not turn."""
        return self.speed_m_s / abs(self.r_rad_s) if self.r_rad_s else math.inf

    @property
    def turn_period_s(self) -> float:
        """Time of one turn; infinite where it does not turn."""
        return 2.0 * math.pi / abs(self.r_rad_s) if self.r_rad_s else math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Stability:
    """Linearisation at a point: ``matrix`` (3, 3) over u, v, r; its ``eigenvalues`` (3,), 1/s."""

    matrix: FloatArray
    eigenvalues: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]

    @property
    def hurwitz(self) -> bool:
        """Whether every small deviation dies exponentially.

        Without a turn it does not: a₃₃ = −2c₄|r| is 0 there, and r dies as 1/(c₄t) by r|r|.
        """
        return bool(np.all(self.eigenvalues.real < 0.0))

    @property
    def slowest_s(self) -> float:
        """Time constant of what dies slowest; infinite where not Hurwitz."""
        rate = float(-self.eigenvalues.real.max())
        return 1.0 / rate if rate > 0.0 else math.inf


def closed_form(
    parameters: PlantParameters, beat: TailBeat, scaling: Scaling = PUBLISHED
) -> Equilibrium:
    """Equilibrium as printed after (5.30), for either sign of the bias.

    Raises ``NoEquilibriumError`` where the mean thrust or the mean moment has the wrong sign.
    """
    force = scaled_forces(parameters, beat, scaling)
    p = reduced(parameters, beat.bias_rad, Dynamics())
    if force.x <= 0.0:
        raise NoEquilibriumError(f"the mean thrust of {beat} is not positive: {force.x:.4g} N")
    if force.moment * beat.bias_rad > 0.0:
        raise NoEquilibriumError(
            f"K_moment is negative at a bias of {math.degrees(beat.bias_rad):.4g}°: "
            f"{scaling.moment_at(beat.bias_rad):.4g}"
        )
    u = math.sqrt(force.x / p.c1)
    turning = force.moment / (p.c4 * p.j3)
    r = math.copysign(math.sqrt(abs(turning)), turning) if turning else 0.0
    v = force.y / ((p.c1 + p.c2) * u) - p.m1 * r / (p.c1 + p.c2)
    return Equilibrium(u, v, r)


@compiled
def _fill_jacobian(p: Reduced, u: float, v: float, r: float, matrix: FloatArray) -> None:
    """Elements of (5.31) with the coupling."""
    m1, m2, c1, c2 = p.m1, p.m2, p.c1, p.c2
    if p.full != 0.0:
        speed = math.sqrt(u * u + v * v)
        along, across = u / speed, v / speed
        attack = atan2(v, u)
        # of the drag c₁V and the lift c₂Vβ, by u and v
        drag, drag_u, drag_v = c1 * speed, c1 * along, c1 * across
        lift = c2 * speed * attack
        lift_u, lift_v = c2 * (along * attack - across), c2 * (across * attack + along)
    else:
        drag, drag_u, drag_v = c1 * u, c1, 0.0
        lift, lift_u, lift_v = c2 * v, 0.0, c2
    matrix[0, 0] = (-drag - drag_u * u + lift_u * v) / m1
    matrix[0, 1] = (m2 * r - drag_v * u + lift + lift_v * v) / m1
    matrix[0, 2] = m2 * v / m1
    matrix[1, 0] = (-m1 * r - drag_u * v - lift - lift_u * u) / m2
    matrix[1, 1] = (-drag - drag_v * v - lift_v * u) / m2
    matrix[1, 2] = -m1 * u / m2
    coupling = p.munk * (m1 - m2) / p.j3
    matrix[2, 0] = coupling * v
    matrix[2, 1] = coupling * u
    matrix[2, 2] = -2.0 * p.c4 * abs(r)


def jacobian(
    parameters: PlantParameters,
    bias_rad: float,
    velocity: tuple[float, float, float],
    dynamics: Dynamics | None = None,
) -> FloatArray:
    """∂(u̇, v̇, ṙ)/∂(u, v, r) at velocities u, v, r (5.31); needs u ≠ 0 or v ≠ 0."""
    matrix = np.empty((3, 3))
    u, v, r = velocity
    _fill_jacobian(reduced(parameters, bias_rad, dynamics or Dynamics()), u, v, r, matrix)
    return matrix


def stability(parameters: PlantParameters, beat: TailBeat, at: Equilibrium) -> Stability:
    """Linearise (5.30) at an equilibrium of this beat."""
    matrix = jacobian(parameters, beat.bias_rad, (at.u_m_s, at.v_m_s, at.r_rad_s))
    return Stability(matrix, np.linalg.eigvals(matrix).astype(np.complex128))


def _newton(
    p: Reduced, f: Forcing, start: FloatArray, turns: bool, unit: tuple[float, float]
) -> FloatArray | None:
    """Newton steps on u, v, r from a start; None where they do not come to an equilibrium."""
    x, matrix = start, np.empty((3, 3))
    rows = 3 if turns else 2
    for _ in range(_NEWTON_STEPS):
        du, dv, dr = hull(p, *x.tolist())
        _fill_jacobian(p, x[0], x[1], x[2], matrix)
        try:
            step = np.linalg.solve(
                matrix[:rows, :rows], np.array([du + f.x, dv + f.y, dr + f.z])[:rows]
            )
        except np.linalg.LinAlgError:
            return None
        x = x - np.append(step, 0.0)[:3]
        if not np.all(np.isfinite(x)) or math.hypot(x[0], x[1]) == 0.0:
            return None
        if abs(step[:2]).max() <= 1e-15 * unit[0] and abs(step[2:]).sum() <= 1e-15 * unit[1]:
            break
    du, dv, dr = hull(p, *x.tolist())
    if math.hypot(du + f.x, dv + f.y) > RESIDUAL * math.hypot(f.x, f.y):
        return None
    if turns and abs(dr + f.z) > RESIDUAL * max(abs(f.z), p.c4 * unit[1] * unit[1]):
        return None
    return x


def equilibria(
    parameters: PlantParameters,
    beat: TailBeat,
    scaling: Scaling = PUBLISHED,
    full_tail: bool = False,
) -> tuple[Equilibrium, ...]:
    """Every equilibrium of (5.30) that Newton steps find, fastest forward first.

    Starts cover speeds up to three times, and rates up to six times, those that the mean forces
    sustain, in every direction. Where nothing turns the robot, r = 0 is set and not searched; the
    coupling does, so that straight swimming with it is one equilibrium of three.
    """
    dynamics = Dynamics(full_tail=full_tail, scaling=scaling)
    p = reduced(parameters, beat.bias_rad, dynamics)
    f = forcing(parameters, beat, dynamics)
    unit_v = math.sqrt(math.hypot(p.m1 * f.x, p.m2 * f.y) / p.c1)
    turns = f.z != 0.0 or p.munk != 0.0
    unit_r = math.sqrt(abs(f.z) / p.c4) or unit_v / parameters.body.hinge_distance_m
    speeds = (0.3, 1.0, 3.0, -0.3, -1.0, -3.0)
    sways = (0.1, 1.0, 3.0, -0.1, -1.0, -3.0)
    rates = (-1.0, -0.1, -6.0, 1.0, 0.1, 6.0) if turns else (0.0,)
    found: list[Equilibrium] = []
    for u, v, r in itertools.product(speeds, sways, rates):
        x = _newton(p, f, np.array([u * unit_v, v * unit_v, r * unit_r]), turns, (unit_v, unit_r))
        if x is None:
            continue
        one = Equilibrium(*(float(value) for value in x))
        if all(
            math.hypot(one.u_m_s - other.u_m_s, one.v_m_s - other.v_m_s) > _SAME * unit_v
            or abs(one.r_rad_s - other.r_rad_s) > _SAME * unit_r
            for other in found
        ):
            found.append(one)
    return tuple(sorted(found, key=lambda item: -item.u_m_s))


def equilibrium(
    parameters: PlantParameters,
    beat: TailBeat,
    scaling: Scaling = PUBLISHED,
    full_tail: bool = False,
) -> Equilibrium:
    """The forward equilibrium of (5.30) without approximation.

    From the closed form where that is near, else of those of ``equilibria`` that swim forward the
    fastest stable one (with the coupling there may be three). Raises ``NoEquilibriumError`` where
    none swims forward.
    """
    dynamics = Dynamics(full_tail=full_tail, scaling=scaling)
    p = reduced(parameters, beat.bias_rad, dynamics)
    if p.munk == 0.0:
        near = closed_form(parameters, beat, scaling)
        x = _newton(
            p,
            forcing(parameters, beat, dynamics),
            np.array([near.u_m_s, near.v_m_s, near.r_rad_s]),
            near.r_rad_s != 0.0,
            (near.speed_m_s, abs(near.r_rad_s) or 1.0),
        )
        if x is not None and abs(math.atan2(x[1], x[0])) < 0.5 * math.pi:
            return Equilibrium(*(float(value) for value in x))
    forward = [
        item
        for item in equilibria(parameters, beat, scaling, full_tail)
        if abs(item.attack_rad) < 0.5 * math.pi
    ]
    if not forward:
        raise NoEquilibriumError(f"{beat}: the average model has no equilibrium swimming forward")
    return min(forward, key=lambda item: not stability(parameters, beat, item).hurwitz)
