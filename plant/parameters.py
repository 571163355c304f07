"""What the plant is made of: frozen, validated parameters, with their published values as defaults.

Defaults are Table 3.1 of the source with the coefficients identified at 20° bias. Values are SI;
names carry the unit. Nonsense is refused at construction with the field's dotted name, so that an
invalid robot cannot exist and compiled code need not check. ``packing.pack`` makes the record that
compiled code reads (``layout.Packed``). Nothing here needs NumPy or Numba, so that a scenario is
read quickly.
"""

import math
from dataclasses import dataclass, field, fields
from typing import ClassVar

from plant.checks import Checked, check_number, number
from plant.errors import InvalidParameterError
from plant.extra_force import ExtraForce
from plant.profile import check_profile

LARGEST_BIAS_RAD = math.radians(60.0)
"""Travel of the servo to each side: up to there no drag may be negative."""

KG_CM = 9.80665e-2
"""N·m in one kilogram-force centimetre, the unit of servo datasheets."""

MOST_SEGMENTS = 64
MOST_MODES = 20
"""Bounds of a flexible tail: beyond, neither model gains anything, and both get slow."""


@dataclass(frozen=True, slots=True)
class Body(Checked):
    """The rigid hull (Table 3.1). J_bz is that of a slender rod: m_b(2c)²/12."""

    SECTION: ClassVar[str] = "body"

    mass_kg: float = number(0.311, above=0.0, most=1e3)
    hinge_distance_m: float = number(0.07, least=0.0, most=10.0)  # c
    wetted_area_m2: float = number(0.0108, above=0.0, most=100.0)  # S
    yaw_inertia_kg_m2: float = number(0.311 * 0.14**2 / 12.0, above=0.0, most=1e4)  # J_bz
    added_mass_surge_kg: float = number(0.0621, least=0.0, most=1e3)  # −X_u̇
    added_mass_sway_kg: float = number(0.2299, least=0.0, most=1e3)  # −Y_v̇
    added_inertia_yaw_kg_m2: float = number(1.0413e-4, least=0.0, most=1e4)  # −N_ṙ


