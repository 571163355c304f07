"""Neighbours: estimates against the links' loss, the table's bound, who is noticed as gone."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.routing.machine import Outgoing
from procboard.routing.neighbours import (
    BEACONS,
    ETX_ONE,
    LOST_MS,
    MAX_LINK_ETX,
    NO_ROUTE,
    TABLE_LIMIT,
    WHITE_DBM,
    BeaconHeard,
    NeighbourFound,
    NeighbourLost,
    Neighbours,
)
from radio_802154 import routing_messages as messages
from radio_802154.messages import TOSH_DATA_LENGTH
from tests.procboard.routing.air import Air, Node, chance, clique

GOOD_DBM = -60


def beacon(sequence: int, etx: int = NO_ROUTE, *qualities: tuple[int, int]) -> bytes:
    return messages.encode_beacon(
        messages.Beacon(sequence & 0xFF, 0, 1, etx),
        [messages.LinkQuality(*quality) for quality in qualities],
    )


@dataclass
class Beaconer(Node):
    events: list[Any] = field(default_factory=list)
    unicasts: bool = False

    def __post_init__(self) -> None:
        self.neighbours = Neighbours(self.address, chance(7, self.address))

    def begin(self, now_ms: int) -> None:
        self.neighbours.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        if message.am_type == messages.BEACON_AM:
            self.events += self.neighbours.receive(source, message.payload, GOOD_DBM, now_ms)

    def take(self, now_ms: int) -> Outgoing | None:
        if self.unicasts and not self.queue:
            self.queue.append(Outgoing(1, 0x7F, b""))
            return None
        return self.queue.popleft() if self.queue else self.neighbours.take(now_ms)

    def sent(self, message: Outgoing, attempts: int, acknowledged: bool, now_ms: int) -> None:
        self.neighbours.report(message.destination, attempts, acknowledged, now_ms)

    def next_deadline(self) -> int | None:
        return self.neighbours.next_deadline()

    def handle_timer(self, now_ms: int) -> None:
        self.events += self.neighbours.handle_timer(now_ms)


def pair(there: float, back: float, seed: int = 1) -> tuple[Air, list[Beaconer]]:
    nodes = [Beaconer(0, drift=4e-5), Beaconer(1, drift=-4e-5, start_ms=1e6)]
    return Air(nodes, {0: {1: there}, 1: {0: back}}, seed), nodes


def test_a_beacon_octet_by_octet() -> None:
    assert beacon(0x12, 0x0345, (0x0607, 0x80)) == bytes.fromhex("12 00 0001 0345 0607 80")


def test_no_beacon_exceeds_what_tinyos_takes() -> None:
    assert messages.BEACON.size + messages.MAX_LINK_QUALITIES * 3 == 27 <= TOSH_DATA_LENGTH


@given(st.binary(max_size=40))
def test_no_payload_raises(payload: bytes) -> None:
    neighbours = Neighbours(1, chance(1))
    events = neighbours.receive(2, payload, GOOD_DBM, 0)
    assert bool(events) != bool(neighbours.bad_messages)


def test_perfect_links_cost_one_transmission() -> None:
    air, nodes = pair(0.0, 0.0)
    air.run(3)
    for node, other in ((nodes[0], 1), (nodes[1], 0)):
        assert node.neighbours.table[other].link_etx(node.now(air.time)) == ETX_ONE
        assert [e for e in node.events if isinstance(e, NeighbourFound)] == [NeighbourFound(other)]


def mean_etx(there: float, back: float, unicasts: bool) -> float:
    """The estimate of board 0, in transmissions, over an hour of virtual time."""
    air, nodes = pair(there, back)
    nodes[0].unicasts = unicasts
    air.run(300)
    total = 0
    for step in range(200):
        if unicasts:
            air.kick(nodes[0])
        air.run(300 + 16 * (step + 1))
        total += nodes[0].neighbours.table[1].link_etx(nodes[0].now(air.time))
    return total / 200 / ETX_ONE


@pytest.mark.parametrize(("there", "back"), [(0.3, 0.3), (0.5, 0.1), (0.1, 0.5)])
def test_beacons_estimate_both_directions(there: float, back: float) -> None:
    # De Couto et al. 2003, equation 1; 1 / p of a p that scatters is a little more on the mean.
    assert mean_etx(there, back, False) == pytest.approx(1 / ((1 - there) * (1 - back)), rel=0.15)


def test_unicasts_say_it_too() -> None:
    neighbours = Neighbours(0, chance(0))
    for sequence in range(5):
        neighbours.receive(1, beacon(sequence), GOOD_DBM, 0)
    assert neighbours.table[1].link_etx(0) == ETX_ONE
    for _ in range(100):  # acknowledged at the fourth attempt, and not at all, in turns
        neighbours.report(1, 4, True, 0)
        neighbours.report(1, 4, False, 0)
    assert neighbours.table[1].link_etx(0) == pytest.approx(8 * ETX_ONE, rel=0.05)
    for sequence in range(5, 50):  # beacons do not change what unicasts have shown
        neighbours.receive(1, beacon(sequence), GOOD_DBM, 0)
    assert neighbours.table[1].link_etx(0) == pytest.approx(8 * ETX_ONE, rel=0.05)
    assert neighbours.table[1].link_etx(10**6) == ETX_ONE  # but they were long ago


def test_a_dead_neighbour_grows_costly_with_every_failure() -> None:
    neighbours = Neighbours(0, chance(0))
    for sequence in range(5):
        neighbours.receive(1, beacon(sequence), GOOD_DBM, 0)
    costs = []
    for _ in range(40):
        neighbours.report(1, 4, False, 0)
        costs.append(neighbours.table[1].link_etx(0))
    assert costs == sorted(costs)
    assert costs[4] > 3 * ETX_ONE  # 20 attempts
    assert costs[-1] <= MAX_LINK_ETX


def test_who_falls_silent_is_lost_once_and_found_again() -> None:
    air, nodes = pair(0.0, 0.0)
    air.run(100)
    air.kill(nodes[1])
    air.run(100 + (LOST_MS + BEACONS.maximum_ms) / 1000 + 1)
    lost = [event for event in nodes[0].events if isinstance(event, NeighbourLost)]
    assert lost == [NeighbourLost(1, evicted=False)]
    assert nodes[0].neighbours.table == {}
    air.revive(nodes[1])
    air.run(400)
    assert 1 in nodes[0].neighbours.table


def test_at_30_percent_loss_hardly_anybody_who_lives_is_lost() -> None:
    nodes = [Beaconer(n) for n in range(8)]
    air = Air(nodes, clique(8, 0.3), seed=3)
    air.run(3600)
    lost = sum(isinstance(event, NeighbourLost) for node in nodes for event in node.events)
    assert lost <= 6  # 56 pairs, 1 hour, one in 20 hours: 2.8 expected


def full(etx: int) -> Neighbours:
    neighbours = Neighbours(0, chance(0))
    for address in range(1, TABLE_LIMIT + 1):
        for sequence in range(5):
            neighbours.receive(address, beacon(sequence, etx), GOOD_DBM, 0)
    neighbours.pin(TABLE_LIMIT)
    return neighbours


def test_a_full_table_takes_in_only_who_is_nearer_to_the_base() -> None:
    neighbours = full(etx=ETX_ONE)
    assert neighbours.receive(99, beacon(0, ETX_ONE), GOOD_DBM, 0)[-1].kept is False  # type: ignore[union-attr]
    assert neighbours.receive(99, beacon(0), GOOD_DBM, 0)[-1].kept is False  # type: ignore[union-attr]
    assert neighbours.refused == 2
    assert len(neighbours.table) == TABLE_LIMIT
    weak = neighbours.receive(99, beacon(0, 0), WHITE_DBM - 1, 0)
    assert weak == [BeaconHeard(99, messages.Beacon(0, 0, 1, 0), kept=False)]
    events = neighbours.receive(99, beacon(0, 0), GOOD_DBM, 0)
    assert events[0] == NeighbourLost(TABLE_LIMIT - 1, evicted=True)  # the pinned one stays
    assert len(neighbours.table) == TABLE_LIMIT


def test_a_bad_link_gives_way_to_anybody() -> None:
    neighbours = full(etx=ETX_ONE)
    for _ in range(20):
        neighbours.report(3, 4, False, 0)
    events = neighbours.receive(99, beacon(0), GOOD_DBM, 0)
    assert events[0] == NeighbourLost(3, evicted=True)


@settings(max_examples=8)
@given(st.integers(2, 24), st.integers(0, 1000))
def test_the_table_keeps_its_bound_and_links_are_told_in_turn(count: int, seed: int) -> None:
    nodes = [Beaconer(n) for n in range(count)]
    air = Air(nodes, clique(count, 0.1), seed)
    air.run(200)
    for node in nodes:
        table = node.neighbours.table
        assert len(table) == min(count - 1, TABLE_LIMIT)
        if count <= TABLE_LIMIT:  # all know all, and three beacons tell of 21
            assert all(entry.outbound for entry in table.values())
