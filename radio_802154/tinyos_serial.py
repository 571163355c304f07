"""The TinyOS serial protocol (TEP 113): frames between a host and a mote, without clock and port.

    7E | type | sequence (not with 45) | dispatch, body (not with 43) | CRC, low octet first | 7E

Framing is HDLC's (RFC 1662): 7E delimits, 7D escapes, the octet after it has bit 0x20 inverted. The
CRC is CRC-16/XMODEM (0x1021 from zero; check value 0x31C3) over everything from the type on, before
escaping. TEP 113's text and TinyOS 2.1's code differ in the type numbers and in what the CRC
covers; motes run the code, so this is the code's form, as the TinyOS wiki ("Serial/HDLC") has it:
0x44 data to be acknowledged, 0x45 data, 0x43 acknowledgement.

A body with dispatch 0 is an active message: destination and source (big-endian), length, group, AM
type, payload. The decoder cuts at 7E only, so one good delimiter puts it in step whatever came
before; it keeps at most one frame, never raises, and counts what it throws away by kind.
`serial_link.py` has acknowledgements and retransmission.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

import crcmod

from radio_802154.errors import LocalFrameError, RemoteFrameError

BAUD: Final = 115_200
"""Of a TelosB's USB."""

FLAG: Final = 0x7E
ESCAPE: Final = 0x7D
INVERTED: Final = 0x20
CRC_OCTETS: Final = 2

AM_DISPATCH: Final = 0
"""SERIAL_TOS_SERIAL_ACTIVE_MESSAGE_ID: the body is an active message."""

_AM_HEADER: Final = struct.Struct(">HHBBB")  # destination, source, length, group, AM type
MAX_BODY_OCTETS: Final = _AM_HEADER.size + 255
"""Longest body: an active message whose length octet is full."""
MAX_FRAME_OCTETS: Final = 3 + MAX_BODY_OCTETS + CRC_OCTETS
"""Type, sequence, dispatch, body, CRC."""
_MIN_FRAME_OCTETS: Final = 2 + CRC_OCTETS

crc16: Final[Callable[[bytes], int]] = crcmod.mkCrcFun(0x11021, initCrc=0, rev=False, xorOut=0)
"""CRC-16/XMODEM."""

_ESCAPED: Final = bytes((ESCAPE,))


class PacketType(IntEnum):
    """The first octet of a frame."""

    ACK = 0x43
    DATA_ACK = 0x44
    """Data that the other side acknowledges."""
    DATA = 0x45
    """Data, best effort; without a sequence number."""


class SerialError(StrEnum):
    """What was wrong with received octets."""

    SHORT = "short"
    OVERSIZE = "oversize"
    ESCAPE = "escape"
    """A frame that ends within an escape: RFC 1662's way of breaking one off."""
    CRC = "crc"
    TYPE = "type"


@dataclass(frozen=True, slots=True)
class SerialPacket:
    """One frame of the line; `sequence` is None with DATA, `dispatch` with ACK."""

    kind: PacketType
    sequence: int | None = None
    dispatch: int | None = None
    body: bytes = b""


@dataclass(frozen=True, slots=True)
class AmMessage:
    """An active message as it stands in a serial packet (message_header of the serial stack)."""

    destination: int
    am_type: int
    payload: bytes = b""
    source: int = 0
    group: int = 0x22


def encode(packet: SerialPacket) -> bytes:
    """Return the frame as it goes onto the line, both delimiters included.

    Raises:
        LocalFrameError: a field does not fit, is missing, or does not belong to this type.

    """
    out = bytearray((packet.kind,))
    if (packet.sequence is None) != (packet.kind is PacketType.DATA):
        raise LocalFrameError(f"{packet.kind.name}: all but DATA have a sequence number")
    if (packet.dispatch is None) != (packet.kind is PacketType.ACK):
        raise LocalFrameError(f"{packet.kind.name}: all but ACK have a dispatch octet")
    if packet.kind is PacketType.ACK and packet.body:
        raise LocalFrameError("an acknowledgement has no body")
    if len(packet.body) > MAX_BODY_OCTETS:
        raise LocalFrameError(f"{len(packet.body)} octets: at most {MAX_BODY_OCTETS} fit")
    for number in (packet.sequence, packet.dispatch):
        if number is not None:
            if not 0 <= number <= 0xFF:
                raise LocalFrameError(f"{number} does not fit an octet")
            out.append(number)
    out += packet.body
    out += crc16(bytes(out)).to_bytes(CRC_OCTETS, "little")
    flag = bytes((FLAG,))
    return flag + _stuff(bytes(out)) + flag


