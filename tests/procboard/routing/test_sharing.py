"""Sharing in the small air: everybody has everything in the end, once, whatever came between."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import MessageTooLongError
from procboard.routing.machine import Outgoing
from procboard.routing.sharing import (
    BURST,
    LAST_NUMBER,
    ORIGIN_LIMIT,
    VERSIONS_TRICKLE,
    ItemReceived,
    Sharing,
    mixed,
)
from radio_802154 import routing_messages as messages
from radio_802154.messages import TOSH_DATA_LENGTH
from radio_802154.routing_messages import ITEM_AM, VERSIONS_AM, Version
from tests.procboard.routing.air import Air, Links, Node, chance, clique, line

RSSI_DBM = -60


@dataclass
class Sharer(Node):
    seed: int = 0
    items: dict[tuple[int, int], bytes] = field(default_factory=dict)
    twice: list[ItemReceived] = field(default_factory=list)
    heard_at: dict[tuple[int, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.sharing = Sharing(self.address, chance(self.seed, self.address))

    def publish(self, now_ms: int) -> None:
        number = self.sharing.publish(now_ms)
        self.items[self.address, number] = bytes((self.address, number & 0xFF))

    def begin(self, now_ms: int) -> None:
        self.sharing.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        for event in self.sharing.receive(
            source, message.am_type, message.payload, RSSI_DBM, now_ms
        ):
            key = event.origin, event.number
            if key in self.items:
                self.twice.append(event)
            self.items[key] = event.item
            self.heard_at[key] = now_ms

    def take(self, now_ms: int) -> Outgoing | None:
        wanted = self.sharing.wanted
        if wanted is not None:
            self.sharing.provide(*wanted, self.items[wanted])
        return self.sharing.take(now_ms)

    def next_deadline(self) -> int | None:
        return self.sharing.next_deadline()

    def handle_timer(self, now_ms: int) -> None:
        self.sharing.handle_timer(now_ms)


def sharers(count: int, seed: int) -> list[Sharer]:
    return [
        Sharer(n, drift=(n % 3 - 1) * 5e-5, start_ms=n * 777.0, seed=seed) for n in range(count)
    ]


def publishing(air: Air, board: int, at_s: float) -> None:
    def publish() -> None:
        node = air.nodes[board]
        assert isinstance(node, Sharer)
        node.publish(node.now(air.time))
        air.kick(node)

    air.at(1000 * at_s, publish)


def held(air: Air) -> list[dict[tuple[int, int], bytes]]:
    for node in air.nodes.values():
        assert isinstance(node, Sharer)
        assert node.twice == []
    return [node.items for node in air.nodes.values() if isinstance(node, Sharer)]


def test_octet_by_octet() -> None:
    payload = messages.encode_versions(0x01020304, [Version(0x0506, 0x0708)])
    assert payload == bytes(range(1, 9))
    assert messages.SHARED_ITEM.encode(messages.SharedItem(0x0102, 0x0304)) == bytes(range(1, 5))
    assert 4 + 4 * messages.MAX_VERSIONS <= TOSH_DATA_LENGTH
    assert messages.SHARED_ITEM.size + messages.MAX_ITEM_OCTETS <= TOSH_DATA_LENGTH


def test_the_mixer_is_murmurs() -> None:
    # fmix32 of MurmurHash3 maps 1 to 0x514E28B7; nothing is 0.
    assert mixed(0, 1) == 0x514E28B7
    assert mixed(77, 0) == 0


@given(st.sampled_from([VERSIONS_AM, ITEM_AM]), st.binary(max_size=30))
def test_no_payload_raises(am_type: int, payload: bytes) -> None:
    sharing = Sharing(1, chance(1))
    sharing.receive(2, am_type, payload, RSSI_DBM, 0)
    sharing.handle_timer(10**6)
    sharing.take(10**6)


@settings(max_examples=15)
@given(st.integers(2, 9), st.integers(0, 10_000), st.data())
def test_all_connected_boards_end_with_the_same_items(
    count: int, seed: int, data: st.DataObject
) -> None:
    """Items come at any time, links are lossy, and two parts are cut off for a while."""
    random = Random(seed)
    links: Links = {a: {} for a in range(count)}
    for a in range(1, count):
        for b in {random.randrange(a), random.randrange(a)}:
            links[a][b] = random.uniform(0, 0.5)
            links[b][a] = random.uniform(0, 0.5)
    air = Air(sharers(count, seed), links, seed)
    for board, at_s in data.draw(
        st.lists(st.tuples(st.integers(0, count - 1), st.integers(0, 60)), max_size=40)
    ):
        publishing(air, board, at_s)
    side = {n: data.draw(st.booleans()) for n in range(count)}
    apart = {a: {b: p for b, p in to.items() if side[a] == side[b]} for a, to in links.items()}
    air.run(10)
    air.links = apart
    air.run(80)
    air.links = links
    air.run(200)
    everything = {key for items in held(air) for key in items}
    for items in held(air):
        assert set(items) == everything
    for node in air.nodes.values():
        assert isinstance(node, Sharer)
        sharing = node.sharing
        told = sum(mixed(origin, number) for origin, number in sharing.versions.items())
        assert sharing._digest == told & 0xFFFFFFFF


def test_a_board_that_comes_late_gets_all_soon() -> None:
    air = Air(sharers(6, 3), clique(6, 0.3), 3)
    late = air.nodes[5]
    air.kill(late)
    for index in range(100):
        publishing(air, index % 5, 1 + index * 0.5)
    air.run(100)
    before = sum(air.frames.values())
    air.revive(late)
    air.run(115)
    assert len(held(air)[5]) == 100
    sent = sum(air.frames.values()) - before
    assert sent < 100 / 0.7 * 3  # answers are not given by all at once


def test_news_is_seven_hops_away_in_ten_seconds_and_then_all_is_quiet() -> None:
    air = Air(sharers(8, 5), line(8, 0.2), 5)
    air.run(300)
    publishing(air, 0, 300)
    air.run(310)
    assert all((0, 1) in items for items in held(air))
    air.run(400)
    before = sum(air.frames.values())
    air.run(1000)
    per_minute = (sum(air.frames.values()) - before) / 8 / 10
    assert per_minute <= 60_000 / VERSIONS_TRICKLE.maximum_ms * 1.1


def test_a_crowd_answers_as_a_few_would() -> None:
    air = Air(sharers(40, 1), clique(40, 0.3), 1)
    air.run(200)
    before = air.frames.copy()
    publishing(air, 0, 200)
    air.run(230)
    frames = air.frames - before
    assert all((0, 1) in items for items in held(air))
    assert sum(n for (_, am), n in frames.items() if am == ITEM_AM) <= 20
    air.run(400)
    before = sum(air.frames.values())
    air.run(400 + 10 * VERSIONS_TRICKLE.maximum_ms / 1000)
    assert (sum(air.frames.values()) - before) / 10 <= 12  # and tells as a few would, of 40


def test_an_item_out_of_order_is_taken_within_a_burst() -> None:
    sharing = Sharing(1, chance(1))

    def item(number: int) -> list[ItemReceived]:
        payload = messages.SHARED_ITEM.encode(messages.SharedItem(7, number)) + b"x"
        return sharing.receive(2, ITEM_AM, payload, RSSI_DBM, 5)

    assert item(2) == [ItemReceived(7, 2, b"x")]
    assert item(2 + BURST) == []
    assert item(1 + BURST) == [ItemReceived(7, 1 + BURST, b"x")]
    assert sharing.versions[7] == 0
    assert item(1) == [ItemReceived(7, 1, b"x")]
    assert sharing.versions[7] == 2
    assert item(2) == []
    assert sharing.heard_ms == {7: 5}
    assert (sharing.statistics.duplicates, sharing.statistics.beyond) == (1, 1)


def test_a_full_table_takes_no_further_origin() -> None:
    sharing = Sharing(0, chance(1), dict.fromkeys(range(1, ORIGIN_LIMIT), 1))
    payload = messages.SHARED_ITEM.encode(messages.SharedItem(999, 1)) + b"x"
    assert sharing.receive(2, ITEM_AM, payload, RSSI_DBM, 0) == []
    sharing.receive(2, VERSIONS_AM, messages.encode_versions(0, [Version(999, 1)]), RSSI_DBM, 0)
    assert sharing.statistics.refused == 2
    assert len(sharing.versions) == ORIGIN_LIMIT
    payload = messages.SHARED_ITEM.encode(messages.SharedItem(5, 2)) + b"x"
    assert sharing.receive(2, ITEM_AM, payload, RSSI_DBM, 0) == [ItemReceived(5, 2, b"x")]


def test_what_cannot_be_shared_is_refused() -> None:
    sharing = Sharing(1, chance(1), {1: LAST_NUMBER})
    with pytest.raises(ValueError, match="used up"):
        sharing.publish(0)
    with pytest.raises(MessageTooLongError):
        sharing.provide(1, 1, bytes(21))


def test_a_board_that_lost_its_flash_gets_its_own_items_back() -> None:
    air = Air(sharers(2, 1), clique(2), 1)
    for _ in range(3):
        publishing(air, 1, 1)
    air.run(20)
    board = air.nodes[1]
    assert isinstance(board, Sharer)
    board.items.clear()
    board.sharing = Sharing(1, chance(9))
    air.revive(board)
    air.run(60)
    assert held(air)[0] == held(air)[1]
    assert board.sharing.publish(0) == 4
