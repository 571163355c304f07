"""Every row of the transport table, unasked: it loads, and carries bytes both ways unchanged.

A transport needs an entry in `TRIALS` that connects its two ends; a row without one fails.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.trace import Trace
from spi_bus.link import Link, MessageReceived, Role
from spi_bus.messages import Ping, Pong
from spi_bus.transports import TRANSPORTS, TransportRow
from tools.commands import listing

Exchange = Callable[[bytes], bytes]
"""Sends bytes to the far end and returns the answer, which has the same length."""


class Echo:
    """A slave that answers with what came one byte before."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.next = 0x5A
        self.selected = False

    def select(self, selected: bool) -> None:
        self.selected = selected

    def begin(self) -> int:
        return self.next

    def end(self, mosi: int) -> None:
        self.heard.append(mosi)
        self.next = mosi


def over_wires(row: TransportRow) -> tuple[Exchange, Echo]:
    """Emulated SPI wires between a master that is played here and an echo."""
    scheduler, slave = Scheduler(), Echo()
    wires = row.load()(scheduler, slave, Trace())
    period_fs = 4 * 10**9

    def exchange(data: bytes) -> bytes:
        wires.select(True)
        answer = bytearray()
        for octet in data:
            wires.begin(octet, period_fs)
            scheduler.run(scheduler.now + 8 * period_fs)
            answer.append(wires.end())
        wires.select(False)
        return bytes(answer)

    return exchange, slave


TRIALS: dict[str, Callable[[TransportRow], tuple[Exchange, Echo]]] = {"emulated": over_wires}


def test_every_row_has_its_trial_and_is_listed() -> None:
    assert TRIALS.keys() == {row.name for row in TRANSPORTS}
    assert [name for name, _ in listing.rows("transports")] == [row.name for row in TRANSPORTS]


@pytest.mark.parametrize("row", TRANSPORTS, ids=lambda row: row.name)
def test_a_row_loads_and_says_what_it_is(row: TransportRow) -> None:
    assert len(row.description) > 20
    found = row.load()
    assert inspect.isclass(found)
    assert found.__module__ == row.module
    assert found.__doc__


@pytest.mark.parametrize("row", TRANSPORTS, ids=lambda row: row.name)
def test_all_bytes_go_through_both_ways_in_order(row: TransportRow) -> None:
    exchange, far = TRIALS[row.name](row)
    sent = bytes(range(256)) + b"\0\0\xff\xff" + bytes(reversed(range(256)))
    assert exchange(sent) == b"\x5a" + sent[:-1]
    assert bytes(far.heard) == sent
    assert exchange(b"\x11\x22") == sent[-1:] + b"\x11"


@pytest.mark.parametrize("row", TRANSPORTS, ids=lambda row: row.name)
def test_the_link_runs_over_it(row: TransportRow) -> None:
    """Two links meet over the bytes that the far end heard, and a Ping comes back as a Pong."""
    exchange, far = TRIALS[row.name](row)
    master, slave = Link(Role.MASTER, 3), Link(Role.SLAVE, 8)
    master.send(Ping(0xBEEF))
    answers: list[object] = []
    for now_us in range(0, 2_000_000, 20_000):
        for link in (master, slave):
            link.handle_timer(now_us)
        heard = len(far.heard)
        exchange(master.data_to_send(now_us) + b"\0")
        for event in slave.receive(bytes(far.heard[heard:]), now_us):
            if isinstance(event, MessageReceived):
                assert event.message == Ping(0xBEEF)
                slave.send(Pong(0xBEEF))
        # The way back: the echo returns each byte with the next one.
        reply = slave.data_to_send(now_us)
        back = exchange(reply + b"\0")[1:] if reply else b""
        events = master.receive(back, now_us)
        answers += [event.message for event in events if isinstance(event, MessageReceived)]
    assert answers == [Pong(0xBEEF)]
