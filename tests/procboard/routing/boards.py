"""A board of the tests that collects: neighbours, tree, and a flash full of records."""

from __future__ import annotations

from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Any

from procboard.routing.collection import Collection, RecordDelivered, RecordsAcknowledged
from procboard.routing.machine import Outgoing
from procboard.routing.neighbours import Neighbours
from radio_802154 import routing_messages as messages
from tests.procboard.routing.air import Air, Links, Node, chance

RSSI_DBM = -60
COLLECTION_AM = {messages.BEACON_AM, messages.DATA_AM, messages.ACK_AM}


@dataclass
class Board(Node):
    """A robot, or the base where the address is 0."""

    seed: int = 0
    flash: dict[int, bytes] = field(default_factory=dict)
    """Records that the board still keeps."""
    stored: int = 0
    events: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        random = chance(self.seed, self.address)
        self.neighbours = Neighbours(self.address, random)
        self.collection = Collection(self.neighbours, random, base=self.address == 0)

    def store(self) -> None:
        number = self.stored
        self.stored += 1
        self.flash[number] = bytes((self.address, number & 0xFF))
        self.collection.origin.stored(number)

    def note(self, events: list[Any]) -> None:
        self.events += events
        for event in events:
            if isinstance(event, RecordsAcknowledged):
                for number in [n for n in self.flash if n < event.below]:
                    del self.flash[number]

    def begin(self, now_ms: int) -> None:
        self.collection.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        if message.am_type in COLLECTION_AM:
            self.note(
                self.collection.receive(source, message.am_type, message.payload, RSSI_DBM, now_ms)
            )

    def take(self, now_ms: int) -> Outgoing | None:
        number = self.collection.wanted
        if number is not None:
            self.collection.provide(number, self.flash[number], now_ms)
        return self.collection.take(now_ms)

    def sent(self, message: Outgoing, attempts: int, acknowledged: bool, now_ms: int) -> None:
        self.note(self.collection.sent(message, attempts, acknowledged, now_ms))

    def next_deadline(self) -> int | None:
        return self.collection.next_deadline()

    def handle_timer(self, now_ms: int) -> None:
        self.note(self.collection.handle_timer(now_ms))

    @property
    def parent(self) -> int | None:
        return self.collection.tree.parent

    def delivered(self) -> list[tuple[int, int]]:
        return [(e.origin, e.number) for e in self.events if isinstance(e, RecordDelivered)]


def sampling(air: Air, period_s: float, until_s: float) -> None:
    """Let every robot store a record each period, not all at once."""

    def store(node: Node) -> None:
        if isinstance(node, Board) and node.alive and node.address:
            node.store()
            air.kick(node)

    count = len(air.nodes)
    for index, node in enumerate(air.nodes.values()):
        step = period_s * index / count
        while step < until_s:
            air.at(air.time + 1000 * step, store, node)
            step += period_s


def shortest(links: Links) -> dict[int, float]:
    """True ETX of every board to board 0, by Dijkstra's algorithm; transmissions."""
    costs = {0: 0.0}
    heap = [(0.0, 0)]
    done = set()
    while heap:
        cost, board = heappop(heap)
        if board in done:
            continue
        done.add(board)
        for other in links[board]:
            through = cost + etx(links, other, board)
            if through < costs.get(other, float("inf")):
                costs[other] = through
                heappush(heap, (through, other))
    return costs


def etx(links: Links, a: int, b: int) -> float:
    good = (1 - links[a].get(b, 1.0)) * (1 - links[b].get(a, 1.0))
    return 1 / good if good else float("inf")


def cost_of_tree(air: Air, board: int) -> float:
    """True ETX of the way that a board's parents make to board 0; inf for a loop or none."""
    cost = 0.0
    for _ in range(len(air.nodes)):
        if board == 0:
            return cost
        node = air.nodes[board]
        assert isinstance(node, Board)
        if node.parent is None:
            break
        cost += etx(air.links, board, node.parent)
        board = node.parent
    return float("inf")
