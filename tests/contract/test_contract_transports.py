"""Every row of the transport table, unasked: it loads, and carries bytes both ways unchanged.

A transport that a URL opens needs a line in `conftest.py` that opens both of its ends, any other an
entry in `TRIALS` that connects them; a row without one fails.
"""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.trace import Trace
from spi_bus.errors import (
    PortNotFoundError,
    TransportClosedError,
    TransportFull,
    TransportLost,
)
from spi_bus.frame import Decoder, ErrorKind, Frame, FrameType
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import Ping, Pong
from spi_bus.transports import TRANSPORTS, BackOff, OutageLog, Transport, TransportRow
from spi_bus.transports.base import BUFFER_BYTES
from spi_bus.transports.reconnect import ReconnectingTransport
from spi_bus.transports.runner import LinkRunner, run_all
from tools.commands import listing

PATIENCE_S = 20.0
"""How long anything may take before a test fails: far more than it does."""

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
WIRED = [row for row in TRANSPORTS if not row.schemes]


def test_every_row_has_its_trial_and_is_listed() -> None:
    assert TRIALS.keys() == {row.name for row in WIRED}
    assert [name for name, _ in listing.rows("transports")] == [row.name for row in TRANSPORTS]


@pytest.mark.parametrize("row", TRANSPORTS, ids=lambda row: row.name)
def test_a_row_loads_and_says_what_it_is(row: TransportRow) -> None:
    assert len(row.description) > 20
    found = row.load()
    assert inspect.isclass(found)
    assert found.__module__ == row.module
    assert found.__doc__


@pytest.mark.parametrize("row", WIRED, ids=lambda row: row.name)
def test_all_bytes_go_through_both_ways_in_order(row: TransportRow) -> None:
    exchange, far = TRIALS[row.name](row)
    sent = bytes(range(256)) + b"\0\0\xff\xff" + bytes(reversed(range(256)))
    assert exchange(sent) == b"\x5a" + sent[:-1]
    assert bytes(far.heard) == sent
    assert exchange(b"\x11\x22") == sent[-1:] + b"\x11"


@pytest.mark.parametrize("row", WIRED, ids=lambda row: row.name)
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


# Transports that are opened by URL: every line of conftest.py, which together cover every row.


def gather(transport: Transport, count: int, others: tuple[Transport, ...] = ()) -> bytes:
    """Read until so many bytes have come; the others are flushed meanwhile."""
    found = b""
    end_s = time.monotonic() + PATIENCE_S
    while len(found) < count:
        found += transport.read(min(7_000, count - len(found)))
        for other in others:
            other.flush()
        assert time.monotonic() < end_s, f"{len(found)} of {count} bytes came"
        if len(found) < count:
            transport.wait(0.001 if others else 0.1)
    return found


def drain(transport: Transport, limit: int) -> tuple[bytes, str]:
    """Read until the line is lost; what came, and the reason."""
    found = b""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            found += transport.read(limit)
        except TransportLost as error:
            return found, str(error)
        transport.wait(0.01)
    pytest.fail(f"{transport.description} was never lost")


def pump(source: Transport, sink: Transport, data: bytes, cut: Callable[[], int]) -> bytes:
    """Write all of it in pieces while reading at the other end; return what came."""
    found, left = b"", data
    end_s = time.monotonic() + PATIENCE_S
    while len(found) < len(data):
        piece = left[: min(cut(), source.room)]
        source.write(piece)
        left = left[len(piece) :]
        found += sink.read(cut())
        source.read(0)  # lets CAN take flow control
        source.flush()
        if not piece and len(found) < len(data):
            sink.wait(0.001)
        assert time.monotonic() < end_s, f"{len(found)} of {len(data)} bytes came"
    return found


def test_every_row_that_a_url_opens_has_a_line(lines: tuple[Any, ...]) -> None:
    covered = {row for line in lines for row in line.rows}
    assert covered | {"replay"} == {row.name for row in TRANSPORTS if row.schemes}
    schemes = [scheme for row in TRANSPORTS for scheme in row.schemes]
    assert len(schemes) == len(set(schemes))


def test_bytes_arrive_intact_in_order_both_ways(line: Any, place: Any) -> None:
    one, other = line.open(place)
    rng = Random(11)
    data = bytes(range(256)) + b"\0\0\x11\x13\xff\xff\r\n\x03\x04" + rng.randbytes(3_000)
    for source, sink in ((one, other), (other, one)):
        assert pump(source, sink, data, lambda: rng.choice((1, 2, 7, 8, 63, 255, 600))) == data
    assert one.description
    assert one.openings == other.openings == 1


