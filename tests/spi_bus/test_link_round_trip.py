"""How long the link waits for an acknowledgement: it follows the round trip, within bounds."""

import pytest

from spi_bus.link import Link, Role
from spi_bus.messages import Ping
from tests.spi_bus.test_link import CONFIG, connected, talk


def test_the_time_waited_for_follows_the_round_trip():
    master, slave = connected()
    now, waits = 0, []
    for trip_us in (50_000, 50_000, 250_000, 0, 0, 5_000_000):
        master.send(Ping(1))
        data = master.data_to_send(now)
        waits.append(master.next_deadline_us() - now)
        now += trip_us
        slave.receive(data, now)
        master.receive(slave.data_to_send(now, acknowledge=True), now)
    # Twice the mean, an eighth of each new one in it; 60 ms at the least.
    assert waits == [60_000, 100_000, 100_000, 150_000, 131_250, 114_844]
    master.send(Ping(1))
    assert master.data_to_send(now)
    assert master.next_deadline_us() - now == 350_490


def test_no_round_trip_is_waited_for_longer_than_the_longest_time():
    master, slave = connected()
    for trip_us, wait_us in ((5_000_000, CONFIG.retransmit_us), (0, CONFIG.retransmit_max_us)):
        master.send(Ping(1))
        data = master.data_to_send(0)
        assert master.next_deadline_us() == wait_us
        slave.receive(data, trip_us)
        master.receive(slave.data_to_send(trip_us, acknowledge=True), trip_us)


@pytest.mark.parametrize(
    ("timeouts", "trip_us", "wait_us"),
    [([60_000], 100_000, 200_000), ([60_000, 180_000], 190_000, 60_000)],
)
def test_one_time_out_within_a_round_trip_is_let_pass_two_are_not(timeouts, trip_us, wait_us):
    master, slave = connected()
    master.send(Ping(1))
    late = master.data_to_send(0)
    for now in timeouts:
        master.handle_timer(now)
        master.data_to_send(now)
    slave.receive(late, trip_us)
    master.receive(slave.data_to_send(trip_us, acknowledge=True), trip_us)
    master.send(Ping(2))
    master.data_to_send(trip_us)
    assert master.next_deadline_us() == trip_us + wait_us


def test_a_round_trip_does_not_go_on_over_a_reset_of_the_peer():
    master, _ = connected()
    master.send(Ping(1))
    master.data_to_send(0)
    now = 500_000
    reborn = Link(Role.SLAVE, 3)
    talk(master, reborn, now)
    master.receive(reborn.data_to_send(now, acknowledge=True), now)
    assert master.queued == 0
    master.send(Ping(2))
    master.data_to_send(now)
    assert master.next_deadline_us() == now + CONFIG.retransmit_us


@pytest.mark.parametrize("told", [True, False], ids=["told", "update lost"])
def test_the_time_behind_a_closed_window_is_no_round_trip(told):
    master, slave = connected()
    slave.receive_window = 0
    master.send(Ping(1))
    slave.receive(master.data_to_send(0), 0)
    master.receive(slave.data_to_send(0), 0)
    slave.receive_window = 4
    update = slave.data_to_send(50_000)
    if told:
        master.receive(update, 50_000)
    else:
        master.handle_timer(CONFIG.retransmit_us)  # the probe finds out
    now = 50_000 if told else CONFIG.retransmit_us
    slave.receive(master.data_to_send(now), now)
    master.receive(slave.data_to_send(now, acknowledge=True), now)
    assert master.queued == 0
    master.send(Ping(2))
    master.data_to_send(now)
    assert master.next_deadline_us() == now + CONFIG.retransmit_us
