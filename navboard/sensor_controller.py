"""Sensor controller: what is measured when, in SI, filtered, time-stamped and handed over.

At every control tick the analog scan is converted and the gyro carries the heading on. The
accelerometer is due 25 times a second and the magnetometer 15 times, spread over the ticks by an
accumulator; GPS comes when it comes. A sample has a value where an instrument gave a new one at
this tick and None elsewhere; a report has the latest value of each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from navboard import costs
from navboard.chips.gps18x import Gps18xConfig, metres_per_degree
from navboard.config import NavConfig
from navboard.drivers.adc_scan import AdcScan
from navboard.drivers.gps18x import Fix
from navboard.heading import HeadingFilter, wrap
from navboard.motion import ONE_RAD, TailBeatGenerator
from navboard.sensors import AnalogSensor
from spi_bus.messages import GpsReport, SensorReport

ACCELEROMETER_HZ = 25
MAGNETOMETER_HZ = 15

SAMPLE_CHANNELS = (
    "tail_bias_rad",
    "tail_amplitude_rad",
    "tail_frequency_hz",
    "tail_command_rad",
    "gyro_z_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "compass_rad",
    "heading_estimate_rad",
    "gps_x_m",
    "gps_y_m",
    "tail_angle_rad",
    "battery_v",
    "servo_current_a",
    "temperature_c",
    "water_quality_ug_l",
)
"""Names of the values of a `Sample`, in order; those of channels.csv where that has them."""

Sample: TypeAlias = tuple["float | None", ...]
OnSample: TypeAlias = Callable[[int, Sample], None]
"""Takes the time in femtoseconds and a sample, once a control tick."""


class SensorController:
    """Holds the latest value of every channel and the heading filter."""

    def __init__(self, config: NavConfig, sensors: tuple[AnalogSensor, ...], scan: AdcScan) -> None:
        self.filter = HeadingFilter(config.heading)
        self.latest: dict[str, float | None] = {}
        self.sequence = 0
        self.accelerometer_due = False
        self.magnetometer_due = False
        self._north_rad = config.north_rad
        self._dt_s = 1.0 / config.control_hz
        self._hz = config.control_hz
        self._accelerometer_phase = 0.0
        self._magnetometer_phase = 0.0
        self._scan = scan
        self._analog = tuple(  # by the kind of scan: without the slow inputs, and with them
            tuple(
                (sensor.name, sensor.convert, tuple(buffers[c] for c in sensor.channels))
                for sensor in sensors
                if whole or not sensor.slow
            )
            for whole, buffers in ((False, scan.buffers(False)), (True, scan.buffers(True)))
        )
        self._acceleration: tuple[float, float, float] | None = None
        self._compass_rad: float | None = None
        self._position: tuple[float, float] | None = None
        self._gps = config.gps and replace(config.gps, north_rad=config.north_rad)
        self._tick_cycles = tuple(
            costs.FILTER_PREDICT + costs.ANALOG_CHANNEL * sum(len(row[2]) for row in rows)
            for rows in self._analog
        )

    @property
    def tick_cycles(self) -> int:
        """What the latest tick costs."""
        return self._tick_cycles[self._scan.whole]

    # --- what comes from other tasks ----------------------------------------------------

    def acceleration(self, xyz_m_s2: tuple[float, float, float]) -> None:
        """Take a reading of the accelerometer."""
        self._acceleration = xyz_m_s2
        latest = self.latest
        latest["accel_x_m_s2"], latest["accel_y_m_s2"], latest["accel_z_m_s2"] = xyz_m_s2

    def magnetic_heading(self, from_north_rad: float) -> None:
        """Take a reading of the compass and correct the filter."""
        self._compass_rad = self.latest["compass_rad"] = compass = wrap(
            from_north_rad + self._north_rad
        )
        self.filter.compass(compass)

    def fix(self, fix: Fix) -> None:
        """Take a GPS fix; its course corrects the filter when the robot is fast enough."""
        if fix.latitude_deg is None or fix.longitude_deg is None or self._gps is None:
            return
        self._position = local_position(self._gps, fix.latitude_deg, fix.longitude_deg)
        if fix.course_rad is not None and fix.speed_m_s is not None:
            self.filter.course(wrap(self._north_rad - fix.course_rad), fix.speed_m_s)

    # --- the control tick ---------------------------------------------------------------

    def tick(self, motion: TailBeatGenerator) -> Sample:
        """Convert the scan, predict, and return this tick's sample."""
        latest = self.latest
        whole = self._scan.whole
        for name, convert, buffers in self._analog[whole]:
            latest[name] = convert(*[buffer.value for buffer in buffers])
        rate = latest["gyro_z_rad_s"]
        assert rate is not None
        self.filter.predict(rate, self._dt_s)
        self._plan()
        acceleration = self._acceleration or (None, None, None)
        position = self._position or (None, None)
        compass = self._compass_rad
        self._acceleration = self._compass_rad = self._position = None
        get = latest.get
        latest["tail_command_rad"] = command = motion.alpha / ONE_RAD
        return (
            motion.bias / ONE_RAD,
            motion.amplitude / ONE_RAD,
            motion.frequency_hz,
            command,
            rate,
            *acceleration,
            compass,
            self.filter.heading_rad,
            *position,
            get("tail_angle_rad"),
            latest["battery_v"] if whole else None,
            latest["servo_current_a"],
            latest["temperature_c"] if whole else None,
            get("water_quality_ug_l") if whole else None,
        )

    def _plan(self) -> None:
        self._accelerometer_phase += ACCELEROMETER_HZ
        if self._accelerometer_phase >= self._hz:
            self._accelerometer_phase = max(0.0, self._accelerometer_phase - self._hz)
            self.accelerometer_due = True
        self._magnetometer_phase += MAGNETOMETER_HZ
        if self._magnetometer_phase >= self._hz:
            self._magnetometer_phase = max(0.0, self._magnetometer_phase - self._hz)
            self.magnetometer_due = True

    # --- reports ------------------------------------------------------------------------

    def report(self, now_us: int) -> SensorReport:
        """Return the latest of everything."""
        get = self.latest.get
        self.sequence = (self.sequence + 1) & 0xFFFF
        return SensorReport(
            time_us=now_us,
            sequence=self.sequence,
            gyro_z_rad_s=get("gyro_z_rad_s"),
            accel_x_m_s2=get("accel_x_m_s2"),
            accel_y_m_s2=get("accel_y_m_s2"),
            accel_z_m_s2=get("accel_z_m_s2"),
            compass_rad=get("compass_rad"),
            heading_rad=self.filter.heading_rad,
            tail_command_rad=get("tail_command_rad"),
            battery_v=_not_negative(get("battery_v")),
            servo_current_a=get("servo_current_a"),
            temperature_c=get("temperature_c"),
            water_quality_ug_l=get("water_quality_ug_l"),
        )


def gps_report(fix: Fix, time_us: int) -> GpsReport:
    """Return the message for a fix."""
    return GpsReport(
        time_us=time_us,
        latitude_deg=fix.latitude_deg,
        longitude_deg=fix.longitude_deg,
        speed_m_s=fix.speed_m_s,
        course_rad=fix.course_rad,
        fix_time_s=fix.utc_s,
        satellites=fix.satellites,
    )


def local_position(
    reference: Gps18xConfig, latitude_deg: float, longitude_deg: float
) -> tuple[float, float]:
    """Return x, y in the tank of a position, on the plane that touches at the reference point."""
    scale = metres_per_degree(reference.latitude_deg)
    north = (latitude_deg - reference.latitude_deg) * scale[0]
    east_deg = longitude_deg - reference.longitude_deg
    if abs(east_deg) > 180.0:  # the reference lies on the other side of the date line
        east_deg -= math.copysign(360.0, east_deg)
    east = east_deg * scale[1]
    cos, sin = math.cos(reference.north_rad), math.sin(reference.north_rad)
    return north * cos + east * sin, north * sin - east * cos


def _not_negative(value: float | None) -> float | None:
    return None if value is None else max(0.0, value)
