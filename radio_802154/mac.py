"""The MAC frame codec: IEEE Std 802.15.4-2006, clause 7.2, without clock, chip or port.

A frame is a frozen value with the standard's names. `encode` builds the MAC header and payload,
`decode` reads them; the FCS is apart (`fcs.py`), because on real hardware the chip owns it. PAN
id compression is a field and not a consequence: frames on the air do leave a compressible PAN id
in place, and a codec that normalised would not give back what it was given.

Wire errors say whose fault: `LocalFrameError` for a frame that cannot be built, `RemoteFrameError`
for octets that are no frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from radio_802154.errors import LocalFrameError, RemoteFrameError, UnsupportedFrameError
from radio_802154.fcs import FCS_OCTETS
from radio_802154.timing import MAX_PSDU_OCTETS

BROADCAST: Final = 0xFFFF
"""Broadcast PAN identifier and broadcast short address (clauses 7.2.1.3, 7.2.1.4)."""

NO_SHORT_ADDRESS: Final = 0xFFFE
"""macShortAddress of a device that is associated but has no short address (Table 86)."""

MAX_CONTENT_OCTETS: Final = MAX_PSDU_OCTETS - FCS_OCTETS
"""Longest header and payload without the FCS [octets]."""

_SECURITY: Final = 1 << 3
_PENDING: Final = 1 << 4
_ACK_REQUEST: Final = 1 << 5
_PAN_COMPRESSION: Final = 1 << 6
_RESERVED: Final = 0b111 << 7
_DESTINATION_SHIFT: Final = 10
_VERSION_SHIFT: Final = 12
_SOURCE_SHIFT: Final = 14


class FrameType(IntEnum):
    """Frame type subfield (clause 7.2.1.1.1, Table 79)."""

    BEACON = 0
    DATA = 1
    ACK = 2
    COMMAND = 3


class AddressingMode(IntEnum):
    """Addressing mode subfields (clause 7.2.1.1.6, Table 80); the value 1 is reserved."""

    NONE = 0
    SHORT = 2
    EXTENDED = 3


class CommandId(IntEnum):
    """First payload octet of a MAC command frame (clause 7.3, Table 82)."""

    ASSOCIATION_REQUEST = 1
    ASSOCIATION_RESPONSE = 2
    DISASSOCIATION = 3
    DATA_REQUEST = 4
    PAN_ID_CONFLICT = 5
    ORPHAN = 6
    BEACON_REQUEST = 7
    COORDINATOR_REALIGNMENT = 8
    GTS_REQUEST = 9


ADDRESS_OCTETS: Final = {
    AddressingMode.NONE: 0,
    AddressingMode.SHORT: 2,
    AddressingMode.EXTENDED: 8,
}
"""Length of an address by its mode (clause 7.2.1.4)."""


@dataclass(frozen=True, slots=True)
class Address:
    """A device on a PAN: short (16 bit) or extended (64 bit) address, and the PAN's identifier."""

    pan_id: int
    value: int
    mode: AddressingMode = AddressingMode.SHORT

    def __post_init__(self) -> None:
        octets = ADDRESS_OCTETS[self.mode]
        if octets == 0:
            raise LocalFrameError("an address has a mode: leave the address out for none")
        if not 0 <= self.pan_id <= 0xFFFF:
            raise LocalFrameError(f"PAN id {self.pan_id:#x} does not fit 16 bits")
        if not 0 <= self.value < 1 << (8 * octets):
            raise LocalFrameError(f"address {self.value:#x} does not fit {8 * octets} bits")

    @property
    def is_broadcast(self) -> bool:
        """Whether this is the broadcast short address, which every device accepts."""
        return self.mode is AddressingMode.SHORT and self.value == BROADCAST


