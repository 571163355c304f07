"""The dynamics that chapter 5 averages (5.5), its simplification (5.18) and its averages (5.30).

One right-hand side serves all of them: the hull's part f1…f3 and the tail's part f4…f6, which is
either the beating tail or a constant. So what two models have in common is the same code, and what
tells them apart is data: the ``Dynamics`` that a caller names.

    u̇ = (m₂/m₁) v r − (c₁/m₁) u V + (c₂/m₁) v V β + f₄       f₄ = −(c₃/m₁) α̈ sin α
    v̇ = −(m₁/m₂) u r − (c₁/m₂) v V − (c₂/m₂) u V β + f₅      f₅ =  (c₃/m₂) α̈ cos α
    ṙ = s (m₁ − m₂)/J₃ u v − c₄ r|r| + f₆                     f₆ = −c₅ α̈ cos α − c₆ α̈
    V = √(u² + v²), β = arctan(v/u); c₁ = ½ρSC_D, c₂ = ½ρSC_L, c₃ = ½mL², c₄ = K_D/J₃,
    c₅ = L²mc/(2J₃), c₆ = L³m/(3J₃)

(5.5) prints the coupling (m₁ − m₂)uv without its division by J₃; the share s is
``hydrodynamics.munk_coupling``, and every figure of chapter 5 was computed with s = 0. (5.18) takes
V ≈ u, β ≈ v/u, sin α ≈ α − α³/6 and cos α ≈ 1 − α²/2. Body motion in the tail forces is ignored
by all of them. With s = 0 and a tail of constant beat everything is quadratic in the speeds, so a
beat of n times the frequency makes the same path n times as fast.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from plant.checks import check_number
from plant.compiled import compiled
from plant.elementary import atan2 as _atan2
from plant.errors import InvalidParameterError
from plant.parameters import Linkage, PlantParameters
from plant.tail_input import TailBeat, sincos

atan2 = compiled(_atan2)


@dataclass(frozen=True, slots=True)
class Scaling:
    """K_force, and K_moment = moment + moment_per_rad · |α₀| (5.29). Of either sign of the bias.

    The source writes α₀, and has positive biases only; the robot is symmetric.
    """

    force: float
    moment: float
    moment_per_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no finite number, and a force that pushes backwards."""
        check_number("scaling.force", self.force, above=0.0)
        check_number("scaling.moment", self.moment)
        check_number("scaling.moment_per_rad", self.moment_per_rad)

    def moment_at(self, bias_rad: float) -> float:
        """K_moment of a bias, rad."""
        return self.moment + self.moment_per_rad * abs(bias_rad)


CLASSICAL = Scaling(1.0, 1.0)
"""Classical averaging (5.26–5.28): the forcing as it is."""

PUBLISHED = Scaling(0.8485, -0.0074, 0.4831)
"""The source's scaling for the robot of Table 3.1 with the coefficients of chapter 5."""

PUBLISHED_HEAVY = Scaling(0.891, 0.0817, 1.0313)
"""The same with mass and inertia of the body doubled (0.622 kg)."""


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Which equations: ``scaling`` None is a beating tail, else the average with that scaling.

    ``full_attack``: √(u² + v²) and arctan(v/u), else u and v/u. ``full_tail``: sin α and cos α,
    else their expansions; of an average, its closed form with J₁(α_A), else that of (5.30).
    """

    full_attack: bool = True
    full_tail: bool = True
    scaling: Scaling | None = None


ORIGINAL = Dynamics()
"""(5.5)."""

SIMPLIFIED = Dynamics(full_attack=False, full_tail=False)
"""(5.18)."""

AVERAGE = Dynamics(full_tail=False, scaling=PUBLISHED)
"""(5.30) with the published scaling."""


class Reduced(NamedTuple):
    """Constants of the hull's part, SI units, and the shares of its terms."""

    m1: float  # m_b − X_u̇, kg
    m2: float  # m_b − Y_v̇, kg
    j3: float  # J_bz − N_ṙ, kg·m²
    c1: float  # ½ρSC_D, kg/m
    c2: float  # ½ρSC_L, kg/(m·rad)
    c4: float  # K_D/J₃
    munk: float  # share of the coupling in ṙ
    full: float  # 1: V and arctan; 0: u and v/u


