"""A small air for the state machines of `procboard.routing`: who hears whom, in virtual time.

Links have a loss probability each way; a unicast is tried four times as the MAC does, and its
acknowledgement is a frame too. A board sends one frame at a time. Boards have crystals of their
own: each sees `start + (1 + drift) t`. No collisions: `tests/radio_802154` has those.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import hypot
from random import Random
from typing import Any

from procboard.network import RandomMlcg
from procboard.routing.machine import BROADCAST, Outgoing
from radio_802154.messages import TOSH_DATA_LENGTH

ATTEMPTS = 4  # macMaxFrameRetries 3 and the first
FRAME_MS = (2.0, 6.0)  # back-off and frame, one attempt
LATENCY_MS = 0.01  # from a deadline to its handling: time goes on whatever a machine asks

Links = dict[int, dict[int, float]]
"""Loss probability from the first to the second."""


def chance(*seeds: int) -> RandomMlcg:
    state = 1
    for seed in seeds:
        state = (state * 65_599 + seed + 1) % 0x7FFFFFFF
    mlcg = RandomMlcg(state)
    mlcg.below(2)  # neighbouring seeds give neighbouring first numbers
    return mlcg


def disc(places: Iterable[tuple[int, float, float]], reach: float, loss: float = 0.0) -> Links:
    """Links between all that are within reach, with one loss."""
    boards = list(places)
    return {
        a: {b: loss for b, bx, by in boards if a != b and hypot(ax - bx, ay - by) <= reach}
        for a, ax, ay in boards
    }


def clique(count: int, loss: float = 0.0) -> Links:
    return {a: {b: loss for b in range(count) if a != b} for a in range(count)}


def line(count: int, loss: float = 0.0) -> Links:
    return disc(((n, n, 0) for n in range(count)), 1.0, loss)


@dataclass
class Node:
    """A board: wraps machines; tests derive from it."""

    address: int
    drift: float = 0.0
    start_ms: float = 0.0
    alive: bool = True
    sending: bool = False
    wake: float | None = None
    queue: deque[Outgoing] = field(default_factory=deque)

    def clock(self, time: float) -> float:
        """This board's crystal [ms], unrounded."""
        return self.start_ms + (1 + self.drift) * time

    def now(self, time: float) -> int:
        return int(self.clock(time) + 1e-6)

    def true_time(self, now_ms: float) -> float:
        return (now_ms - self.start_ms) / (1 + self.drift)

    # what a test's board does

    def begin(self, now_ms: int) -> None:
        """The board boots."""

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        """A frame came."""

    def take(self, now_ms: int) -> Outgoing | None:
        """What goes next."""

    def sent(self, message: Outgoing, attempts: int, acknowledged: bool, now_ms: int) -> None:
        """What became of a unicast."""

    def next_deadline(self) -> int | None:
        """When `handle_timer` is wanted."""

    def handle_timer(self, now_ms: int) -> None:
        """The time has come."""

    def departing(self, message: Outgoing, clock_ms: float) -> Outgoing:
        """The frame's first symbol goes."""
        return message


class Air:
    """All boards and what is between them."""

    def __init__(self, nodes: Iterable[Node], links: Links, seed: int = 0) -> None:
        self.nodes = {node.address: node for node in nodes}
        self.links = links
        self.random = Random(seed)
        self.time = 0.0
        self.frames: Counter[tuple[int, int]] = Counter()
        """Transmissions by board and AM type, attempts counted."""
        self.airtime_ms = 0.0
        self._events: list[tuple[float, int, Any, tuple[Any, ...]]] = []
        self._order = 0
        self._idle = 0
        for node in self.nodes.values():
            self.at(0.0, self._begin, node)

    def at(self, time: float, action: Any, *arguments: Any) -> None:
        self._order += 1
        heappush(self._events, (max(time, self.time), self._order, action, arguments))

    def run(self, until_s: float) -> None:
        until = 1000.0 * until_s
        while self._events and self._events[0][0] <= until:
            time, _, action, arguments = heappop(self._events)
            self._idle = self._idle + 1 if time < self.time + 0.02 else 0
            assert self._idle < 100_000, "a machine wants to be called again and again"
            self.time = time
            action(*arguments)
        self.time = until

    def kill(self, node: Node) -> None:
        node.alive = False

    def revive(self, node: Node) -> None:
        node.alive, node.sending, node.wake = True, False, None
        self._begin(node)

    def kick(self, node: Node) -> None:
        """Look for what the board wants to send, and when it wants to be woken."""
        if not node.alive:
            return
        if not node.sending:
            message = node.take(node.now(self.time))
            if message is not None:
                node.sending = True
                self._attempt(node, message, 1, False)
        deadline = node.next_deadline()
        if deadline is not None:
            due = max(node.true_time(deadline), self.time + LATENCY_MS)
            if node.wake is None or due < node.wake:
                node.wake = due
                self.at(due, self._timer, node, due)

    def _begin(self, node: Node) -> None:
        node.begin(node.now(self.time))
        self.kick(node)

    def _timer(self, node: Node, due: float) -> None:
        if not node.alive or node.wake != due:
            return
        node.wake = None
        node.handle_timer(node.now(self.time))
        self.kick(node)

    def _attempt(self, node: Node, message: Outgoing, attempt: int, came: bool) -> None:
        delay = self.random.uniform(*FRAME_MS)
        self.at(self.time + delay, self._go, node, message, attempt, came)

    def _go(self, node: Node, message: Outgoing, attempt: int, came: bool) -> None:
        if not node.alive:
            return
        self.frames[node.address, message.am_type] += 1
        self.airtime_ms += (6 + 11 + len(message.payload) + 2) * 0.032
        message = node.departing(message, node.clock(self.time))
        assert len(message.payload) <= TOSH_DATA_LENGTH
        heard = self.links.get(node.address, {})
        random = self.random.random
        if message.destination == BROADCAST:
            for address, loss in heard.items():
                if random() >= loss:
                    self._deliver(node, address, message)
            self._done(node, message, attempt, True)
            return
        loss = heard.get(message.destination, 1.0)
        back = self.links.get(message.destination, {}).get(node.address, 1.0)
        peer = self.nodes[message.destination]
        if peer.alive and random() >= loss:
            if not came:
                self._deliver(node, message.destination, message)
            came = True
            if random() >= back:
                self._done(node, message, attempt, True)
                return
        if attempt < ATTEMPTS:
            self._attempt(node, message, attempt + 1, came)
        else:
            self._done(node, message, attempt, False)

    def _deliver(self, sender: Node, address: int, message: Outgoing) -> None:
        node = self.nodes[address]
        if node.alive:
            node.receive(
                sender.address, message, node.now(self.time), clock_ms=node.clock(self.time)
            )
            self.kick(node)

    def _done(self, node: Node, message: Outgoing, attempts: int, acknowledged: bool) -> None:
        node.sending = False
        if message.destination != BROADCAST:
            node.sent(message, attempts, acknowledged, node.now(self.time))
        self.kick(node)
