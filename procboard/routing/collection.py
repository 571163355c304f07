"""Collection: every record of every board to the base, over as many hops as it takes.

The Collection Tree Protocol (TEP 123; Gnawali et al., SenSys 2009) with acknowledgements from end
to end. Here: what passes through a board. `tree.py` chooses the next hop, `delivery.py` has the two
ends, `neighbours.py` the beacons.

- *Datapath validation.* A packet carries its sender's cost. One that is not above ours came by a
  route that does not exist any more, perhaps round a loop: beacons begin anew, and the packet waits
  until they are out.
- *Duplicates* of the last hop, whose acknowledgement was lost, are dropped by origin, number, hops
  and the origin's count of repeats: a record that the origin sends again is none.
- *Acknowledgements* go back the way that an origin's packets came, hop by hop, as far as it is
  remembered; one that gets lost is asked for by the record that is sent again.

Nothing here must work for records to arrive once, only for them to arrive. On an MSP430: 13 packets
of 30 octets, 16 keys of 10, 128 ways back of 4: 1.1 KB.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from procboard.errors import MessageTooLongError
from procboard.routing.delivery import WINDOW, Ledger, Origin, known_below
from procboard.routing.machine import Chance, Outgoing, earliest
from procboard.routing.neighbours import (
    BEACONS,
    BeaconHeard,
    NeighbourFound,
    NeighbourLost,
    Neighbours,
)
from procboard.routing.tree import ParentChanged, Tree
from radio_802154.errors import RemoteFrameError
from radio_802154.routing_messages import (
    ACK_AM,
    BEACON_AM,
    COLLECTION_ACK,
    COLLECTION_DATA,
    DATA_AM,
    MAX_RECORD_OCTETS,
    BeaconFlag,
    CollectionAck,
    CollectionData,
    split,
)

FORWARD_LIMIT: Final = 12
"""Others' packets that wait (CTP's forwarding pool); one of our own may wait beside them. What
finds no place is dropped, and its origin sends it again."""
ACK_LIMIT: Final = 8
"""Acknowledgements that wait; what finds no place is dropped, and asked for again."""
SEEN_LIMIT: Final = 16
"""Packets remembered; CTP has 4, for boards with fewer children."""
WAY_BACK_LIMIT: Final = 128
"""Origins whose way back is remembered; the one that was silent longest makes room."""
MAX_HOPS: Final = 32
"""A packet that has come so far goes round in circles."""
MAX_SENDS: Final = 8
"""Unicasts for a packet, of four attempts each: the 32 transmissions of CTP."""
MAX_ACK_SENDS: Final = 2
"""The same for an acknowledgement, which can be asked for again."""
RETRY_MS: Final = 64
"""A unicast that failed is repeated after one to two times this: longer than all the back-offs of
another's unicast (4 × 10 ms)."""
LOOP_PAUSE_MS: Final = 2 * BEACONS.minimum_ms
"""Nothing is sent for so long after a packet that came by a wrong route: the first beacon is out
within one shortest interval, the neighbours' answer within two."""
ACK_DELAY_MS: Final = 10_000
"""How long the base waits for more records of an origin before it acknowledges: one that samples
every 10 s is acknowledged every second time. Nobody is in a hurry, the record is on flash."""
ACK_SOON_MS: Final = 500
"""The same where the origin waits: half its window came, or a record came again."""


@dataclass(frozen=True, slots=True)
class RecordDelivered:
    """At the base: a record, for the first and only time; records of an origin in any order."""

    origin: int
    number: int
    record: bytes


@dataclass(frozen=True, slots=True)
class RecordsGone:
    """At the base: the origin's flash gave up records that had not come."""

    origin: int
    count: int


@dataclass(frozen=True, slots=True)
class RecordsAcknowledged:
    """At an origin: all records below are at the base; the flash may forget them."""

    below: int


@dataclass(frozen=True, slots=True)
class LedgerAhead:
    """At an origin: the base has records of it, below `following`, that it does not know.

    Its flash was cleared and its numbers begin anew, which they must not: what it stores is taken
    for old records. It has to number on from `following`.
    """

    following: int


CollectionEvent: TypeAlias = (
    RecordDelivered
    | RecordsGone
    | RecordsAcknowledged
    | LedgerAhead
    | ParentChanged
    | NeighbourFound
    | NeighbourLost
)


@dataclass(slots=True)
class CollectionStatistics:
    """Counted since the start."""

    forwarded: int = 0
    delivered: int = 0
    duplicates: int = 0
    """Dropped here: the last hop's repetition."""
    repeated: int = 0
    """At the base: records that had come before."""
    loops: int = 0
    """Packets whose sender's cost was not above ours."""
    queue_full: int = 0
    given_up: int = 0
    """Packets that no parent acknowledged, or that went too far."""
    acks_lost: int = 0
    """Acknowledgements given up, or without a way back."""
    refused: int = 0
    """At the base: records for which the ledger has no place."""
    bad_messages: int = 0


