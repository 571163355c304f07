"""The messages between the two boards: one frozen dataclass and one table row each.

The processing board is the SPI master, the navigation board the slave. Little-endian, as both
MCUs are. Ranges are wider than any instrument's, so that a saturated sensor still fits; angles that
come from estimators wrap. To add a message: a dataclass, a `Layout`, a row with a new number.
Numbers are never used again for something else.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from spi_bus.layout import (
    I16,
    I32,
    TURN_LSB_PER_RAD,
    U8,
    U16,
    U32,
    U48,
    Field,
    Layout,
    MessageRow,
    MessageTable,
)

__all__ = [
    "LINK_MESSAGES",
    "MASTER",
    "SLAVE",
    "BoardEvent",
    "BoardEventCode",
    "ClockReport",
    "ClockRequest",
    "CommandApplied",
    "GpsReport",
    "Ping",
    "Pong",
    "SensorReport",
    "SetReporting",
    "TailBeat",
]

MASTER: Final = "master"
SLAVE: Final = "slave"


@dataclass(frozen=True, slots=True)
class TailBeat:
    """Swim with α(t) = bias + amplitude · sin φ, for `valid_for_s` or until told otherwise."""

    command_id: int
    bias_rad: float
    amplitude_rad: float
    frequency_hz: float
    valid_for_s: float


@dataclass(frozen=True, slots=True)
class SetReporting:
    """How often the navigation board reports, and whether GPS fixes are forwarded."""

    period_s: float
    gps_enabled: bool


@dataclass(frozen=True, slots=True)
class Ping:
    """Asks for a `Pong` with the same token: measures the round trip through both applications."""

    token: int


@dataclass(frozen=True, slots=True)
class Pong:
    """Answers a `Ping`."""

    token: int


@dataclass(frozen=True, slots=True)
class ClockRequest:
    """Asks for a `ClockReport` with the same token: the navigation board's `Ping`.

    Firmware that does not know it acknowledges it and goes on.
    """

    token: int


@dataclass(frozen=True, slots=True)
class ClockReport:
    """Answers a `ClockRequest`: the processing board's clock, which its other messages lack.

    `time_us` counts from the processing board's reset, by its own clock, when this was queued.
    """

    token: int
    time_us: int


@dataclass(frozen=True, slots=True)
class SensorReport:
    """One filtered sample of every instrument; None where an instrument gave nothing valid.

    `time_us` counts from the navigation board's reset, by its own clock. Angles are in [-π, π).
    """

    time_us: int
    sequence: int
    gyro_z_rad_s: float | None
    accel_x_m_s2: float | None
    accel_y_m_s2: float | None
    accel_z_m_s2: float | None
    compass_rad: float | None
    heading_rad: float | None
    tail_command_rad: float | None
    battery_v: float | None
    servo_current_a: float | None
    temperature_c: float | None
    water_quality_ug_l: float | None


@dataclass(frozen=True, slots=True)
class GpsReport:
    """One RMC/GGA pair of the GPS receiver; position and motion are None without a fix.

    `time_us` is the navigation board's clock at the PPS edge, or at the sentence where there is
    none; `fix_time_s` the UTC time of day that the fix belongs to. `course_rad` is clockwise from
    true north, in [-π, π).
    """

    time_us: int
    latitude_deg: float | None
    longitude_deg: float | None
    speed_m_s: float | None
    course_rad: float | None
    fix_time_s: float | None
    satellites: int


@dataclass(frozen=True, slots=True)
class CommandApplied:
    """The tail-beat command is what the servo follows since `time_us`."""

    command_id: int
    time_us: int


class BoardEventCode(IntEnum):
    """What a `BoardEvent` reports; `detail` says more."""

    RESET = 1
    """The board started; detail: the reset cause register (RCON)."""
    FAIL_SAFE_ON = 2
    """No valid command any more, the tail goes to rest; detail: the last command id."""
    FAIL_SAFE_OFF = 3
    """A command ended the fail-safe; detail: its id."""
    OVERRUN = 4
    """The SPI receiver lost bytes; detail: how often since the last report."""
    QUEUE_FULL = 5
    """Reports were not sent because the link was full; detail: how many."""
    SENSOR_FAULT = 6
    """An instrument stopped answering; detail: its number in the sensor table."""


@dataclass(frozen=True, slots=True)
class BoardEvent:
    """Something happened on the navigation board.

    `code` is a `BoardEventCode`, or a number that a newer firmware knows.
    """

    time_us: int
    code: int
    detail: int


_TIME = Field("time_us", U48, "µs", summary="since reset; wraps after 8.9 years")
_COMMAND_ID = Field("command_id", U16, summary="chosen by the sender, to tell commands apart")


def _turn(name: str, summary: str) -> Field:
    return Field(name, I16, "rad", TURN_LSB_PER_RAD, wraps=True, optional=True, summary=summary)


def _acceleration(axis: str) -> Field:
    return Field(
        f"accel_{axis}_m_s2", I16, "m/s²", 200, optional=True, summary=f"body axis {axis}"
    )  # ±163 m/s²: twice the ±8 g of an LSM303DLH; 5 mm/s² is half its 1 mg LSB


TAIL_BEAT: Final = Layout(
    TailBeat,
    (
        _COMMAND_ID,
        Field("bias_rad", I16, "rad", 20_000, -1.6, 1.6, summary="mean tail angle"),
        Field("amplitude_rad", I16, "rad", 20_000, 0.0, 1.6, summary="half the tail's swing"),
        Field("frequency_hz", U16, "Hz", 1_000, 0.0, 20.0, summary="tail beats per second"),
        Field("valid_for_s", U16, "s", 100, summary="after this the fail-safe takes over"),
    ),
)
SET_REPORTING: Final = Layout(
    SetReporting,
    (
        Field("period_s", U16, "s", 1_000, summary="between sensor reports; 0 stops them"),
        Field("gps_enabled", U8, boolean=True, summary="forward GPS fixes"),
    ),
)
PING: Final = Layout(Ping, (Field("token", U16, summary="comes back in the Pong"),))
PONG: Final = Layout(Pong, (Field("token", U16, summary="of the Ping"),))
CLOCK_REQUEST: Final = Layout(
    ClockRequest, (Field("token", U16, summary="comes back in the ClockReport"),)
)
CLOCK_REPORT: Final = Layout(
    ClockReport, (Field("token", U16, summary="of the ClockRequest"), _TIME)
)
SENSOR_REPORT: Final = Layout(
    SensorReport,
    (
        _TIME,
        Field("sequence", U16, summary="counts reports, wraps"),
        Field("gyro_z_rad_s", I16, "rad/s", 2_000, optional=True, summary="yaw rate, ±16.4"),
        _acceleration("x"),
        _acceleration("y"),
        _acceleration("z"),
        _turn("compass_rad", "magnetic heading, counter-clockwise from the tank's +x"),
        _turn("heading_rad", "filtered heading, same sense"),
        Field("tail_command_rad", I16, "rad", 10_000, optional=True, summary="α(t) now"),
        Field("battery_v", U16, "V", 1_000, optional=True, summary="pack voltage"),
        Field("servo_current_a", I16, "A", 1_000, optional=True, summary="servo supply"),
        Field("temperature_c", I16, "°C", 100, optional=True, summary="water temperature"),
        Field("water_quality_ug_l", U16, "µg/L", 10, optional=True, summary="oil or chlorophyll"),
    ),
)
GPS_REPORT: Final = Layout(
    GpsReport,
    (
        _TIME,
        Field("latitude_deg", I32, "°", 10_000_000, -90, 90, optional=True, summary="WGS 84"),
        Field("longitude_deg", I32, "°", 10_000_000, -180, 180, optional=True, summary="east"),
        Field("speed_m_s", U16, "m/s", 100, optional=True, summary="over ground"),
        _turn("course_rad", "over ground, clockwise from true north"),
        Field("fix_time_s", U32, "s", 1_000, 0.0, 86_401.0, optional=True, summary="UTC of day"),
        Field("satellites", U8, summary="used in the fix"),
    ),
)
COMMAND_APPLIED: Final = Layout(CommandApplied, (_COMMAND_ID, _TIME))
BOARD_EVENT: Final = Layout(
    BoardEvent,
    (
        _TIME,
        Field("code", U8, summary="see BoardEventCode"),
        Field("detail", U16, summary="depends on the code"),
    ),
)

LINK_MESSAGES: Final = MessageTable(
    (
        MessageRow(0x01, MASTER, TAIL_BEAT, "tail-beat command"),
        MessageRow(0x02, MASTER, SET_REPORTING, "what is reported how often"),
        MessageRow(0x03, MASTER, PING, "round-trip probe"),
        MessageRow(0x04, MASTER, CLOCK_REPORT, "the processing board's clock"),
        MessageRow(0x81, SLAVE, SENSOR_REPORT, "all instruments once"),
        MessageRow(0x82, SLAVE, GPS_REPORT, "a GPS fix"),
        MessageRow(0x83, SLAVE, COMMAND_APPLIED, "a command took effect"),
        MessageRow(0x84, SLAVE, BOARD_EVENT, "resets, fail-safe, overruns"),
        MessageRow(0x85, SLAVE, PONG, "answer to a Ping"),
        MessageRow(0x86, SLAVE, CLOCK_REQUEST, "asks for the processing board's clock"),
    )
)
