"""TinyOS active messages on the air: how a real TelosB with TinyOS 2 lays out its frames.

    61 88 | DSN | PAN | dest | src | 3F | AM type | payload | FCS      (numbers low octet first)

A data frame with short addresses in one PAN, then the 6LoWPAN "not a LoWPAN" dispatch octet 0x3F
(RFC 4944, section 5.1: 00xxxxxx is NALP; TinyOS calls it TINYOS_6LOWPAN_NETWORK_ID) and the AM
type, as TEP 125 ("TinyOS 802.15.4 Frames", I-Frame) has it. The frame control field is 0x8861
with and 0x8841 without acknowledgement request.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from radio_802154 import mac
from radio_802154.errors import LocalFrameError, RemoteFrameError

NALP_DISPATCH: Final = 0x3F
"""TINYOS_6LOWPAN_NETWORK_ID (TEP 125)."""

AM_BROADCAST: Final = 0xFFFF
"""AM_BROADCAST_ADDR, which is the broadcast short address (TEP 116)."""

DEFAULT_PAN_ID: Final = 0x22
"""TOS_AM_GROUP as TinyOS builds it by default: PAN id and AM group are one number."""

HEADER_OCTETS: Final = 11
"""Frame control, DSN, PAN, destination, source (9) and dispatch, AM type (2)."""

MAX_PAYLOAD_OCTETS: Final = mac.MAX_CONTENT_OCTETS - HEADER_OCTETS
"""Longest active-message payload that a frame holds [octets] (TinyOS itself defaults to 28)."""


@dataclass(frozen=True, slots=True)
class AmPacket:
    """An active message between two motes."""

    destination: int
    source: int
    am_type: int
    payload: bytes
    sequence: int = 0
    pan_id: int = DEFAULT_PAN_ID
    ack_request: bool = True


def encode(packet: AmPacket) -> bytes:
    """MAC header and payload of an active message, without FCS.

    The acknowledgement request is dropped from a broadcast, as clause 7.5.6.4 wants it.

    Raises:
        LocalFrameError: a field does not fit.

    """
    if not 0 <= packet.am_type <= 0xFF:
        raise LocalFrameError(f"AM type {packet.am_type} does not fit 8 bits")
    if len(packet.payload) > MAX_PAYLOAD_OCTETS:
        raise LocalFrameError(
            f"AM payload of {len(packet.payload)} octets: at most {MAX_PAYLOAD_OCTETS} fit"
        )
    frame = mac.data_frame(
        packet.sequence,
        mac.Address(packet.pan_id, packet.destination),
        mac.Address(packet.pan_id, packet.source),
        bytes((NALP_DISPATCH, packet.am_type)) + packet.payload,
        ack_request=packet.ack_request,
    )
    return mac.encode(frame)


def from_frame(frame: mac.Frame) -> AmPacket:
    """The active message that a decoded MAC frame carries.

    Raises:
        RemoteFrameError: it carries none: another frame type, other addressing, other dispatch.

    """
    if frame.frame_type is not mac.FrameType.DATA:
        raise RemoteFrameError(f"{frame.frame_type.name} frame: active messages are data frames")
    destination, source = frame.destination, frame.source
    if (
        destination is None
        or source is None
        or destination.mode is not mac.AddressingMode.SHORT
        or source.mode is not mac.AddressingMode.SHORT
        or not frame.pan_id_compression
    ):
        raise RemoteFrameError("active messages have short addresses within one PAN (TEP 125)")
    if len(frame.payload) < 2:
        raise RemoteFrameError("data frame ends before its dispatch octet and AM type")
    if frame.payload[0] != NALP_DISPATCH:
        raise RemoteFrameError(f"dispatch octet 0x{frame.payload[0]:02X}: no active message")
    return AmPacket(
        destination=destination.value,
        source=source.value,
        am_type=frame.payload[1],
        payload=frame.payload[2:],
        sequence=frame.sequence,
        pan_id=destination.pan_id,
        ack_request=frame.ack_request,
    )


def decode(octets: bytes) -> AmPacket:
    """Read an active message from MAC header and payload (FCS already removed).

    Raises:
        RemoteFrameError: the octets are no frame, or a frame without an active message.

    """
    return from_frame(mac.decode(octets))
