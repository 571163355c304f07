"""The hybrid target-tracking law of the source (section 5.7): numbers in, a tail bias out.

Nothing here knows a board, a clock or a radio: the application calls it once a tail beat, and so
does the study that swims the plant alone from a grid of poses.

Coordinates (5.35): r is the distance of the target, θ = ψ − φ the heading against the direction of
the target, so θ > 0 means that the target lies to starboard, and a bias > 0 turns the robot there.

    ṙ = −V_x cos θ + V_y sin θ,    θ̇ = ω + (V_x sin θ + V_y cos θ)/r                       (5.36)

**Approaching** by backstepping (the source prints the result only, and its A, B, C damaged). With
V₁ = ½r² (5.37) the wish is ṙ = −k_r r, and z₁ = k_r r + ṙ is what is missing: V̇₁ = −k_r r² + r z₁.
With V₂ = V₁ + ½λz₁² (5.38, there λ = 1) and ż₁ = −k₁ z₁,

    V̇₂ = −k_r r² + r z₁ − λ k₁ z₁² < 0    for λ > 1/(4 k_r k₁), which exists.

ż₁ + k₁ z₁ = r̈ + (k₁ + k_r) ṙ + k₁ k_r r, and

    r̈ = −V̇_x cos θ + V̇_y sin θ + θ̇ (V_x sin θ + V_y cos θ).

The average model (5.30) has V̇_x = f_u + ¼q/m₁ · (1 − ½α₀² − ⅛α_A²), V̇_y = f_v + ¼q/m₂ · α₀ with
q = K_force m L² ω_α² α_A². So ż₁ = −k₁ z₁ is A α₀² + B α₀ + C = 0 (5.39) with

    A = ⅛ q/m₁ cos θ,   B = ¼ q/m₂ sin θ,
    C = −¼ q/m₁ (1 − ⅛α_A²) cos θ + (k₁ + k_r) ṙ + k₁ k_r r − f_u cos θ + f_v sin θ
        + (V_x sin θ + V_y cos θ) θ̇.

A bias takes thrust away: the law brakes with it, and the quadratic leaves its side open. Where
C < 0 the roots have both signs, and the one that turns the robot to the target is taken. Where
C ≥ 0 more thrust is asked for than the beat gives: no root, or both on the side that turns the
robot away. Then the bias only steers, α₀max · sat(θ/θ₂), which meets the turning controller at θ₂;
and a root that is smaller than this yields to it.

**Turning** (5.40): α₀ = α₀max sgn θ. Hysteresis: approach below |θ| = θ₁, turn above θ₂.

**Leaving** is ours. A target inside the circle of the tightest turn (r < 2R |sin θ|) is never
reached by turning: the robot circles round it for ever. It swims straight ahead then until the
target is `leave_radii` R away, and turns back.

θ is taken a little ahead, θ + lead · θ̇: yaw lags behind the bias by seconds, poses come once a
beat.

**The gains** are not published. C < 0 from about r = V (1/k_r + 1/k₁) on, and thrust is so weak
that the root soon is beyond ±α₀max: the brake flips from side to side. Each flip turns the body by
−(c₅ + c₆) Δα₀ (5.5), 25° for 80°, which the average model does not know; a servo makes thrust of
it, too. So with gains of 0.2 and 0.3 per second, which brake over the last 25 cm, many a robot with
a real tail misses the target and comes round again; with 0.5 per second it brakes over the last
12 cm and does not. docs/tracking.md has figures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from procboard.errors import ProcConfigError

LEAST_DISTANCE_M: Final = 1e-3
"""The distance that r is taken as at least where the law divides by it; arrival lies far above."""


class Motion(NamedTuple):
    """Means over a tail beat: where the target is (5.35), and how the robot moves."""

    distance_m: float
    """r."""
    error_rad: float
    """θ = ψ − φ, in [-π, π): positive where the target lies to starboard."""
    surge_m_s: float
    """V_Cx."""
    sway_m_s: float
    """V_Cy."""
    yaw_rate_rad_s: float
    """ω_z."""


@dataclass(frozen=True, slots=True)
class SwimModel:
    """The average model (5.30) that the robot believes: Table 3.1, coefficients of chapter 5."""

    surge_mass_kg: float = 0.311 + 0.0621
    """m₁ = m_b − X_u̇."""
    sway_mass_kg: float = 0.311 + 0.2299
    """m₂ = m_b − Y_v̇."""
    yaw_inertia_kg_m2: float = 0.311 * 0.14**2 / 12.0 + 1.0413e-4
    """J₃ = J_bz − N_ṙ."""
    hinge_distance_m: float = 0.07
    drag_kg_m: float = 0.5 * 1000.0 * 0.0108 * 0.386
    """c₁ = ½ρSC_D."""
    lift_kg_m: float = 0.5 * 1000.0 * 0.0108 * 4.50
    """c₂ = ½ρSC_L."""
    yaw_drag_kg_m2: float = 7.82e-4
    """K_D."""
    tail_kg_m: float = 0.25 * math.pi * 1000.0 * 0.025**2 * 0.08**2
    """mL², with the tail's virtual mass per length m = ¼πρd²."""
    force_scale: float = 0.8485
    """K_force."""
    moment_scale: float = -0.0074
    moment_scale_per_rad: float = 0.4831
    """K_moment = −0.0074 + 0.4831 |α₀|."""

    def free_surge(self, motion: Motion) -> float:
        """f₁ of (5.5), m/s²: what the body alone does, without its tail."""
        u, v, r = motion.surge_m_s, motion.sway_m_s, motion.yaw_rate_rad_s
        speed, angle = math.hypot(u, v), math.atan2(v, u)
        return (
            self.sway_mass_kg * v * r
            - self.drag_kg_m * u * speed
            + self.lift_kg_m * v * speed * angle
        ) / self.surge_mass_kg

    def free_sway(self, motion: Motion) -> float:
        """f₂ of (5.5), m/s²."""
        u, v, r = motion.surge_m_s, motion.sway_m_s, motion.yaw_rate_rad_s
        speed, angle = math.hypot(u, v), math.atan2(v, u)
        return (
            -self.surge_mass_kg * u * r
            - self.drag_kg_m * v * speed
            - self.lift_kg_m * u * speed * angle
        ) / self.sway_mass_kg

    def forcing_n(self, amplitude_rad: float, frequency_hz: float) -> float:
        """Return q = K_force m L² ω_α² α_A², N: four times the mean thrust of a small beat."""
        rate = 2 * math.pi * frequency_hz * amplitude_rad
        return self.force_scale * self.tail_kg_m * rate * rate

    def turn_radius_m(self, bias_rad: float, amplitude_rad: float, frequency_hz: float) -> float:
        """Radius of the steady turn of (5.30), found by letting the model swim to it.

        A minute in steps of 50 ms: the slowest rate of the model is that of the speed, about 10 s.
        """
        if bias_rad == 0.0 or amplitude_rad == 0.0 or frequency_hz == 0.0:
            return math.inf
        q, bias = self.forcing_n(amplitude_rad, frequency_hz), abs(bias_rad)
        thrust = 0.25 * q / self.surge_mass_kg * (1 - 0.5 * bias**2 - 0.125 * amplitude_rad**2)
        side = 0.25 * q / self.sway_mass_kg * bias
        scale = (self.moment_scale + self.moment_scale_per_rad * bias) / self.force_scale
        moment = 0.25 * scale * q * self.hinge_distance_m * bias
        if moment <= 0.0:
            return math.inf
        # The third equation of (5.30) stands alone: M = K_D ω². The turn is clockwise.
        rate = -math.sqrt(moment / self.yaw_drag_kg_m2)
        u = v = 0.0
        for _ in range(1200):
            motion = Motion(1.0, 0.0, u, v, rate)
            u, v = (
                u + 0.05 * (self.free_surge(motion) + thrust),
                v + 0.05 * (self.free_sway(motion) + side),
            )
        return math.hypot(u, v) / abs(rate)


