"""Packet captures of the newer kind, as Wireshark writes them: blocks of draft-ietf-opsawg-pcapng.

A section header says the byte order, an interface description the link type and the unit of time,
and packet blocks (enhanced, simple, and the obsolete one) hold frames of an interface; all others
are passed over. A block has its length at both ends: where the two differ, or a length cannot be,
the reader looks for the next place where they agree, says how much it left out, and goes on there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import BinaryIO, Final

from tools.decode.items import Item, Octets, What
from tools.decode.pcap import LINK_TYPES, LONGEST_RECORD, Window, frame
from tools.errors import UserError

SECTION: Final = 0x0A0D0D0A
MAGIC: Final = b"\x0a\x0d\x0d\x0a"
_INTERFACE, _OLD_PACKET, _SIMPLE, _PACKET = 1, 2, 3, 6
_ORDERS: Final = {b"\x1a\x2b\x3c\x4d": ">", b"\x4d\x3c\x2b\x1a": "<"}
_TS_RESOLUTION, _TS_OFFSET = 9, 14  # options of an interface, section 4.2
_LEAST: Final = 12  # type, length, length again
_MOST: Final = 1 << 20
"""Octets of a block: a frame has 127; name and secret blocks of other captures are long."""
_MOST_INTERFACES: Final = 4096


@dataclass(frozen=True, slots=True)
class _Interface:
    link_type: int
    ticks: int
    """Of a second."""
    offset_s: int
    snap: int


class _Reader:
    """What the blocks so far have said."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._window = Window(file, 0)
        self._name = name
        self._order = "<"
        self._interfaces: list[_Interface] = []

    def items(self) -> Iterator[Octets | Item]:
        window = self._window
        while window.have(_LEAST):
            block = self._block()
            if block is None:
                begin = window.offset
                self._find_block()
                text = f"{window.offset - begin} bytes are no block and are left out"
                yield Item(What.ERROR, "damaged capture", offset=begin, text=text)
                continue
            kind, length = block
            if not window.have(length):
                break
            yield from self._read(kind, window.data[8 : length - 4], window.offset)
            window.drop(length)
        if window.data:
            text = f"{len(window.data)} bytes are the begin of a block whose end is missing"
            yield Item(What.ERROR, "truncated file", offset=window.offset, text=text)

    def _block(self, at: int = 0) -> tuple[int, int] | None:
        """Type and length of the block that begins there; None where none can."""
        window = self._window
        if not window.have(at + _LEAST):
            return None
        data = window.data
        order = self._order
        if data[at : at + 4] == MAGIC:
            found = _ORDERS.get(data[at + 8 : at + 12])
            if found is None:
                return None
            order = found
        kind, length = struct.unpack_from(order + "II", data, at)
        if not _LEAST <= length <= _MOST or length % 4:
            return None
        if not window.have(at + length):
            return (kind, length) if not at else None  # the file ends within it
        (again,) = struct.unpack_from(order + "I", window.data, at + length - 4)
        return (kind, length) if again == length else None

    def _find_block(self) -> None:
        window = self._window
        while window.have(_LEAST + 4):
            # One that the file cuts off is believed only where we are, not where we look.
            most = min(len(window.data) - _LEAST, 1 << 12)
            for start in range(4, most, 4):
                if self._block(start) is not None:
                    window.drop(start)
                    return
            window.drop(max(4, most - most % 4))
        window.drop(len(window.data))

    def _read(self, kind: int, body: bytes, offset: int) -> Iterator[Octets | Item]:
        if kind == SECTION:
            self._order = _ORDERS[body[:4]]
            self._interfaces = []
        elif kind == _INTERFACE:
            yield from self._describe(body, offset)
        elif kind in (_PACKET, _OLD_PACKET, _SIMPLE):
            yield from self._packet(kind, body, offset)

    def _describe(self, body: bytes, offset: int) -> Iterator[Item]:
        if len(body) < 8 or len(self._interfaces) >= _MOST_INTERFACES:
            yield _damaged("an interface that is not described", offset)
            return
        link_type, _, snap = struct.unpack_from(self._order + "HHI", body)
        ticks, offset_s = 10**6, 0
        for code, value in self._options(body[8:]):
            if code == _TS_RESOLUTION and value:
                power = value[0] & 0x7F
                ticks = 1 << min(power, 63) if value[0] & 0x80 else 10 ** min(power, 18)
            elif code == _TS_OFFSET and len(value) == 8:
                (offset_s,) = struct.unpack(self._order + "q", value)
        self._interfaces.append(_Interface(link_type, ticks, offset_s, snap))
        if link_type not in LINK_TYPES:
            text = f"link type {link_type} is not IEEE 802.15.4: its packets are left out"
            yield Item(What.ERROR, "other interface", offset=offset, text=text)

    def _options(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        position = 0
        while position + 4 <= len(data):
            code, size = struct.unpack_from(self._order + "HH", data, position)
            if not code:
                return
            yield code, data[position + 4 : position + 4 + size]
            position += 4 + size + -size % 4

    def _packet(self, kind: int, body: bytes, offset: int) -> Iterator[Octets | Item]:
        time: int | None = None
        try:
            if kind == _SIMPLE:
                (original,) = struct.unpack_from(self._order + "I", body)
                number, begin = 0, 4
                length = min(original, len(body) - begin)
            else:
                layout = "HHIIII" if kind == _OLD_PACKET else "IIIII"
                number, *_, high, low, length, original = struct.unpack_from(
                    self._order + layout, body
                )
                begin = 20
                time = high << 32 | low
        except struct.error:
            yield _damaged("a packet without its header", offset)
            return
        if number >= len(self._interfaces):
            yield _damaged(f"a packet of interface {number}, which is not described", offset)
            return
        interface = self._interfaces[number]
        if kind == _SIMPLE and interface.snap:
            length = min(length, interface.snap)
        if interface.link_type not in LINK_TYPES:
            return
        if not 0 < length <= min(len(body) - begin, LONGEST_RECORD):
            yield _damaged(f"a packet of {length} octets in a block of {len(body)}", offset)
            return
        time_s = None
        if time is not None:
            whole, rest = divmod(time, interface.ticks)
            time_s = interface.offset_s + whole + rest / interface.ticks
        yield frame(body[begin : begin + length], time_s, offset, interface.link_type)
        if original > length:
            text = f"captured {length} of its {original} bytes"
            yield Item(What.ERROR, "cut frame", time_s, offset=offset, text=text)

    def check(self, first: list[Octets | Item]) -> None:
        """Refuse a capture that has no interface of ours before its first packet."""
        if any(one.link_type in LINK_TYPES for one in self._interfaces):
            return
        if self._interfaces:
            types = ", ".join(str(one.link_type) for one in self._interfaces)
            raise UserError(
                f"{self._name}: link type {types} is not IEEE 802.15.4 "
                f"({', '.join(map(str, LINK_TYPES))} are): was it captured on another interface?"
            )
        if not first:
            raise UserError(f"{self._name}: a capture without an interface, and so without packets")


def read(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield every 802.15.4 frame of a capture, and what is wrong with the file.

    Raises:
        UserError: none of its interfaces is of 802.15.4.

    """
    reader = _Reader(file, name)
    items = reader.items()
    first: list[Octets | Item] = []
    for item in items:
        first.append(item)
        if isinstance(item, Octets) or len(first) >= 100:
            break
    reader.check(first)
    return chain(first, items)


def _damaged(text: str, offset: int) -> Item:
    return Item(What.ERROR, "damaged capture", offset=offset, text=text)
