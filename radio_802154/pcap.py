"""Frames on the air as a pcap file of link type 283, "IEEE 802.15.4 TAP".

Each record is a TAP header (version, length, then type-length-value fields padded to 32 bits) and
the MPDU with its FCS. The TLVs say what a sniffer would: FCS type, received strength, channel,
times of start and end of the frame, link quality. Times have nanosecond resolution (magic
0xA1B23C4D). Layout: "IEEE 802.15.4 TAP Link Type Specification" (Exegin), as Wireshark's
packet-ieee802154.h reads it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import BinaryIO, Final

LINKTYPE_IEEE802_15_4_TAP: Final = 283
"""https://www.tcpdump.org/linktypes.html."""

_MAGIC_NS: Final = 0xA1B23C4D
_SNAP_LENGTH: Final = 0xFFFF
_FS_PER_NS: Final = 10**6

_TLV_FCS_TYPE: Final = 0
_TLV_RSS_DBM: Final = 1
_TLV_CHANNEL: Final = 3
_TLV_START_NS: Final = 5
_TLV_END_NS: Final = 6
_TLV_LQI: Final = 10

_FCS_16_BIT: Final = 1
_PAGE_2450_MHZ: Final = 0


@dataclass(frozen=True, slots=True)
class Capture:
    """One frame as captured.

    Attributes:
        start_fs: first symbol of the preamble on the air [fs]; the record's timestamp.
        end_fs: end of the last symbol of the FCS [fs].
        channel: 11 to 26.
        rss_dbm: signal strength to report [dBm].
        mpdu: MAC header, payload and FCS.
        lqi: link quality, 0 to 255, or None to leave it out.

    """

    start_fs: int
    end_fs: int
    channel: int
    rss_dbm: float
    mpdu: bytes
    lqi: int | None = None


def _tlv(kind: int, value: bytes) -> bytes:
    return struct.pack("<HH", kind, len(value)) + value + bytes(-len(value) % 4)


def global_header() -> bytes:
    """Return the 24 octets that open the file."""
    return struct.pack("<IHHiIII", _MAGIC_NS, 2, 4, 0, 0, _SNAP_LENGTH, LINKTYPE_IEEE802_15_4_TAP)


def record(frame: Capture) -> bytes:
    """Return one record: pcap header, TAP header, MPDU."""
    fields = _tlv(_TLV_FCS_TYPE, bytes((_FCS_16_BIT,)))
    fields += _tlv(_TLV_RSS_DBM, struct.pack("<f", frame.rss_dbm))
    fields += _tlv(_TLV_CHANNEL, struct.pack("<HB", frame.channel, _PAGE_2450_MHZ))
    fields += _tlv(_TLV_START_NS, struct.pack("<Q", frame.start_fs // _FS_PER_NS))
    fields += _tlv(_TLV_END_NS, struct.pack("<Q", frame.end_fs // _FS_PER_NS))
    if frame.lqi is not None:
        fields += _tlv(_TLV_LQI, bytes((frame.lqi,)))
    data = struct.pack("<BBH", 0, 0, 4 + len(fields)) + fields + frame.mpdu
    seconds, nanoseconds = divmod(frame.start_fs // _FS_PER_NS, 10**9)
    return struct.pack("<IIII", seconds, nanoseconds, len(data), len(data)) + data


def write(file: BinaryIO, frames: Iterable[Capture]) -> int:
    """Write a whole capture in order of start; return the number of frames."""
    file.write(global_header())
    ordered = sorted(frames, key=lambda frame: frame.start_fs)
    file.writelines(record(frame) for frame in ordered)
    return len(ordered)