def test_reading_what_is_not_there_returns_at_once_with_nothing(line: Any, place: Any) -> None:
    one, other = line.open(place)
    assert one.read() == other.read() == b""
    one.wait(0.0)
    other.wait(0.001)
    one.write(b"")
    assert other.read() == b""


def test_waiting_ends_when_bytes_come(line: Any, place: Any) -> None:
    one, other = line.open(place)
    one.write(b"now")
    began_s = time.monotonic()
    found = b""
    while len(found) < 3:
        other.wait(PATIENCE_S)
        found += other.read()
    assert found == b"now"
    assert time.monotonic() - began_s < PATIENCE_S


def test_back_pressure_is_felt_and_nothing_is_lost(line: Any, place: Any) -> None:
    one, other = line.open(place)
    data = Random(5).randbytes(9_000 if line.slow else 2_000_000)
    taken = 0
    while taken < len(data) and (room := one.room):
        one.write(data[taken : taken + min(room, 1_000)])
        taken += min(room, 1_000, len(data) - taken)
    if line.blocks and not line.slow:
        assert 0 < taken < len(data), "a line that nobody reads took everything"
    if not one.room:
        with pytest.raises(TransportFull):
            one.write(b"x")
    assert gather(other, taken, (one,)) == data[:taken]
    rest = data[taken : taken + 5_000]
    assert pump(one, other, rest, lambda: 1_000) == rest


def test_more_than_there_is_room_for_is_refused_whole(line: Any, place: Any) -> None:
    one, other = line.open(place)
    with pytest.raises(TransportFull):
        one.write(bytes(one.room + 1))
    one.write(b"after")
    assert gather(other, 5, (one,)) == b"after"


def test_closing_is_final_and_may_be_repeated(line: Any, place: Any) -> None:
    one, _other = line.open(place)
    one.close()
    one.close()
    assert one.fileno() == -1
    for use in (one.read, lambda: one.write(b"x"), lambda: one.wait(0.0)):
        with pytest.raises(TransportClosedError, match="closed"):
            use()


@pytest.mark.parametrize("closing", [0, 1])
def test_what_came_before_the_other_end_closed_is_read_first(
    line: Any, place: Any, closing: int
) -> None:
    ends = line.open(place)
    gone, left = ends[closing], ends[1 - closing]
    gone.write(b"last words")
    if "pty" in line.rows and closing == 0:
        left.wait(PATIENCE_S)  # a pty's buffer goes with its controlling side
        assert left.read() == b"last words"
    elif not line.notices[1 - closing]:
        assert gather(left, 10, (gone,)) == b"last words"
    gone.close()
    if not line.notices[1 - closing]:
        assert left.read() == b""
        return
    found, reason = drain(left, 4)
    assert "gone" in reason
    assert found == (b"" if "pty" in line.rows else b"last words")
    assert left.room in (0, BUFFER_BYTES)
    with pytest.raises(TransportLost, match="gone"):
        left.read()


def test_both_ends_can_be_opened_again(line: Any, place: Any) -> None:
    for text in (b"first time", b"second time"):
        one, other = line.open(place)
        one.write(text)
        assert gather(other, len(text), (one,)) == text
        one.close()
        other.close()


class Faulty:
    """A transport whose received bytes are damaged, and whose cable can be pulled."""

    def __init__(self, inner: Transport, plug: Plug) -> None:
        self._inner = inner
        self._plug = plug

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def read(self, limit: int = 65_536) -> bytes:
        if not self._plug.there:
            raise TransportLost("pulled")
        return self._plug.damage(self._inner.read(limit))


class Plug:
    """What happens to one end: damage of one byte in so many, pulled or not."""

    def __init__(self, rng: Random, one_in: int) -> None:
        self.there = True
        self._rng = rng
        self._one_in = one_in
        self.damaged = 0

    def damage(self, chunk: bytes) -> bytes:
        if not self._one_in or self._rng.random() < (1 - 1 / self._one_in) ** len(chunk):
            return chunk
        self.damaged += 1
        where = self._rng.randrange(len(chunk))
        if self._rng.random() < 0.5:
            return chunk[:where]  # lost from here on
        return chunk[:where] + bytes((chunk[where] ^ 0x10,)) + chunk[where + 1 :]


class App:
    """Queues numbered messages as the link takes them, and checks those of the other side."""

    def __init__(self, link: Link, count: int) -> None:
        self.link = link
        self.left = deque(range(count))
        self.got: list[int] = []

    def hear(self, event: object) -> None:
        if isinstance(event, MessageReceived):
            self.got.append(event.message.token)

    def talk(self) -> None:
        kind = Ping if self.link.role is Role.MASTER else Pong
        while self.left and self.link.queued < self.link.config.queue_limit:
            self.link.send(kind(self.left.popleft()))


