"""Neighbours: who is there, and how many transmissions a frame to each takes (ETX).

After TEP 124 (beacons with sequence numbers carry how well others are heard) and the four-bit
estimator of Fonseca et al. (HotNets 2007), whose bits are here:

- *ack*: attempts and acknowledgements of unicasts. They are the truth about both directions, so
  where there were some lately, beacons are not asked. (The four-bit estimator averages the two
  kinds of sample; on an asymmetric link they disagree for ever.)
- *white*: a full table takes in only who is heard at a level at which links are good.
- *compare*: and only one whose route is better than the worst in the table.
- *pin*: the parent is never thrown out.

ETX = 1 / (p_in p_out) (De Couto et al., MobiCom 2003): p_in counted here, p_out told by the
neighbour's beacons; until it has told, both are taken to be equal. Quantities are what an MSP430
has: integers, p in 255ths, ETX in sixteenths. An entry is 26 octets there, the table 416.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

from procboard.routing.machine import BROADCAST, NOBODY, Chance, Outgoing
from procboard.routing.trickle import Trickle, TrickleConfig
from radio_802154.errors import RemoteFrameError
from radio_802154.routing_messages import (
    BEACON_AM,
    MAX_LINK_QUALITIES,
    Beacon,
    BeaconFlag,
    LinkQuality,
    decode_beacon,
    encode_beacon,
)

ETX_ONE: Final = 16
"""One transmission."""
NO_ROUTE: Final = 0xFFFF
"""ETX of a board without a way to the base."""
MAX_LINK_ETX: Final = 32 * ETX_ONE
"""Worse is all the same [1/16]: the most transmissions that CTP gives one frame (32)."""

TABLE_LIMIT: Final = 16
"""Neighbours kept; TinyOS has 10, 16 fit its routing table's search in a shoal."""
BEACONS: Final = TrickleConfig(128, 7, None)
"""128 ms as CTP in TinyOS (CollectionC), which goes up to 512 s; here to 16.4 s, because robots
swim and a dead one is to be noticed."""
LOST_MS: Final = 120_000
"""Silence after which a neighbour is gone: seven beacons at the longest interval. At 30 % loss
0.3^7 = 0.02 % of all beacons begin such a silence: one neighbour that lives in 20 hours."""
BEACON_WINDOW: Final = 3
"""Beacons for one sample of p_in, those missed included (BLQ_PKT_WINDOW, TinyOS 4bitle, counts
those that came: a window that ends with a success is too hopeful)."""
UNICAST_WINDOW: Final = 5
"""Attempts for one sample of ETX (k_u = 5 of Fonseca et al.; DLQ_PKT_WINDOW)."""
MAX_SEQUENCE_GAP: Final = 10
"""Beacons missed in a row after which counting begins anew (MAX_PKT_GAP, TinyOS 4bitle)."""
BEACON_SHIFT: Final = 2
"""A sample weighs 1/4: a window takes up to 49 s, and robots swim. TinyOS: 1/10."""
UNICAST_SHIFT: Final = 3
"""A sample weighs 1/8: the power of two next to TinyOS's 1/10."""
UNICAST_FRESH_MS: Final = 120_000
"""How long unicasts speak for a link: as long as about two windows of beacons."""
WHITE_DBM: Final = -87
"""From here on links of CC2420s are good (Srinivasan and Levis, EmNets 2006)."""
COMPARE_MARGIN: Final = ETX_ONE // 2
"""By how much a newcomer must be nearer to the base than the worst entry [1/16]: half a hop over a
perfect link, so that the base itself always finds a place."""
EVICT_ETX: Final = 104
"""A link of 6.5 transmissions [1/16] gives way to anybody (EVICT_EETX_THRESHOLD 55, which counts
tenths beyond the first, TinyOS 4bitle)."""


@dataclass(frozen=True, slots=True)
class NeighbourFound:
    """A link has its first estimate."""

    address: int


@dataclass(frozen=True, slots=True)
class NeighbourLost:
    """Nothing was heard for `LOST_MS`, or the table needed the place (`evicted`)."""

    address: int
    evicted: bool


@dataclass(frozen=True, slots=True)
class BeaconHeard:
    """A beacon came; `kept` says whether its sender is in the table."""

    address: int
    beacon: Beacon
    kept: bool


