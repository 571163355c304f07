"""What can be chosen about a navigation board, and what it looks at."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_model.dspic30f.mcu import DspicConfig
from firmware_model.signals import Quantity, constant
from navboard.chips.gps18x import Gps18xConfig
from navboard.chips.hs5646wp import Hs5646wpSpecs
from navboard.errors import ConfigurationError
from navboard.heading import HeadingTuning
from navboard.motion import MotionLimits

_ZERO = constant(0.0)


@dataclass(frozen=True, slots=True)
class NavInputs:
    """The physical world of the board: quantities as functions of time in femtoseconds."""

    gyro_z_rad_s: Quantity = _ZERO
    """Yaw rate, counter-clockwise positive."""
    accel_x_m_s2: Quantity = _ZERO
    """Specific force forward, in body axes."""
    accel_y_m_s2: Quantity = _ZERO
    """Specific force to the left."""
    accel_z_m_s2: Quantity = field(default_factory=lambda: constant(9.80665))
    """Specific force upward; +g for a fish that swims level."""
    heading_rad: Quantity = _ZERO
    """Heading ψ, counter-clockwise from the tank's +x: the compass looks at it."""
    x_m: Quantity = _ZERO
    y_m: Quantity = _ZERO
    temperature_c: Quantity = field(default_factory=lambda: constant(20.0))
    battery_v: Quantity = field(default_factory=lambda: constant(7.4))
    servo_current_a: Quantity = _ZERO
    water_quality_ug_l: Quantity = _ZERO
    tail_angle_rad: Quantity = _ZERO


@dataclass(frozen=True, slots=True)
class NavConfig:
    """Hardware options, firmware settings and imperfections of one board."""

    name: str = "nav"
    mcu: DspicConfig = field(default_factory=DspicConfig)
    control_hz: float = 50.0
    """Control tick: ADC scan, tail beat, filter."""
    report_period_s: float = 0.1
    """Period of sensor reports until a `SetReporting` changes it; 0: none."""
    fail_safe_s: float = 3.0
    """How long a command holds that names no validity of its own (0)."""
    north_rad: float = 0.0
    """Direction of magnetic and true north in the tank: the world's, and the firmware's setting."""
    limits: MotionLimits = field(default_factory=MotionLimits)
    heading: HeadingTuning = field(default_factory=HeadingTuning)
    servo: Hs5646wpSpecs = field(default_factory=Hs5646wpSpecs)
    gyro_bias_rad_s: float | None = None
    gyro_noise_scale: float = 1.0
    hard_iron_t: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Hard iron of the hull, tesla, in body axes."""
    hard_iron_calibration_t: tuple[float, float] = (0.0, 0.0)
    """What the firmware takes off the magnetometer's x and y."""
    compass_noise_scale: float = 1.0
    gps: Gps18xConfig | None = None
    """None: no GPS is fitted."""
    water_probe_fitted: bool = True
    water_probe_noise_scale: float = 1.0
    tail_potentiometer_fitted: bool = False
    tail_potentiometer_noise_rad: float = 0.003

    def __post_init__(self) -> None:
        if not 10.0 <= self.control_hz <= 200.0:
            raise ConfigurationError(f"control_hz = {self.control_hz} is outside 10 to 200")
        if self.report_period_s < 0.0 or self.fail_safe_s <= 0.0:
            raise ConfigurationError("report_period_s and fail_safe_s must not be negative")
