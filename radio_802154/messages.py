"""What base station and robots tell each other: one frozen dataclass and one table row each.

Every message is the payload of an active message whose AM type is its number (`tinyos.py`), laid
out big-endian without padding as a TinyOS `nx_struct`, so that a mote programmed in nesC reads it.
All fit TinyOS's default payload of 28 octets. To add a message: a dataclass, a `Layout`, a row with
a new AM type. AM types are never used again for something else.

A command may arrive twice (its acknowledgement was lost and it was sent again): `command_id` tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from radio_802154.errors import LocalFrameError, RemoteFrameError
from spi_bus.errors import FieldError, PayloadError
from spi_bus.layout import I16, TURN_LSB_PER_RAD, U8, U16, U32, Field, Layout, MessageRow

BASE: Final = "base"
ROBOT: Final = "robot"

TOSH_DATA_LENGTH: Final = 28
"""Default longest active-message payload of TinyOS [octets] (tos/types/message.h)."""


@dataclass(frozen=True, slots=True)
class TailBeatCommand:
    """Swim with α(t) = bias + amplitude · sin φ, for `valid_for_s`; 0: until told otherwise."""

    command_id: int
    bias_rad: float
    amplitude_rad: float
    frequency_hz: float
    valid_for_s: float


@dataclass(frozen=True, slots=True)
class TargetCommand:
    """Swim to a place in the tank; the robot steers itself."""

    command_id: int
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the overhead camera saw the robot; heading counter-clockwise from the tank's +x.

    `camera_time_ms` is the base station's clock at the exposure.
    """

    x_m: float
    y_m: float
    heading_rad: float
    camera_time_ms: int


NOBODY: Final = 0xFFFF
"""In place of a robot's address where a batch has none (the broadcast address is no robot's)."""
BATCH: Final = 3
"""Poses a batch has room for."""


@dataclass(frozen=True, slots=True)
class PoseBatch:
    """Where the overhead camera saw several robots at one exposure, for all to hear.

    There is room for three; a robot of 0xFFFF (`NOBODY`) is none, and what follows means nothing.
    """

    camera_time_ms: int
    robot_1: int
    x_1_m: float
    y_1_m: float
    heading_1_rad: float
    robot_2: int = NOBODY
    x_2_m: float = 0.0
    y_2_m: float = 0.0
    heading_2_rad: float = 0.0
    robot_3: int = NOBODY
    x_3_m: float = 0.0
    y_3_m: float = 0.0
    heading_3_rad: float = 0.0

    @classmethod
    def of(cls, poses: Sequence[tuple[int, Pose]]) -> PoseBatch:
        """Make a batch of up to `BATCH` poses of one exposure, each with its robot's address."""
        nobody = NOBODY, Pose(0.0, 0.0, 0.0, 0)
        (a, first), (b, second), (c, third) = (*poses, *[nobody] * (BATCH - len(poses)))
        return cls(
            poses[0][1].camera_time_ms,
            *(a, first.x_m, first.y_m, first.heading_rad),
            *(b, second.x_m, second.y_m, second.heading_rad),
            *(c, third.x_m, third.y_m, third.heading_rad),
        )

    @property
    def poses(self) -> tuple[tuple[int, Pose], ...]:
        """The poses that are in it, each with its robot's address."""
        rows = (
            (self.robot_1, self.x_1_m, self.y_1_m, self.heading_1_rad),
            (self.robot_2, self.x_2_m, self.y_2_m, self.heading_2_rad),
            (self.robot_3, self.x_3_m, self.y_3_m, self.heading_3_rad),
        )
        return tuple(
            (robot, Pose(x, y, heading, self.camera_time_ms))
            for robot, x, y, heading in rows
            if robot != NOBODY
        )


class CommandStatus(IntEnum):
    """What became of a command."""

    ACCEPTED = 0
    """The processing board took it and passes it on."""
    APPLIED = 1
    """The navigation board reported that the tail follows it."""
    REFUSED = 2
    """A value is outside what the robot allows."""
    DUPLICATE = 3
    """The same command was taken before; nothing was done again."""
    UNREACHABLE = 4
    """The navigation board does not answer."""


@dataclass(frozen=True, slots=True)
class CommandReply:
    """What became of a command; `status` is a `CommandStatus`, or a number yet unknown."""

    command_id: int
    status: int


class TelemetryFlag(IntFlag):
    """Conditions of the robot."""

    FAIL_SAFE = 1 << 0
    """The tail is at rest because no command is valid."""
    HEADING_CONTROL = 1 << 1
    """The robot steers itself to a target."""
    TARGET_REACHED = 1 << 2
    """It has come close enough."""
    GPS_FIX = 1 << 3
    """The GPS receiver has a fix."""
    LINK_DOWN = 1 << 4
    """The navigation board does not answer."""
    STORAGE_FULL = 1 << 5
    """The log takes no more samples."""
    RESET = 1 << 6
    """First telemetry since a reset."""


@dataclass(frozen=True, slots=True)
class Telemetry:
    """State of a robot; None where there is nothing valid.

    `time_s` counts from the processing board's reset, by its own clock. `last_command_id` is the
    last command that was applied.
    """

    time_s: float
    sequence: int
    heading_rad: float | None
    gyro_z_rad_s: float | None
    tail_bias_rad: float | None
    battery_v: float | None
    temperature_c: float | None
    water_quality_ug_l: float | None
    samples_stored: int
    samples_lost: int
    last_command_id: int
    flags: int


