"""The routing controller: the state machines of this package on a board, with its radio and flash.

What the radio receives goes to the machines at once; what follows (flash, the application) is done
by one task, in order. The same task sends. It has one place in the radio's queue, and machines are
asked for a message only when the last one is out: what has to wait does so with them, and is up to
date when it goes.

Order makes it safe. A record or an item of this board is on flash before anybody hears of it. The
base has a record on flash before it acknowledges it. What came and cannot be kept is not taken: a
MAC acknowledgement promises nothing, and it comes again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from firmware_model.cpu import Cpu, Flag
from procboard.alarms import ARM_CYCLES, TICKS_PER_S, Alarms
from procboard.coroutines import Firmware, Lock
from procboard.drivers.cc2420 import Stamp
from procboard.errors import MessageTooLongError, ProcConfigError
from procboard.network import Network, RandomMlcg, Received, SendStatus, Sent
from procboard.routing.collection import (
    Collection,
    CollectionEvent,
    LedgerAhead,
    RecordDelivered,
)
from procboard.routing.config import EVENT_LIMIT, RoutingConfig
from procboard.routing.delivery import Origin
from procboard.routing.duty import Duty, error_bound
from procboard.routing.machine import BROADCAST, Outgoing, earliest
from procboard.routing.neighbours import Neighbours
from procboard.routing.sharing import ItemReceived, Sharing
from procboard.routing.stores import ItemStore, ReceiptStore, RecordStore
from procboard.routing.time_sync import RootChanged, TimeSync
from procboard.storage_controller import StorageController
from radio_802154.routing_messages import (
    ACK_AM,
    BEACON_AM,
    DATA_AM,
    ITEM_AM,
    MAX_ITEM_OCTETS,
    MAX_RECORD_OCTETS,
    TIME_AM,
    TIME_OFFSET,
    VERSIONS_AM,
)

RECEIVE_CYCLES: Final = {
    BEACON_AM: 1_500,
    DATA_AM: 700,
    ACK_AM: 400,
    VERSIONS_AM: 6_500,
    ITEM_AM: 1_500,
    TIME_AM: 8_000,
}
"""Taking a message in, estimated from what is looked through at 8 cycles a place: a beacon's sender
and then all routes in a table of 16, with 60 cycles an entry for its ETX; 16 keys of packets and
128 ways back; 8 acknowledgements; six versions, each among 128; one, and the bits beyond it; eight
pairs, with 64-bit products of 100 cycles and a division of 2000."""
TIMER_CYCLES: Final = 300
"""Looking at the deadlines of all machines: about 100 instructions (estimate)."""
SEND_CYCLES: Final = 500
"""Asking the machines and filling a message: about 150 instructions (estimate)."""
DUTY_CYCLES: Final = 400
"""The shared time and what it says of the radio: about 120 instructions (estimate)."""
EVENT_CYCLES: Final = 60
"""Handing an event on: about 20 instructions (estimate)."""

LOAD_POLL_US: Final = 20_000
"""How often a task looks whether the flash has been read: 0.1 to 4 s after the boot."""

RoutingEvent: TypeAlias = CollectionEvent | ItemReceived | RootChanged
EventHandler: TypeAlias = Callable[[Any], Firmware[None]]


@dataclass(slots=True)
class RoutingStatistics:
    """Counted since the last boot; the machines count for themselves."""

    busy: int = 0
    """Records and items that came and were not taken: too much waited, or the flash is full."""
    unreadable: int = 0
    """Records and items that the flash had no more when they were wanted."""
    renumbered: int = 0
    """Times that this board's records got new numbers (`LedgerAhead`)."""


@dataclass(frozen=True, slots=True)
class _Receipt:
    """At the base: a record that came, and what the ledger had of its origin then."""

    event: RecordDelivered
    following: int
    beyond: int