class Mode(IntEnum):
    """Which controller is at work."""

    TURNING = 0
    APPROACHING = 1
    LEAVING = 2


@dataclass(frozen=True, slots=True)
class TrackingGains:
    """Constants of the law. Thresholds and arrival are the source's; the rest it does not print."""

    approach_per_s: float = 0.5
    """k_r: the distance is to fall by this share a second."""
    speed_per_s: float = 0.5
    """k₁: how fast what is missing in speed is to vanish."""
    bias_max_rad: float = math.radians(40.0)
    """α₀max."""
    approach_below_rad: float = math.radians(20.0)
    """θ₁."""
    turn_above_rad: float = math.radians(40.0)
    """θ₂."""
    arrival_m: float = 0.02
    """Distance at which a target counts as reached."""
    lead_s: float = 0.75
    """How far ahead θ is looked at: most of a beat of 1 Hz."""
    leave_radii: float = 2.5
    """Distance to swim away to, in radii of the tightest turn; 0: never leave."""

    def __post_init__(self) -> None:
        if not (self.approach_per_s > 0 and self.speed_per_s > 0 and self.arrival_m > 0):
            raise ProcConfigError(
                "target tracking: approach_per_s, speed_per_s and arrival_m are positive"
            )
        if not 0 < self.bias_max_rad <= math.pi / 2:
            raise ProcConfigError("target tracking: bias_max_rad lies between 0 and π/2")
        if not 0 < self.approach_below_rad <= self.turn_above_rad <= math.pi:
            raise ProcConfigError(
                "target tracking: approach_below_rad lies between 0 and turn_above_rad, and that "
                "below π"
            )
        if self.lead_s < 0 or not (self.leave_radii == 0 or self.leave_radii >= 2):
            raise ProcConfigError(
                "target tracking: lead_s is not negative, leave_radii is 0 or at least 2"
            )


