"""Frames that a shoal puts on the air, by protocol: `python -m tests.procboard.routing.traffic`.

Boards lie at random in a square whose side keeps some fifteen within reach of each, or all hear all
(`dense`). Every robot stores a record every 10 s and shares an item every minute; all that this
package has runs on every board, duty cycling apart.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from procboard.routing.machine import Outgoing, earliest
from procboard.routing.sharing import ItemReceived, Sharing
from procboard.routing.time_sync import TICKS_PER_MS, TimeSync
from radio_802154 import routing_messages as messages
from tests.procboard.routing.air import Air, Links, chance, clique, disc
from tests.procboard.routing.boards import COLLECTION_AM, RSSI_DBM, Board, sampling

PROTOCOLS = {
    messages.BEACON_AM: "beacons",
    messages.DATA_AM: "records",
    messages.ACK_AM: "acknowledgements",
    messages.VERSIONS_AM: "versions",
    messages.ITEM_AM: "items",
    messages.TIME_AM: "time",
}
IN_REACH = 15
WARM_UP_S = 180
COOL_DOWN_S = 60


@dataclass
class Whole(Board):
    """A board with every protocol."""

    def __post_init__(self) -> None:
        super().__post_init__()
        random = chance(self.seed, self.address, 2)
        self.sharing = Sharing(self.address, random)
        self.sync = TimeSync(self.address, random)
        self.items: dict[tuple[int, int], bytes] = {}

    def share(self, now_ms: int) -> None:
        self.items[self.address, self.sharing.publish(now_ms)] = bytes(12)

    def begin(self, now_ms: int) -> None:
        super().begin(now_ms)
        self.sharing.start(now_ms)
        self.sync.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        if message.am_type in COLLECTION_AM:
            super().receive(source, message, now_ms)
            return
        self.neighbours.heard(source, now_ms)
        if message.am_type == messages.TIME_AM:
            self.sync.receive(source, message.payload, int(stamps["clock_ms"] * TICKS_PER_MS))
            return
        for event in self.sharing.receive(
            source, message.am_type, message.payload, RSSI_DBM, now_ms
        ):
            assert isinstance(event, ItemReceived)
            self.items[event.origin, event.number] = event.item

    def departing(self, message: Outgoing, clock_ms: float) -> Outgoing:
        if message.am_type != messages.TIME_AM:
            return message
        ticks = int(clock_ms * TICKS_PER_MS)
        return replace(message, payload=self.sync.stamped(message.payload, ticks))

    def take(self, now_ms: int) -> Outgoing | None:
        wanted = self.sharing.wanted
        if wanted is not None:
            self.sharing.provide(*wanted, self.items[wanted])
        return self.sync.take(now_ms) or self.sharing.take(now_ms) or super().take(now_ms)

    def next_deadline(self) -> int | None:
        return earliest(
            (super().next_deadline(), self.sharing.next_deadline(), self.sync.next_deadline())
        )

    def handle_timer(self, now_ms: int) -> None:
        super().handle_timer(now_ms)
        self.sharing.handle_timer(now_ms)
        self.sync.handle_timer(now_ms)


def scattered(count: int, loss: float, seed: int) -> Links:
    """Boards at random, the base in a corner, each with some fifteen others within reach."""
    random = Random(seed)
    reach = (IN_REACH / 3.1416 / count) ** 0.5 if count > IN_REACH else 2.0
    places = [(n, random.random(), random.random()) for n in range(1, count)]
    return disc([(0, 0.1, 0.1), *places], reach, loss)


def shoal(links: Links, seed: int) -> Air:
    random = Random(seed)
    nodes = [
        Whole(n, drift=random.uniform(-5e-5, 5e-5), start_ms=n * 777.0, seed=seed) for n in links
    ]
    return Air(nodes, links, seed)


def sharing(air: Air, period_s: float, until_s: float) -> None:
    def share(node: Whole) -> None:
        node.share(node.now(air.time))
        air.kick(node)

    for index, node in enumerate(air.nodes.values()):
        step = period_s * index / len(air.nodes)
        while step < until_s:
            air.at(1000 * step, share, node)
            step += period_s


@dataclass(frozen=True)
class Traffic:
    """What was counted: frames per board and minute by protocol, and the channel's load."""

    frames: dict[str, float]
    airtime: float
    """Share of the time that a place hears somebody, acknowledgements of the MAC apart."""
    undelivered: int
    """Records that are not at the base a minute later."""
    unshared: int
    """Items that a board lacks by then, all boards' together."""

    @property
    def total(self) -> float:
        return sum(self.frames.values())


def measure(links: Links, seed: int, span_s: float) -> Traffic:
    air = shoal(links, seed)
    until = WARM_UP_S + span_s
    sampling(air, 10, until)
    sharing(air, 60, until)
    air.run(WARM_UP_S)
    before, airtime = air.frames.copy(), air.airtime_ms
    air.run(until)
    frames: Counter[str] = Counter()
    for (board, am_type), count in air.frames.items():
        frames[PROTOCOLS[am_type]] += count - before[board, am_type]
    heard = sum(len(others) + 1 for others in links.values()) / len(links) ** 2
    load = (air.airtime_ms - airtime) / 1000 / span_s * heard
    air.run(until + COOL_DOWN_S)
    boards = [node for node in air.nodes.values() if isinstance(node, Whole)]
    known = {item for board in boards for item in board.items}
    return Traffic(
        {name: frames[name] / len(boards) / span_s * 60 for name in PROTOCOLS.values()},
        load,
        sum(board.stored for board in boards) - len(boards[0].delivered()),
        sum(len(known) - len(board.items) for board in boards),
    )


def main() -> None:
    span_s = float(sys.argv[1]) if len(sys.argv) > 1 else 120.0
    print("boards place     loss", *PROTOCOLS.values(), "total airtime undelivered unshared")
    for count in (2, 20, 100):
        for place, loss in (("scattered", 0.1), ("scattered", 0.3), ("dense", 0.1)):
            links = clique(count, loss) if place == "dense" else scattered(count, loss, 1)
            t = measure(links, 1, span_s)
            print(
                f"{count:6} {place:9} {loss:.1f}",
                *(f"{t.frames[name]:.1f}" for name in t.frames),
                f"{t.total:.1f} {t.airtime:.1%} {t.undelivered} {t.unshared}",
                flush=True,
            )


if __name__ == "__main__":
    main()