@dataclass(frozen=True, slots=True)
class Frame:
    """A MAC frame (clause 7.2.1, Figure 41) without its FCS.

    `version` is the frame version subfield: 0 for 802.15.4-2003, 1 for 802.15.4-2006.
    """

    frame_type: FrameType
    sequence: int
    destination: Address | None = None
    source: Address | None = None
    payload: bytes = b""
    ack_request: bool = False
    frame_pending: bool = False
    pan_id_compression: bool = False
    version: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.sequence <= 0xFF:
            raise LocalFrameError(f"sequence number {self.sequence} does not fit 8 bits")
        if self.version not in (0, 1):
            raise LocalFrameError(f"frame version {self.version}: 802.15.4-2006 has 0 and 1")
        if self.pan_id_compression:
            if self.destination is None or self.source is None:
                raise LocalFrameError("PAN id compression needs both addresses (7.2.1.1.5)")
            if self.destination.pan_id != self.source.pan_id:
                raise LocalFrameError("PAN id compression between two PANs (7.2.1.1.5)")

    @property
    def frame_control(self) -> int:
        """The frame control field (clause 7.2.1.1, Figure 42)."""
        control = int(self.frame_type) | self.version << _VERSION_SHIFT
        if self.frame_pending:
            control |= _PENDING
        if self.ack_request:
            control |= _ACK_REQUEST
        if self.pan_id_compression:
            control |= _PAN_COMPRESSION
        if self.destination is not None:
            control |= int(self.destination.mode) << _DESTINATION_SHIFT
        if self.source is not None:
            control |= int(self.source.mode) << _SOURCE_SHIFT
        return control

    @property
    def command(self) -> CommandId | int | None:
        """The command identifier of a command frame; a plain number where it is reserved."""
        if self.frame_type is not FrameType.COMMAND or not self.payload:
            return None
        try:
            return CommandId(self.payload[0])
        except ValueError:
            return self.payload[0]


@dataclass(frozen=True, slots=True)
class FrameControl:
    """The frame control field, read. Used by receivers that must decide before the frame's end."""

    frame_type: int
    security: bool
    frame_pending: bool
    ack_request: bool
    pan_id_compression: bool
    destination_mode: int
    version: int
    source_mode: int
    reserved: int

    @classmethod
    def parse(cls, control: int) -> FrameControl:
        """Split 16 bits into the subfields of clause 7.2.1.1; nothing is judged here."""
        return cls(
            frame_type=control & 0b111,
            security=bool(control & _SECURITY),
            frame_pending=bool(control & _PENDING),
            ack_request=bool(control & _ACK_REQUEST),
            pan_id_compression=bool(control & _PAN_COMPRESSION),
            destination_mode=(control >> _DESTINATION_SHIFT) & 0b11,
            version=(control >> _VERSION_SHIFT) & 0b11,
            source_mode=(control >> _SOURCE_SHIFT) & 0b11,
            reserved=(control & _RESERVED) >> 7,
        )


def encode(frame: Frame) -> bytes:
    """MAC header and payload, without FCS.

    Raises:
        LocalFrameError: the frame has a form that the standard forbids, or it is too long.

    """
    _check_form(frame)
    out = bytearray(frame.frame_control.to_bytes(2, "little"))
    out.append(frame.sequence)
    if frame.destination is not None:
        out += frame.destination.pan_id.to_bytes(2, "little")
        out += frame.destination.value.to_bytes(ADDRESS_OCTETS[frame.destination.mode], "little")
    if frame.source is not None:
        if not frame.pan_id_compression:
            out += frame.source.pan_id.to_bytes(2, "little")
        out += frame.source.value.to_bytes(ADDRESS_OCTETS[frame.source.mode], "little")
    out += frame.payload
    if len(out) > MAX_CONTENT_OCTETS:
        raise LocalFrameError(
            f"frame of {len(out)} octets and FCS: at most {MAX_PSDU_OCTETS} fit the PHY (6.4.1)"
        )
    return bytes(out)