@dataclass(frozen=True, slots=True)
class Tail(Checked):
    """The tail plate: rigid (Table 3.1), or flexible as segments or as a beam (chapter 4).

    ``segments``: rigid pieces joined by springs; 1 is a rigid tail. ``modes``: modes of an
    Euler–Bernoulli beam; 0 is no beam. Stiffness comes from ``modulus_pa`` and ``thickness_m``
    (4.18), or, for segments, as ``joint_stiffness_n_m`` of each joint; 0 is "not given".
    ``damping_s``: κ, damping over stiffness (4.4). Profiles: factors of depth and thickness at
    equally spaced stations from joint to tip, linear between; empty is uniform.
    """

    SECTION: ClassVar[str] = "tail"

    length_m: float = number(0.08, above=0.0, most=10.0, because="a tail has an extent")  # L
    depth_m: float = number(0.025, above=0.0, most=10.0, because="a tail has an extent")  # d
    segments: int = number(1, least=1, most=MOST_SEGMENTS)  # N
    modes: int = number(0, least=0, most=MOST_MODES)
    modulus_pa: float = number(0.0, least=0.0, most=1e13)  # E
    thickness_m: float = number(0.0, least=0.0, most=1.0)  # h
    joint_stiffness_n_m: float = number(0.0, least=0.0, most=1e6)  # K_S, N·m/rad
    damping_s: float = number(0.0, least=0.0, most=1e3)  # κ
    depth_profile: tuple[float, ...] = ()
    thickness_profile: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check every field, then what must come together and what excludes each other."""
        Checked.__post_init__(self)
        for name in ("segments", "modes"):
            count = getattr(self, name)
            if not isinstance(count, int):
                raise InvalidParameterError(f"tail.{name}", f"must be a whole number, got {count}")
        check_profile("tail.depth_profile", self.depth_profile)
        check_profile("tail.thickness_profile", self.thickness_profile)
        for name, wrong, reason in self._contradictions():
            if wrong:
                raise InvalidParameterError(f"tail.{name}", reason)

    @property
    def flexible(self) -> bool:
        """Whether the tail bends."""
        return self.segments > 1 or self.modes > 0

    def _contradictions(self) -> tuple[tuple[str, bool, str], ...]:
        """Field, whether it is wrong beside the others, and why."""
        modulus, thickness = self.modulus_pa > 0.0, self.thickness_m > 0.0
        joints = self.joint_stiffness_n_m > 0.0
        stiffness = modulus or thickness or joints
        bends = "a rigid tail (segments 1, modes 0) does not bend: give segments or modes"
        return (
            ("modes", self.segments > 1 and self.modes > 0, "segments or modes, not both"),
            ("thickness_m", modulus and not thickness, "a modulus needs a thickness"),
            ("modulus_pa", thickness and not modulus, "a thickness needs a modulus"),
            ("joint_stiffness_n_m", joints and modulus, "given, and by modulus and thickness, too"),
            (
                "joint_stiffness_n_m",
                joints and self.modes > 0,
                "a beam has no joints: give modulus and thickness",
            ),
            (
                "modulus_pa",
                self.flexible and not stiffness,
                "a flexible tail needs a stiffness: modulus and thickness, or that of its joints",
            ),
            ("modulus_pa", modulus and not self.flexible, bends),
            ("joint_stiffness_n_m", joints and not self.flexible, bends),
            ("damping_s", self.damping_s > 0.0 and not self.flexible, bends),
            ("thickness_profile", bool(self.thickness_profile) and not self.flexible, bends),
        )


@dataclass(frozen=True, slots=True)
class Hydrodynamics(Checked):
    """Drag and lift of the body (3.19–3.21, 3.32, 3.33) and the shares of two model terms.

    ``lift_per_bias``: the surrogate (3.34), which stands in for ``lift`` (then 0): the bias takes
    the place of the angle of attack, whose sign it has (a tail to starboard turns the robot
    clockwise, and the body drifts to port of where it points).
    ``linear_drag_n_s_m``: a force −b V on the body beside the quadratic drag.
    ``body_motion_in_tail``: 1 is (3.13); 0 ignores the body motion in the tail forces (3.30).
    ``munk_coupling``: 1 keeps (Y_v̇ − X_u̇)uv in (3.7); chapter 5 of the source neglects it.
    ``bias_memory_s``: where a servo moves the tail, the bias that the adapted drag depends on is
    the running mean of the tail angle with this time constant (assumed: about two beats; the
    source knows the commanded bias, a body does not).
    """

    SECTION: ClassVar[str] = "hydrodynamics"

    drag: float = number(0.2231, least=0.0, most=1e3)  # C_D, or C′_D0
    drag_per_bias_squared: float = number(0.0, least=-1e3, most=1e3)  # C′_D1, 1/rad²
    lift: float = number(4.50, least=0.0, most=1e3)  # C_L, 1/rad
    lift_per_bias: float = number(0.0, least=0.0, most=1e3)  # C′_L, 1/rad
    yaw_drag_n_m_s2: float = number(11.29e-4, least=0.0, most=1e3)  # K_D, or K′_D0
    yaw_drag_per_bias_n_m_s2: float = number(0.0, least=-1e3, most=1e3)  # K′_D1, per rad
    linear_drag_n_s_m: float = number(0.0, least=0.0, most=1e3)  # b
    body_motion_in_tail: float = number(1.0, least=0.0, most=1.0)
    munk_coupling: float = number(1.0, least=0.0, most=1.0)
    bias_memory_s: float = number(2.0, above=0.0, most=1e3)

    def __post_init__(self) -> None:
        """Check every field, then that no bias within a servo's travel drives the body."""
        Checked.__post_init__(self)
        for name, total in (
            ("drag_per_bias_squared", self.drag + self.drag_per_bias_squared * LARGEST_BIAS_RAD**2),
            (
                "yaw_drag_per_bias_n_m_s2",
                self.yaw_drag_n_m_s2 + self.yaw_drag_per_bias_n_m_s2 * LARGEST_BIAS_RAD,
            ),
        ):
            if total < 0.0:
                raise InvalidParameterError(
                    f"hydrodynamics.{name}",
                    f"makes the drag negative at a bias of {LARGEST_BIAS_RAD:.3g} rad, "
                    f"got {getattr(self, name)!r}",
                )


