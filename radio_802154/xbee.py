"""XBee modules (802.15.4 firmware) in API mode: frames on the serial line, without clock and port.

    7E | length, big-endian | frame type, fields | checksum: 0xFF less the sum of type and fields

In API mode 2 (AP = 2) the octets 7E, 7D, 11 and 13 after the first are escaped: 7D, then the octet
with bit 0x20 inverted; there 7E is always a frame's start. In mode 1 nothing is escaped and a 7E
may be anything: after a frame that cannot be right the decoder looks for the next 7E *within* it,
so that noise which looks like a start costs no frame that follows, only time; `idle` says that the
line is silent and ends that wait.

The checksum is all there is: eight bits, so that of random damage one frame in 256 passes, fewer
where type and length are checked too. The layouts are a table; a type that is not in it is handed
out as `OtherFrame`. Source: Digi, "XBee/XBee-PRO RF Modules 802.15.4 Product Manual", chapter "API
operation".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum, StrEnum
from typing import Any, Final

from radio_802154.errors import LocalFrameError, RemoteFrameError

BAUD: Final = 9600
"""A module's default (BD = 3)."""

START: Final = 0x7E
ESCAPE: Final = 0x7D
INVERTED: Final = 0x20
_SPECIAL: Final = (0x7D, 0x7E, 0x11, 0x13)  # the escape itself first

MAX_RF_DATA_OCTETS: Final = 100
"""Most RF data of a packet (RO, and the manual's frames 0x00, 0x01, 0x80, 0x81)."""
MAX_FRAME_OCTETS: Final = 256
"""Longest type and fields that is believed (assumed; the longest in the table has 111)."""

BROADCAST_16: Final = 0xFFFF
BROADCAST_64: Final = 0xFFFF


class TxOption(IntEnum):
    """Bits of the options of a request."""

    DISABLE_ACK = 0x01
    BROADCAST_PAN = 0x04


class TxResult(IntEnum):
    """`TxStatus.status`."""

    SUCCESS = 0
    NO_ACK = 1
    CCA_FAILURE = 2
    PURGED = 3


class AtResult(IntEnum):
    """`AtResponse.status`."""

    OK = 0
    ERROR = 1
    INVALID_COMMAND = 2
    INVALID_PARAMETER = 3


@dataclass(frozen=True, slots=True)
class TxRequest64:
    """Send to a 64-bit address; `frame_id` 0 asks for no status."""

    frame_id: int
    destination: int
    options: int
    data: bytes


@dataclass(frozen=True, slots=True)
class TxRequest16:
    """Send to a 16-bit address; `frame_id` 0 asks for no status."""

    frame_id: int
    destination: int
    options: int
    data: bytes


@dataclass(frozen=True, slots=True)
class AtCommand:
    """Set, or without a parameter ask for, a register of the module."""

    frame_id: int
    command: bytes
    parameter: bytes = b""


@dataclass(frozen=True, slots=True)
class AtCommandQueued:
    """As `AtCommand`, in force with the next AC."""

    frame_id: int
    command: bytes
    parameter: bytes = b""


@dataclass(frozen=True, slots=True)
class RxPacket64:
    """Received from a 64-bit address; `rssi` is minus the strength in dBm."""

    source: int
    rssi: int
    options: int
    data: bytes


@dataclass(frozen=True, slots=True)
class RxPacket16:
    """Received from a 16-bit address; `rssi` is minus the strength in dBm."""

    source: int
    rssi: int
    options: int
    data: bytes


@dataclass(frozen=True, slots=True)
class AtResponse:
    """Answer to an `AtCommand`; `status` is an `AtResult`."""

    frame_id: int
    command: bytes
    status: int
    value: bytes = b""


@dataclass(frozen=True, slots=True)
class TxStatus:
    """What became of a request; `status` is a `TxResult`."""

    frame_id: int
    status: int


@dataclass(frozen=True, slots=True)
class ModemStatus:
    """What the module says of itself: 0 hardware reset, 1 watchdog reset, 2 associated."""

    status: int


@dataclass(frozen=True, slots=True)
class OtherFrame:
    """A frame type that the table does not have."""

    kind: int
    data: bytes


ApiFrame = (
    TxRequest64
    | TxRequest16
    | AtCommand
    | AtCommandQueued
    | RxPacket64
    | RxPacket16
    | AtResponse
    | TxStatus
    | ModemStatus
    | OtherFrame
)


