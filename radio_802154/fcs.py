"""The frame check sequence: the 16-bit ITU-T CRC of IEEE Std 802.15.4-2006, clause 7.2.1.9.

Generator x^16 + x^12 + x^5 + 1, initial remainder zero, octets sent least significant bit first:
the catalogue calls it CRC-16/KERMIT (check value 0x2189). The FCS travels low octet first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import crcmod

from radio_802154.errors import FcsError, RemoteFrameError

FCS_OCTETS: Final = 2
"""Length of the FCS in octets (clause 7.2.1.9)."""

_POLYNOMIAL: Final = 0x11021  # x^16 + x^12 + x^5 + 1, with the leading term as crcmod wants it

_crc: Final[Callable[[bytes], int]] = crcmod.mkCrcFun(_POLYNOMIAL, initCrc=0, rev=True, xorOut=0)


def fcs(mhr_and_payload: bytes) -> int:
    """The FCS of a MAC header and payload, as a number."""
    return _crc(mhr_and_payload)


def append_fcs(mhr_and_payload: bytes) -> bytes:
    """The whole MPDU: header, payload, FCS low octet first."""
    return mhr_and_payload + _crc(mhr_and_payload).to_bytes(FCS_OCTETS, "little")


def fcs_ok(mpdu: bytes) -> bool:
    """Whether an MPDU ends in its own FCS. Too short an MPDU does not."""
    if len(mpdu) <= FCS_OCTETS:
        return False
    return _crc(mpdu[:-FCS_OCTETS]) == int.from_bytes(mpdu[-FCS_OCTETS:], "little")


def strip_fcs(mpdu: bytes) -> bytes:
    """Header and payload of an MPDU whose FCS is right.

    Raises:
        RemoteFrameError: there are not even enough octets for an FCS.
        FcsError: the FCS is wrong.

    """
    if len(mpdu) <= FCS_OCTETS:
        raise RemoteFrameError(f"received {len(mpdu)} octets: shorter than an FCS and any content")
    if not fcs_ok(mpdu):
        received = int.from_bytes(mpdu[-FCS_OCTETS:], "little")
        computed = _crc(mpdu[:-FCS_OCTETS])
        raise FcsError(f"received FCS 0x{received:04X}, the octets have 0x{computed:04X}")
    return mpdu[:-FCS_OCTETS]