QUICK = LinkConfig(ack_delay_us=2_000, retransmit_us=20_000, retransmit_max_us=100_000)


def converse(ends: tuple[Transport, Transport], count: int, meddle: Callable[[int], None]) -> Any:
    """Send so many messages each way over two ends; `meddle` hears how many have arrived."""
    links = Link(Role.MASTER, 5, QUICK), Link(Role.SLAVE, 6, QUICK)
    apps = [App(link, count) for link in links]
    runners = [
        LinkRunner(link, end, on_event=app.hear, answer_pings=False)
        for link, end, app in zip(links, ends, apps, strict=True)
    ]

    def done() -> bool:
        for app in apps:
            app.talk()
        meddle(sum(len(app.got) for app in apps))
        return all(not app.left and not app.link.queued for app in apps) and all(
            len(app.got) == count for app in apps
        )

    run_all(runners, time.monotonic() + PATIENCE_S, done)
    for app in apps:
        assert app.got == list(range(count)), "lost, repeated or out of order"
    return runners


@pytest.mark.parametrize("one_in", [0, 120])
def test_the_link_is_exactly_once_over_it(line: Any, place: Any, one_in: int) -> None:
    plug = Plug(Random(3), one_in)
    one, other = (Faulty(end, plug) for end in line.open(place))
    runners = converse((one, other), 60, lambda arrived: None)
    again = sum(runner.link.statistics.retransmissions for runner in runners)
    if one_in:
        assert plug.damaged
        assert again
    for runner in runners:
        assert runner.link.statistics.lost == 0
        assert runner.statistics.bytes_read
        assert runner.diagnosis() is None


def test_the_link_survives_an_unplugged_line(line: Any, place: Any) -> None:
    """Both ends lose their line twice in the middle of a conversation and open it again."""
    plug = Plug(Random(4), 0)
    log = OutageLog()
    opened: list[Transport] = []

    def opener(index: int) -> Callable[[], Transport]:
        def open_line() -> Transport:
            if not plug.there:
                raise PortNotFoundError("pulled")
            if not opened:
                opened.extend(line.open(place))
            found = opened[index]
            taken[index] = True
            if all(taken):
                opened.clear()
                taken[:] = [False, False]
            return Faulty(found, plug)

        taken = takens
        return open_line

    takens = [False, False]
    back_off = BackOff(first_s=0.005, longest_s=0.02)
    ends = [ReconnectingTransport(opener(index), back_off, notify=log.note) for index in (0, 1)]
    pulled: list[int] = []

    def meddle(arrived: int) -> None:
        down = [end for end in ends if end.line is None]
        if plug.there and not down and arrived >= 40 * (len(pulled) + 1) and len(pulled) < 2:
            plug.there = False
            pulled.append(arrived)
        elif not plug.there and len(down) == 2:
            plug.there = True

    runners = converse((ends[0], ends[1]), 80, meddle)
    assert len(pulled) == 2
    assert log.outages == 4
    assert [end.openings for end in ends] == [3, 3]
    assert [runner.statistics.resumptions for runner in runners] == [2, 2]
    assert all(runner.link.statistics.peer_resets == 0 for runner in runners)
    for end in ends:
        end.close()


def test_a_loopback_gives_bytes_back_and_the_link_says_what_it_is(place: Any) -> None:
    loop = place.open("loop://?baud=921600")
    loop.write(b"to myself")
    assert gather(loop, 9) == b"to myself"
    runner = LinkRunner(Link(Role.MASTER, 5, QUICK), loop)
    runner.run(PATIENCE_S, lambda: bool(runner.link.error_counts[ErrorKind.ECHO]))
    assert not runner.link.connected
    assert "our own frames come back" in (runner.diagnosis() or "")


def test_a_replay_gives_what_was_recorded(place: Any) -> None:
    path = place.file(".log")
    place.number += 1
    recorded = place.open(f"record:{path}:pair:{place.number}")
    far = place.open(f"pair:{place.number}")
    converse((recorded, far), 40, lambda arrived: None)
    recorded.close()
    for play, role in (("received", Role.MASTER), ("sent", Role.SLAVE)):
        replayed = place.open(f"replay:{path}?pace=at-once&play={play}")
        found, reason = drain(replayed, 100)
        assert "ended" in reason
        messages = [Frame.parse(body) for body in Decoder().receive(found)]
        data = [frame for frame in messages if frame.frame_type == FrameType.DATA]
        numbers = [int.from_bytes(frame.payload[1:], "little") for frame in data]
        assert sorted(set(numbers)) == list(range(40)), role
        replayed.close()
        with pytest.raises(TransportClosedError):
            replayed.read()
