"""What the hostile channel of the twins hardly ever brings about, brought about on purpose."""

from __future__ import annotations

import pytest

from spi_bus.link import Link, LinkConfig, Role, StreamReceived
from spi_bus.messages import Ping, Pong
from tests.spi_bus.test_link import talk

CONFIG = LinkConfig()


@pytest.fixture
def connected(new_twins):
    """Twins as master (epoch 1) and a Python slave (epoch 2), connected and silent."""
    master, slave = new_twins(Role.MASTER, 1, CONFIG), Link(Role.SLAVE, 2, CONFIG)
    talk(master, slave)
    assert master.connected
    return master, slave


def test_no_round_trip_is_waited_for_longer_than_the_longest_time(connected):
    master, slave = connected
    for trip_us, wait_us in ((5_000_000, CONFIG.retransmit_us), (0, CONFIG.retransmit_max_us)):
        master.send(Ping(1))
        data = master.data_to_send(0)
        assert master.next_deadline_us() == wait_us
        slave.receive(data, trip_us)
        master.receive(slave.data_to_send(trip_us, acknowledge=True), trip_us)
    assert master.queued == 0


def test_a_stream_that_waits_does_not_go_to_the_next_incarnation(connected):
    master, _ = connected
    reborn = Link(Role.SLAVE, 3, CONFIG)
    master.receive(reborn.data_to_send(0), 0)
    reborn.receive(master.data_to_send(0), 0)
    assert master.send_newest(Ping(7))  # while the newcomer's proof is on its way
    events = master.receive(reborn.data_to_send(0), 0)
    assert master.peer_epoch == 3
    events += talk(master, reborn)
    assert not [event for event in events if isinstance(event, StreamReceived)]
    assert master.statistics.replaced == 1


def test_stream_and_messages_take_turns(connected):
    master, slave = connected
    for token in range(3):
        master.send(Ping(token))
    told = []
    for token in range(100, 106):
        master.send_newest(Ping(token))
        told += slave.receive(master.data_to_send(0, 12), 0)
    assert [event.message.token for event in told] == [100, 0, 102, 1, 104, 2]
    assert [isinstance(event, StreamReceived) for event in told] == [True, False] * 3


def test_a_window_that_closes_and_a_probe_that_finds_it_open(connected):
    master, slave = connected
    slave.receive_window = 0
    master.send(Ping(1))
    slave.receive(master.data_to_send(0), 0)
    master.receive(slave.data_to_send(0), 0)
    slave.receive_window = 4
    slave.data_to_send(50_000)  # lost
    now = CONFIG.retransmit_us
    master.handle_timer(now)
    slave.receive(master.data_to_send(now), now)
    slave.send(Pong(2))
    master.receive(slave.data_to_send(now), now)
    assert master.queued == 0
    master.send(Ping(2))
    master.data_to_send(now)
    assert master.next_deadline_us() == now + CONFIG.retransmit_us
