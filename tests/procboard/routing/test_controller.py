"""The network layer on emulated boards: whole motes with radio, flash and resets."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.power import Rail
from firmware_model.trace import Trace
from procboard.board import BaseStation
from procboard.chips.m25p80 import FlashGeometry, FlashImage
from procboard.errors import MessageTooLongError, ProcConfigError
from procboard.firmware import FirmwareConfig
from procboard.network import NetworkConfig, Received
from procboard.routing.collection import LedgerAhead, NeighbourLost, RecordsAcknowledged
from procboard.routing.config import RoutingConfig
from procboard.routing.neighbours import ETX_ONE, LOST_MS
from procboard.routing.sharing import ItemReceived
from radio_802154.medium import Antenna
from radio_802154.routing_messages import (
    ACK_AM,
    COLLECTION_ACK,
    COLLECTION_DATA,
    DATA_AM,
    CollectionData,
)
from radio_802154.tinyos import AM_BROADCAST
from tests.procboard.routing.emulated import BASE, SPACING_M, Mote, Shoal, in_a_row

DIAMOND = [(0.0, 0.0), (SPACING_M, 10.0), (SPACING_M, -10.0), (2 * SPACING_M, 0.0)]
"""Two ways from board 3 to the base."""


def sample(shoal: Shoal, count: int, period_s: float, boards: list[Mote] | None = None) -> None:
    """Let robots store a record each period."""
    for n in range(count):
        for mote in boards or shoal.motes[1:]:
            mote.record(bytes((mote.address, n)) + b"reading"[: n % 8])
        shoal.run(period_s)


def all_there_once(shoal: Shoal) -> None:
    """Every record that was on a flash is on the base's, once, and was told once."""
    assert sorted(shoal.base.kept()) == shoal.promised()
    told = [(e.origin, e.number, e.record) for e in shoal.base.app.delivered]
    assert sorted(told) == shoal.promised()


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_records_cross_three_hops_exactly_once(loss):
    shoal = Shoal(in_a_row(4), loss=loss)
    shoal.run(20)
    assert [mote.parent for mote in shoal.motes] == [None, 0, 1, 2]
    sample(shoal, 12, 2.0)
    shoal.run_until(shoal.settled, 240)
    assert len(shoal.promised()) == 36
    all_there_once(shoal)
    assert [mote.of(RecordsAcknowledged)[-1].below for mote in shoal.motes[1:]] == [12] * 3


def test_attempts_tell_what_a_link_takes():
    """At 30 % loss each way a frame takes 1 / 0.7² = 2.04 transmissions."""
    shoal = Shoal(in_a_row(2), loss=0.3)
    shoal.run(20)
    sample(shoal, 60, 1.0)
    neighbour = shoal.motes[1].routing.neighbours.table[BASE]
    assert 1.5 * ETX_ONE <= neighbour.unicast_etx <= 3 * ETX_ONE


def test_a_relay_dies_and_records_find_another_way():
    shoal = Shoal(DIAMOND, loss=0.3)
    shoal.run(30)
    relay = shoal.motes[3].parent
    assert relay in (1, 2)
    sample(shoal, 3, 1.0, [shoal.motes[3]])
    shoal.motes[relay].power(False)
    sample(shoal, 8, 2.0, [shoal.motes[3]])
    shoal.run_until(shoal.settled, 300)
    assert shoal.motes[3].parent == 3 - relay
    all_there_once(shoal)
    lost = shoal.motes[3].of(NeighbourLost)
    shoal.run(0 if lost else LOST_MS / 1000 + 20)
    assert [e.address for e in shoal.motes[3].of(NeighbourLost)] == [relay]


@pytest.mark.parametrize("seed", [1, 2])
def test_resets_in_the_middle_of_transfers_lose_and_repeat_nothing(seed):
    """Far board, relay and base are reset or cut off while records are on their way."""
    shoal = Shoal(in_a_row(3), loss=0.2, seed=seed)
    shoal.run(15)
    for turn in range(12):
        sample(shoal, 2, 0.45, [shoal.motes[2], shoal.motes[1]])
        victim = shoal.motes[(turn + seed) % 3]
        if turn % 2:
            victim.power(False)
            shoal.run(0.15)
            victim.power(True)
        else:
            victim.reset()
        shoal.run(1.37)
    shoal.run_until(shoal.settled, 400)
    assert len(shoal.promised()) > 20
    kept = shoal.base.kept()
    assert set(kept) >= set(shoal.promised())  # and some that were stored as the reset came
    assert len({(origin, number) for origin, number, _ in kept}) == len(kept)
    told = [(e.origin, e.number) for e in shoal.base.app.delivered]
    assert len(told) == len(set(told))  # the flash has those that a reset kept from being told


