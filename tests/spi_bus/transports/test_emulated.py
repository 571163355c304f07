"""Emulated SPI wires: bytes at the right times, errors at the right rate, links across them."""

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_US
from firmware_model.trace import Trace
from spi_bus.link import Link, LinkConfig, MessageAcknowledged, MessageReceived, Role
from spi_bus.messages import Ping, Pong
from spi_bus.transports.emulated import FLOATING, SpiWires

BIT_FS = 3_814_697_265  # 262 144 Hz


class Slave:
    """A shift register with a queue behind it."""

    def __init__(self, answers: bytes = b"") -> None:
        self.answers = list(answers)
        self.received = bytearray()
        self.selections: list[bool] = []

    def select(self, selected: bool) -> None:
        self.selections.append(selected)

    def begin(self) -> int:
        return self.answers.pop(0) if self.answers else 0

    def end(self, mosi: int) -> None:
        self.received.append(mosi)


class Recorder:
    """Collects the channels of a trace from the beginning."""

    def __init__(self, trace: Trace, *names: str) -> None:
        self.trace = trace
        self.blocks: dict[str, list] = {name: [] for name in names}
        for name, block in self.blocks.items():
            trace.channel(name).sink(block.extend)

    def __getitem__(self, name: str) -> list:
        self.trace.flush()
        return self.blocks[name]


def transfer(scheduler: Scheduler, wires: SpiWires, data: bytes) -> bytes:
    """Clock bytes back to back, as a master with DMA does."""
    answers = bytearray()
    for byte in data:
        wires.begin(byte, BIT_FS)
        scheduler.run(scheduler.now + 8 * BIT_FS)
        answers.append(wires.end())
    return bytes(answers)


def test_bytes_cross_and_the_trace_says_when():
    scheduler, trace, slave = Scheduler(), Trace(), Slave(b"\xa5\x5a")
    recorder = Recorder(trace, "spi.bytes", "spi.cs", "spi.ready")
    wires = SpiWires(scheduler, slave, trace)
    scheduler.run(1_000)
    wires.select(True)
    assert transfer(scheduler, wires, b"\x01\x80\xff") == b"\xa5\x5a\x00"
    wires.select(False)
    assert slave.received == b"\x01\x80\xff"
    assert slave.selections == [True, False]
    assert recorder["spi.bytes"] == [
        (1_000, (BIT_FS, b"\x01\x80\xff", b"\xa5\x5a\x00")),
    ]
    assert recorder["spi.cs"] == [(0, 1), (1_000, 0), (1_000 + 24 * BIT_FS, 1)]
    assert recorder["spi.ready"] == [(0, 0)]
    assert wires.bytes_transferred == 3


def test_the_slaves_byte_is_latched_at_the_first_edge():
    slave = Slave(b"\x11")
    wires = SpiWires(Scheduler(), slave, Trace())
    wires.select(True)
    wires.begin(0x00, BIT_FS)
    slave.answers.insert(0, 0x22)
    assert wires.end() == 0x11


def test_nobody_selected_is_nobody_talked_to():
    scheduler, slave = Scheduler(), Slave(b"\x11")
    wires = SpiWires(scheduler, slave, Trace())
    assert transfer(scheduler, wires, b"\x99") == bytes((FLOATING,))
    assert SpiWires(scheduler, None, Trace()).end() == FLOATING
    assert slave.received == b""
    assert slave.answers == [0x11]
    assert wires.bytes_transferred == 0


def test_a_byte_cut_off_by_chip_select_is_lost_and_the_next_is_whole():
    slave = Slave(b"\x11\x22")
    wires = SpiWires(Scheduler(), slave, Trace())
    wires.select(True)
    wires.begin(0x77, BIT_FS)
    wires.select(False)
    wires.select(True)
    assert wires.end() == FLOATING
    wires.begin(0x78, BIT_FS)
    assert wires.end() == 0x22
    assert slave.received == b"\x78"
    assert slave.selections == [True, False, True]


def test_selecting_twice_is_selecting_once():
    slave = Slave()
    wires = SpiWires(Scheduler(), slave, Trace())
    wires.select(True)
    wires.select(True)
    assert slave.selections == [True]


def test_a_new_slave_hears_the_chip_select():
    first, second = Slave(b"\x11"), Slave(b"\x22")
    wires = SpiWires(Scheduler(), first, Trace())
    wires.select(True)
    wires.begin(0x01, BIT_FS)
    wires.connect(second)
    assert wires.end() == FLOATING
    wires.begin(0x02, BIT_FS)
    assert wires.end() == 0x22
    assert (first.received, second.received) == (b"", b"\x02")
    assert second.selections == [True]


