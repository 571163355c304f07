"""A joystick as a helm, by Linux's joystick interface: eight octets an event, no package needed.

    u32 time in ms | s16 value | u8 type (1 button, 2 axis, +0x80 at opening) | u8 number

(Linux, Documentation/input/joydev/joystick-api.rst.) Which axis does what is a table, in TOML:

    dead_zone = 0.1
    [axes.bias]          # right is positive
    number = 0
    [axes.frequency]     # forward is negative on most sticks: inverted
    number = 1
    inverted = true
    [buttons]
    stop = 0
    end = 7
    hold = 5             # optional: drives only while this one is held

`frequency` and `amplitude` go from 0 at the dead zone to their bound, `bias` both ways. An axis
`amplitude` is optional; without it the amplitude stays as it is.
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import msgspec

from tools.errors import UserError
from tools.teleop.setpoint import LEFT, Bounds, End, Hold, Input, Stop

EVENT: Final = struct.Struct("=IhBB")
"""struct js_event, in the machine's own order."""
BUTTON: Final = 0x01
AXIS: Final = 0x02
INITIAL: Final = 0x80
FULL: Final = 32_767

Number = Annotated[int, msgspec.Meta(ge=0, le=255)]


@dataclass(frozen=True, slots=True)
class JoystickEvent:
    """An axis or button that has a value now; axes from −1 to 1, buttons 0 or 1."""

    is_axis: bool
    number: int
    value: float
    initial: bool


class Axis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One axis: its number, and whether its sense is turned round."""

    number: Number
    inverted: bool = False


class Axes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which axis is what."""

    bias: Axis = Axis(0)
    frequency: Axis = Axis(1, True)
    amplitude: Axis | None = None


class Buttons(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which button is what."""

    stop: Number | None = 0
    end: Number | None = 7
    hold: Number | None = None


class Mapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table; its defaults fit most gamepads (left stick, first button, start)."""

    dead_zone: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.1
    axes: Axes = Axes()
    buttons: Buttons = Buttons()


def read_mapping(path: Path) -> Mapping:
    """Read a mapping from a TOML file.

    Raises:
        UserError: it is not there, or not as above.

    """
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Mapping)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: {error}") from error


class EventDecoder:
    """Cuts octets, split anywhere, into events."""

    __slots__ = ("_buffer", "unknown")

    def __init__(self) -> None:
        self._buffer = b""
        self.unknown = 0
        """Events of a type that is neither axis nor button."""

    def receive(self, data: bytes) -> list[JoystickEvent]:
        """Return the events that end in these octets."""
        data = self._buffer + data
        whole = len(data) - len(data) % EVENT.size
        self._buffer = data[whole:]
        events = []
        for _time, value, kind, number in EVENT.iter_unpack(data[:whole]):
            initial, kind = bool(kind & INITIAL), kind & ~INITIAL
            if kind == AXIS:
                events.append(JoystickEvent(True, number, max(-1.0, value / FULL), initial))
            elif kind == BUTTON:
                events.append(JoystickEvent(False, number, float(bool(value)), initial))
            else:
                self.unknown += 1
        return events


def beyond_dead_zone(value: float, dead_zone: float) -> float:
    """Return a deflection from −1 to 1 with a dead zone about 0, without a step at its edge."""
    reach = abs(value) - dead_zone
    if reach <= 0.0:
        return 0.0
    return (1.0 if value > 0 else -1.0) * min(1.0, reach / (1.0 - dead_zone))


class Stick:
    """Turns events into inputs by a mapping."""

    def __init__(self, mapping: Mapping, bounds: Bounds) -> None:
        self.mapping = mapping
        self.bounds = bounds
        self._held = mapping.buttons.hold is None
        self._latest: dict[int, float] = {}

    def inputs(self, events: list[JoystickEvent]) -> list[Input]:
        """Return what events do, in order."""
        found: list[Input] = []
        buttons = self.mapping.buttons
        for event in events:
            if event.is_axis:
                self._latest[event.number] = event.value
                if self._held and not event.initial:  # a lever left forward starts nothing
                    found += self._axis(event.number, event.value)
                continue
            pressed = event.value > 0
            if event.number == buttons.hold:
                self._held = pressed
                if pressed:
                    for number, value in self._latest.items():
                        found += self._axis(number, value)
                else:
                    found.append(Stop())
            elif pressed and not event.initial and event.number == buttons.stop:
                found.append(Stop())
            elif pressed and not event.initial and event.number == buttons.end:
                found.append(End(f"button {event.number} was pressed"))
        return found

    def _axis(self, number: int, value: float) -> list[Input]:
        axes, bounds = self.mapping.axes, self.bounds
        found: list[Input] = []
        for name, axis in (
            ("bias", axes.bias), ("frequency", axes.frequency), ("amplitude", axes.amplitude)
        ):  # fmt: skip
            if axis is None or axis.number != number:
                continue
            turned = -value if axis.inverted else value
            reach = beyond_dead_zone(turned, self.mapping.dead_zone)
            if name == "bias":
                found.append(Hold(bias_rad=-LEFT * reach * bounds.bias_rad))
            elif name == "frequency":
                found.append(Hold(frequency_hz=max(0.0, reach) * bounds.frequency_hz))
            else:
                found.append(Hold(amplitude_rad=max(0.0, reach) * bounds.amplitude_rad))
        return found


def open_device(path: str) -> int:
    """Open a joystick; return its descriptor, which does not block.

    Raises:
        UserError: there is none, or it may not be read.

    """
    import os

    try:
        return os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        remedy = "is it plugged in? `ls /dev/input/js*` shows what there is"
        if isinstance(error, PermissionError):
            remedy = "sudo usermod -aG input $USER, and log in again"
        if not sys.platform.startswith("linux"):
            remedy = "this interface is Linux's; use --input keyboard"
        raise UserError(f"--input joystick:{path}: {error.strerror}: {remedy}") from error
