"""Packet captures of 802.15.4: link types 195 (with FCS), 230 (without), 283 (TAP).

Records are read one by one. Where a record's header cannot be right, the reader looks for the next
place from which two headers in a row can be, says how much it left out, and goes on there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

from tools.decode.items import Item, Octets, What
from tools.errors import UserError

_MAGIC: Final = {
    b"\xd4\xc3\xb2\xa1": ("<", 10**6),
    b"\x4d\x3c\xb2\xa1": ("<", 10**9),
    b"\xa1\xb2\xc3\xd4": (">", 10**6),
    b"\xa1\xb2\x3c\x4d": (">", 10**9),
}
"""Byte order and ticks of a second, by a file's first four octets."""
MAGICS: Final = tuple(_MAGIC)

WITH_FCS, WITHOUT_FCS, TAP = 195, 230, 283
LINK_TYPES: Final = (WITH_FCS, WITHOUT_FCS, TAP)
_HEADER: Final = 24
_RECORD: Final = 16
LONGEST_RECORD: Final = 4096
"""Octets: a frame has 127, a TAP header some dozens; more is damage."""
_MOST_JUMP_S: Final = 86_400 * 366
"""Longest time between two records that is believed when looking for the next one."""

_TLV_FCS_TYPE, _TLV_RSS, _TLV_CHANNEL = 0, 1, 3


def read(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield every frame of a capture, and what is wrong with the file.

    Raises:
        UserError: a header that is cut off, or a link type that is not 802.15.4.

    """
    header = file.read(_HEADER)
    if len(header) < _HEADER:
        raise UserError(f"{name}: cut off within the capture's header of {_HEADER} bytes")
    order, ticks = _MAGIC[header[:4]]
    link_type = struct.unpack_from(order + "I", header, 20)[0] & 0x0FFFFFFF
    if link_type not in LINK_TYPES:
        raise UserError(
            f"{name}: link type {link_type} is not IEEE 802.15.4 "
            f"({WITH_FCS}, {WITHOUT_FCS} and {TAP} are): was it captured on another interface?"
        )
    return _records(file, order, ticks, link_type)


class Window:
    """A part of the file, moved forward."""

    def __init__(self, file: BinaryIO, offset: int) -> None:
        self._file = file
        self.data = b""
        self.offset = offset

    def have(self, count: int) -> bool:
        """Read on until there are so many bytes; whether there are."""
        while len(self.data) < count:
            more = self._file.read(1 << 16)
            if not more:
                return False
            self.data += more
        return True

    def drop(self, count: int) -> None:
        """Go on by so many bytes."""
        self.data = self.data[count:]
        self.offset += count


def _records(file: BinaryIO, order: str, ticks: int, link_type: int) -> Iterator[Octets | Item]:
    window = Window(file, _HEADER)
    last: int | None = None
    layout = struct.Struct(order + "IIII")
    while window.have(_RECORD):
        seconds, fraction, length, original = layout.unpack_from(window.data)
        if not _plausible(fraction, length, original, ticks):
            offset = window.offset
            _find_record(window, layout, ticks, last)
            yield Item(
                What.ERROR,
                "damaged capture",
                offset=offset,
                text=f"{window.offset - offset} bytes are no record and are left out",
            )
            continue
        if not window.have(_RECORD + length):
            break
        last = seconds
        data = window.data[_RECORD : _RECORD + length]
        yield frame(data, seconds + fraction / ticks, window.offset, link_type)
        if original > length:
            yield Item(
                What.ERROR,
                "cut frame",
                seconds + fraction / ticks,
                offset=window.offset,
                text=f"captured {length} of its {original} bytes",
            )
        window.drop(_RECORD + length)
    if window.data:
        text = f"{len(window.data)} bytes are the begin of a record whose end is missing"
        yield Item(What.ERROR, "truncated file", offset=window.offset, text=text)


def _plausible(fraction: int, length: int, original: int, ticks: int) -> bool:
    return fraction < ticks and 0 < length <= original <= LONGEST_RECORD


def _find_record(window: Window, layout: struct.Struct, ticks: int, last: int | None) -> None:
    """Move the window to where two record headers in a row can be, or to the file's end."""
    window.drop(1)
    while window.have(_RECORD):
        more = window.have(LONGEST_RECORD + 2 * _RECORD)
        data = window.data
        # What stands behind a record's header counts, so that the end waits for the next block.
        most = len(data) - (LONGEST_RECORD + 2 * _RECORD if more else _RECORD) + 1
        for start in range(most):
            seconds, fraction, length, original = layout.unpack_from(data, start)
            if not _plausible(fraction, length, original, ticks):
                continue
            if last is not None and abs(seconds - last) > _MOST_JUMP_S:
                continue
            after = start + _RECORD + length
            if after + _RECORD <= len(data):
                _, fraction, length, original = layout.unpack_from(data, after)
                if not _plausible(fraction, length, original, ticks):
                    continue
            elif after != len(data):
                continue
            window.drop(start)
            return
        window.drop(most)
    window.drop(len(window.data))


def frame(data: bytes, time_s: float | None, offset: int, link_type: int) -> Octets | Item:
    """Return the frame of a record, or what is wrong with its TAP header."""
    has_fcs = link_type == WITH_FCS
    note = ""
    if link_type == TAP:
        read = _tap(data)
        if read is None:
            return Item(
                What.ERROR, "TAP header", time_s, offset=offset, text="it does not fit its record"
            )
        data, has_fcs, note = read
    return Octets(data, "", time_s, offset, frame=True, has_fcs=has_fcs, note=note)


def _tap(data: bytes) -> tuple[bytes, bool, str] | None:
    """Split a TAP record into MPDU, whether it has a 16-bit FCS, and strength and channel."""
    if len(data) < 4:
        return None
    version, _, length = struct.unpack_from("<BBH", data)
    if version != 0 or not 4 <= length <= len(data):
        return None
    has_fcs = False
    words = []
    position = 4
    while position + 4 <= length:
        kind, size = struct.unpack_from("<HH", data, position)
        value = data[position + 4 : position + 4 + size]
        if position + 4 + size > length:
            return None
        if kind == _TLV_FCS_TYPE and value:
            has_fcs = value[0] == 1
            if value[0] == 2:
                return None  # a 32-bit FCS belongs to a later standard
        elif kind == _TLV_RSS and size == 4:
            words.append(f"{struct.unpack('<f', value)[0]:.0f} dBm")
        elif kind == _TLV_CHANNEL and size >= 2:
            words.append(f"channel {int.from_bytes(value[:2], 'little')}")
        position += 4 + size + -size % 4
    return data[length:], has_fcs, ", ".join(words)