_COMMAND_ID = Field("command_id", U16, summary="chosen by the base, to tell commands apart")


def _place(axis: str, number: str = "") -> Field:
    return Field(
        f"{axis}{number}_m", I16, "m", 1_000, summary="in the tank; ±32.7 m, by the millimetre"
    )


def _turn(name: str, *, optional: bool = False) -> Field:
    return Field(name, I16, "rad", TURN_LSB_PER_RAD, wraps=True, optional=optional)


TAIL_BEAT_COMMAND: Final = Layout(
    TailBeatCommand,
    (
        _COMMAND_ID,
        Field("bias_rad", I16, "rad", 20_000, -1.6, 1.6, summary="mean tail angle"),
        Field("amplitude_rad", I16, "rad", 20_000, 0.0, 1.6, summary="half the tail's swing"),
        Field("frequency_hz", U16, "Hz", 1_000, 0.0, 20.0, summary="tail beats per second"),
        Field("valid_for_s", U16, "s", 100, summary="then the fail-safe takes over; 0: never"),
    ),
    "big",
)
TARGET_COMMAND: Final = Layout(TargetCommand, (_COMMAND_ID, _place("x"), _place("y")), "big")
POSE: Final = Layout(
    Pose,
    (
        _place("x"),
        _place("y"),
        _turn("heading_rad"),
        Field("camera_time_ms", U32, "ms", summary="wraps after 49 days"),
    ),
    "big",
)
POSE_BATCH: Final = Layout(
    PoseBatch,
    (
        Field("camera_time_ms", U32, "ms", summary="of the exposure; wraps after 49 days"),
        *(
            field
            for number in range(1, BATCH + 1)
            for field in (
                Field(f"robot_{number}", U16, summary="its address; 0xFFFF: none here"),
                _place("x", f"_{number}"),
                _place("y", f"_{number}"),
                _turn(f"heading_{number}_rad"),
            )
        ),
    ),
    "big",
)
COMMAND_REPLY: Final = Layout(
    CommandReply, (_COMMAND_ID, Field("status", U8, summary="see CommandStatus")), "big"
)
TELEMETRY: Final = Layout(
    Telemetry,
    (
        Field("time_s", U32, "s", 1_000, summary="since reset; wraps after 49 days"),
        Field("sequence", U16, summary="counts telemetry, wraps"),
        _turn("heading_rad", optional=True),
        Field("gyro_z_rad_s", I16, "rad/s", 2_000, optional=True, summary="yaw rate, ±16.4"),
        Field("tail_bias_rad", I16, "rad", 20_000, optional=True, summary="commanded, ±1.6"),
        Field("battery_v", U16, "V", 1_000, optional=True, summary="pack voltage"),
        Field("temperature_c", I16, "°C", 100, optional=True, summary="water temperature"),
        Field("water_quality_ug_l", U16, "µg/L", 10, optional=True, summary="oil or chlorophyll"),
        Field("samples_stored", U32, summary="in the log since it was erased"),
        Field("samples_lost", U8, summary="that could not be stored; 255 means more"),
        Field("last_command_id", U16, summary="that was applied"),
        Field("flags", U8, summary="see TelemetryFlag"),
    ),
    "big",
)

AM_MESSAGES: Final = (
    MessageRow(0x10, BASE, TAIL_BEAT_COMMAND, "tail-beat command"),
    MessageRow(0x11, BASE, TARGET_COMMAND, "swim to a place"),
    MessageRow(0x12, BASE, POSE, "what the overhead camera saw"),
    MessageRow(0x13, BASE, POSE_BATCH, "what the overhead camera saw of several robots"),
    MessageRow(0x20, ROBOT, COMMAND_REPLY, "what became of a command"),
    MessageRow(0x21, ROBOT, TELEMETRY, "state of the robot"),
)
"""The messages by AM type (`kind`)."""

_BY_TYPE: Final = {row.kind: row for row in AM_MESSAGES}
_BY_CLASS: Final = {row.layout.message: row for row in AM_MESSAGES}


def encode(message: object, sender: str | None = None) -> tuple[int, bytes]:
    """Return AM type and payload of a message.

    Raises:
        LocalFrameError: no message of the table, not one that `sender` sends, or a value that
            does not fit.

    """
    row = _BY_CLASS.get(type(message))
    if row is None:
        raise LocalFrameError(f"{type(message).__name__} is no radio message")
    if sender is not None and row.sender != sender:
        raise LocalFrameError(f"{type(message).__name__} is sent by the {row.sender} only")
    try:
        return row.kind, row.layout.encode(message)
    except FieldError as error:
        raise LocalFrameError(str(error)) from error


def decode(am_type: int, payload: bytes, sender: str | None = None) -> object:
    """Return the message that an active message holds.

    Raises:
        RemoteFrameError: an unknown AM type, one that `sender` does not send, or wrong contents.

    """
    row = _BY_TYPE.get(am_type)
    if row is None or (sender is not None and row.sender != sender):
        raise RemoteFrameError(f"AM type 0x{am_type:02X} is none that the {sender or 'net'} sends")
    try:
        message: object = row.layout.decode(payload)
    except PayloadError as error:
        raise RemoteFrameError(str(error)) from error
    return message