NeighbourEvent: TypeAlias = NeighbourFound | NeighbourLost | BeaconHeard


@dataclass(slots=True)
class Neighbour:
    """What is known of one; p in 255ths, ETX in sixteenths, 0 where nothing is known."""

    address: int
    sequence: int
    heard_ms: int
    rssi_dbm: int
    parent: int = NOBODY
    etx: int = NO_ROUTE
    """Its own way to the base."""
    inbound: int = 0
    outbound: int = 0
    unicast_etx: int = 0
    unicast_ms: int = 0
    received: int = 0
    expected: int = 0
    attempts: int = 0
    acknowledged: int = 0
    pinned: bool = False

    @property
    def mature(self) -> bool:
        """Whether there is an estimate."""
        return bool(self.inbound or self.unicast_etx)

    def link_etx(self, now_ms: int) -> int:
        """Transmissions to it [1/16]; `MAX_LINK_ETX` while nothing is known."""
        if self.unicast_etx and (now_ms - self.unicast_ms <= UNICAST_FRESH_MS or not self.inbound):
            return self.unicast_etx
        both = self.inbound * (self.outbound or self.inbound)
        if not both:
            return MAX_LINK_ETX
        return min((ETX_ONE * 255 * 255 + both // 2) // both, MAX_LINK_ETX)

    def path_etx(self, now_ms: int) -> int:
        """Transmissions to the base by way of it [1/16]; `NO_ROUTE` where it has none."""
        if self.etx == NO_ROUTE:
            return NO_ROUTE
        return min(self.etx + self.link_etx(now_ms), NO_ROUTE)

    def count_beacon(self, sequence: int) -> None:
        """Take a beacon's number into p_in."""
        gap = (sequence - self.sequence) & 0xFF
        self.sequence = sequence
        if not gap or gap > MAX_SEQUENCE_GAP + 1:  # it rebooted, or was away
            self.received = self.expected = 0
            return
        for missed in range(gap - 1, -1, -1):
            self.received += not missed
            self.expected += 1
            if self.expected == BEACON_WINDOW:
                sample = 255 * self.received // BEACON_WINDOW
                self.inbound = _averaged(self.inbound, sample, BEACON_SHIFT) or 1
                self.received = self.expected = 0

    def count_unicast(self, attempts: int, acknowledged: bool, now_ms: int) -> None:
        """Take a unicast's outcome into the ETX; without any success the failures add up."""
        self.attempts += attempts
        self.acknowledged += acknowledged
        if self.attempts < UNICAST_WINDOW:
            return
        sample = ETX_ONE * self.attempts // max(self.acknowledged, 1)
        before = self.link_etx(now_ms) if self.mature else 0
        self.unicast_etx = _averaged(before, min(sample, MAX_LINK_ETX), UNICAST_SHIFT)
        self.unicast_ms = now_ms
        if self.acknowledged:
            self.attempts = self.acknowledged = 0


def _averaged(mean: int, sample: int, shift: int) -> int:
    """Return the exponential average in whole numbers; rounded, so that it can reach the sample."""
    if not mean:
        return sample
    change = sample - mean
    step = (abs(change) + (1 << shift) - 1) >> shift
    return mean + step if change > 0 else mean - step


class Neighbours:
    """The table and the beacons of one board. Whoever routes sets `route` and `parent`."""

    def __init__(self, address: int, chance: Chance) -> None:
        self.address = address
        self.route = (NOBODY, NO_ROUTE)
        """Parent and ETX that beacons tell."""
        self.table: dict[int, Neighbour] = {}
        self.refused = 0
        """Beacons of boards that a full table did not take in."""
        self.bad_messages = 0
        self._trickle = Trickle(BEACONS, chance)
        self._due = False
        self._sequence = chance.below(256)
        self._told = 0  # index of the next link quality to tell

    def start(self, now_ms: int) -> None:
        """Begin to say that this board is there."""
        self._trickle.start(now_ms)

    def hurry(self, now_ms: int) -> bool:
        """Begin beaconing anew, as there is something to say; return whether it was not so yet."""
        return self._trickle.inconsistent(now_ms)

    def receive(
        self, source: int, payload: bytes, rssi_dbm: int, now_ms: int
    ) -> list[NeighbourEvent]:
        """Take a beacon."""
        try:
            beacon, qualities = decode_beacon(payload)
        except RemoteFrameError:
            self.bad_messages += 1
            return []
        events: list[NeighbourEvent] = []
        neighbour = self.table.get(source)
        if neighbour is None:
            neighbour = Neighbour(source, beacon.sequence, now_ms, rssi_dbm)
            if not self._make_room(beacon, rssi_dbm, now_ms, events):
                self.refused += 1
                events.append(BeaconHeard(source, beacon, kept=False))
                return events
            self.table[source] = neighbour
        known = neighbour.mature
        neighbour.count_beacon(beacon.sequence)
        neighbour.heard_ms = now_ms
        neighbour.rssi_dbm += (rssi_dbm - neighbour.rssi_dbm) // 4
        neighbour.parent, neighbour.etx = beacon.parent, beacon.etx
        for quality in qualities:
            if quality.neighbour == self.address:
                neighbour.outbound = quality.inbound
        if neighbour.mature and not known:
            events.append(NeighbourFound(source))
        events.append(BeaconHeard(source, beacon, kept=True))
        return events

    def heard(self, source: int, now_ms: int) -> None:
        """Some other frame of a board came: it lives."""
        neighbour = self.table.get(source)
        if neighbour is not None:
            neighbour.heard_ms = now_ms

    def report(self, destination: int, attempts: int, acknowledged: bool, now_ms: int) -> None:
        """Take the outcome of a unicast; `attempts` are transmissions, 0 on a busy channel."""
        neighbour = self.table.get(destination)
        if neighbour is not None and attempts:
            neighbour.count_unicast(attempts, acknowledged, now_ms)
            if acknowledged:
                neighbour.heard_ms = now_ms

    def pin(self, address: int) -> None:
        """Keep this one, and none else, whatever comes."""
        for neighbour in self.table.values():
            neighbour.pinned = neighbour.address == address

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted."""
        return self._trickle.next_deadline()

    def handle_timer(self, now_ms: int) -> list[NeighbourEvent]:
        """Beacon, and look who has been silent too long: at every deadline, so once a beacon."""
        if self._trickle.handle_timer(now_ms):
            self._due = True
        silent = [n.address for n in self.table.values() if now_ms - n.heard_ms > LOST_MS]
        for address in silent:
            del self.table[address]
        return [NeighbourLost(address, evicted=False) for address in silent]

    def take(self, now_ms: int) -> Outgoing | None:
        """Return the beacon that is due."""
        if not self._due:
            return None
        self._due = False
        self._sequence = (self._sequence + 1) & 0xFF
        parent, etx = self.route
        flags = BeaconFlag.PULL if etx == NO_ROUTE else 0
        beacon = Beacon(self._sequence, flags, parent, etx)
        return Outgoing(BROADCAST, BEACON_AM, encode_beacon(beacon, self._qualities()))

    def _qualities(self) -> list[LinkQuality]:
        """Return link qualities for one beacon: those that have waited longest."""
        known = [n for n in self.table.values() if n.inbound]
        count = min(len(known), MAX_LINK_QUALITIES)
        first = self._told % len(known) if known else 0
        self._told = first + count
        chosen = (known[(first + n) % len(known)] for n in range(count))
        return [LinkQuality(n.address, n.inbound) for n in chosen]

    def _make_room(
        self, beacon: Beacon, rssi_dbm: int, now_ms: int, events: list[NeighbourEvent]
    ) -> bool:
        """Have a place for a newcomer, if need be that of the worst; return whether there is one.

        It is worth one when it is heard well (white) and either the link to the worst entry is bad
        or its own way to the base is shorter than that entry's (compare). The worst is the end of
        the longest way; a link without an estimate counts as perfect, or newcomers would push one
        another out before they have one.
        """
        if len(self.table) < TABLE_LIMIT:
            return True
        worst = max(
            (n for n in self.table.values() if not n.pinned),
            key=lambda n: (n.etx + (n.link_etx(now_ms) if n.mature else ETX_ONE), n.address),
        )
        bad = worst.mature and worst.link_etx(now_ms) >= EVICT_ETX
        if rssi_dbm < WHITE_DBM or not (bad or beacon.etx + COMPARE_MARGIN < worst.etx):
            return False
        del self.table[worst.address]
        events.append(NeighbourLost(worst.address, evicted=True))
        return True
