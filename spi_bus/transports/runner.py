"""The one loop that brings a link, a line and the time together.

A turn: what has arrived goes to the link and its events to the application; then timers and ticks
that are due; then what the link wants to send, as much as the line takes; then one wait, until
bytes come, the line takes more, or the next moment that anything asked for. Everything that decides
is in the link, sans-IO; the clock and the waiting come from outside, so that the same loop runs in
real time and, with a clock that a test moves, without any.

Ticks come at origin + n · period and never at the last one plus a period: lateness does not add up.
A tick that is late by whole periods is run once, and those passed over are counted.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import floor
from typing import Any, Final

from firmware_model.histogram import DurationHistogram
from spi_bus.errors import LinkFull
from spi_bus.frame import ErrorKind
from spi_bus.link import (
    Event,
    Link,
    LinkError,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
)
from spi_bus.messages import Ping, Pong
from spi_bus.transports.base import Clock, Transport, wait_any

__all__ = ["LinkRunner", "RunnerStatistics", "run_all"]

_LONGEST_WAIT_S: Final = 0.5
"""However little there is to do, look this often whether to stop."""
_READS_A_TURN: Final = 8
"""A peer that never stops does not keep ticks and timers waiting."""
_GRACE_US: Final = 1e-3
"""A moment that was waited for has come, though its sum in floating point be an ulp short."""
_AHEAD_BYTES: Final = 512
"""Bytes that a transport may hold back: two of the largest frames."""
_MOST_PINGS: Final = 64
"""Probes waited for at once; with the link's own queue of 16 there are rarely so many."""


@dataclass(slots=True)
class RunnerStatistics:
    """What one runner saw since it began."""

    bytes_read: int = 0
    bytes_written: int = 0
    turns: int = 0
    ticks: int = 0
    ticks_late: int = 0
    """Ticks later than `deadline_s`."""
    ticks_skipped: int = 0
    """Whole periods that passed without their tick."""
    pings_sent: int = 0
    pings_lost: int = 0
    """Probes whose answer the peer's reset took, or that were too many to remember."""
    resumptions: int = 0
    """How often the line was opened again."""
    tick_lateness: DurationHistogram = field(default_factory=DurationHistogram)
    timer_lateness: DurationHistogram = field(default_factory=DurationHistogram)
    """How late the link's own timers were served."""
    round_trip: DurationHistogram = field(default_factory=DurationHistogram)
    """From queueing a Ping to its Pong: both links, both lines, both loops."""

    @property
    def missed(self) -> int:
        """Deadlines missed: ticks late, and ticks that never came."""
        return self.ticks_late + self.ticks_skipped

    def summary(self) -> dict[str, Any]:
        """Everything, for a `summary.json`."""
        return {
            "bytes_read": self.bytes_read,
            "bytes_written": self.bytes_written,
            "ticks": self.ticks,
            "ticks_late": self.ticks_late,
            "ticks_skipped": self.ticks_skipped,
            "pings_sent": self.pings_sent,
            "pings_lost": self.pings_lost,
            "resumptions": self.resumptions,
            "tick_lateness": self.tick_lateness.summary(),
            "timer_lateness": self.timer_lateness.summary(),
            "round_trip": self.round_trip.summary(),
        }