class Forcing(NamedTuple):
    """The tail's part: a beat through three coefficients, and constants."""

    bias: float  # rad
    amplitude: float  # rad; 0 where the tail does not beat
    omega: float  # rad/s
    full: float  # 1: sin α, cos α; 0: α − α³/6, 1 − α²/2
    c3: float  # ½mL², kg·m
    c5: float  # L²mc/(2J₃)
    c6: float  # L³m/(3J₃)
    x: float  # constant part of u̇, m/s²
    y: float  # of v̇
    z: float  # of ṙ, rad/s²


class Motion(NamedTuple):
    """Position and heading in the tank, velocities through the water in body axes."""

    x: float
    y: float
    psi: float
    u: float
    v: float
    r: float


REDUCED, FORCING, MOTION = len(Reduced._fields), len(Forcing._fields), len(Motion._fields)
"""Lengths of the records as vectors."""


def check_robot(parameters: PlantParameters) -> None:
    """Refuse what the models of chapter 5 do not have, rather than leave it out in silence.

    The servo and the current are no part of them: a beat is the tail's own motion, velocities are
    through the water. Raises ``InvalidParameterError``.
    """
    tail, hydro, walls = parameters.tail, parameters.hydrodynamics, parameters.walls
    water, linkage = parameters.water, parameters.linkage
    for name, foreign, what in (
        ("tail.segments", tail.flexible, "a flexible tail"),
        ("tail.depth_profile", bool(tail.depth_profile), "a tail of varying depth"),
        ("hydrodynamics.lift_per_bias", hydro.lift_per_bias != 0.0, "lift by the bias"),
        ("hydrodynamics.linear_drag_n_s_m", hydro.linear_drag_n_s_m != 0.0, "linear drag"),
        ("walls.drag_rise", walls.drag_rise != 0.0 or walls.stiffness_n_m != 0.0, "walls"),
        (
            "water.shear_x_per_y_s",
            water.shear_x_per_y_s != 0.0 or water.shear_y_per_x_s != 0.0,
            "a sheared current",
        ),
        ("linkage", linkage != Linkage(), "a linkage between beat and tail"),
    ):
        if foreign:
            raise InvalidParameterError(name, f"the models of chapter 5 do not have {what}")


def reduced(parameters: PlantParameters, bias_rad: float, dynamics: Dynamics) -> Reduced:
    """Constants of a robot, with the drag of this bias where it is adapted (3.32, 3.33)."""
    check_robot(parameters)
    body, hydro, water = parameters.body, parameters.hydrodynamics, parameters.water
    half_rho_s = 0.5 * water.density_kg_m3 * body.wetted_area_m2
    j3 = body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2
    drag = hydro.drag + hydro.drag_per_bias_squared * bias_rad * bias_rad
    yaw_drag = hydro.yaw_drag_n_m_s2 + hydro.yaw_drag_per_bias_n_m_s2 * abs(bias_rad)
    return Reduced(
        m1=float(body.mass_kg + body.added_mass_surge_kg),
        m2=float(body.mass_kg + body.added_mass_sway_kg),
        j3=float(j3),
        c1=float(half_rho_s * drag),
        c2=float(half_rho_s * hydro.lift),
        c4=float(yaw_drag / j3),
        munk=float(hydro.munk_coupling),
        full=1.0 if dynamics.full_attack else 0.0,
    )


def tail_coefficients(parameters: PlantParameters) -> tuple[float, float, float]:
    """c₃ = ½mL² (kg·m), c₅ = L²mc/(2J₃), c₆ = L³m/(3J₃) of (5.5), m = ¼πρd²."""
    body, tail = parameters.body, parameters.tail
    length = tail.length_m
    mass_per_m = 0.25 * math.pi * parameters.water.density_kg_m3 * tail.depth_m**2
    j3 = body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2
    c3 = 0.5 * mass_per_m * length * length
    return c3, c3 * body.hinge_distance_m / j3, mass_per_m * length**3 / (3.0 * j3)