@dataclass(frozen=True, slots=True)
class Water(Checked):
    """The water: density, and a steady current in the tank frame, uniform or sheared.

    u and v are velocities *through the water*. A uniform current carries everything with it and
    only adds to the motion of the position; this is exact. In a sheared one the current at (x, y)
    is (c_x + s_x y, c_y + s_y x), and the body feels the forces that ``surroundings`` derives.
    """

    SECTION: ClassVar[str] = "water"

    density_kg_m3: float = number(1000.0, above=0.0, most=2e4)
    current_x_m_s: float = number(0.0, least=-10.0, most=10.0)
    current_y_m_s: float = number(0.0, least=-10.0, most=10.0)
    shear_x_per_y_s: float = number(0.0, least=-10.0, most=10.0)  # s_x = ∂U_x/∂y, 1/s
    shear_y_per_x_s: float = number(0.0, least=-10.0, most=10.0)  # s_y = ∂U_y/∂x, 1/s

    @property
    def sheared(self) -> bool:
        """Whether the current differs from place to place."""
        return self.shear_x_per_y_s != 0.0 or self.shear_y_per_x_s != 0.0

    def current_m_s(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Velocity of the undisturbed water at a point of the tank."""
        return (
            self.current_x_m_s + self.shear_x_per_y_s * y_m,
            self.current_y_m_s + self.shear_y_per_x_s * x_m,
        )


@dataclass(frozen=True, slots=True)
class Walls(Checked):
    """What the walls of a tank do; by default nothing, wherever they stand (open water).

    ``drag_rise``: the drag is multiplied by 1 + k exp(−d/0.1 m), d the distance of the body centre
    to the nearest wall. ``stiffness_n_m``: a disc around the body centre, with the hinge distance
    as its radius, meets a frictionless soft wall; 0 lets the robot pass through. The bound keeps
    the contact's own oscillation (√(K/m) ≤ 60/s for the robot of Table 3.1) within any step.
    Positions may be infinite: there is no wall on that side.
    """

    SECTION: ClassVar[str] = "walls"

    drag_rise: float = number(0.0, least=-1.0, most=1e3)
    stiffness_n_m: float = number(0.0, least=0.0, most=1e3)
    x_min_m: float = field(default=-math.inf)
    y_min_m: float = field(default=-math.inf)
    x_max_m: float = field(default=math.inf)
    y_max_m: float = field(default=math.inf)

    def __post_init__(self) -> None:
        """Check every field, then that there is water between the walls."""
        Checked.__post_init__(self)
        for low, high in (("x_min_m", "x_max_m"), ("y_min_m", "y_max_m")):
            if not getattr(self, low) < getattr(self, high):
                raise InvalidParameterError(f"walls.{high}", f"must lie beyond {low}")

    @property
    def acting(self) -> bool:
        """Whether walls do anything."""
        return self.drag_rise != 0.0 or self.stiffness_n_m != 0.0


@dataclass(frozen=True, slots=True)
class Servo(Checked):
    """The HS-5646WP as an actuator; what its electronics do with a pulse is the board's affair.

    Published (Hitec data sheet): 60° in 0.20 s at 6.0 V and 0.18 s at 7.4 V, stall torque 11.3 and
    12.9 kg·cm, idle 4.5 mA, running without load 330 mA, stall 2.1 A, dead band 4 µs.
    Assumed: the position gain k_p and the motor lag τ_m, which make a closed loop of natural
    frequency √(k_p/τ_m) = 55 rad/s, damping 0.91, −3 dB at 6.4 Hz, without overshoot (gains from
    20 to 40/s and lags from 10 to 20 ms change the swimming speed by less than 1.3 %, see
    ``comparison``); ±60° for 900–2100 µs, which makes 4 µs of dead band 0.4° of full width;
    published currents taken at 7.4 V.
    ``ideal``: the tail is exactly where it is told to be.

    What may be wrong with either kind is neutral by default: the command arrives
    ``command_delay_s`` later, behind a first-order lag; ``slowness_s_rad`` is one over the largest
    speed (a real servo keeps its own limit, too); ``extra_dead_band_rad`` is a half width, beside
    a real servo's own.
    """

    SECTION: ClassVar[str] = "servo"

    ideal: bool = False
    command_delay_s: float = number(0.0, least=0.0, most=10.0)
    command_lag_s: float = number(0.0, least=0.0, most=10.0)
    slowness_s_rad: float = number(0.0, least=0.0, most=1e3)
    extra_dead_band_rad: float = number(0.0, least=0.0, most=1.0)
    position_gain_per_s: float = number(30.0, above=0.0, most=1e4)  # k_p
    motor_lag_s: float = number(0.010, above=0.0, most=10.0)  # τ_m
    dead_band_rad: float = number(math.radians(0.2), least=0.0, most=1.0)  # half width
    low_voltage_v: float = number(6.0, above=0.0, most=100.0)
    low_voltage_speed_rad_s: float = number(math.radians(60.0) / 0.20, above=0.0)
    low_voltage_stall_torque_n_m: float = number(11.3 * KG_CM, above=0.0)
    high_voltage_v: float = number(7.4, above=0.0, most=100.0)
    high_voltage_speed_rad_s: float = number(math.radians(60.0) / 0.18, above=0.0)
    high_voltage_stall_torque_n_m: float = number(12.9 * KG_CM, above=0.0)
    least_voltage_v: float = number(4.0, least=0.0, most=100.0)  # electronics stop (assumed)
    idle_current_a: float = number(4.5e-3, least=0.0)
    running_current_a: float = number(0.330, least=0.0)
    stall_current_a: float = number(2.1, above=0.0)

    def __post_init__(self) -> None:
        """Check every field, then the two points of the voltage line against each other."""
        # dataclass(slots=True) makes a new class, which zero-argument super() does not know
        Checked.__post_init__(self)
        if not isinstance(self.ideal, bool):
            raise InvalidParameterError("servo.ideal", f"must be true or false, got {self.ideal!r}")
        check_number(
            "servo.high_voltage_v",
            self.high_voltage_v,
            above=self.low_voltage_v,
            because="two points make the line of speed over voltage",
        )
        check_number("servo.stall_current_a", self.stall_current_a, least=self.running_current_a)

    @property
    def largest_speed_rad_s(self) -> float:
        """What ``slowness_s_rad`` allows whatever the supply; infinite by default."""
        return 1.0 / self.slowness_s_rad if self.slowness_s_rad > 0.0 else math.inf

    @property
    def tracks(self) -> bool:
        """Whether an ideal servo has a state of its own, since it cannot follow at once."""
        return self.ideal and (self.slowness_s_rad > 0.0 or self.extra_dead_band_rad > 0.0)

    def _at(self, volts: float, low: float, high: float) -> float:
        """Linear in supply voltage through both published points; nothing below the least."""
        if volts < self.least_voltage_v:
            return 0.0
        slope = (high - low) / (self.high_voltage_v - self.low_voltage_v)
        return max(0.0, low + slope * (volts - self.low_voltage_v))

    def no_load_speed_rad_s(self, volts: float) -> float:
        """Speed of the motor without load at a supply voltage; 0 without power."""
        return self._at(volts, self.low_voltage_speed_rad_s, self.high_voltage_speed_rad_s)

    def speed_limit_rad_s(self, volts: float) -> float:
        """Largest speed at a supply voltage; 0 where the servo has no power."""
        return min(self.no_load_speed_rad_s(volts), self.largest_speed_rad_s)

    def stall_torque_n_m(self, volts: float) -> float:
        """Largest torque at a supply voltage; 0 where the servo has no power."""
        return self._at(
            volts, self.low_voltage_stall_torque_n_m, self.high_voltage_stall_torque_n_m
        )


@dataclass(frozen=True, slots=True)
class Linkage(Checked):
    """Between servo and tail: α(t) = (1 + g)(1 − k t) θ + δ, θ behind the play, t of the run.

    ``gain_error`` g, ``fade_per_s`` k (the deflection never changes sign: it ends at zero),
    ``offset_rad`` δ, ``play_rad`` the full width of the play.
    """

    SECTION: ClassVar[str] = "linkage"

    gain_error: float = number(0.0, least=-1.0, most=10.0)
    fade_per_s: float = number(0.0, least=-1.0, most=1.0)
    offset_rad: float = number(0.0, least=-math.pi, most=math.pi)
    play_rad: float = number(0.0, least=0.0, most=2.0)


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """One robot in its water. The defaults are the robot of Table 3.1 with its servo.

    ``force``: what none of the other sections explains; none by default.
    """

    body: Body = field(default_factory=Body)
    tail: Tail = field(default_factory=Tail)
    hydrodynamics: Hydrodynamics = field(default_factory=Hydrodynamics)
    water: Water = field(default_factory=Water)
    walls: Walls = field(default_factory=Walls)
    servo: Servo = field(default_factory=Servo)
    linkage: Linkage = field(default_factory=Linkage)
    force: ExtraForce = field(default_factory=ExtraForce)

    def __post_init__(self) -> None:
        """Refuse a section of the wrong kind (each section has checked itself)."""
        for item in fields(self):
            value = getattr(self, item.name)
            if not isinstance(value, item.type if isinstance(item.type, type) else object):
                raise InvalidParameterError(item.name, f"must be a section, got {value!r}")
