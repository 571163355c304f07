"""How long a frame takes on a line, as far as its URL says how fast the line is.

For whoever sends at a fixed rate and wants to know beforehand whether that fits. A serial port's
URL has its baud rate and format; a CAN URL may have a bit rate. Ptys, pairs and sockets are as fast
as the machines, and nothing is said of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import ceil

from spi_bus.crc import CRC_BYTES
from spi_bus.errors import TransportUrlError
from spi_bus.frame import HEADER_BYTES
from spi_bus.transports.serial_port import BAUD, OPTIONS, PYSERIAL_SCHEMES
from spi_bus.transports.urls import parse, take

__all__ = ["FRAME_OVERHEAD", "LineSpeed", "line_speed"]

FRAME_OVERHEAD = HEADER_BYTES + CRC_BYTES + 2
"""Bytes of a frame beyond its payload: header, CRC, one of COBS, the closing zero."""
CAN_FRAME_BITS = 135
"""Classic CAN, 11-bit identifier, eight data bytes: 111 bits and at most 24 of stuffing
(ISO 11898-1, 10.5)."""
CAN_FRAME_BITS_EXTENDED = 160
"""The same with a 29-bit identifier: 131 bits and at most 29 of stuffing."""
_FIRST, _FURTHER = 6, 7  # payload bytes of ISO-TP's first and consecutive frames
_RECORD = re.compile(r"record:.+?:([A-Za-z][A-Za-z0-9+.-]*:.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class LineSpeed:
    """Bits a second of a line, and how bytes become bits."""

    bits_per_s: float
    bits_per_byte: float = 10.0
    """Of an asynchronous line: start and stop bits too. 0: CAN."""
    can_frame_bits: int = CAN_FRAME_BITS
    shared: bool = False
    """Whether both directions share the bits."""

    def seconds(self, payload_bytes: int) -> float:
        """Return the longest time that a frame with such a payload takes."""
        octets = payload_bytes + FRAME_OVERHEAD
        if self.bits_per_byte:
            return octets * self.bits_per_byte / self.bits_per_s
        frames = 1 if octets <= _FURTHER else 2 + ceil((octets - _FIRST) / _FURTHER)
        return frames * self.can_frame_bits / self.bits_per_s  # with one flow control frame


def line_speed(url: str) -> LineSpeed | None:
    """Return how fast the line of a URL is; None where the URL does not say.

    Raises:
        TransportUrlError: a URL that is none.

    """
    recorded = _RECORD.fullmatch(url)
    if recorded is not None:
        return line_speed(recorded[1])
    parsed = parse(url)
    if parsed.scheme in PYSERIAL_SCHEMES:
        options = take(parsed, OPTIONS, leftover={})
        parity = options.get("parity", "N") != "N"
        bits = 1 + options.get("bytesize", 8) + parity + options.get("stopbits", 1.0)
        return LineSpeed(options.get("baud", BAUD), bits)
    if parsed.scheme == "can" and "bitrate" in parsed.options and "fd" not in parsed.options:
        try:
            bit_rate = float(parsed.options["bitrate"])
            longest = max(int(parsed.options.get(name, "0"), 0) for name in ("tx", "rx"))
        except ValueError as error:
            raise TransportUrlError(f"{url}: {error}") from error
        bits_per_frame = CAN_FRAME_BITS_EXTENDED if longest > 0x7FF else CAN_FRAME_BITS
        return LineSpeed(bit_rate, 0.0, bits_per_frame, shared=True) if bit_rate > 0 else None
    return None
