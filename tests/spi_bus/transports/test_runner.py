"""The loop, the outage rule and the reconnection in a time that the tests move."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from pathlib import Path

import pytest

from spi_bus.errors import PortNotFoundError, TransportClosedError, TransportFull, TransportLost
from spi_bus.frame import Frame, FrameType
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import Ping, Pong, TailBeat
from spi_bus.transports import BackOff, OutageLog
from spi_bus.transports.outage import OutageBegan, OutageEnded, Supervisor
from spi_bus.transports.reconnect import ReconnectingTransport
from spi_bus.transports.recording import Recorder, read_log
from spi_bus.transports.runner import LinkRunner, run_all


class Time:
    """A clock that moves when somebody waits, and with every look if told so."""

    def __init__(self, now_s: float = 100.0) -> None:
        self.now_s = now_s
        self.waits: list[float] = []
        self.stall: deque[float] = deque()  # how much longer the next waits take

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.waits.append(duration_s)
        self.now_s += duration_s + (self.stall.popleft() if self.stall else 0.0)


class Wire:
    """One end of a line in memory, with a delay, that can be lost."""

    openings = 1
    pending = 0
    wants_writable = False
    description = "wire"

    def __init__(self, time: Time, delay_s: float = 0.0, room: int = 4096) -> None:
        self.time = time
        self.delay_s = delay_s
        self.room = room
        self.coming: deque[tuple[float, bytes]] = deque()
        self.far: Wire | None = None
        self.lost = False
        self.closed = False

    def read(self, limit: int = 65_536) -> bytes:
        if self.lost:
            raise TransportLost("wire: pulled")
        found = b""
        while self.coming and self.coming[0][0] <= self.time():
            found += self.coming.popleft()[1]
        assert len(found) <= limit
        return found

    def write(self, data: bytes) -> None:
        if self.lost:
            raise TransportLost("wire: pulled")
        assert len(data) <= self.room
        if self.far is not None:
            self.far.coming.append((self.time() + self.delay_s, data))

    def flush(self) -> None: ...

    def fileno(self) -> int:
        return -1

    def next_deadline_s(self) -> float | None:
        return self.coming[0][0] if self.coming else None

    def wait(self, timeout_s: float) -> None:
        self.time.sleep(timeout_s)

    def close(self) -> None:
        self.closed = True


def wires(time: Time, delay_s: float = 0.0) -> tuple[Wire, Wire]:
    one, other = Wire(time, delay_s), Wire(time, delay_s)
    one.far, other.far = other, one
    return one, other


def links() -> tuple[Link, Link]:
    return Link(Role.MASTER, 1), Link(Role.SLAVE, 2)


def test_ticks_come_at_their_times_and_do_not_add_up_lateness() -> None:
    time = Time()
    ticks: list[tuple[int, float]] = []
    runner = LinkRunner(
        links()[0],
        Wire(time),
        on_tick=lambda number: ticks.append((number, round(time() - 100.0, 9))),
        period_s=0.010,
        deadline_s=0.002,
        clock=time,
    )
    time.stall.extend([0.0, 0.001, 0.003, 0.0, 0.025])
    runner.run(0.0999)
    numbers = [number for number, _ in ticks]
    assert ticks[:5] == [(0, 0.0), (1, 0.01), (2, 0.021), (3, 0.033), (4, 0.04)]
    assert ticks[5] == (5, 0.075)
    assert numbers == [0, 1, 2, 3, 4, 5, 8, 9], "ticks 6 and 7 were passed over"
    seen = runner.statistics
    assert (seen.ticks, seen.ticks_late, seen.ticks_skipped, seen.missed) == (8, 2, 2, 4)
    assert seen.tick_lateness.maximum_s == pytest.approx(0.025)
    assert seen.tick_lateness.total_s == pytest.approx(0.029)


def test_the_round_trip_is_what_the_wires_take() -> None:
    time = Time()
    master, slave = links()
    one, other = wires(time, delay_s=0.004)
    runners = (
        LinkRunner(master, one, ping_period_s=0.1, clock=time),
        LinkRunner(slave, other, clock=time),
    )
    run_all(runners, time() + 2.0)
    trip = runners[0].statistics.round_trip
    assert trip.count >= 18
    assert trip.minimum_s == pytest.approx(0.008, abs=0.0011)
    assert trip.maximum_s < 0.011
    assert runners[0].statistics.pings_sent - trip.count in (0, 1)
    assert runners[0].statistics.pings_lost == 0
    assert runners[1].statistics.pings_sent == 0
    assert set(runners[0].statistics.summary()) >= {"round_trip", "tick_lateness", "ticks_skipped"}


def test_application_messages_pass_and_the_runners_own_do_not() -> None:
    time = Time()
    master, slave = links()
    heard: dict[Role, list[object]] = {Role.MASTER: [], Role.SLAVE: []}

    def hear(role: Role) -> Callable[[object], None]:
        def note(event: object) -> None:
            if isinstance(event, MessageReceived):
                heard[role].append(event.message)

        return note

    one, other = wires(time, 0.001)
    runners = (
        LinkRunner(master, one, on_event=hear(Role.MASTER), ping_period_s=0.05, clock=time),
        LinkRunner(slave, other, on_event=hear(Role.SLAVE), answer_pings=False, clock=time),
    )
    master.send(TailBeat(1, 0.0, 0.25, 0.9, 5.0))
    slave.send(Pong(60_000))  # an answer to nothing that the runner asked
    run_all(runners, time() + 0.3)
    assert heard[Role.MASTER] == [Pong(60_000)]
    assert heard[Role.SLAVE][0] == TailBeat(1, 0.0, 0.25, 0.9, 5.0)
    assert Ping(1) in heard[Role.SLAVE]
    assert runners[0].statistics.round_trip.count == 0


def test_a_slave_that_cannot_answer_holds_its_master_off() -> None:
    time = Time()
    master, slave = links()
    one, other = wires(time, 0.001)
    runner = LinkRunner(slave, other, clock=time)
    boss = LinkRunner(master, one, clock=time)
    run_all((boss, runner), time() + 0.1)
    while slave.queued < slave.config.queue_limit:
        slave.send(Pong(1))
    one.room = other.room = 0  # nothing gets through any more
    for token in range(3):
        runner._dispatch([MessageReceived(Ping(token))])
    runner.turn()
    assert slave.receive_window == 0
    one.room = other.room = 4096
    run_all((boss, runner), time() + 5.0)
    assert slave.receive_window == slave.config.window
    assert slave.queued == 0


def test_no_more_is_taken_from_the_link_than_the_line_has_room_for() -> None:
    time = Time()
    master, slave = links()
    one, other = wires(time)
    one.room = 5
    heard: list[object] = []
    runners = (
        LinkRunner(master, one, clock=time),
        LinkRunner(slave, other, on_event=heard.append, clock=time),
    )
    master.send(Ping(9))
    run_all(runners, time() + 2.0)
    assert MessageReceived(Ping(9)) in heard


def test_a_peer_that_never_stops_does_not_hold_up_the_ticks() -> None:
    time = Time()

    class Flood(Wire):
        def read(self, limit: int = 65_536) -> bytes:
            time.now_s += 0.0001
            return bytes(100)

        def next_deadline_s(self) -> float | None:
            return time()

    ticks: list[int] = []
    runner = LinkRunner(links()[0], Flood(time), on_tick=ticks.append, period_s=0.01, clock=time)
    runner.run(0.1)
    assert ticks[:10] == list(range(10))
    assert runner.statistics.bytes_read > 50_000


def test_the_links_timers_are_served_and_their_lateness_is_counted() -> None:
    time = Time()
    runner = LinkRunner(links()[0], Wire(time), clock=time)
    time.stall.extend([0.0, 0.040])
    runner.run(1.0)
    late = runner.statistics.timer_lateness
    assert late.count >= 3
    assert late.maximum_s == pytest.approx(0.040, abs=1e-5)
    assert runner.link.statistics.frames_sent >= 3


@pytest.mark.parametrize("wrong", [{"period_s": 0.0}, {"ping_period_s": -1.0}])
def test_periods_are_positive(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="not positive"):
        LinkRunner(links()[0], Wire(Time()), **wrong)


def test_a_line_that_nobody_reopens_ends_the_run() -> None:
    time = Time()
    wire = Wire(time)
    runner = LinkRunner(links()[0], wire, clock=time)
    runner.run(0.1)
    wire.lost = True
    with pytest.raises(TransportLost):
        runner.run(0.1)


def test_why_a_link_does_not_come_up_is_said_in_a_line() -> None:
    time = Time()
    wire = Wire(time)
    runner = LinkRunner(links()[0], wire, clock=time)
    runner.run(0.2)
    assert "nothing comes" in (runner.diagnosis() or "")
    wire.coming.append((0.0, b"\x80\xfe\x80\x00garbage\x00"))
    runner.run(0.2)
    assert "baud" in (runner.diagnosis() or "")
    foreign = Frame(FrameType.HELLO, 0x20, 0, 0, 0x10, 4, bytes(6), version=2)
    wire.coming.append((0.0, foreign.encode()))
    runner.run(0.2)
    assert "version 2, we 1: install the same" in (runner.diagnosis() or "")
    deaf = LinkRunner(links()[0], wire, clock=time)
    wire.coming.append((0.0, Link(Role.SLAVE, 2).data_to_send(0)))
    deaf.run(0.2)
    assert "does the other side hear us" in (deaf.diagnosis() or "")


# The outage rule.


def test_attempts_back_off_and_begin_anew_after_a_time_of_peace() -> None:
    rule = Supervisor(BackOff(first_s=0.1, longest_s=0.5, factor=2.0), 0.0)
    assert rule.up
    assert rule.next_attempt_s is None
    assert rule.lost(10.0, "gone") == OutageBegan(10.0, "gone")
    times = []
    now_s = 10.0
    for _ in range(5):
        assert rule.next_attempt_s is not None
        times.append(round(rule.next_attempt_s - now_s, 6))
        now_s = rule.next_attempt_s
        assert rule.attempt_due(now_s)
        assert not rule.attempt_due(now_s - 0.01)
        rule.failed(now_s, "still gone")
    assert times == [0.1, 0.2, 0.4, 0.5, 0.5]
    assert rule.last_failure == "still gone"
    ended = rule.restored(20.0)
    assert ended == OutageEnded(20.0, 10.0, 6, "gone")
    assert ended.duration_s == 10.0
    rule.lost(20.1, "flapping")
    assert rule.next_attempt_s == pytest.approx(20.6), "a flapping line is hammered"
    rule.restored(21.0)
    rule.lost(21.5, "gone again")
    assert rule.next_attempt_s == pytest.approx(21.6)
    rule.restored(22.0)
    with pytest.raises(ValueError, match="not down"):
        rule.restored(23.0)


@pytest.mark.parametrize(
    "wrong", [{"first_s": 0.0}, {"first_s": 3.0, "longest_s": 1.0}, {"factor": 0.5}]
)
def test_paces_that_cannot_be_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"factor|first_s"):
        BackOff(**wrong)


class Cord:
    """Opens wires to one far side, or does not."""

    def __init__(self, time: Time) -> None:
        self.time = time
        self.far = Wire(time)
        self.there = True
        self.attempts: list[float] = []
        self.wire = Wire(time)

    def open(self) -> Wire:
        self.attempts.append(self.time())
        if not self.there:
            raise PortNotFoundError("no cord")
        self.wire = Wire(self.time)
        self.wire.far, self.far.far = self.far, self.wire
        self.far.coming.clear()
        return self.wire

    def pull(self) -> None:
        self.there = False
        self.wire.lost = True


def test_an_outage_is_survived_and_told() -> None:
    time, log = Time(), OutageLog()
    cord = Cord(time)
    line = ReconnectingTransport(
        cord.open, BackOff(first_s=0.1, longest_s=1.0), time, log.note, time.sleep
    )
    master, slave = links()
    heard: list[object] = []
    runners = (
        LinkRunner(master, line, clock=time),
        LinkRunner(slave, cord.far, on_event=heard.append, clock=time),
    )
    sent = [TailBeat(number, 0.0, 0.25, 0.9, 5.0) for number in range(9)]
    for message in sent[:3]:
        master.send(message)
    run_all(runners, time() + 0.5)
    assert master.queued == 0
    old = cord.wire
    cord.pull()
    for message in sent[3:6]:
        master.send(message)
    run_all(runners, time() + 1.0)
    assert old.closed
    assert line.line is None
    assert line.room == line.pending == 0
    assert line.fileno() == -1
    assert "no cord" in line.description
    with pytest.raises(TransportFull):
        line.write(b"x")
    cord.there = True
    for message in sent[6:]:
        master.send(message)
    run_all(runners, time() + 3.0)
    assert [e.message for e in heard if isinstance(e, MessageReceived)] == sent
    assert runners[0].statistics.resumptions == 1
    began, ended = log.last
    assert isinstance(began, OutageBegan)
    assert isinstance(ended, OutageEnded)
    gaps = [
        b - a for a, b in zip([began.time_s, *cord.attempts[1:]], cord.attempts[1:], strict=False)
    ]
    assert gaps[:4] == pytest.approx([0.1, 0.2, 0.4, 0.8], abs=0.01)
    assert log.summary() == {
        "outages": 1,
        "down_s": pytest.approx(ended.duration_s),
        "longest_s": pytest.approx(ended.duration_s),
        "attempts": ended.attempts,
    }
    line.close()
    assert cord.wire.closed
    with pytest.raises(TransportClosedError):
        line.read()
    with pytest.raises(TransportClosedError):
        line.wait(1.0)


def test_the_first_opening_fails_at_once() -> None:
    time = Time()
    cord = Cord(time)
    cord.there = False
    with pytest.raises(PortNotFoundError):
        ReconnectingTransport(cord.open, clock=time)
    assert len(cord.attempts) == 1


def test_a_recording_is_the_same_every_time_and_holds_the_outage(tmp_path: Path) -> None:
    texts = []
    for name in ("a.log", "b.log"):
        time = Time()
        cord = Cord(time)

        def open_line(
            note: Callable[[object], None], time: Time = time, cord: Cord = cord
        ) -> object:
            return ReconnectingTransport(cord.open, BackOff(), time, note, time.sleep)

        recorder = Recorder(open_line, tmp_path / name, time)
        master = Link(Role.MASTER, 1, LinkConfig())
        slave = Link(Role.SLAVE, 2, LinkConfig())
        runners = (
            LinkRunner(master, recorder, clock=time),
            LinkRunner(slave, cord.far, clock=time),
        )
        master.send(Ping(1))
        run_all(runners, time() + 0.2)
        cord.pull()
        run_all(runners, time() + 0.2)
        cord.there = True
        run_all(runners, time() + 1.0)
        recorder.close()
        texts.append((tmp_path / name).read_text())
        lines = list(read_log(tmp_path / name))
        assert [line.time_us for line in lines] == sorted(line.time_us for line in lines)
        happened = [line.text.split(":")[0] for line in lines if line.kind == "!"]
        assert happened == ["down", "up"]
        assert lines[0].kind == ">"
        assert lines[0].data[0] == 0, "a zero goes first"
        assert lines[0].time_us == 0
    assert texts[0] == texts[1]