def _stuff(octets: bytes) -> bytes:
    escape = octets.replace(_ESCAPED, b"\x7d\x5d")
    return escape.replace(b"\x7e", b"\x7d\x5e")


def encode_am(message: AmMessage) -> bytes:
    """Return the body of an active message, for dispatch 0.

    Raises:
        LocalFrameError: a field does not fit.

    """
    try:
        header = _AM_HEADER.pack(
            message.destination,
            message.source,
            len(message.payload),
            message.group,
            message.am_type,
        )
    except struct.error as error:
        raise LocalFrameError(f"{message} does not fit its fields: {error}") from None
    return header + message.payload


def decode_am(body: bytes) -> AmMessage:
    """Read an active message from the body of a packet with dispatch 0.

    Raises:
        RemoteFrameError: shorter than a header, or another length than it says.

    """
    if len(body) < _AM_HEADER.size:
        raise RemoteFrameError(f"active message of {len(body)} octets: shorter than its header")
    destination, source, length, group, am_type = _AM_HEADER.unpack_from(body)
    payload = bytes(body[_AM_HEADER.size :])
    if len(payload) != length:
        raise RemoteFrameError(f"active message says {length} octets and has {len(payload)}")
    return AmMessage(destination, am_type, payload, source, group)


class Decoder:
    """Cuts any octet stream, split anywhere, into intact packets.

    `errors` counts by kind what was thrown away.
    """

    __slots__ = ("_oversize", "_partial", "error_count", "errors")

    def __init__(self) -> None:
        self._partial = bytearray()  # since the last delimiter, still escaped
        self._oversize = False
        self.errors: dict[SerialError, int] = dict.fromkeys(SerialError, 0)
        self.error_count = 0

    @property
    def buffered(self) -> int:
        """Octets kept of a frame that has not ended."""
        return len(self._partial)

    def receive(self, data: bytes) -> list[SerialPacket]:
        """Return the packets of all good frames that end in these octets."""
        packets = []
        *ended, rest = data.split(b"\x7e")
        for piece in ended:
            self._keep(piece)
            frame = bytes(self._partial)
            self._partial.clear()
            if self._oversize:
                self._oversize = False
            elif frame:  # nothing between two delimiters is filler
                packet = self._frame(frame)
                if packet is not None:
                    packets.append(packet)
        self._keep(rest)
        return packets

    def reset(self) -> None:
        """Forget a frame half received."""
        self._partial.clear()
        self._oversize = False

    def _keep(self, piece: bytes) -> None:
        if self._oversize:
            return
        if len(self._partial) + len(piece) > 2 * MAX_FRAME_OCTETS:  # if every octet is escaped
            self._partial.clear()
            self._oversize = True
            self._count(SerialError.OVERSIZE)
        else:
            self._partial += piece

    def _frame(self, escaped: bytes) -> SerialPacket | None:
        octets = unstuff(escaped)
        if octets is None:
            kind = SerialError.ESCAPE
        elif len(octets) < _MIN_FRAME_OCTETS:
            kind = SerialError.SHORT
        elif len(octets) > MAX_FRAME_OCTETS:
            kind = SerialError.OVERSIZE
        elif crc16(octets[:-CRC_OCTETS]) != int.from_bytes(octets[-CRC_OCTETS:], "little"):
            kind = SerialError.CRC
        else:
            packet = parse(octets[:-CRC_OCTETS])
            if packet is not None:
                return packet
            kind = SerialError.TYPE
        self._count(kind)
        return None

    def _count(self, kind: SerialError) -> None:
        self.errors[kind] += 1
        self.error_count += 1


def unstuff(escaped: bytes) -> bytes | None:
    """Take the escapes out of what stood between two delimiters; None if it ends within one.

    Any octet may be escaped, as RFC 1662 allows.
    """
    if ESCAPE not in escaped:
        return escaped
    out = bytearray()
    position = 0
    while True:
        found = escaped.find(ESCAPE, position)
        if found < 0:
            return bytes(out + escaped[position:])
        if found + 1 == len(escaped):
            return None
        out += escaped[position:found]
        out.append(escaped[found + 1] ^ INVERTED)
        position = found + 2


def parse(content: bytes) -> SerialPacket | None:
    """Return the packet of checked octets, from type to body; None where the form is unknown."""
    if content[0] == PacketType.ACK and len(content) == 2:
        return SerialPacket(PacketType.ACK, content[1])
    if content[0] == PacketType.DATA_ACK and len(content) >= 3:
        return SerialPacket(PacketType.DATA_ACK, content[1], content[2], content[3:])
    if content[0] == PacketType.DATA and len(content) >= 2:
        return SerialPacket(PacketType.DATA, None, content[1], content[2:])
    return None