def check_beat(beat: TailBeat) -> None:
    """Refuse a beat that cannot be averaged: one that does not beat, or turns the tail about."""
    check_number("tail_beat.frequency_hz", beat.frequency_hz, above=0.0)
    check_number("tail_beat.amplitude_rad", beat.amplitude_rad, above=0.0)
    if abs(beat.bias_rad) + beat.amplitude_rad > 0.5 * math.pi:
        raise InvalidParameterError(
            "tail_beat.bias_rad",
            f"bias and amplitude together pass 90° "
            f"({math.degrees(abs(beat.bias_rad) + beat.amplitude_rad):.4g}°), "
            f"where the tail no longer pushes forward",
        )


@compiled
def hull(p: Reduced, u: float, v: float, r: float) -> tuple[float, float, float]:
    """f₁, f₂, f₃ of (5.5) or (5.18): m/s², m/s², rad/s²."""
    if p.full != 0.0:
        speed = math.sqrt(u * u + v * v)
        attack = atan2(v, u)
    else:
        speed = u
        attack = v / u if u != 0.0 else 0.0
    drag = p.c1 * speed
    lift = p.c2 * speed * attack
    return (
        (p.m2 * v * r - drag * u + lift * v) / p.m1,
        (-p.m1 * u * r - drag * v - lift * u) / p.m2,
        p.munk * (p.m1 - p.m2) / p.j3 * u * v - p.c4 * r * abs(r),
    )


@compiled
def tail_part(p: Reduced, f: Forcing, time_s: float) -> tuple[float, float, float]:
    """f₄, f₅, f₆ at a time: m/s², m/s², rad/s²."""
    if f.amplitude == 0.0:
        return f.x, f.y, f.z
    beat = sincos(f.omega * time_s)[0]
    alpha = f.bias + f.amplitude * beat
    alpha_ddot = -f.amplitude * f.omega * f.omega * beat
    if f.full != 0.0:
        sine, cosine = sincos(alpha)
    else:
        sine, cosine = alpha - alpha * alpha * alpha / 6.0, 1.0 - 0.5 * alpha * alpha
    return (
        f.x - f.c3 / p.m1 * alpha_ddot * sine,
        f.y + f.c3 / p.m2 * alpha_ddot * cosine,
        f.z - f.c5 * alpha_ddot * cosine - f.c6 * alpha_ddot,
    )


@compiled
def motion_rates(p: Reduced, f: Forcing, time_s: float, s: Motion) -> Motion:
    """Derivatives of the motion; the water is at rest."""
    du, dv, dr = hull(p, s.u, s.v, s.r)
    ax, ay, az = tail_part(p, f, time_s)
    sine, cosine = sincos(s.psi)
    return Motion(
        s.u * cosine - s.v * sine, s.u * sine + s.v * cosine, s.r, du + ax, dv + ay, dr + az
    )


@compiled
def moved(s: Motion, h: float, k: Motion) -> Motion:
    """Return s + h·k."""
    return Motion(
        s.x + h * k.x,
        s.y + h * k.y,
        s.psi + h * k.psi,
        s.u + h * k.u,
        s.v + h * k.v,
        s.r + h * k.r,
    )


@compiled
def motion_step(p: Reduced, f: Forcing, time_s: float, h: float, s: Motion) -> Motion:
    """One step of the classical Runge–Kutta method of order four.

    The stages stand in a loop so that the right-hand side is compiled in once.
    """
    result = s
    k = s
    for stage in range(4):
        part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
        k = motion_rates(p, f, time_s + part, moved(s, part, k))
        result = moved(result, h / 6.0 if stage in (0, 3) else h / 3.0, k)
    return result
