"""Address recognition: which frames a receiver keeps (802.15.4, clause 7.5.6.2, third level).

The CC2420 decides this in hardware while a frame is still arriving, from as much of the MAC header
as there is; so this works on the octets, not on a decoded frame, and judges nothing else. The rules
are those of the standard, whatever operating system fills the address registers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from radio_802154.mac import BROADCAST, AddressingMode, FrameControl, FrameType

SHORTEST_HEADER: Final = 3
"""Frame control and sequence number [octets]."""

_ADDRESS_OCTETS: Final = (0, 0, 2, 8)  # by addressing mode; mode 1 is reserved


_parse: Final = lru_cache(maxsize=256)(FrameControl.parse)  # a net uses a handful of values


@dataclass(frozen=True, slots=True)
class AddressFilter:
    """What a receiver knows of itself (macPANId, macShortAddress, aExtendedAddress).

    `accept_reserved` keeps frame types 4 to 7 unseen (CC2420: MDMCTRL0.RESERVED_FRAME_MODE);
    `accept_beacons` keeps beacons of any PAN (CC2420: IOCFG0.BCN_ACCEPT).
    """

    pan_id: int
    short_address: int
    extended_address: int
    pan_coordinator: bool = False
    accept_reserved: bool = False
    accept_beacons: bool = False


@lru_cache(maxsize=256)
def header_octets(frame_control: int) -> int:
    """Return the length of the MAC header up to its last address, from the frame control field."""
    control = _parse(frame_control)
    length = SHORTEST_HEADER
    if control.destination_mode >= AddressingMode.SHORT:
        length += 2 + _ADDRESS_OCTETS[control.destination_mode]
    if control.source_mode >= AddressingMode.SHORT:
        length += _ADDRESS_OCTETS[control.source_mode]
        if not control.pan_id_compression:
            length += 2
    return length


def accepts(own: AddressFilter, header: bytes) -> bool:
    """Whether the standard's rules keep a frame that begins with these octets.

    `header` holds at least `header_octets` octets of the frame; a frame that ended before that is
    not kept.
    """
    if len(header) < SHORTEST_HEADER:
        return False
    frame_control = header[0] | header[1] << 8
    control = _parse(frame_control)
    if control.frame_type > FrameType.COMMAND:
        return own.accept_reserved
    if 1 in (control.destination_mode, control.source_mode):
        return False
    if len(header) < header_octets(frame_control):
        return False
    position = SHORTEST_HEADER
    destination_pan: int | None = None
    if control.destination_mode:
        destination_pan = header[3] | header[4] << 8
        if destination_pan not in (own.pan_id, BROADCAST):
            return False
        octets = _ADDRESS_OCTETS[control.destination_mode]
        address = int.from_bytes(header[5 : 5 + octets], "little")
        position = 5 + octets
        if control.destination_mode == AddressingMode.SHORT:
            if address not in (own.short_address, BROADCAST):
                return False
        elif address != own.extended_address:
            return False
    source_pan: int | None = None
    if control.source_mode:
        if control.pan_id_compression:
            source_pan = destination_pan
        else:
            source_pan = header[position] | header[position + 1] << 8
    if control.frame_type == FrameType.BEACON:
        return own.accept_beacons or own.pan_id == BROADCAST or source_pan == own.pan_id
    if control.frame_type != FrameType.ACK and not control.destination_mode:
        # only a source, in a data or command frame: for the PAN coordinator
        return own.pan_coordinator and control.source_mode != 0 and source_pan == own.pan_id
    return True