def test_data_ready_reaches_the_master_and_the_trace():
    scheduler, trace = Scheduler(), Trace()
    recorder = Recorder(trace, "left.ready")
    wires = SpiWires(scheduler, Slave(), trace, "left")
    seen: list[bool] = []
    wires.data_ready.watch(seen.append)
    scheduler.run(500)
    wires.data_ready.set(True)
    wires.data_ready.set(True)
    scheduler.run(700)
    wires.data_ready.set(False)
    assert seen == [True, False]
    assert recorder["left.ready"] == [(0, 0), (500, 1), (700, 0)]


def errors_of(rate: float, count: int, seed: int) -> tuple[int, int, list[int]]:
    """Inverted bits towards slave and master, and the distances between them in bits."""
    scheduler, slave = Scheduler(), Slave()
    wires = SpiWires(scheduler, slave, Trace(), bit_error_rate=rate, rng=Random(seed))
    wires.select(True)
    received = bytearray()
    for _ in range(count):
        wires.begin(0x55, BIT_FS)
        received.append(wires.end())
    bits = "".join(
        f"{mosi ^ 0x55:08b}{miso:08b}" for mosi, miso in zip(slave.received, received, strict=True)
    )
    positions = [index for index, bit in enumerate(bits) if bit == "1"]
    assert wires.bits_inverted == len(positions)
    towards_slave = sum(position % 16 < 8 for position in positions)
    gaps = [b - a for a, b in pairwise(positions)]
    return towards_slave, len(positions) - towards_slave, gaps


@pytest.mark.parametrize("rate", [1e-3, 0.02, 0.3])
def test_bit_errors_come_at_their_rate_in_both_directions(rate):
    count = 40_000
    to_slave, to_master, gaps = errors_of(rate, count, seed=5)
    expected = 8 * count * rate
    five_sigma = 5 * (expected * (1 - rate)) ** 0.5
    assert abs(to_slave - expected) < five_sigma
    assert abs(to_master - expected) < five_sigma
    # Geometric: the share of errors that follow at once is the rate itself.
    at_once = sum(gap == 1 for gap in gaps) / len(gaps)
    assert abs(at_once - rate) < 5 * (rate / len(gaps)) ** 0.5
    assert errors_of(rate, 1000, seed=5) == errors_of(rate, 1000, seed=5)


def test_without_errors_every_bit_is_right_and_no_number_is_drawn():
    assert errors_of(0.0, 1000, seed=1) == (0, 0, [])


def test_the_rate_can_change_on_the_way():
    slave = Slave()
    wires = SpiWires(Scheduler(), slave, Trace(), rng=Random(1))
    wires.select(True)
    for rate, damaged in ((0.0, False), (0.5, True), (0.0, False)):
        wires.set_bit_error_rate(rate)
        slave.received.clear()
        for _ in range(50):
            wires.begin(0, BIT_FS)
            wires.end()
        assert any(slave.received) is damaged


@pytest.mark.parametrize(("rate", "rng"), [(-0.1, Random(1)), (0.6, Random(1)), (0.1, None)])
def test_impossible_errors_are_refused(rate, rng):
    with pytest.raises(ValueError, match="bit_error_rate"):
        SpiWires(Scheduler(), Slave(), Trace(), bit_error_rate=rate, rng=rng)


class LinkSlave:
    """A link behind a shift register: loads a byte at a time, hands in what a burst brought."""

    def __init__(self, link: Link, scheduler: Scheduler) -> None:
        self.link = link
        self.scheduler = scheduler
        self.wires: SpiWires
        self.burst = bytearray()
        self.events: list = []

    def poll(self) -> None:
        deadline = self.link.next_deadline_us()
        if deadline is not None and deadline <= self.now_us:
            self.link.handle_timer(self.now_us)
        self.wires.data_ready.set(self.link.wants_to_send)

    @property
    def now_us(self) -> int:
        return self.scheduler.now // FS_PER_US

    def select(self, selected: bool) -> None:
        if not selected:
            self.events += self.link.receive(bytes(self.burst), self.now_us)
            self.burst.clear()

    def begin(self) -> int:
        return (self.link.data_to_send(self.now_us, 1) or b"\0")[0]

    def end(self, mosi: int) -> None:
        self.burst.append(mosi)