def decode(octets: bytes) -> Frame:
    """Read a MAC header and payload (FCS already checked and removed).

    Raises:
        RemoteFrameError: the octets are no frame of this standard.
        UnsupportedFrameError: a secured frame, or one of a later standard.

    """
    if len(octets) < 3:
        raise RemoteFrameError(f"{len(octets)} octets: shorter than the shortest MAC header (3)")
    control = FrameControl.parse(int.from_bytes(octets[:2], "little"))
    if control.frame_type > FrameType.COMMAND:
        raise UnsupportedFrameError(f"frame type {control.frame_type} is reserved (Table 79)")
    if control.version > 1:
        raise UnsupportedFrameError(f"frame version {control.version} is of a later standard")
    if control.security:
        raise UnsupportedFrameError("secured frame: no auxiliary security header is read here")
    reader = _Reader(octets, 3)
    destination_pan: int | None = None
    destination: Address | None = None
    source: Address | None = None
    destination_mode = _mode(control.destination_mode, "destination")
    source_mode = _mode(control.source_mode, "source")
    if destination_mode is not AddressingMode.NONE:
        destination_pan = reader.take(2, "destination PAN id")
        value = reader.take(ADDRESS_OCTETS[destination_mode], "destination address")
        destination = Address(destination_pan, value, destination_mode)
    if source_mode is not AddressingMode.NONE:
        if control.pan_id_compression:
            if destination_pan is None:
                raise RemoteFrameError("PAN id compression without a destination (7.2.1.1.5)")
            source_pan = destination_pan
        else:
            source_pan = reader.take(2, "source PAN id")
        value = reader.take(ADDRESS_OCTETS[source_mode], "source address")
        source = Address(source_pan, value, source_mode)
    elif control.pan_id_compression:
        raise RemoteFrameError("PAN id compression without a source (7.2.1.1.5)")
    frame = Frame(
        frame_type=FrameType(control.frame_type),
        sequence=octets[2],
        destination=destination,
        source=source,
        payload=bytes(octets[reader.position :]),
        ack_request=control.ack_request,
        frame_pending=control.frame_pending,
        pan_id_compression=control.pan_id_compression,
        version=control.version,
    )
    try:
        _check_form(frame)
    except LocalFrameError as error:
        raise RemoteFrameError(f"received frame: {error}") from None
    return frame


def data_frame(
    sequence: int,
    destination: Address | None,
    source: Address | None,
    payload: bytes,
    *,
    ack_request: bool = False,
    frame_pending: bool = False,
) -> Frame:
    """A data frame with PAN id compression where clause 7.5.6.1 wants it.

    A broadcast never asks for an acknowledgement (clause 7.5.6.4).

    Raises:
        LocalFrameError: neither address is there, or a field does not fit.

    """
    compress = (
        destination is not None and source is not None and destination.pan_id == source.pan_id
    )
    if destination is not None and destination.is_broadcast:
        ack_request = False
    frame = Frame(
        FrameType.DATA,
        sequence,
        destination,
        source,
        payload,
        ack_request=ack_request,
        frame_pending=frame_pending,
        pan_id_compression=compress,
    )
    _check_form(frame)
    return frame


def ack_frame(sequence: int, *, frame_pending: bool = False) -> Frame:
    """The acknowledgement of the frame with this sequence number (clause 7.2.2.3)."""
    return Frame(FrameType.ACK, sequence, frame_pending=frame_pending)


def acknowledges(ack: Frame, frame: Frame) -> bool:
    """Whether one frame is an acknowledgement of another: same sequence number (7.5.6.4.3)."""
    return ack.frame_type is FrameType.ACK and frame.ack_request and ack.sequence == frame.sequence


def _check_form(frame: Frame) -> None:
    """Each frame type's own rules (clauses 7.2.2.1 to 7.2.2.4)."""
    match frame.frame_type:
        case FrameType.BEACON:
            if frame.destination is not None or frame.source is None:
                raise LocalFrameError("a beacon has a source and no destination (7.2.2.1.1)")
        case FrameType.DATA:
            if frame.destination is None and frame.source is None:
                raise LocalFrameError("a data frame has at least one address (7.2.2.2.1)")
        case FrameType.ACK:
            if frame.destination is not None or frame.source is not None or frame.payload:
                raise LocalFrameError("an acknowledgement is three octets and FCS (7.2.2.3)")
        case FrameType.COMMAND:
            if not frame.payload:
                raise LocalFrameError("a command frame begins with a command id (7.2.2.4)")


def _mode(value: int, which: str) -> AddressingMode:
    if value == 1:
        raise RemoteFrameError(f"{which} addressing mode 1 is reserved (Table 80)")
    return AddressingMode(value)


class _Reader:
    """Takes little-endian numbers off the octets and says what was missing."""

    __slots__ = ("_octets", "position")

    def __init__(self, octets: bytes, position: int) -> None:
        self._octets = octets
        self.position = position

    def take(self, count: int, what: str) -> int:
        end = self.position + count
        if end > len(self._octets):
            raise RemoteFrameError(f"frame of {len(self._octets)} octets ends within its {what}")
        value = int.from_bytes(self._octets[self.position : end], "little")
        self.position = end
        return value