class Routing:
    """The network layer of a running board. `start` at every boot, when all handlers are there.

    Events: `RecordDelivered` at the base, once, when the record is on its flash; `ItemReceived`
    for others' items, and after a reset for all that were kept, this board's own among them; those
    of `collection.py` and `neighbours.py` as they happen.
    """

    def __init__(
        self,
        cpu: Cpu,
        alarms: Alarms,
        network: Network,
        boot: int,
        config: RoutingConfig,
        records: StorageController,
        items: StorageController,
    ) -> None:
        self.statistics = RoutingStatistics()
        self.address = network.config.address
        self.ready = False
        """Whether the flash has been read and the machines run."""
        self._cpu = cpu
        self._alarms = alarms
        self._network = network
        self._config = config
        self._chance = chance = RandomMlcg((self.address + 1) * 65_599 + (boot << 16) + 1)
        chance.below(2)  # neighbouring seeds give neighbouring first numbers
        self._records = RecordStore(records)
        self._receipts = ReceiptStore(records) if config.base else None
        self._items = ItemStore(items, config.item_limit)
        records.log.on_stored = self._records_stored
        items.log.on_stored = self._items_stored
        self.neighbours = Neighbours(self.address, chance)
        self.collection = Collection(self.neighbours, chance, base=config.base)
        self.sharing = Sharing(self.address, chance)
        self.time = TimeSync(self.address, chance)
        self._handlers: dict[type, EventHandler] = {}
        self._events: deque[RoutingEvent | _Receipt] = deque()
        self._wake = Flag("routing: something to do")
        self._sharing_lock = Lock("routing: an item's number")
        self._shared = 0  # number of this board's last item, stored or about to be
        self._in_queue = False  # a message of ours is with the network
        self._turn = 0

    # --- what an application uses -----------------------------------------------------

    def on(self, event_class: type, handler: EventHandler) -> None:
        """Hand events of a class to a sub-routine of routing's task."""
        self._handlers[event_class] = handler

    def record(self, record: bytes) -> Firmware[int | None]:
        """Store a record that shall come to the base; return its number, None where it is lost.

        Raises:
            MessageTooLongError: it has more than `MAX_RECORD_OCTETS`.
            ProcConfigError: this is the base, where records come to.

        """
        if self._receipts is not None:
            raise ProcConfigError("the base stores what comes; it has no records of its own")
        if len(record) > MAX_RECORD_OCTETS:
            raise MessageTooLongError(f"{len(record)} octets: {MAX_RECORD_OCTETS} fit a packet")
        return (yield from self._records.storage.store(record))

    def share(self, item: bytes) -> Firmware[int | None]:
        """Store an item for all boards; return its number, None where there is no room for it.

        Raises:
            MessageTooLongError: it has more than `MAX_ITEM_OCTETS`.

        """
        if len(item) > MAX_ITEM_OCTETS:
            raise MessageTooLongError(f"{len(item)} octets: an item has {MAX_ITEM_OCTETS} at most")
        while not self.ready:  # the number of its last item is on flash
            yield from self._alarms.sleep_us(LOAD_POLL_US)
        yield from self._sharing_lock.acquire()
        try:
            if self._items.full:
                return None
            number = self._shared + 1
            if (yield from self._items.store(self.address, number, item)) is None:
                return None
            self._shared = number
            return number
        finally:
            self._sharing_lock.release()

    def now_ms(self) -> int:
        """Return milliseconds since the boot: what the machines count in."""
        return self._alarms.now() * 1_000 // TICKS_PER_S

    def global_ticks(self) -> int | None:
        """Return the time that all boards share, ticks modulo 2^32; None before it is known."""
        return self.time.to_global(self._alarms.now()) if self.time.synchronised else None

    @property
    def heard_ms(self) -> dict[int, int]:
        """When the last new item of each board came, by `now_ms`: who is alive shares something."""
        return self.sharing.heard_ms

    # --- the task -----------------------------------------------------------------------

    def start(self) -> None:
        """Begin."""
        self._cpu.spawn("routing", self._run())

    def _run(self) -> Firmware[None]:
        yield from self._load()
        now_ms = self.now_ms()
        self.collection.start(now_ms)
        self.sharing.start(now_ms)
        self.time.start(now_ms)
        for am_type in RECEIVE_CYCLES:
            self._network.on(am_type, self._receive)
        self.ready = True
        self._records_stored(self._records.log.stored_sequence)
        if self._config.duty is not None:
            self._cpu.spawn("duty cycle", self._duty_cycle(Duty(self.address, self._config.duty)))
        while True:
            yield TIMER_CYCLES
            self._timers()
            yield from self._handle_events()
            yield from self._look_after_records()
            ready = self._network.sends and not self._in_queue
            if ready and (yield from self._send()):
                continue
            if self._events:
                continue
            deadline_ms = earliest(
                (
                    self.collection.next_deadline(),
                    self.sharing.next_deadline(),
                    self.time.next_deadline(),
                )
            )
            assert deadline_ms is not None  # Trickle never ends
            alarm = self._alarms.at(-(-deadline_ms * TICKS_PER_S // 1_000), self._wake)
            yield ARM_CYCLES
            yield self._wake
            self._alarms.cancel(alarm)

    def _load(self) -> Firmware[None]:
        """Read from flash what has to outlive a reset."""
        chance, neighbours = self._chance, self.neighbours
        if self._receipts is not None:
            known = yield from self._receipts.load()
            self.collection = Collection(neighbours, chance, base=True, known=known)
        else:
            oldest, newest = yield from self._records.load()
            self.collection = Collection(neighbours, chance, origin=Origin(chance, oldest, newest))
        kept = yield from self._items.load()
        versions = self._items.versions()
        self._shared = versions.get(self.address, 0)
        self.sharing = Sharing(self.address, chance, versions)
        for origin, number, item in kept:
            yield from self._tell(ItemReceived(origin, number, item))

    def _timers(self) -> None:
        now_ms = self.now_ms()
        self._events += self.collection.handle_timer(now_ms)
        self._events += self.time.handle_timer(now_ms)
        self.sharing.handle_timer(now_ms)

    # --- what comes -----------------------------------------------------------------------

    def _receive(self, packet: Received) -> Firmware[None]:
        """Take a message: a sub-routine of the network's task."""
        am_type = packet.am_type
        yield RECEIVE_CYCLES[am_type]
        if not self._takes(am_type):
            self.statistics.busy += 1
            return
        if am_type == TIME_AM:
            if packet.sfd_ticks is not None:
                self._events += self.time.receive(packet.source, packet.payload, packet.sfd_ticks)
            self._wake.set()
            return
        machine = self.sharing if am_type in (VERSIONS_AM, ITEM_AM) else self.collection
        for event in machine.receive(
            packet.source, am_type, packet.payload, packet.rssi_dbm, self.now_ms()
        ):
            if isinstance(event, RecordDelivered):
                entry = self.collection.ledger.entries[event.origin]
                self._events.append(_Receipt(event, *entry))
            else:
                self._events.append(event)
        self._wake.set()

    def _takes(self, am_type: int) -> bool:
        """Whether what such a message brings could be kept."""
        if am_type == ITEM_AM:
            return len(self._events) < EVENT_LIMIT and not self._items.full
        if am_type == DATA_AM and self._receipts is not None:
            return len(self._events) < EVENT_LIMIT and not self._receipts.broken
        return True

    def _handle_events(self) -> Firmware[None]:
        while self._events:
            event = self._events[0]
            if isinstance(event, _Receipt):
                assert self._receipts is not None
                yield from self._receipts.store(event.event, event.following, event.beyond)
            elif isinstance(event, ItemReceived):
                if event.origin == self.address:
                    self._shared = max(self._shared, event.number)
                if (event.origin, event.number) not in self._items:
                    yield from self._items.store(event.origin, event.number, event.item)
                    yield from self._tell(event)
            else:
                origin = self.collection.origin
                if isinstance(event, LedgerAhead) and event.following > origin.newest + 1:
                    self.statistics.renumbered += 1
                    yield from self._records.number_on(origin, event.following)
                yield from self._tell(event)
            self._events.popleft()
        if self._receipts is not None:
            for delivered in self._receipts.settled():
                yield from self._tell(delivered)

    def _tell(self, event: RoutingEvent) -> Firmware[None]:
        handler = self._handlers.get(type(event))
        if handler is not None:
            yield EVENT_CYCLES
            yield from handler(event)

    # --- what is on flash -------------------------------------------------------------------

    def _records_stored(self, last: int) -> None:
        if self._receipts is None and self.ready:
            origin = self.collection.origin
            for number in range(origin.newest + 1, last + 1):
                origin.stored(number)
        self._wake.set()

    def _items_stored(self, last: int) -> None:
        self._items.stored(last)
        while (self.address, self.sharing.versions[self.address] + 1) in self._items.places:
            self.sharing.publish(self.now_ms())
        self._wake.set()

    def _look_after_records(self) -> Firmware[None]:
        """Provide the record and the item that are wanted; notice what the flash gave up."""
        collection, sharing = self.collection, self.sharing
        if self._receipts is None:
            oldest = yield from self._records.given_up()
            if oldest is not None:
                collection.origin.forgotten(oldest)
        number = collection.wanted
        if number is not None:
            record = yield from self._records.log.read(number)
            if record is None:
                self.statistics.unreadable += 1
                collection.origin.forgotten(number + 1)
            else:
                collection.provide(number, record, self.now_ms())
        asked = sharing.wanted
        if asked is not None:
            item = yield from self._items.read(*asked)
            if item is None:
                self.statistics.unreadable += 1
                sharing.decline(*asked, self.now_ms())
            else:
                sharing.provide(*asked, item)

    # --- what goes ----------------------------------------------------------------------------

    def _send(self) -> Firmware[bool]:
        """Hand the network one message, if there is one; the machines take turns."""
        yield SEND_CYCLES
        now_ms = self.now_ms()
        machines = (self.collection, self.sharing, self.time)
        message = None
        for _ in machines:
            self._turn = (self._turn + 1) % len(machines)
            message = machines[self._turn].take(now_ms)
            if message is not None:
                break
        if message is None:
            return False
        if message.am_type == ACK_AM and self._receipts is not None:
            yield from self._receipts.settle()  # all that it speaks of is in the log's hands
            if self._receipts.broken:
                self._events += self.collection.sent(message, 0, False, self.now_ms())
                return True
        self._in_queue = True

        def done(sent: Sent) -> None:
            self._in_queue = False
            if message.destination != BROADCAST:
                came = sent.status is SendStatus.ACKNOWLEDGED
                self._events += self.collection.sent(message, sent.attempts, came, self.now_ms())
            self._wake.set()

        taken = self._network.send(
            message.destination,
            message.am_type,
            message.payload,
            done,
            reserved=True,
            stamp=self._stamp(message) if message.am_type == TIME_AM else None,
        )
        assert taken  # nobody else uses the place, and it is free again before `done`
        return True

    def _stamp(self, mark: Outgoing) -> Stamp:
        return lambda ticks: (TIME_OFFSET, self.time.stamped(mark.payload, ticks)[TIME_OFFSET:])

    # --- when the radio is on -----------------------------------------------------------------

    def _duty_cycle(self, duty: Duty) -> Firmware[None]:
        """Switch the radio on and off by the shared time, and let messages go in its windows."""
        network, alarms = self._network, self._alarms
        on = True
        while True:
            yield DUTY_CYCLES
            now = alarms.now()
            state = duty.state(self.time.to_global(now), self._clock_error(now))
            until = now + state.ticks
            if on and not state.listening:
                network.sends = False
                yield from network.radio_off()
            elif state.listening and not on:
                yield from network.radio_on()
            on = state.listening
            if not state.sending:
                network.sends = False
            elif not network.sends:  # what came up meanwhile is not to go from all boards at once
                yield from alarms.sleep_until(now + self._chance.below(duty.config.spread_ticks))
                network.sends = True
                self._wake.set()
            yield from alarms.sleep_until(until)

    def _clock_error(self, now: int) -> int | None:
        """Return by how many ticks this board's shared time may be off; None: it has none."""
        if not self.time.synchronised:
            return None
        return 0 if self.time.root == self.address else error_bound(self.time.last_pair_ticks, now)
