"""Sharing: small items from every board to every board, through losses and partitions.

Anti-entropy (Demers et al., PODC 1987) timed by Trickle, as Drip and DIP do (Lin and Levis, IPSN
2008). Every origin numbers its items 1, 2, …; a board has all of them up to some number, so a
number an origin says what it has. A board tells by Trickle a digest of all these numbers and six of
them: those that changed or differed last, and others in turn. Who hears another digest is not in
step, and both begin to tell at the shortest interval; who hears a lower number than its own sends
what is missing; who hears a higher one tells its own number soon, which is how it asks. A new item
goes out at once.

Answers wait a random while and are dropped when somebody else has given them, so a crowd answers as
a few would. An answer is at most a burst of `BURST` items; items within as much of the last are
taken in any order, each once.

The items themselves lie with the application (on flash): this machine asks for one when it is its
turn. They must be kept for as long as boards may come that lack them. On an MSP430: 9 octets an
origin, 1.2 KB.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from procboard.errors import MessageTooLongError
from procboard.routing.delivery import settled
from procboard.routing.machine import BROADCAST, Chance, Outgoing, earliest
from procboard.routing.trickle import Trickle, TrickleConfig
from radio_802154.errors import RemoteFrameError
from radio_802154.routing_messages import (
    ITEM_AM,
    MAX_ITEM_OCTETS,
    MAX_VERSIONS,
    SHARED_ITEM,
    VERSIONS_AM,
    SharedItem,
    Version,
    decode_versions,
    encode_versions,
    split,
)

ORIGIN_LIMIT: Final = 128
"""Origins whose items are kept; those of others are neither taken nor passed on."""
LAST_NUMBER: Final = 0xFFFF
"""Items that an origin can have in a mission."""
VERSIONS_TRICKLE: Final = TrickleConfig(256, 7, 2)
"""From 256 ms, in which a few answers find room, to 33 s; k = 2, as one message alone may be lost
(our choice)."""
BURST: Final = 8
"""Items an answer has at most, and how far ahead of a gap items are taken (a bit each)."""
ANSWER_MS: Final = 128
"""An answer waits up to so long, half the shortest interval, for somebody else's."""
ITEM_GAP_MS: Final = 16
"""Between the items of a burst there are one to two times this: the time of two frames with their
back-offs, so that others can speak."""
NEWS: Final = MAX_VERSIONS // 2
"""Entries of a message for what changed last; the rest goes round."""


@dataclass(frozen=True, slots=True)
class ItemReceived:
    """An item of another board, once; those of an origin may come out of order."""

    origin: int
    number: int
    item: bytes


@dataclass(slots=True)
class SharingStatistics:
    """Counted since the start."""

    items_sent: int = 0
    items_received: int = 0
    duplicates: int = 0
    beyond: int = 0
    """Items too far ahead of a gap."""
    refused: int = 0
    """Items of origins for which there is no place."""
    bad_messages: int = 0