@pytest.mark.parametrize("rate", [0.0, 1e-3, 5e-3])
def test_links_deliver_exactly_once_over_bad_wires(rate):
    scheduler, trace = Scheduler(), Trace()
    master = Link(Role.MASTER, 1, LinkConfig(queue_limit=300))
    slave = LinkSlave(Link(Role.SLAVE, 1, LinkConfig(queue_limit=300)), scheduler)
    wires = slave.wires = SpiWires(
        scheduler, slave, trace, bit_error_rate=rate, rng=Random(20140801)
    )
    events: list = []
    for token in range(200):
        master.send(Ping(token))
        slave.link.send(Pong(token))
    while master.queued or slave.link.queued:
        assert scheduler.now < 60_000_000 * FS_PER_US
        scheduler.run(scheduler.now + 1_000 * FS_PER_US)
        now_us = slave.now_us
        slave.poll()
        deadline = master.next_deadline_us()
        if deadline is not None and deadline <= now_us:
            master.handle_timer(now_us)
        out = master.data_to_send(now_us, 32)
        if out or wires.data_ready.value:
            wires.select(True)
            answer = transfer(scheduler, wires, out.ljust(32, b"\0"))
            wires.select(False)
            events += master.receive(answer, slave.now_us)
    for seen, expected in ((events, Pong), (slave.events, Ping)):
        messages = [event.message for event in seen if isinstance(event, MessageReceived)]
        assert messages == [expected(token) for token in range(200)]
        acknowledged = [event.token for event in seen if isinstance(event, MessageAcknowledged)]
        assert acknowledged == list(range(1, 201))
    damaged = master.statistics.crc_errors + slave.link.statistics.crc_errors
    assert (damaged > 0) is (rate > 0)
    assert (wires.bits_inverted > 0) is (rate > 0)


class WordSlave:
    """A slave that works in words of two bytes: its pair calls must amount to the single ones."""

    def __init__(self, answers: list[int]) -> None:
        self.answers = answers
        self.words: list[int] = []
        self._first: int | None = None
        self._answer = 0

    def select(self, selected: bool) -> None:
        self._first = None

    def begin(self) -> int:
        if self._first is not None:
            return self._answer & 0xFF
        self._answer = self.answers[len(self.words)]
        return self._answer >> 8

    def end(self, mosi: int) -> None:
        if self._first is None:
            self._first = mosi
        else:
            self.words.append(self._first << 8 | mosi)
            self._first = None

    def takes_pairs(self) -> bool:
        return self._first is None

    def begin_pair(self) -> int:
        self._answer = self.answers[len(self.words)]
        return self._answer

    def end_pair(self, mosi: int) -> None:
        self.words.append(mosi)


@given(
    st.lists(st.tuples(st.integers(0, 0xFFFF), st.sampled_from(["pair", "0", "1", "bytes"]))),
    st.sampled_from([0.0, 0.02, 0.3]),
)
def test_pairs_split_or_whole_are_the_bytes_that_they_stand_for(words, rate):
    def play(by_bytes: bool) -> tuple:
        scheduler, trace = Scheduler(), Trace()
        slave = WordSlave([word ^ 0x5AA5 for word, _ in words])
        recorder = Recorder(trace, "spi.bytes")
        wires = SpiWires(scheduler, slave, trace, bit_error_rate=rate, rng=Random(7))
        wires.select(True)
        answers = []

        def byte(value: int) -> int:
            wires.begin(value, BIT_FS)
            scheduler.run(scheduler.now + 8 * BIT_FS)
            return wires.end()

        for word, how in words:
            if by_bytes or how == "bytes":
                answers += [byte(word >> 8), byte(word & 0xFF)]
                continue
            assert wires.takes_pairs()
            wires.begin_pair(word, BIT_FS)
            if how == "pair":
                scheduler.run(scheduler.now + 16 * BIT_FS)
                answers += wires.end_pair().to_bytes(2, "big")
            elif how == "1":
                scheduler.run(scheduler.now + 12 * BIT_FS)
                answers.append(wires.split_pair(first_is_over=True))
                scheduler.run(scheduler.now + 4 * BIT_FS)
                answers.append(wires.end())
            else:
                scheduler.run(scheduler.now + 3 * BIT_FS)
                wires.split_pair(first_is_over=False)
                scheduler.run(scheduler.now + 5 * BIT_FS)
                answers.append(wires.end())
                answers.append(byte(word & 0xFF))
        wires.select(False)
        return answers, slave.words, recorder["spi.bytes"], wires.bits_inverted

    assert play(by_bytes=False) == play(by_bytes=True)
