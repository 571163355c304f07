"""Consistent Overhead Byte Stuffing: bytes without zeros from any bytes, so that zero can delimit.

S. Cheshire, M. Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking
7(2), 1999. A code byte n announces n - 1 bytes that follow it and then a zero; code 0xFF announces
254 bytes and no zero; the last zero is implied by the end.

The work is done per run between zeros by `bytes.split` and slices, not per byte: the cost follows
the number of zeros in the data.
"""

from typing import Final

from spi_bus.errors import CobsError

__all__ = ["LONGEST_RUN", "decode", "encode"]

LONGEST_RUN: Final = 254  # bytes that one code byte (0xFF) can announce

_CODES: Final = tuple(bytes((n + 1,)) for n in range(LONGEST_RUN + 1))  # by length of the run


def encode(data: bytes) -> bytes:
    """Return the stuffed bytes, none of them zero: longer by one for every 254 begun."""
    codes = _CODES
    runs = data.split(b"\0")
    if len(data) < LONGEST_RUN:
        return b"".join([codes[len(run)] + run for run in runs])
    parts: list[bytes] = []
    last = len(runs) - 1
    for index, run in enumerate(runs):
        start = 0
        length = len(run)
        while length - start >= LONGEST_RUN:
            parts += (b"\xff", run[start : start + LONGEST_RUN])
            start += LONGEST_RUN
        # A run that fills its last block exactly needs no empty block behind it at the very end.
        if start < length or index < last or not length:
            parts += (codes[length - start], run[start:])
    return b"".join(parts)


def decode(data: bytes) -> bytes:
    """Return the bytes that `encode` was given.

    Raises:
        CobsError: a zero inside, nothing at all, or a run that ends before its code says.

    """
    end = len(data)
    if not end or b"\0" in data:
        raise CobsError(f"{end} bytes with {data.count(0)} zeros are no COBS block")
    parts: list[bytes] = []
    start = 0
    while True:
        code = data[start]
        stop = start + code
        parts.append(data[start + 1 : stop])
        if stop >= end:
            break
        if code <= LONGEST_RUN:
            parts.append(b"\0")
        start = stop
    if stop > end:
        raise CobsError(f"COBS code 0x{code:02X} at byte {start} of {end} points behind the end")
    return b"".join(parts)