def mixed(origin: int, number: int) -> int:
    """Return 32 bits that depend on all of both: the finaliser of MurmurHash3; 0 for no item."""
    x = (origin << 16 | number) if number else 0
    x = (x ^ x >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    x = (x ^ x >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return x ^ x >> 16


class Sharing:
    """One board's part. `versions` is what it has; after a reset, what its flash has."""

    def __init__(
        self, address: int, chance: Chance, versions: Mapping[int, int] | None = None
    ) -> None:
        self.address = address
        self.statistics = SharingStatistics()
        self.versions = {address: 0} | dict(versions or {})
        """By origin, the one that changed or differed longest ago first."""
        self.heard_ms: dict[int, int] = {}
        """When the last new item of an origin came; a board that lives shares something."""
        self._digest = sum(mixed(o, n) for o, n in self.versions.items()) & 0xFFFFFFFF
        self._beyond: dict[int, int] = {}
        self._chance = chance
        self._trickle = Trickle(VERSIONS_TRICKLE, chance)
        self._tells = False
        self._turn = 0
        self._asked: dict[int, tuple[int, int]] = {}  # origin: first and last item to send
        self._answer_ms: int | None = None
        self._ready: tuple[int, int] | None = None
        self._item: bytes | None = None

    def start(self, now_ms: int) -> None:
        """Begin to tell what this board has."""
        self._trickle.start(now_ms)

    # What the application sees.

    def publish(self, now_ms: int) -> int:
        """Return the number of a new item of this board, which the application now holds.

        Raises:
            ValueError: the board has shared all it can.

        """
        number = self.versions[self.address] + 1
        if number > LAST_NUMBER:
            raise ValueError(f"all {LAST_NUMBER} items are used up")
        self._set_version(self.address, number)
        self._ask(self.address, number, number, now_ms, 1)
        self._trickle.inconsistent(now_ms)
        return number

    @property
    def wanted(self) -> tuple[int, int] | None:
        """Origin and number of the item to be read and provided."""
        return self._ready if self._item is None else None

    def provide(self, origin: int, number: int, item: bytes) -> None:
        """Hand over the item that was wanted.

        Raises:
            MessageTooLongError: it has more than `MAX_ITEM_OCTETS`.

        """
        if len(item) > MAX_ITEM_OCTETS:
            raise MessageTooLongError(f"{len(item)} octets: an item has {MAX_ITEM_OCTETS} at most")
        if self._ready == (origin, number):  # nobody else has sent it meanwhile
            self._item = item

    def decline(self, origin: int, number: int, now_ms: int) -> None:
        """Take note that the item that was wanted cannot be read; another board may have it."""
        if self._ready == (origin, number):
            self._settle(origin, number, now_ms)

    # What the network sees.

    def receive(
        self, source: int, am_type: int, payload: bytes, rssi_dbm: int, now_ms: int
    ) -> list[ItemReceived]:
        """Take a message of one of the two AM types."""
        try:
            if am_type == VERSIONS_AM:
                self._compare(*decode_versions(payload), now_ms)
                return []
            if am_type == ITEM_AM:
                header, item = split(SHARED_ITEM, payload)
                if header.number and len(item) <= MAX_ITEM_OCTETS:
                    return self._take_in(header.origin, header.number, item, now_ms)
        except RemoteFrameError:
            pass
        self.statistics.bad_messages += 1
        return []

    def take(self, now_ms: int) -> Outgoing | None:
        """Return the next message, a broadcast: an item, or what this board has."""
        if self._ready is not None and self._item is not None:
            origin, number = self._ready
            payload = SHARED_ITEM.encode(SharedItem(origin, number)) + self._item
            self._settle(origin, number, now_ms)
            self.statistics.items_sent += 1
            return Outgoing(BROADCAST, ITEM_AM, payload)
        if self._tells:
            self._tells = False
            return Outgoing(BROADCAST, VERSIONS_AM, encode_versions(self._digest, self._told()))
        return None

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted."""
        return earliest((self._trickle.next_deadline(), self._answer_ms))

    def handle_timer(self, now_ms: int) -> None:
        """Do what is due."""
        if self._trickle.handle_timer(now_ms):
            self._tells = True
        if self._answer_ms is not None and now_ms >= self._answer_ms:
            self._answer_ms = None
            if self._ready is None and self._asked:
                origin = next(iter(self._asked))
                self._ready = origin, self._asked[origin][0]

    # What others have.

    def _compare(self, digest: int, theirs: list[Version], now_ms: int) -> None:
        in_step = digest == self._digest
        for entry in theirs:
            ours = self.versions.get(entry.origin, 0)
            if entry.number == ours:
                continue
            in_step = False
            if entry.number < ours:
                last = min(ours, entry.number + BURST)
                self._ask(entry.origin, entry.number + 1, last, now_ms, ANSWER_MS)
            elif entry.origin not in self.versions and len(self.versions) >= ORIGIN_LIMIT:
                self.statistics.refused += 1
                continue
            self._touch(entry.origin)
        if in_step:
            self._trickle.consistent()
        else:
            self._trickle.inconsistent(now_ms)

    def _take_in(self, origin: int, number: int, item: bytes, now_ms: int) -> list[ItemReceived]:
        self._settle(origin, number, now_ms)
        if origin not in self.versions and len(self.versions) >= ORIGIN_LIMIT:
            self.statistics.refused += 1
            return []
        have = self.versions.get(origin, 0)
        place = number - have - 1
        bits = self._beyond.get(origin, 0) << 1
        if place < 0 or bits >> place & 1:
            self.statistics.duplicates += 1
            return []
        self._trickle.inconsistent(now_ms)
        if place > BURST:
            self.statistics.beyond += 1
            self._touch(origin)
            return []
        following, self._beyond[origin] = settled(have + 1, bits | 1 << place)
        self._set_version(origin, following - 1)
        self.heard_ms[origin] = now_ms
        self.statistics.items_received += 1
        return [ItemReceived(origin, number, item)]

    # What goes.

    def _ask(self, origin: int, first: int, last: int, now_ms: int, within_ms: int) -> None:
        """Let items be sent, a random while from now."""
        before = self._asked.get(origin, (first, last))
        self._asked[origin] = min(first, before[0]), max(last, before[1])
        self._schedule(now_ms, within_ms)

    def _schedule(self, from_ms: int, within_ms: int) -> None:
        if self._asked and self._answer_ms is None and self._ready is None:
            self._answer_ms = from_ms + self._chance.below(within_ms)

    def _settle(self, origin: int, number: int, now_ms: int) -> None:
        """Strike an item from what is to be sent: it was, by this board or another."""
        if self._ready == (origin, number):
            self._ready = self._item = None
        first, last = self._asked.get(origin, (0, 0))
        if first == number:
            if number < last:
                self._asked[origin] = number + 1, last
            else:
                del self._asked[origin]
        self._schedule(now_ms + ITEM_GAP_MS, ITEM_GAP_MS)

    def _told(self) -> list[Version]:
        """Return the versions for one message: news first, then others in turn."""
        order = list(self.versions)
        news = order[-NEWS:]
        others = order[: len(order) - len(news)]
        count = min(len(others), MAX_VERSIONS - len(news))
        first = self._turn % len(others) if others else 0
        self._turn = first + count
        news += [others[(first + n) % len(others)] for n in range(count)]
        return [Version(origin, self.versions[origin]) for origin in news]

    def _set_version(self, origin: int, number: int) -> None:
        change = mixed(origin, number) - mixed(origin, self.versions.get(origin, 0))
        self._digest = (self._digest + change) & 0xFFFFFFFF
        self.versions[origin] = number
        self._touch(origin)

    def _touch(self, origin: int) -> None:
        """Make an origin's version the first to be told."""
        self.versions[origin] = self.versions.pop(origin, 0)