def test_the_base_has_on_flash_what_it_acknowledges():
    shoal = Shoal(in_a_row(2))
    shoal.run(10)
    network = shoal.base.app.services.network
    send = network.send
    acknowledged = []

    def checked(destination: int, am_type: int, payload: bytes, *rest: Any, **more: Any) -> bool:
        if am_type == ACK_AM:
            ack = COLLECTION_ACK.decode(payload)
            kept = {number for _, number, _ in shoal.base.kept()}
            assert kept >= set(range(ack.next))
            acknowledged.append(ack.next)
        return bool(send(destination, am_type, payload, *rest, **more))

    network.send = checked
    # Four are acknowledged in half a second; those that come just before are not on flash by then.
    for n in range(40):
        shoal.motes[1].record(bytes((n,)))
        shoal.run(0.11)
    shoal.run_until(shoal.settled, 60)
    assert acknowledged[-1] == 40
    assert len(acknowledged) >= 5


def test_items_reach_everybody_and_who_was_away():
    shoal = Shoal(in_a_row(4), loss=0.2)
    shoal.run(10)
    late = shoal.motes[3]
    late.power(False)
    for n in range(6):
        shoal.motes[n % 3].share(bytes((n,)) * 20)
        shoal.run(1.0)
    late.power(True)
    items = {(n % 3, n // 3 + 1): bytes((n,)) * 20 for n in range(6)}

    def lacking(mote: Mote) -> set[Any]:
        return {item for item in items.items() if item[0][0] != mote.address} - set(
            mote.items().items()
        )

    shoal.run_until(lambda: not any(map(lacking, shoal.motes)), 120)
    heard = late.routing.heard_ms
    assert set(heard) == {0, 1, 2}
    assert max(heard.values()) <= late.routing.now_ms()
    told = [(e.origin, e.number) for e in late.of(ItemReceived)]
    assert len(told) == len(set(told))


def test_a_reset_board_has_its_items_and_numbers_again():
    shoal = Shoal(in_a_row(2))
    shoal.run(10)
    for n in range(3):
        shoal.motes[1].share(bytes((n,)))
        shoal.run(1.0)
    shoal.base.share(b"plan")
    shoal.run(3.0)
    sent = shoal.kinds()
    shoal.motes[1].reset()
    shoal.run(2.0)
    again = shoal.motes[1].items()
    assert again == {(1, 1): b"\0", (1, 2): b"\1", (1, 3): b"\2", (0, 1): b"plan"}
    shoal.motes[1].share(b"next")
    shoal.run(5.0)
    assert shoal.base.items()[1, 4] == b"next"
    assert shoal.kinds()[0x34] - sent[0x34] == 1  # nobody had to send the others again


def test_a_new_flash_numbers_on():
    """The base has records under this board's name; those of a blank flash count from there."""
    shoal = Shoal(in_a_row(2))
    mote = shoal.motes[1]
    shoal.run(10)
    sample(shoal, 5, 1.0)
    shoal.run_until(shoal.settled, 60)
    mote.power(False)
    mote.image.memory[:] = b"\xff" * len(mote.image.memory)
    mote.promised.clear()
    mote.power(True)
    shoal.run(3.0)
    for n in range(3):
        mote.record(b"new" + bytes((n,)))
        shoal.run(0.3)
    shoal.run(60)
    assert mote.of(LedgerAhead)
    assert mote.routing.statistics.renumbered == 1
    kept = shoal.base.kept()
    assert [number for _, number, _ in kept] == list(range(8))
    assert [record for _, _, record in kept][5:] == [b"new\0", b"new\1", b"new\2"]


def test_an_application_that_fills_the_queue_delays_nothing_for_ever():
    """One that has the radio's queue full all the time."""
    shoal = Shoal(in_a_row(2))
    shoal.run(10)
    mote = shoal.motes[1]
    network = mote.app.services.network

    def flood(_sent: Any = None) -> None:
        while network.room:
            network.send(AM_BROADCAST, 0x99, bytes(40), flood)

    flood()
    sample(shoal, 5, 0.5)
    shoal.run(3)
    assert network.statistics.transmissions > 200
    assert network.statistics.refused == 0
    all_there_once(shoal)


def test_a_base_station_and_the_next_one_with_its_flash():
    shoal = Shoal(in_a_row(2))
    robot = shoal.motes[1]
    shoal.base.power(False)
    image = FlashImage.blank(FlashGeometry())
    heard: list[tuple[int, int, bytes]] = []
    for life in range(2):
        rail = Rail(shoal.scheduler, f"base{life}", 3.0)
        shoal.medium.place(f"base{life}", Antenna())
        base = BaseStation(
            shoal.scheduler, Trace(), rail, shoal.medium, NetworkConfig(BASE), f"base{life}",
            routing=RoutingConfig(base=True), flash_image=image,
        )  # fmt: skip
        base.app.on_record = lambda *told: heard.append(told)
        items: dict[tuple[int, int], bytes] = {}
        base.app.on_item = lambda origin, number, item, to=items: to.update(
            {(origin, number): item}
        )
        shoal.run(12)
        robot.share(b"life %d" % life)
        sample(shoal, 5, 0.7)
        base.mote.mcu.press_reset()
        sample(shoal, 5, 0.7)
        shoal.run_until(shoal.settled, 120)
        shoal.run(5)
        kept = sorted((e.origin, e.number, e.record) for e in base.collected())
        assert kept == shoal.promised()
        assert items == {(1, n + 1): b"life %d" % n for n in range(life + 1)}
        rail.set_volts(0.0)
    assert len(heard) == len(set(heard))
    assert set(heard) <= set(shoal.promised())  # those that a reset kept from being told are kept


def test_a_base_that_was_reset_knows_which_record_is_missing():
    shoal = Shoal(in_a_row(1))
    shoal.run(3)
    base = shoal.base

    def comes(number: int) -> None:
        header = CollectionData(0, ETX_ONE, 9, number, 0, number)
        payload = COLLECTION_DATA.encode(header) + bytes((number,))
        packet = Received(9, BASE, DATA_AM, payload, -60)
        base.mote.mcu.cpu.spawn("comes", base.routing._receive(packet))
        shoal.run(0.1)

    for number in (0, 3, 2):
        comes(number)
    shoal.run(5)
    base.reset()
    shoal.run(3)
    assert base.routing.collection.ledger.entries == {9: (1, 0b11)}
    for number in (3, 1, 2, 0):
        comes(number)
    shoal.run(5)
    assert [number for _, number, _ in base.kept()] == [0, 3, 2, 1]


def test_what_no_message_holds_is_refused():
    shoal = Shoal(in_a_row(2))
    shoal.run(3)
    routing = shoal.motes[1].routing
    with pytest.raises(MessageTooLongError):
        next(routing.record(bytes(18)))
    with pytest.raises(MessageTooLongError):
        next(routing.share(bytes(21)))
    with pytest.raises(ProcConfigError, match="no records of its own"):
        next(shoal.base.routing.record(b"mine"))


def test_impossible_configurations_are_refused():
    with pytest.raises(ProcConfigError, match="3 sectors"):
        RoutingConfig(record_sectors=2)
    with pytest.raises(ProcConfigError, match="base station"):
        FirmwareConfig(NetworkConfig(1), routing=RoutingConfig(base=True))


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_boards_share_one_time(loss):
    """Three hops, crystals up to 100 ppm apart: docs/network.md has what more runs measured."""
    shoal = Shoal(in_a_row(4), loss=loss, drifts=(50.0, -50.0, 40.0, -30.0))
    shoal.run(300)
    worst = 0
    for _ in range(30):
        sample(shoal, 1, 2.0)  # flash and radio are busy
        times = [mote.routing.global_ticks() for mote in shoal.motes]
        assert None not in times
        worst = max(worst, max(times) - min(times))
    assert worst <= 10  # 0.3 ms
    assert all(mote.app.services.network.statistics.late_stamps == 0 for mote in shoal.motes)
    clocks = [mote.app.services.alarms.now() for mote in shoal.motes]
    assert max(clocks) - min(clocks) > 1000  # they do not agree by themselves


def test_a_reset_board_learns_the_time_again_and_a_dead_root_is_replaced():
    shoal = Shoal(in_a_row(3), drifts=(20.0, -20.0, 0.0))
    shoal.run(180)
    mote = shoal.motes[2]
    mote.reset()
    shoal.run(2)
    assert mote.routing.global_ticks() is None
    shoal.run_until(lambda: mote.routing.global_ticks() is not None, 80)
    shoal.run(20)
    assert abs(mote.routing.global_ticks() - shoal.base.routing.global_ticks()) <= 20
    before, at = mote.routing.global_ticks(), shoal.scheduler.now
    root = mote.routing.time.root
    shoal.motes[root].power(False)
    shoal.run(180)
    alive = [m for m in shoal.motes if m.address != root]
    assert all(m.routing.time.root not in (root, None) for m in alive)
    passed = (shoal.scheduler.now - at) * 32_768 // 10**15
    assert abs(mote.routing.global_ticks() - before - passed) <= 200  # nobody's time jumped