@dataclass(frozen=True, slots=True)
class ApiRow:
    """How a frame type travels: fixed fields, and whether a last one takes the rest."""

    kind: int
    frame: type[Any]
    head: struct.Struct
    most_tail: int | None
    """Most octets of the last field; None: there is no such field."""


API_FRAMES: Final = (
    ApiRow(0x00, TxRequest64, struct.Struct(">BQB"), MAX_RF_DATA_OCTETS),
    ApiRow(0x01, TxRequest16, struct.Struct(">BHB"), MAX_RF_DATA_OCTETS),
    ApiRow(0x08, AtCommand, struct.Struct(">B2s"), MAX_FRAME_OCTETS - 4),
    ApiRow(0x09, AtCommandQueued, struct.Struct(">B2s"), MAX_FRAME_OCTETS - 4),
    ApiRow(0x80, RxPacket64, struct.Struct(">QBB"), MAX_RF_DATA_OCTETS),
    ApiRow(0x81, RxPacket16, struct.Struct(">HBB"), MAX_RF_DATA_OCTETS),
    ApiRow(0x88, AtResponse, struct.Struct(">B2sB"), MAX_FRAME_OCTETS - 5),
    ApiRow(0x89, TxStatus, struct.Struct(">BB"), None),
    ApiRow(0x8A, ModemStatus, struct.Struct(">B"), None),
)
"""The frame types of the 802.15.4 firmware that carry data, commands and their outcomes."""

_BY_KIND: Final = {row.kind: row for row in API_FRAMES}
_BY_CLASS: Final = {row.frame: row for row in API_FRAMES}


class XBeeError(StrEnum):
    """What was wrong with received octets."""

    NOISE = "noise"
    """Octets between frames."""
    LENGTH = "length"
    """A length that no frame has."""
    CHECKSUM = "checksum"
    CUT = "cut"
    """A frame that ended before its length said: a new one began, or the line fell silent."""
    LAYOUT = "layout"
    """A right checksum over fields that do not fit the frame type."""


def pack(frame: ApiFrame) -> bytes:
    """Return frame type and fields.

    Raises:
        LocalFrameError: a field does not fit.

    """
    if isinstance(frame, OtherFrame):
        if not 0 <= frame.kind <= 0xFF or frame.kind in _BY_KIND:
            raise LocalFrameError(f"frame type {frame.kind} is no other one")
        content = bytes((frame.kind,)) + frame.data
    else:
        row = _BY_CLASS[type(frame)]
        values = [getattr(frame, item.name) for item in fields(frame)]
        tail = values.pop() if row.most_tail is not None else b""
        for value in values:
            if isinstance(value, bytes) and len(value) != 2:
                raise LocalFrameError(f"AT command {value!r} has not two characters")
        if row.most_tail is not None and len(tail) > row.most_tail:
            raise LocalFrameError(f"{len(tail)} octets of data: at most {row.most_tail} fit")
        try:
            content = bytes((row.kind,)) + row.head.pack(*values) + tail
        except struct.error as error:
            raise LocalFrameError(f"{frame} does not fit its fields: {error}") from None
    if len(content) > MAX_FRAME_OCTETS:
        raise LocalFrameError(f"{len(content)} octets: at most {MAX_FRAME_OCTETS} are a frame")
    return content


def unpack(content: bytes) -> ApiFrame:
    """Read frame type and fields, length and checksum already taken off.

    Raises:
        RemoteFrameError: they do not fit the type's layout.

    """
    if not content:
        raise RemoteFrameError("a frame without its type")
    row = _BY_KIND.get(content[0])
    if row is None:
        return OtherFrame(content[0], content[1:])
    end = 1 + row.head.size
    tail = content[end:]
    most = row.most_tail or 0
    if len(content) < end or len(tail) > most:
        name = row.frame.__name__
        raise RemoteFrameError(f"{name} of {len(content)} octets: {end} to {end + most}")
    values = row.head.unpack_from(content, 1)
    frame: ApiFrame = row.frame(*values, *([] if row.most_tail is None else [tail]))
    return frame


def encode(frame: ApiFrame, *, escaped: bool) -> bytes:
    """Return the octets for the line, in API mode 2 (`escaped`) or 1.

    Raises:
        LocalFrameError: a field does not fit.

    """
    content = pack(frame)
    octets = len(content).to_bytes(2, "big") + content + bytes((checksum(content),))
    if escaped:
        for special in _SPECIAL:
            octets = octets.replace(bytes((special,)), bytes((ESCAPE, special ^ INVERTED)))
    return bytes((START,)) + octets