class LinkRunner:
    """Drives one link over one transport.

    Args:
        link: either side.
        transport: open; `close` it yourself.
        on_event: hears what the link says; answers to the runner's own probes excepted.
        on_tick: called with the tick's number (from 0) every `period_s`.
        period_s: of ticks; None for none.
        deadline_s: a tick later than this counts as late.
        ping_period_s: how often a master measures the round trip; None for never.
        answer_pings: a slave answers Ping with Pong itself.
        clock: monotonic, in seconds; also what the transport was opened with.

    """

    def __init__(
        self,
        link: Link,
        transport: Transport,
        *,
        on_event: Callable[[Event], None] = lambda event: None,
        on_tick: Callable[[int], None] = lambda number: None,
        period_s: float | None = None,
        deadline_s: float = 0.005,
        ping_period_s: float | None = None,
        answer_pings: bool = True,
        clock: Clock = time.monotonic,
    ) -> None:
        for name, value in (("period_s", period_s), ("ping_period_s", ping_period_s)):
            if value is not None and not value > 0:
                raise ValueError(f"{name} = {value} is not positive")
        self.link = link
        self.transport = transport
        self.statistics = RunnerStatistics()
        self._on_event = on_event
        self._on_tick = on_tick
        self._period_s = period_s
        self._deadline_s = deadline_s
        self._ping_period_s = ping_period_s if link.role is Role.MASTER else None
        self._answers = answer_pings and link.role is Role.SLAVE
        self._clock = clock
        self._origin_s = clock()
        self._openings = 0
        self._tick = 0
        self._ping = 0
        self._token = 0
        self._asked: dict[int, float] = {}  # token → when, oldest first
        self._underway: dict[int, int] = {}  # the link's token → ours, until acknowledged
        self._owed: deque[int] = deque()
        self._held_off = False
        self._window = link.receive_window
        self._version_seen = ""

    def now_us(self) -> int:
        """The link's time: microseconds since this runner began."""
        return floor((self._clock() - self._origin_s) * 1e6 + _GRACE_US)

    def run(self, duration_s: float, stop: Callable[[], bool] = lambda: False) -> None:
        """Run for a time, or until `stop` says so (asked every turn).

        Raises:
            TransportLost: the line is gone and nobody opens it again.

        """
        run_all((self,), self._clock() + duration_s, stop)

    def settle(self, timeout_s: float) -> bool:
        """Run without ticks and probes until all is acknowledged; return whether it was."""

        def done() -> bool:
            return not (
                self.link.queued
                or self.link.wants_to_send
                or self.transport.pending
                or self._owed
                or self._asked
            )

        self.run_quietly(timeout_s, done)
        return done()

    def run_quietly(self, duration_s: float, stop: Callable[[], bool] = lambda: False) -> None:
        """Run as `run`, without ticks and probes of our own."""
        period_s, self._period_s = self._period_s, None
        ping_s, self._ping_period_s = self._ping_period_s, None
        try:
            self.run(duration_s, stop)
        finally:
            self._period_s, self._ping_period_s = period_s, ping_s

    def turn(self) -> None:
        """Do what there is to do now, without waiting."""
        self.statistics.turns += 1
        self._receive()
        self._serve_timers()
        self._serve_ticks()
        self._probe()
        self._send()

    def next_moment_s(self) -> float | None:
        """Return when `turn` has something to do even if no byte comes."""
        moments = []
        deadline_us = self.link.next_deadline_us()
        if deadline_us is not None:
            moments.append(self._origin_s + deadline_us / 1e6)
        if self._period_s is not None:
            moments.append(self._origin_s + self._tick * self._period_s)
        if self._ping_period_s is not None:
            moments.append(self._origin_s + self._ping * self._ping_period_s)
        return min(moments, default=None)

    def diagnosis(self) -> str | None:
        """Return a line on why the link does not come up; None when it is up."""
        link, seen = self.link, self.statistics
        if link.connected:
            return None
        where = self.transport.description
        if self._version_seen:
            return f"{where}: {self._version_seen}: install the same version on both sides"
        errors = link.error_counts
        if errors[ErrorKind.ECHO]:
            return f"{where}: our own frames come back: is TX wired to RX of the same side?"
        if seen.bytes_read and not link.statistics.frames_received:
            return (
                f"{where}: {seen.bytes_read} bytes came and no frame was intact: is the baud rate "
                "the same on both sides, and is this the link's port?"
            )
        if not seen.bytes_read:
            return f"{where}: nothing comes: is the other side running, and the cable in?"
        return f"{where}: frames come but no greeting is answered: does the other side hear us?"

    # One turn's parts.

    def _receive(self) -> None:
        for _ in range(_READS_A_TURN):
            data = self.transport.read()
            if self.transport.openings != self._openings:
                self.statistics.resumptions += bool(self._openings)
                self._openings = self.transport.openings
                self.link.resume(self.now_us())
            if not data:
                return
            self.statistics.bytes_read += len(data)
            self._dispatch(self.link.receive(data, self.now_us()))

    def _dispatch(self, events: Sequence[Event]) -> None:
        for event in events:
            match event:
                case MessageReceived(Pong(token)) if token in self._asked:
                    self.statistics.round_trip.record(self._clock() - self._asked.pop(token))
                    continue
                case MessageReceived(Ping(token)) if self._answers:
                    self._owed.append(token)
                case MessageAcknowledged(token) if token in self._underway:
                    del self._underway[token]
                    continue
                case PeerReset():
                    self._forget_lost_probes()
                case LinkError(ErrorKind.VERSION, _, detail):
                    self._version_seen = detail
            self._on_event(event)

    def _forget_lost_probes(self) -> None:
        # Acknowledged and not answered: the answer was in the memory of the peer that is gone.
        still = set(self._underway.values())
        for token in [token for token in self._asked if token not in still]:
            del self._asked[token]
            self.statistics.pings_lost += 1

    def _serve_timers(self) -> None:
        deadline_us = self.link.next_deadline_us()
        now_us = self.now_us()
        if deadline_us is not None and now_us >= deadline_us:
            self.statistics.timer_lateness.record((now_us - deadline_us) / 1e6)
            self.link.handle_timer(now_us)

    def _serve_ticks(self) -> None:
        period_s, seen = self._period_s, self.statistics
        if period_s is None:
            return
        late_s = self._clock() - (self._origin_s + self._tick * period_s)
        if late_s < 0:
            return
        seen.ticks += 1
        seen.tick_lateness.record(late_s)
        if late_s > self._deadline_s:
            seen.ticks_late += 1
        number = self._tick
        skipped = floor(late_s / period_s)
        seen.ticks_skipped += skipped
        self._tick += 1 + skipped
        self._on_tick(number)

    def _probe(self) -> None:
        if self._answers:
            self._answer()
        if self._ping_period_s is None:
            return
        now_s = self._clock()
        late_s = now_s - (self._origin_s + self._ping * self._ping_period_s)
        if late_s < 0:
            return
        self._ping += 1 + floor(late_s / self._ping_period_s)
        if not self.link.connected:
            return
        token = (self._token + 1) & 0xFFFF
        try:
            self._underway[self.link.send(Ping(token))] = token
        except LinkFull:
            return  # it would measure the queue
        self._token = token
        self.statistics.pings_sent += 1
        self._asked[token] = now_s
        if len(self._asked) > _MOST_PINGS:
            del self._asked[next(iter(self._asked))]
            self.statistics.pings_lost += 1

    def _answer(self) -> None:
        while self._owed:
            try:
                self.link.send(Pong(self._owed[0]))
            except LinkFull:
                break
            self._owed.popleft()
        # A peer that asks faster than answers go is held off, not remembered without bound.
        if bool(self._owed) != self._held_off:
            self._held_off = not self._held_off
            if self._held_off:
                self._window, self.link.receive_window = self.link.receive_window, 0
            else:
                self.link.receive_window = self._window

    def _send(self) -> None:
        transport, link = self.transport, self.link
        while link.wants_to_send and (room := self._room()) > 0:
            data = link.data_to_send(self.now_us(), room)
            if not data:
                break
            self.statistics.bytes_written += len(data)
            transport.write(data)
        transport.flush()

    def _room(self) -> int:
        # A frame that waits in a buffer acknowledges what had come when it was made, and nothing
        # since: so no more than keeps the line busy is made ahead.
        return min(self.transport.room, _AHEAD_BYTES - self.transport.pending)


def run_all(
    runners: Sequence[LinkRunner],
    until_s: float,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Run several links on one thread until a time of their common clock, or until `stop`.

    Raises:
        TransportLost: a line is gone and nobody opens it again.

    """
    clock = runners[0]._clock
    transports = [runner.transport for runner in runners]
    while True:
        for runner in runners:
            runner.turn()
        now_s = clock()
        if stop() or now_s >= until_s:
            return
        moments = [at for runner in runners if (at := runner.next_moment_s()) is not None]
        wake_s = min([until_s, now_s + _LONGEST_WAIT_S, *moments])
        if wake_s > now_s:
            wait_any(transports, wake_s - now_s, clock)
