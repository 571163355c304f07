"""The network layer's messages: one frozen dataclass and one table row each.

As in `radio_802154/messages.py`: the payload of an active message whose AM type is the row's
number, big-endian without padding. What repeats or is the application's follows the fields of the
row, up to the end of the payload. Whole, none exceeds TinyOS's 28 octets. ETX are in sixteenths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Final, TypeVar

from radio_802154.errors import LocalFrameError, RemoteFrameError
from radio_802154.messages import TOSH_DATA_LENGTH
from spi_bus.errors import FieldError, PayloadError
from spi_bus.layout import U8, U16, U32, Field, Layout, MessageRow

M = TypeVar("M")

BOARD: Final = "board"
"""Sender of every message here: base and robots are equals."""


class BeaconFlag(IntFlag):
    """Bits of a beacon."""

    PULL = 1 << 0
    """The sender has no route and wants beacons (P of TEP 123)."""


@dataclass(frozen=True, slots=True)
class Beacon:
    """A board is there, and how far it is from the base (TEP 123, section 4; TEP 124's header).

    `LinkQuality` entries follow.
    """

    sequence: int
    flags: int
    parent: int
    etx: int


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """How well the beacon's sender hears a neighbour (TEP 124, link information entry)."""

    neighbour: int
    inbound: int


@dataclass(frozen=True, slots=True)
class CollectionData:
    """A record on its way to the base (TEP 123, section 3); the record's octets follow."""

    hops: int
    etx: int
    origin: int
    number: int
    repeat: int
    behind: int


@dataclass(frozen=True, slots=True)
class CollectionAck:
    """What the base has of an origin, on its way there: all below `next`, and `beyond` it."""

    origin: int
    hops: int
    next: int
    beyond: int


@dataclass(frozen=True, slots=True)
class Versions:
    """What a board has of the shared items: a digest of all; `Version` entries of some follow."""

    digest: int


@dataclass(frozen=True, slots=True)
class Version:
    """All items of an origin up to and with this number."""

    origin: int
    number: int


@dataclass(frozen=True, slots=True)
class SharedItem:
    """One item for everybody; its octets follow."""

    origin: int
    number: int


@dataclass(frozen=True, slots=True)
class TimeMark:
    """The root's time at this frame's SFD, as the sender knows it (TimeSyncMsg of FTSP)."""

    root: int
    sequence: int
    time: int


BEACON: Final = Layout(
    Beacon,
    (
        Field("sequence", U8, summary="counts the sender's beacons, wraps"),
        Field("flags", U8, summary="see BeaconFlag"),
        Field("parent", U16, summary="next hop to the base; 0xFFFF: none"),
        Field("etx", U16, summary="sixteenths of transmissions to the base; 0xFFFF: no route"),
    ),
    "big",
)
LINK_QUALITY: Final = Layout(
    LinkQuality,
    (
        Field("neighbour", U16, summary="address"),
        Field("inbound", U8, summary="share of its beacons that arrive, of 255"),
    ),
    "big",
)
COLLECTION_DATA: Final = Layout(
    CollectionData,
    (
        Field("hops", U8, summary="boards that have passed it on (THL of TEP 123)"),
        Field("etx", U16, summary="the sender's, when it went"),
        Field("origin", U16, summary="whose record it is"),
        Field("number", U32, summary="of the record in the origin's log, never used again"),
        Field("repeat", U8, summary="how often the origin has begun anew, wraps"),
        Field("behind", U8, summary="number less that of the oldest record not acknowledged"),
    ),
    "big",
)
COLLECTION_ACK: Final = Layout(
    CollectionAck,
    (
        Field("origin", U16, summary="whose records these are"),
        Field("hops", U8, summary="boards that have passed it on"),
        Field("next", U32, summary="all records with lower numbers are at the base"),
        Field("beyond", U8, summary="bit n: record next + 1 + n is there too"),
    ),
    "big",
)
VERSIONS: Final = Layout(
    Versions, (Field("digest", U32, summary="sum of the mixed versions, see sharing.py"),), "big"
)
VERSION: Final = Layout(
    Version,
    (
        Field("origin", U16, summary="whose items"),
        Field("number", U16, summary="all up to this one; 0: none"),
    ),
    "big",
)
SHARED_ITEM: Final = Layout(
    SharedItem,
    (
        Field("origin", U16, summary="whose item"),
        Field("number", U16, summary="from 1, without gaps"),
    ),
    "big",
)
TIME_MARK: Final = Layout(
    TimeMark,
    (
        Field("root", U16, summary="whose time it is"),
        Field("sequence", U8, summary="the root counts, wraps"),
        Field("time", U32, summary="ticks of 1/32768 s, wraps after 36 h"),
    ),
    "big",
)

BEACON_AM: Final = 0x30
DATA_AM: Final = 0x31
ACK_AM: Final = 0x32
VERSIONS_AM: Final = 0x33
ITEM_AM: Final = 0x34
TIME_AM: Final = 0x35

ROUTING_MESSAGES: Final = (
    MessageRow(BEACON_AM, BOARD, BEACON, "a board is there", LINK_QUALITY.size),
    MessageRow(DATA_AM, BOARD, COLLECTION_DATA, "a record for the base", 1),
    MessageRow(ACK_AM, BOARD, COLLECTION_ACK, "what the base has of an origin"),
    MessageRow(VERSIONS_AM, BOARD, VERSIONS, "what a board has of the shared items", VERSION.size),
    MessageRow(ITEM_AM, BOARD, SHARED_ITEM, "an item for everybody", 1),
    MessageRow(TIME_AM, BOARD, TIME_MARK, "the root's time"),
)
"""The messages by AM type (`kind`)."""
ROUTING_ENTRIES: Final = (
    MessageRow(BEACON_AM, BOARD, LINK_QUALITY, "follows a Beacon's fields, up to 7 times"),
    MessageRow(VERSIONS_AM, BOARD, VERSION, "follows a Versions' digest, up to 6 times"),
)
"""What repeats, by the AM type of its message."""

_ROWS: Final = {row.kind: row for row in ROUTING_MESSAGES}
_BY_CLASS: Final = {row.layout.message: row for row in ROUTING_MESSAGES}
_ENTRIES: Final = {row.kind: row.layout for row in ROUTING_ENTRIES}

MAX_RECORD_OCTETS: Final = TOSH_DATA_LENGTH - COLLECTION_DATA.size
"""Longest record [octets]."""
TIME_OFFSET: Final = TIME_MARK.size - U32.size
"""Where in a TimeMark its time stands, which is put in when the SFD is out."""
MAX_ITEM_OCTETS: Final = 20
"""Longest shared item [octets]; four less than would fit."""
MAX_VERSIONS: Final = (TOSH_DATA_LENGTH - VERSIONS.size) // VERSION.size
MAX_LINK_QUALITIES: Final = (TOSH_DATA_LENGTH - BEACON.size) // LINK_QUALITY.size


def split(layout: Layout[M], payload: bytes) -> tuple[M, bytes]:
    """Return the fields of a message and what follows them.

    Raises:
        RemoteFrameError: the payload is too short, or holds values that no sender produces.

    """
    try:
        return layout.decode(payload[: layout.size]), payload[layout.size :]
    except PayloadError as error:
        raise RemoteFrameError(str(error)) from error


def write(message: object, rest: Sequence[object] | bytes = b"") -> tuple[int, bytes]:
    """Return AM type and payload of a message and what follows its fields.

    Raises:
        LocalFrameError: no message of the table, a value that does not fit, or a wrong rest.

    """
    row = _BY_CLASS.get(type(message))
    if row is None:
        raise LocalFrameError(f"{type(message).__name__} is no message of the network layer")
    try:
        after = rest if isinstance(rest, bytes) else b"".join(map(_ENTRIES[row.kind].encode, rest))
        payload = row.layout.encode(message) + after
    except FieldError as error:
        raise LocalFrameError(str(error)) from error
    if len(after) > _longest_rest(row) or (after and len(after) % row.tail):
        raise LocalFrameError(f"{len(after)} octets do not follow a {row.layout.name}")
    return row.kind, payload


def read(am_type: int, payload: bytes) -> tuple[object, list[Any] | bytes]:
    """Return a message and what follows its fields: entries, or the application's octets.

    Raises:
        RemoteFrameError: an unknown AM type, or a payload that no such message has.

    """
    row = _ROWS.get(am_type)
    if row is None:
        raise RemoteFrameError(f"AM type 0x{am_type:02X} is none of the network layer")
    message: object
    message, rest = split(row.layout, payload)
    if len(rest) > _longest_rest(row):
        raise RemoteFrameError(f"{len(rest)} octets do not follow a {row.layout.name}")
    entry = _ENTRIES.get(am_type)
    return message, rest if entry is None else _entries(entry, rest)


def _longest_rest(row: MessageRow) -> int:
    if not row.tail:
        return 0
    return MAX_ITEM_OCTETS if row.kind == ITEM_AM else TOSH_DATA_LENGTH - row.layout.size


def _entries(layout: Layout[M], rest: bytes) -> list[M]:
    size = layout.size
    if len(rest) % size:
        raise RemoteFrameError(f"{len(rest)} octets are no whole number of {layout.name}")
    return [layout.decode(rest[at : at + size]) for at in range(0, len(rest), size)]


def encode_beacon(beacon: Beacon, qualities: list[LinkQuality]) -> bytes:
    """Return the payload of a beacon."""
    return BEACON.encode(beacon) + b"".join(map(LINK_QUALITY.encode, qualities))


def decode_beacon(payload: bytes) -> tuple[Beacon, list[LinkQuality]]:
    """Return a beacon and its entries.

    Raises:
        RemoteFrameError: no beacon has such a payload.

    """
    beacon, rest = split(BEACON, payload)
    return beacon, _entries(LINK_QUALITY, rest)


def encode_versions(digest: int, versions: list[Version]) -> bytes:
    """Return the payload of what a board has."""
    return VERSIONS.encode(Versions(digest)) + b"".join(map(VERSION.encode, versions))


def decode_versions(payload: bytes) -> tuple[int, list[Version]]:
    """Return digest and entries.

    Raises:
        RemoteFrameError: no such message has such a payload.

    """
    head, rest = split(VERSIONS, payload)
    return head.digest, _entries(VERSION, rest)