def checksum(content: bytes) -> int:
    """Return the octet that makes the sum of frame type, fields and itself 0xFF."""
    return 0xFF - (sum(content) & 0xFF)


class Decoder:
    """Cuts any octet stream, split anywhere, into frames with a right checksum.

    Args:
        escaped: API mode 2; else mode 1.

    `errors` counts by kind what was thrown away.

    """

    __slots__ = ("_buffer", "_escape", "_escaped", "error_count", "errors")

    def __init__(self, *, escaped: bool) -> None:
        self._escaped = escaped
        self._buffer = bytearray()  # from a 7E on, escapes taken out
        self._escape = False
        self.errors: dict[XBeeError, int] = dict.fromkeys(XBeeError, 0)
        self.error_count = 0

    @property
    def buffered(self) -> int:
        """Octets kept of a frame that has not ended."""
        return len(self._buffer)

    def receive(self, data: bytes) -> list[ApiFrame]:
        """Return all good frames that end in these octets."""
        return self._receive_escaped(data) if self._escaped else self._receive_plain(data)

    def idle(self) -> list[ApiFrame]:
        """Say that the line has been silent for longer than within a frame.

        What was begun will not be finished. In mode 1 frames may be hidden in it: they are
        returned.
        """
        frames: list[ApiFrame] = []
        self._escape = False
        while self._buffer:
            self._count(XBeeError.CUT)
            self._restart()
            frames += self._scan()
        return frames

    def _receive_plain(self, data: bytes) -> list[ApiFrame]:
        frames = []
        for start in range(0, len(data), MAX_FRAME_OCTETS):  # so that the buffer stays small
            self._buffer += data[start : start + MAX_FRAME_OCTETS]
            frames += self._scan()
        return frames

    def _scan(self) -> list[ApiFrame]:
        """Take complete frames from the front of the buffer."""
        frames = []
        buffer = self._buffer
        while buffer:
            if buffer[0] != START:
                self._count(XBeeError.NOISE)
                self._restart()
                continue
            length = self._length()
            if length is None:
                break
            if not length:
                self._count(XBeeError.LENGTH)
                self._restart()
                continue
            if len(buffer) < length + 4:
                break
            frame = self._finish(length)
            if frame is None:
                self._restart()
            else:
                del buffer[: length + 4]
                frames.append(frame)
        return frames

    def _receive_escaped(self, data: bytes) -> list[ApiFrame]:
        frames = []
        first, *others = data.split(b"\x7e")
        frames += self._piece(first)
        for piece in others:
            if self._buffer:
                self._count(XBeeError.CUT)
            self._buffer[:] = b"\x7e"
            self._escape = False
            frames += self._piece(piece)
        return frames

    def _piece(self, piece: bytes) -> list[ApiFrame]:
        """Octets without a start, which go on with the frame in the buffer."""
        buffer = self._buffer
        for position, octet in enumerate(piece):
            if not buffer:
                self._count(XBeeError.NOISE)
                break  # as one, to the next start
            if self._escape:
                self._escape = False
                buffer.append(octet ^ INVERTED)
            elif octet == ESCAPE:
                self._escape = True
                continue
            else:
                buffer.append(octet)
            length = self._length()
            if length is None:
                continue
            if not length:
                self._count(XBeeError.LENGTH)
                buffer.clear()
                break
            if len(buffer) == length + 4:
                frame = self._finish(length)
                buffer.clear()
                rest = position + 1 < len(piece)
                if rest:
                    self._count(XBeeError.NOISE)
                return [] if frame is None else [frame]
        return []

    def _length(self) -> int | None:
        """Length that the buffer's frame says; 0 where it cannot be, None where it is not there."""
        if len(self._buffer) < 3:
            return None
        length = self._buffer[1] << 8 | self._buffer[2]
        return length if length <= MAX_FRAME_OCTETS else 0

    def _finish(self, length: int) -> ApiFrame | None:
        content = bytes(self._buffer[3 : 3 + length])
        if checksum(content) != self._buffer[3 + length]:
            self._count(XBeeError.CHECKSUM)
            return None
        try:
            return unpack(content)
        except RemoteFrameError:
            self._count(XBeeError.LAYOUT)
            return None

    def _restart(self) -> None:
        """Drop the front of the buffer up to its next start."""
        found = self._buffer.find(START, 1)
        del self._buffer[: found if found > 0 else len(self._buffer)]

    def _count(self, kind: XBeeError) -> None:
        self.errors[kind] += 1
        self.error_count += 1