class Quadratic(NamedTuple):
    """A, B, C of (5.39), in m/s²."""

    a: float
    b: float
    c: float


class Steering(NamedTuple):
    """What the law decides at a beat."""

    mode: Mode
    bias_rad: float


class TrackingLaw:
    """The law with its constants; it remembers nothing, the mode goes in and out."""

    __slots__ = ("amplitude_rad", "forcing_n", "gains", "model", "turn_radius_m")

    def __init__(
        self,
        amplitude_rad: float,
        frequency_hz: float,
        gains: TrackingGains | None = None,
        model: SwimModel | None = None,
    ) -> None:
        if not (frequency_hz > 0 and amplitude_rad > 0):
            raise ProcConfigError(
                "target tracking: the tail's amplitude and frequency are positive"
            )
        self.gains = gains = gains or TrackingGains()
        self.model = model = model or SwimModel()
        self.amplitude_rad = amplitude_rad
        self.forcing_n = model.forcing_n(amplitude_rad, frequency_hz)
        self.turn_radius_m = model.turn_radius_m(gains.bias_max_rad, amplitude_rad, frequency_hz)
        """R: radius of the tightest turn, as the model has it."""

    def quadratic(self, motion: Motion) -> Quadratic:
        """Return A, B and C of (5.39)."""
        model, gains, q = self.model, self.gains, self.forcing_n
        k_r, k_1 = gains.approach_per_s, gains.speed_per_s
        r, theta, u, v, rate = motion
        r = max(r, LEAST_DISTANCE_M)
        sine, cosine = math.sin(theta), math.cos(theta)
        distance_rate = -u * cosine + v * sine
        across = u * sine + v * cosine
        q_1, q_2 = q / model.surge_mass_kg, q / model.sway_mass_kg
        c = (
            -0.25 * q_1 * (1 - 0.125 * self.amplitude_rad**2) * cosine
            + (k_1 + k_r) * distance_rate
            + k_1 * k_r * r
            - model.free_surge(motion) * cosine
            + model.free_sway(motion) * sine
            + across * (across / r + rate)
        )
        return Quadratic(0.125 * q_1 * cosine, 0.25 * q_2 * sine, c)

    def ahead_rad(self, motion: Motion) -> float:
        """Return θ + lead · θ̇ (5.36)."""
        r, theta, u, v, rate = motion
        swing = (u * math.sin(theta) + v * math.cos(theta)) / max(r, self.gains.arrival_m)
        return theta + self.gains.lead_s * (rate + swing)

    def approach_bias_rad(self, motion: Motion) -> float:
        """Return the approaching controller's bias (5.39), limited."""
        gains = self.gains
        limit = gains.bias_max_rad
        ahead = self.ahead_rad(motion)
        bias = limit * max(-1.0, min(1.0, ahead / gains.turn_above_rad))
        a, b, c = self.quadratic(motion)
        if a > 0 and c < 0:
            root = math.sqrt(b * b - 4 * a * c)
            brake = (root - b if ahead >= 0 else -root - b) / (2 * a)
            if abs(brake) > abs(bias):
                bias = brake
        return max(-limit, min(limit, bias))

    def out_of_reach(self, motion: Motion) -> bool:
        """Whether the target lies within the circle that the tightest turn would make."""
        r, theta = motion.distance_m, motion.error_rad
        if self.gains.leave_radii == 0:
            return False
        # Behind the robot, the circle comes round again: what counts is its whole width.
        sine = 1.0 if abs(theta) > math.pi / 2 else abs(math.sin(theta))
        return r < 2 * self.turn_radius_m * sine

    def next_mode(self, mode: Mode, motion: Motion) -> Mode:
        """Return which controller is at work at a beat, given which one was."""
        gains, error = self.gains, abs(motion.error_rad)
        if mode is Mode.LEAVING and motion.distance_m < gains.leave_radii * self.turn_radius_m:
            return Mode.LEAVING
        if error < gains.approach_below_rad:
            return Mode.APPROACHING
        if error <= gains.turn_above_rad and mode is Mode.APPROACHING:
            return Mode.APPROACHING
        return Mode.LEAVING if self.out_of_reach(motion) else Mode.TURNING

    def step(self, mode: Mode, motion: Motion) -> Steering:
        """Return the mode and the bias for the next beat."""
        mode = self.next_mode(mode, motion)
        if mode is Mode.APPROACHING:
            return Steering(mode, self.approach_bias_rad(motion))
        if mode is Mode.TURNING:
            return Steering(mode, math.copysign(self.gains.bias_max_rad, motion.error_rad))
        return Steering(mode, 0.0)
