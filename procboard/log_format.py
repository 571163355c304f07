"""How the storage log lies on the flash: pages of blocks of records, all of it pure functions.

    page    block block … erased
    block   marker (1) | length (1) | records
    record  length (1) | kind (1) | sequence (4) | CRC-16 (2) | payload     numbers low byte first

A block is what one commit writes. Its length and records are programmed first and read back; only
then is the marker programmed. So a block whose marker is still erased was promised to nobody, and
one whose marker has a bit cleared is whole: whether a record counts never rests on the luck of a
16-bit CRC over half-programmed bits. The CRC of a record guards what comes later: worn-out cells.

After a block that was torn the rest of its page is given up: bits there may be half programmed.
Page 0 of every sector holds its control records only: SECTOR says that the sector was erased and
which turn of the ring it is; OPEN says that records follow, and which of the older ones still live.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

ERASED: Final = 0xFF
COMMITTED: Final = 0x00
"""Values of the marker; any other value than ERASED counts as committed."""

BLOCK_HEADER_BYTES: Final = 2
RECORD_HEADER_BYTES: Final = 8

_HEADER: Final = struct.Struct("<BBIH")
_SECTOR: Final = struct.Struct("<HBxII")
_OPEN: Final = struct.Struct("<III")
_MAGIC: Final = 0xF15B
_VERSION: Final = 1
_U32: Final = 0xFFFFFFFF


class Kind(IntEnum):
    """What a record is. The codes differ in many bits."""

    DATA = 0xD5
    SECTOR = 0x5A
    OPEN = 0x2E


@dataclass(frozen=True, slots=True)
class Record:
    """A record as stored: its number and its payload."""

    sequence: int
    payload: bytes
    kind: int = Kind.DATA


@dataclass(frozen=True, slots=True)
class SectorRecord:
    """First block of a sector: its place in the ring's history and how often it was erased."""

    sequence: int
    erase_count: int


@dataclass(frozen=True, slots=True)
class OpenRecord:
    """The sector takes records: the oldest sector and record that still live, the next number."""

    sequence: int
    oldest_sector: int
    oldest_record: int
    next_record: int


@dataclass(frozen=True, slots=True)
class PageContents:
    """What a page holds: its good records, where free space begins, what was found wrong."""

    records: tuple[Record, ...]
    free_offset: int
    torn: bool
    corrupt: int


SECTOR_BLOCK_BYTES: Final = BLOCK_HEADER_BYTES + RECORD_HEADER_BYTES + _SECTOR.size
OPEN_BLOCK_BYTES: Final = BLOCK_HEADER_BYTES + RECORD_HEADER_BYTES + _OPEN.size


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF): "123456789" gives 0x29B1."""
    return crc_hqx(data, 0xFFFF)


def encode_record(sequence: int, payload: bytes, kind: int = Kind.DATA) -> bytes:
    """A record as bytes."""
    head = _HEADER.pack(len(payload), kind, sequence, 0)[:6]
    return head + crc16(head + payload).to_bytes(2, "little") + payload


def encode_sector(record: SectorRecord) -> bytes:
    """The SECTOR record: its sequence stands there twice, once inverted.

    An erase or program that was cut moves bits one way only, so it cannot turn one valid pair
    into another.
    """
    inverted = record.sequence ^ _U32
    body = _SECTOR.pack(_MAGIC, _VERSION, inverted, record.erase_count)
    return encode_record(record.sequence, body, Kind.SECTOR)


def encode_open(record: OpenRecord) -> bytes:
    """The OPEN record."""
    body = _OPEN.pack(record.oldest_sector, record.oldest_record, record.next_record)
    return encode_record(record.sequence, body, Kind.OPEN)


def decode_sector(page: PageContents) -> SectorRecord | None:
    """The SECTOR record of a control page; None where the sector has to be erased first."""
    if not page.records or page.records[0].kind != Kind.SECTOR:
        return None
    record = page.records[0]
    if len(record.payload) != _SECTOR.size:
        return None
    magic, version, inverted, erase_count = _SECTOR.unpack(record.payload)
    if magic != _MAGIC or version != _VERSION or inverted ^ _U32 != record.sequence:
        return None
    return SectorRecord(record.sequence, erase_count)


def decode_open(page: PageContents) -> OpenRecord | None:
    """The last OPEN record of a control page; None where the sector takes no records yet."""
    for record in reversed(page.records):
        if record.kind == Kind.OPEN and len(record.payload) == _OPEN.size:
            return OpenRecord(record.sequence, *_OPEN.unpack(record.payload))
    return None


def first_sequence(head: bytes) -> int | None:
    """Number of the first record of a page, from the page's first octets; its CRC is not read."""
    if head[0] == ERASED or head[BLOCK_HEADER_BYTES + 1] != Kind.DATA:
        return None
    return int(_HEADER.unpack_from(head, BLOCK_HEADER_BYTES)[2])


def is_erased(data: bytes) -> bool:
    """Whether every bit is one."""
    return data.count(ERASED) == len(data)


def read_page(page: bytes) -> PageContents:
    """Read the blocks of a page, or of its beginning."""
    records: list[Record] = []
    corrupt = 0
    offset = 0
    size = len(page)
    while offset + BLOCK_HEADER_BYTES <= size:
        if page[offset] == ERASED:
            if is_erased(page[offset:]):
                return PageContents(tuple(records), offset, False, corrupt)
            return PageContents(tuple(records), size, True, corrupt)
        start = offset + BLOCK_HEADER_BYTES
        offset = start + page[offset + 1]
        if offset > size or offset == start:
            return PageContents(tuple(records), size, False, corrupt + 1)
        corrupt += _read_records(page[start:offset], records)
    return PageContents(tuple(records), size, False, corrupt)


def _read_records(body: bytes, records: list[Record]) -> int:
    """Add the good records of a block; return how many were not."""
    position = 0
    corrupt = 0
    while position < len(body):
        start = position + RECORD_HEADER_BYTES
        if start > len(body):
            return corrupt + 1
        length, kind, sequence, crc = _HEADER.unpack_from(body, position)
        payload = body[start : start + length]
        if len(payload) < length:
            return corrupt + 1
        if crc16(body[position : position + 6] + payload) == crc:
            records.append(Record(sequence, payload, kind))
        else:
            corrupt += 1
        position = start + length
    return corrupt