@dataclass(slots=True)
class _Record:
    """A record that waits for its next hop."""

    header: CollectionData
    record: bytes
    own: bool = False
    sends: int = 0


@dataclass(slots=True)
class _Ack:
    """An acknowledgement that waits for its next hop."""

    header: CollectionAck
    sends: int = 0


class Collection:
    """One board's part. `origin` and `ledger` are its ends; `base` makes it the root.

    Whoever drives it reads the record `wanted` from flash and hands it to `provide`, and reports
    the outcome of every unicast it `take`s before it takes another message.
    """

    def __init__(
        self,
        neighbours: Neighbours,
        chance: Chance,
        *,
        base: bool = False,
        origin: Origin | None = None,
        known: Mapping[int, tuple[int, int]] | None = None,
    ) -> None:
        self.neighbours = neighbours
        self.tree = Tree(neighbours, base=base)
        self.origin = origin or Origin(chance)
        self.ledger = Ledger(known)
        self.statistics = CollectionStatistics()
        self._address = neighbours.address
        self._chance = chance
        self._records: deque[_Record] = deque()
        self._acks: deque[_Ack] = deque()
        self._in_flight: _Record | _Ack | None = None
        self._paused_until_ms: int | None = None
        self._seen: deque[tuple[int, int, int, int]] = deque(maxlen=SEEN_LIMIT)
        self._way_back: dict[int, int] = {}
        self._ack_due_ms: dict[int, int] = {}
        self._unacknowledged: dict[int, int] = {}

    def start(self, now_ms: int) -> None:
        """Begin to beacon."""
        self.neighbours.start(now_ms)

    # What the application sees.

    @property
    def wanted(self) -> int | None:
        """The record to be read from flash and provided."""
        if self.tree.parent is None or any(packet.own for packet in self._records):
            return None
        return self.origin.wanted()

    def provide(self, number: int, record: bytes, now_ms: int) -> None:
        """Queue the record that was wanted.

        Raises:
            MessageTooLongError: the record has more than `MAX_RECORD_OCTETS`.

        """
        if len(record) > MAX_RECORD_OCTETS:
            raise MessageTooLongError(f"{len(record)} octets: {MAX_RECORD_OCTETS} fit a packet")
        origin = self.origin
        if number < origin.oldest:
            return  # acknowledged while it was read
        origin.sent(number, now_ms)
        behind = number - origin.oldest
        header = CollectionData(0, 0, self._address, number, origin.repeat, behind)
        self._records.append(_Record(header, record, own=True))

    # What the network sees.

    def receive(
        self, source: int, am_type: int, payload: bytes, rssi_dbm: int, now_ms: int
    ) -> list[CollectionEvent]:
        """Take a message of one of the three AM types."""
        if am_type == BEACON_AM:
            return self._receive_beacon(source, payload, rssi_dbm, now_ms)
        self.neighbours.heard(source, now_ms)
        try:
            if am_type == DATA_AM:
                header, record = split(COLLECTION_DATA, payload)
                return self._receive_data(source, header, record, now_ms)
            if am_type == ACK_AM:
                ack, rest = split(COLLECTION_ACK, payload)
                if not rest:
                    return self._receive_ack(ack, now_ms)
        except RemoteFrameError:
            pass
        self.statistics.bad_messages += 1
        return []

    def sent(
        self, message: Outgoing, attempts: int, acknowledged: bool, now_ms: int
    ) -> list[CollectionEvent]:
        """Take the outcome of a unicast; `attempts` are its transmissions."""
        packet, self._in_flight = self._in_flight, None
        self.neighbours.report(message.destination, attempts, acknowledged, now_ms)
        if packet is not None:
            packet.sends += 1
            if isinstance(packet, _Ack):
                self._ack_sent(packet, acknowledged)
            else:
                self._record_sent(packet, acknowledged)
        if not acknowledged:
            self._pause(RETRY_MS + self._chance.below(RETRY_MS), now_ms)
        return [*self.tree.update(now_ms)]

    def take(self, now_ms: int) -> Outgoing | None:
        """Return the next message: a beacon, an acknowledgement, a record; None while one flies."""
        if self._in_flight is not None:
            return None
        beacon = self.neighbours.take(now_ms)
        if beacon is not None:
            return beacon
        if self._paused_until_ms is not None and now_ms < self._paused_until_ms:
            return None
        while self._acks:
            ack = self._acks[0]
            back = self._way_back.get(ack.header.origin)
            if back is not None:
                self._in_flight = ack
                return Outgoing(back, ACK_AM, COLLECTION_ACK.encode(ack.header))
            self._acks.popleft()
            self.statistics.acks_lost += 1
        if self._records and self.tree.parent is not None:
            self._in_flight = packet = self._records[0]
            header = replace(packet.header, etx=self.tree.etx)
            payload = COLLECTION_DATA.encode(header) + packet.record
            return Outgoing(self.tree.parent, DATA_AM, payload)
        return None

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted."""
        return earliest(
            (
                self.neighbours.next_deadline(),
                self.origin.deadline_ms,
                self._paused_until_ms,
                *self._ack_due_ms.values(),
            )
        )

    def handle_timer(self, now_ms: int) -> list[CollectionEvent]:
        """Do what is due."""
        if self._paused_until_ms is not None and now_ms >= self._paused_until_ms:
            self._paused_until_ms = None
        self.origin.expire(now_ms)
        for origin in [o for o, due_ms in self._ack_due_ms.items() if now_ms >= due_ms]:
            del self._ack_due_ms[origin], self._unacknowledged[origin]
            following, beyond = self.ledger.entries[origin]
            self._queue_ack(CollectionAck(origin, 0, following, beyond))
        lost = [e for e in self.neighbours.handle_timer(now_ms) if isinstance(e, NeighbourLost)]
        return [*lost, *(self.tree.update(now_ms) if lost else ())]

    # What came.

    def _receive_beacon(
        self, source: int, payload: bytes, rssi_dbm: int, now_ms: int
    ) -> list[CollectionEvent]:
        events: list[CollectionEvent] = []
        for event in self.neighbours.receive(source, payload, rssi_dbm, now_ms):
            if not isinstance(event, BeaconHeard):
                events.append(event)
            elif event.beacon.flags & BeaconFlag.PULL and self.tree.has_route:
                self.neighbours.hurry(now_ms)
        events += self.tree.update(now_ms)
        return events

    def _receive_data(
        self, source: int, header: CollectionData, record: bytes, now_ms: int
    ) -> list[CollectionEvent]:
        key = (header.origin, header.number, header.hops, header.repeat)
        if key in self._seen:
            self.statistics.duplicates += 1
            return []
        self._seen.append(key)
        self._way_back.pop(header.origin, None)
        self._way_back[header.origin] = source
        if len(self._way_back) > WAY_BACK_LIMIT:
            del self._way_back[next(iter(self._way_back))]
        if self.tree.base:
            return self._deliver(header, record, now_ms)
        if header.etx <= self.tree.etx:
            self.statistics.loops += 1
            if self.neighbours.hurry(now_ms):  # not again and again, or nothing would ever go
                self._pause(LOOP_PAUSE_MS, now_ms)
        if header.hops + 1 >= MAX_HOPS or header.origin == self._address:
            self.statistics.given_up += 1
        elif sum(not packet.own for packet in self._records) >= FORWARD_LIMIT:
            self.statistics.queue_full += 1
        else:
            self._records.append(_Record(replace(header, hops=header.hops + 1), record))
        return []

    def _deliver(self, header: CollectionData, record: bytes, now_ms: int) -> list[CollectionEvent]:
        origin = header.origin
        taken = self.ledger.take(origin, header.number, header.behind)
        if taken is None:
            self.statistics.refused += 1
            return []
        fresh = self._unacknowledged[origin] = self._unacknowledged.get(origin, 0) + 1
        waits = not taken.new or fresh >= WINDOW // 2
        due_ms = now_ms + (ACK_SOON_MS if waits else ACK_DELAY_MS)
        self._ack_due_ms[origin] = min(due_ms, self._ack_due_ms.get(origin, due_ms))
        events: list[CollectionEvent] = []
        if taken.gone:
            events.append(RecordsGone(origin, taken.gone))
        if taken.new:
            self.statistics.delivered += 1
            events.append(RecordDelivered(origin, header.number, record))
        else:
            self.statistics.repeated += 1
        return events

    def _receive_ack(self, ack: CollectionAck, now_ms: int) -> list[CollectionEvent]:
        if ack.origin != self._address:
            if ack.hops + 1 < MAX_HOPS:
                self._queue_ack(replace(ack, hops=ack.hops + 1))
            return []
        origin = self.origin
        before = origin.oldest
        if not origin.acknowledge(ack.next, ack.beyond, now_ms):
            return [LedgerAhead(known_below(ack.next, ack.beyond))]
        return [RecordsAcknowledged(origin.oldest)] if origin.oldest > before else []

    # What waits.

    def _queue_ack(self, ack: CollectionAck) -> None:
        """Queue an acknowledgement in place of an older one for the same origin."""
        for waiting in self._acks:
            if waiting.header.origin == ack.origin and waiting is not self._in_flight:
                waiting.header = ack
                return
        if len(self._acks) < ACK_LIMIT:
            self._acks.append(_Ack(ack))
        else:
            self.statistics.acks_lost += 1

    def _ack_sent(self, ack: _Ack, acknowledged: bool) -> None:
        if acknowledged or ack.sends >= MAX_ACK_SENDS:
            self._acks.popleft()
            self.statistics.acks_lost += not acknowledged

    def _record_sent(self, packet: _Record, acknowledged: bool) -> None:
        if acknowledged or packet.sends >= MAX_SENDS:
            self._records.popleft()
            self.statistics.given_up += not acknowledged
            self.statistics.forwarded += acknowledged and not packet.own

    def _pause(self, duration_ms: int, now_ms: int) -> None:
        until_ms = now_ms + duration_ms
        if self._paused_until_ms is None or until_ms > self._paused_until_ms:
            self._paused_until_ms = until_ms
