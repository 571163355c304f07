"""What the network layer keeps on flash: a robot's records, all boards' items, the base's ledger.

A reset takes the RAM, so each store is made anew at every boot and `load`ed from its log.

- A *robot's record* has the number that it has in its log. What the base has of them is not kept:
  it says so when the oldest comes once more.
- An *item* is stored with origin and number. RAM knows the place of each in the log's order.
- The *base* stores each record that came together with what its ledger had of the origin at that
  moment, so the two cannot differ, whenever a reset comes. The last one of each origin counts.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator
from typing import Final

from procboard.coroutines import Firmware
from procboard.log_format import Record
from procboard.routing.collection import RecordDelivered
from procboard.routing.config import ITEM_LIMIT
from procboard.routing.delivery import Origin
from procboard.storage import RecordLog
from procboard.storage_controller import StorageController

SEARCH_CYCLES: Final = 8
"""A step through a table in RAM: cmp, add and jump (SLAU049F, tables 3-14 to 3-16)."""

_ITEM: Final = struct.Struct(">HH")  # origin, number
_RECEIPT: Final = struct.Struct(">HIIB")  # origin, number, ledger's next and beyond


def receipts(records: Iterator[Record]) -> Iterator[tuple[RecordDelivered, int, int]]:
    """Read a base's log: each record, and what the ledger had of its origin then."""
    for record in records:
        origin, number, following, beyond = _RECEIPT.unpack_from(record.payload)
        content = record.payload[_RECEIPT.size :]
        yield RecordDelivered(origin, number, content), following, beyond


class RecordStore:
    """A robot's records, from flash to the base."""

    def __init__(self, storage: StorageController) -> None:
        self.storage = storage
        self._oldest_sector = 0

    @property
    def log(self) -> RecordLog:
        """The log they are in."""
        return self.storage.log

    def load(self) -> Firmware[tuple[int, int]]:
        """Return the numbers of the oldest and the newest record on flash."""
        self._oldest_sector = self.log.extent[0]
        oldest = yield from self.log.oldest()
        return oldest, self.log.stored_sequence

    def given_up(self) -> Firmware[int | None]:
        """Return the oldest record on flash where that has changed since the last time."""
        if self.log.extent[0] == self._oldest_sector:
            return None
        self._oldest_sector = self.log.extent[0]
        return (yield from self.log.oldest())

    def number_on(self, origin: Origin, following: int) -> Firmware[None]:
        """Give all records that the base has not acknowledged numbers from `following` on."""
        log = self.log
        yield from self.storage.settle()
        old = range(origin.oldest, log.stored_sequence + 1)
        log.next_sequence = max(log.next_sequence, following)
        origin.restart(log.next_sequence)
        for number in old:
            payload = yield from log.read(number)
            if payload is not None:
                yield from self.storage.store(payload)
        yield from self.storage.settle()


class ItemStore:
    """All items that this board has, its own and others'."""

    def __init__(self, storage: StorageController, limit: int = ITEM_LIMIT) -> None:
        self.storage = storage
        self.limit = limit
        self.places: dict[tuple[int, int], int] = {}
        """Number in the log of each item on flash, by origin and number."""
        self._waiting: deque[tuple[int, int, int, bytes]] = deque()  # not yet on flash

    def load(self) -> Firmware[list[tuple[int, int, bytes]]]:
        """Return all items on flash."""
        items = []
        cursor = self.storage.log.cursor()
        while page := (yield from cursor.read()):
            for record in page:
                origin, number = _ITEM.unpack_from(record.payload)
                self.places[origin, number] = record.sequence
                items.append((origin, number, record.payload[_ITEM.size :]))
        return items

    def versions(self) -> dict[int, int]:
        """Return, by origin, the number up to which all items are there."""
        found: dict[int, int] = {}
        for origin, number in sorted(self.places):
            if found.setdefault(origin, 0) == number - 1:
                found[origin] = number
        return found

    @property
    def full(self) -> bool:
        """Whether no more can be kept."""
        storage = self.storage
        kept = len(self.places) + len(self._waiting)
        return storage.full or bool(storage.failure) or kept >= self.limit

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self.places or any(key == item[1:3] for item in self._waiting)

    def store(self, origin: int, number: int, item: bytes) -> Firmware[int | None]:
        """Hand an item to the log; return its number there, None where it is lost."""
        place = yield from self.storage.store(_ITEM.pack(origin, number) + item)
        if place is not None and place > self.storage.log.stored_sequence:
            self._waiting.append((place, origin, number, item))
        elif place is not None:
            self.places[origin, number] = place
        return place

    def stored(self, last: int) -> None:
        """Take note that the log has stored all up to this."""
        while self._waiting and self._waiting[0][0] <= last:
            place, origin, number, _ = self._waiting.popleft()
            self.places[origin, number] = place

    def read(self, origin: int, number: int) -> Firmware[bytes | None]:
        """Return an item, from RAM or from flash."""
        yield SEARCH_CYCLES * len(self.places)
        for _, of, count, item in self._waiting:
            if (of, count) == (origin, number):
                return item
        place = self.places.get((origin, number))
        payload = None if place is None else (yield from self.storage.log.read(place))
        return None if payload is None else payload[_ITEM.size :]


class ReceiptStore:
    """What the base has: every record that came, and with it the ledger."""

    def __init__(self, storage: StorageController) -> None:
        self.storage = storage
        self._waiting: deque[tuple[int, RecordDelivered]] = deque()

    def load(self) -> Firmware[dict[int, tuple[int, int]]]:
        """Return the ledger's entries."""
        entries = {}
        cursor = self.storage.log.cursor()
        while page := (yield from cursor.read()):
            for event, following, beyond in receipts(iter(page)):
                entries[event.origin] = following, beyond
        return entries

    @property
    def broken(self) -> bool:
        """Whether records can no longer be kept: then none is taken and none acknowledged."""
        return self.storage.full or bool(self.storage.failure)

    def store(self, event: RecordDelivered, following: int, beyond: int) -> Firmware[None]:
        """Hand a record to the log, and what the ledger had of its origin when it came."""
        head = _RECEIPT.pack(event.origin, event.number, following, beyond)
        place = yield from self.storage.store(head + event.record)
        if place is not None:
            self._waiting.append((place, event))

    def settle(self) -> Firmware[None]:
        """Have all of them on flash."""
        yield from self.storage.settle()

    def settled(self) -> Iterator[RecordDelivered]:
        """Return, once each, records that are on flash."""
        while self._waiting and self._waiting[0][0] <= self.storage.log.stored_sequence:
            yield self._waiting.popleft()[1]
