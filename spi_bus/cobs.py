"""Consistent Overhead Byte Stuffing: bytes without zeros from any bytes, so that zero can delimit.

S. Cheshire, M. Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking
7(2), 1999. A code byte n announces n - 1 bytes that follow it and then a zero; code 0xFF announces
254 bytes and no zero; the last zero is implied by the end.

A byte is never touched by itself: runs between zeros are found and copied by `bytes.split`, slices
and a regular expression, and neighbouring zeros, whose codes are ones, are taken together. So the
cost follows the number of runs. What fits one block, as every frame of the link does, takes short
ways; the general one is `_encode_long` and the end of `decode`.
"""

import re
from typing import Final

from spi_bus.errors import CobsError

__all__ = ["LONGEST_RUN", "decode", "encode"]

LONGEST_RUN: Final = 254  # bytes that one code byte (0xFF) can announce

_CODES: Final = tuple(bytes((n + 1,)) for n in range(LONGEST_RUN + 1))  # by length of the run
_ONES: Final = tuple(b"\1" * n for n in range(LONGEST_RUN + 2))  # codes of n zeros in a row
_EIGHT_ZEROS: Final = bytes(8)
_EIGHT_ONES: Final = b"\1" * 8  # eight zeros in a row, or data that look so
_RUN_AND_ZEROS: Final = re.compile(rb"([^\0]*)(\0+)")


def encode(data: bytes) -> bytes:
    """Return the stuffed bytes, none of them zero: longer by one for every 254 begun."""
    length = len(data)
    if length > LONGEST_RUN:
        return _encode_long(data)
    codes = _CODES
    if 0 not in data:
        return codes[length] + data
    if data.count(_EIGHT_ZEROS) <= length >> 4:  # not half of it are zeros in a row
        return b"".join([codes[len(run)] + run for run in data.split(b"\0")])
    ones = _ONES
    found = _RUN_AND_ZEROS.findall(data + b"\0")
    return b"".join([codes[len(run)] + run + ones[len(zeros) - 1] for run, zeros in found])


def _encode_long(data: bytes) -> bytes:
    codes = _CODES
    runs = data.split(b"\0")
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
    if not end or 0 in data:
        raise CobsError(f"{end} bytes with {data.count(0)} zeros are no COBS block")
    at = data[0]
    if at == end:
        return data[1:]
    if end > LONGEST_RUN + 1:
        return _decode_long(data)
    opened = bytearray(data)  # every code but the first becomes the zero that it stands for
    if _EIGHT_ONES in data:
        while at < end:
            code = data[at]
            if code == 1:
                after = end - len(data[at:].lstrip(b"\1"))
                opened[at:after] = bytes(after - at)
                at = after
            else:
                opened[at] = 0
                at += code
    else:
        while at < end:
            opened[at] = 0
            at += data[at]
    if at > end:
        raise CobsError(f"a COBS code of {end} bytes points {at - end} behind the end")
    return bytes(opened[1:])


def _decode_long(data: bytes) -> bytes:
    end = len(data)
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
