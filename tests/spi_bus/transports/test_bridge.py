"""The bridge: whole frames between emulated wires and a transport, whatever cuts them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS
from firmware_model.trace import Trace
from spi_bus.transports import OpenContext, Transport, open_transport
from spi_bus.transports.bridge import BIT_FS, BridgeMaster, BridgeSlave, FrameLine
from spi_bus.transports.emulated import SpiWires

Ends = tuple[FrameLine, Transport]


@pytest.fixture
def ends() -> Iterator[Ends]:
    context = OpenContext(clock=lambda: 0.0)
    line = FrameLine(open_transport("pair:x", context), context.clock)
    peer = open_transport("pair:x", context)
    line.poll()
    assert peer.read() == b"\0"  # what noise before may have begun is ended first
    yield line, peer
    line.close()
    peer.close()


class Slave:
    """Answers with given bytes, then filler; keeps what it hears."""

    def __init__(self, answer: bytes = b"") -> None:
        self.answer = answer
        self.heard = bytearray()
        self.selections: list[bool] = []

    def select(self, selected: bool) -> None:
        self.selections.append(selected)

    def begin(self) -> int:
        byte, self.answer = (self.answer[0], self.answer[1:]) if self.answer else (0, b"")
        return byte

    def end(self, mosi: int) -> None:
        self.heard.append(mosi)


def test_filler_stays_on_the_wires_and_frames_leave_whole(ends: Ends) -> None:
    line, peer = ends
    line.give(b"\0\0\x03\x01")
    assert peer.read() == b""  # half a frame
    line.give(b"\x02\0\0\0\x02\x07\0")
    assert peer.read() == b"\x03\x01\x02\0\x02\x07\0"
    assert line.frames_out == 2


def test_frames_arrive_whole_however_they_are_cut(ends: Ends) -> None:
    line, peer = ends
    for octet in b"\0\x03\x01\x02\0\0\0\x02\x07\0\x05":
        peer.write(bytes((octet,)))
        line.poll()
    assert list(line.incoming) == [b"\x03\x01\x02\0", b"\x02\x07\0"]


def test_noise_without_a_zero_is_bounded_and_costs_no_later_frame(ends: Ends) -> None:
    line, peer = ends
    for _ in range(50):
        peer.write(b"\xaa" * 100)
        line.poll()
    peer.write(b"\0\x02\x07\0")
    line.poll()
    assert list(line.incoming) == [b"\x02\x07\0"]
    assert line.noise_bytes == 5000


def test_a_full_line_keeps_whole_frames_and_drops_whole_frames(ends: Ends) -> None:
    line, peer = ends
    frame = b"\x80" + bytes(range(1, 128)) + b"\0"
    given = 0
    while not line.frames_dropped:
        line.give(frame)
        given += 1
        assert given < 10_000
    arrived = bytearray()
    while data := peer.read():
        arrived += data
        line.poll()
    assert arrived == frame * (given - 1)


def test_the_master_clocks_words_only_while_there_is_something(ends: Ends) -> None:
    scheduler, trace = Scheduler(), Trace()
    line, peer = ends
    slave = Slave(b"\0\0\x03\x05\x06\0")
    wires = SpiWires(scheduler, slave, trace)
    BridgeMaster(scheduler, wires, line)
    scheduler.run(FS_PER_MS)
    assert not slave.heard  # the bus is still
    peer.write(b"\x02\x09\0\x02")
    line.poll()
    line.on_incoming()
    scheduler.run(2 * FS_PER_MS)
    # An odd frame is filled up to a word; the half that follows it waits; the slave's frame, which
    # began meanwhile, is clocked to its end.
    assert bytes(slave.heard) == b"\x02\x09\0\0\0\0"
    assert peer.read() == b"\x03\x05\x06\0"
    assert slave.selections == [True, False]
    peer.write(b"\x08\0")
    line.poll()
    line.on_incoming()
    scheduler.run(3 * FS_PER_MS)
    assert bytes(slave.heard[6:]) == b"\x02\x08\0\0"


def test_data_ready_makes_the_master_clock_until_it_falls(ends: Ends) -> None:
    scheduler, trace = Scheduler(), Trace()
    line, peer = ends
    slave = Slave(b"\x02\x01\0\0")
    wires = SpiWires(scheduler, slave, trace)
    BridgeMaster(scheduler, wires, line)
    wires.data_ready.set(True)
    scheduler.after(40 * BIT_FS, lambda: wires.data_ready.set(False))
    scheduler.run(10 * FS_PER_MS)
    assert peer.read() == b"\x02\x01\0"
    assert len(slave.heard) == 6  # words that began before 40 bits had passed


def test_the_slave_raises_data_ready_while_frames_wait(ends: Ends) -> None:
    line, peer = ends
    slave = BridgeSlave(line)
    assert not slave.data_ready.value
    assert slave.begin() == 0
    peer.write(b"\x02\x01\0\x02\x05\0")
    line.poll()
    line.on_incoming()
    heard = bytearray()
    while slave.data_ready.value:
        heard.append(slave.begin())
        slave.end(0)
    assert heard == b"\x02\x01\0\x02\x05\0"
    for octet in b"\x02\x03\0":
        slave.end(octet)
    assert peer.read() == b"\x02\x03\0"
