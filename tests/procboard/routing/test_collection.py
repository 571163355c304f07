"""Collection in the small air: trees against Dijkstra, and every record once at the base."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import MessageTooLongError
from procboard.routing.collection import (
    ACK_LIMIT,
    FORWARD_LIMIT,
    WAY_BACK_LIMIT,
    Collection,
    LedgerAhead,
    NeighbourLost,
    RecordsGone,
)
from procboard.routing.delivery import Origin
from procboard.routing.neighbours import ETX_ONE, NO_ROUTE, Neighbours
from radio_802154 import routing_messages as messages
from radio_802154.messages import TOSH_DATA_LENGTH
from radio_802154.routing_messages import (
    ACK_AM,
    BEACON_AM,
    COLLECTION_ACK,
    COLLECTION_DATA,
    DATA_AM,
    CollectionAck,
    CollectionData,
)
from tests.procboard.routing.air import Air, Links, chance, line
from tests.procboard.routing.boards import (
    RSSI_DBM,
    Board,
    cost_of_tree,
    sampling,
    shortest,
)


def connected(count: int, seed: int, worst: float = 0.5) -> Links:
    """A random connected graph: a random tree and some more, each way with a loss of its own."""
    random = Random(seed)
    links: Links = {a: {} for a in range(count)}
    pairs = [(a, random.randrange(a)) for a in range(1, count)]
    pairs += [(random.randrange(count), random.randrange(count)) for _ in range(count)]
    for a, b in pairs:
        if a != b and b not in links[a]:
            links[a][b] = random.uniform(0, worst)
            links[b][a] = random.uniform(0, worst)
    return links


def boards(count: int, seed: int) -> list[Board]:
    return [Board(n, drift=(n % 3 - 1) * 5e-5, start_ms=n * 777.0, seed=seed) for n in range(count)]


def account(air: Air) -> None:
    """Each record is at the base once, or on the flash of its origin (or both, on its way)."""
    base = air.nodes[0]
    assert isinstance(base, Board)
    delivered = base.delivered()
    assert len(delivered) == len(set(delivered))
    at_base = set(delivered)
    for node in air.nodes.values():
        assert isinstance(node, Board)
        for number in range(node.stored):
            assert (node.address, number) in at_base or number in node.flash


# --- octets ---------------------------------------------------------------------------


def test_data_and_acknowledgement_octet_by_octet() -> None:
    data = COLLECTION_DATA.encode(CollectionData(1, 0x0203, 0x0405, 0x06070809, 10, 11))
    assert data == bytes(range(1, 12))
    assert COLLECTION_ACK.encode(CollectionAck(0x0102, 3, 0x04050607, 8)) == bytes(range(1, 9))
    assert COLLECTION_DATA.size + messages.MAX_RECORD_OCTETS == TOSH_DATA_LENGTH


def single(address: int = 1, *, base: bool = False) -> Collection:
    random = chance(address)
    return Collection(Neighbours(address, random), random, base=base)


@given(st.sampled_from([BEACON_AM, DATA_AM, ACK_AM]), st.binary(max_size=30))
def test_no_payload_raises(am_type: int, payload: bytes) -> None:
    for base in (False, True):
        collection = single(base=base)
        collection.receive(2, am_type, payload, RSSI_DBM, 0)
        collection.handle_timer(10_000)
        collection.take(10_000)


# --- the tree -------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.integers(2, 12), st.integers(0, 10_000))
def test_any_connected_graph_becomes_a_tree_of_short_ways(count: int, seed: int) -> None:
    # A board leaves its parent for 1.5 transmissions only; a hop costs one at least. So a way is at
    # most 2.5 times the shortest if estimates are true; they are, to 20 %.
    links = connected(count, seed)
    air = Air(boards(count, seed), links, seed)
    sampling(air, 10, 200)
    air.run(200)
    best = shortest(links)
    for board in range(1, count):
        assert cost_of_tree(air, board) <= 2.5 * 1.2 * best[board]


def test_over_many_graphs_ways_are_hardly_longer_than_the_shortest() -> None:
    ratios = []
    for seed in range(12):
        links = connected(10, seed)
        air = Air(boards(10, seed), links, seed)
        sampling(air, 10, 200)
        air.run(200)
        best = shortest(links)
        ratios += [cost_of_tree(air, n) / best[n] for n in range(1, 10)]
    assert sum(ratios) / len(ratios) < 1.1


def test_without_the_base_all_know_that_there_is_no_route_and_grow_quiet() -> None:
    air = Air(boards(8, 4), connected(8, 4, 0.2), 4)
    sampling(air, 10, 600)
    air.run(100)
    assert all(board.parent is not None for board in air.nodes.values() if board.address)  # type: ignore[attr-defined]
    air.kill(air.nodes[0])
    air.run(600)
    assert all(board.parent is None for board in air.nodes.values() if board.address)  # type: ignore[attr-defined]
    before = sum(air.frames.values())
    air.run(900)
    assert (sum(air.frames.values()) - before) / 7 / 5 <= 60 / 16.384 * 1.2  # frames a minute
    account(air)
    air.revive(air.nodes[0])
    air.run(1100)
    for board in air.nodes.values():
        assert isinstance(board, Board)
        assert board.flash == {}


def test_a_packet_from_a_board_that_is_nearer_starts_the_beacons_anew() -> None:
    collection = single(1)
    collection.start(0)
    for sequence in range(5):
        beacon = messages.encode_beacon(messages.Beacon(sequence, 0, 0, 0), [])
        collection.receive(0, BEACON_AM, beacon, RSSI_DBM, sequence)
    assert collection.tree.etx == ETX_ONE
    for now in range(0, 60_000, 10):
        collection.handle_timer(now)
        collection.take(now)
    quiet = collection.next_deadline()
    assert quiet is not None
    far = COLLECTION_DATA.encode(CollectionData(0, 2 * ETX_ONE, 2, 0, 0, 0))
    collection.receive(2, DATA_AM, far, RSSI_DBM, 60_000)
    assert (collection.next_deadline(), collection.statistics.loops) == (quiet, 0)
    near = COLLECTION_DATA.encode(CollectionData(0, ETX_ONE, 3, 0, 0, 0))
    collection.receive(3, DATA_AM, near, RSSI_DBM, 60_000)
    assert collection.statistics.loops == 1
    deadline = collection.next_deadline()
    assert deadline is not None
    assert deadline <= 60_128
    assert collection.take(60_001) is None  # it waits for the beacons


def tree_with(*neighbours: tuple[int, int, int]) -> Collection:
    """A board 1 with perfect links to others: address, parent, ETX."""
    collection = single(1)
    for address, parent, etx in neighbours:
        for sequence in range(5):
            beacon = messages.encode_beacon(messages.Beacon(sequence, 0, parent, etx), [])
            collection.receive(address, BEACON_AM, beacon, RSSI_DBM, sequence)
    return collection


def test_a_child_is_no_parent() -> None:
    assert tree_with((2, 1, 3 * ETX_ONE)).tree.parent is None
    assert tree_with((2, 1, 3 * ETX_ONE), (3, 0, 9 * ETX_ONE)).tree.parent == 3


def test_a_parent_is_left_for_one_and_a_half_transmissions_only() -> None:
    assert tree_with((2, 0, 80), (3, 0, 80 - 24)).tree.parent == 2
    assert tree_with((2, 0, 80), (3, 0, 80 - 25)).tree.parent == 3


# --- records --------------------------------------------------------------------------


@settings(max_examples=10)
@given(st.integers(4, 9), st.integers(0, 10_000), st.data())
def test_with_30_percent_loss_and_a_dead_board_every_record_arrives_once(
    count: int, seed: int, data: st.DataObject
) -> None:
    """A complete ring with chords, so that no single board cuts it."""
    dead = data.draw(st.integers(1, count - 1))
    links: Links = {
        a: {
            b: 0.3
            for b in range(count)
            if a != b and (a - b) % count in (1, 2, count - 2, count - 1)
        }
        for a in range(count)
    }
    air = Air(boards(count, seed), links, seed)
    sampling(air, 5, 150)
    air.run(80)
    air.kill(air.nodes[dead])
    air.run(160)
    account(air)
    air.run(600)
    account(air)
    for board in air.nodes.values():
        assert isinstance(board, Board)
        assert board.flash == {} or board.address == dead
        if board.address in links[dead]:
            assert any(isinstance(e, NeighbourLost) and e.address == dead for e in board.events)
    assert isinstance(air.nodes[dead], Board)


def test_a_board_out_of_range_keeps_all_and_brings_it_home() -> None:
    air = Air(boards(3, 1), line(3, 0.2), 1)
    sampling(air, 2, 400)
    air.run(60)
    away = air.links.pop(1)
    air.links[1] = {}
    for heard in air.links.values():
        heard.pop(1, None)
    air.run(400)
    board = air.nodes[1]
    assert isinstance(board, Board)
    assert len(board.flash) > 150
    account(air)
    air.links[1] = away
    air.links[0][1] = air.links[2][1] = 0.2
    air.run(900)
    assert all(isinstance(b, Board) and b.flash == {} for b in air.nodes.values())
    account(air)


def test_an_origin_that_lost_its_numbers_is_told() -> None:
    air = Air(boards(2, 1), line(2), 1)
    sampling(air, 5, 60)
    air.run(100)
    board = air.nodes[1]
    assert isinstance(board, Board)
    board.collection.origin = Origin(chance(3))
    board.stored = 0
    board.store()
    air.kick(board)
    air.run(120)
    assert LedgerAhead(12) in board.events
    assert board.collection.origin.oldest == 0  # nothing was taken as acknowledged
    account_of_old = board.flash
    assert 0 in account_of_old


def test_records_given_up_by_the_flash_are_reported() -> None:
    air = Air(boards(2, 1), {0: {1: 1.0}, 1: {0: 1.0}}, 1)
    sampling(air, 5, 60)
    air.run(60)
    board, base = air.nodes[1], air.nodes[0]
    assert isinstance(board, Board)
    assert isinstance(base, Board)
    air.links = {0: {1: 0.0}, 1: {0: 0.0}}
    air.run(61)
    air.run(120)
    assert len(base.delivered()) == board.stored
    air.links = {0: {1: 1.0}, 1: {0: 1.0}}
    for _ in range(5):
        board.store()
    board.collection.origin.forgotten(board.stored - 2)
    air.links = {0: {1: 0.0}, 1: {0: 0.0}}
    air.kick(board)
    air.run(300)
    assert [e for e in base.events if isinstance(e, RecordsGone)] == [RecordsGone(1, 3)]


def test_tables_keep_their_bounds_and_say_what_they_dropped() -> None:
    collection = single(1)
    for origin in range(10, 10 + WAY_BACK_LIMIT + 20):
        payload = COLLECTION_DATA.encode(CollectionData(0, NO_ROUTE, origin, 0, 0, 0))
        collection.receive(origin, DATA_AM, payload, RSSI_DBM, 0)
        ack = COLLECTION_ACK.encode(CollectionAck(origin, 0, 1, 0))
        collection.receive(99, ACK_AM, ack, RSSI_DBM, 0)
    assert collection.statistics.queue_full == WAY_BACK_LIMIT + 20 - FORWARD_LIMIT
    assert collection.statistics.acks_lost == WAY_BACK_LIMIT + 20 - ACK_LIMIT
    # The ways back of the first twenty are forgotten, and so are their acknowledgements.
    assert collection.take(0) is None
    assert collection.statistics.acks_lost == WAY_BACK_LIMIT + 20


def test_a_record_that_fits_no_packet_is_refused() -> None:
    with pytest.raises(MessageTooLongError):
        single().provide(0, bytes(messages.MAX_RECORD_OCTETS + 1), 0)
