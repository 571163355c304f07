"""The other board as a test plays it: a link that answers at once, on a clock that only moves.

It stands where a transport stands. Waiting moves the clock, so a run in real time takes as long as
it computes, and every time in it is the same on every machine.
"""

from __future__ import annotations

import time

from spi_bus.errors import LinkFull
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import (
    ClockReport,
    ClockRequest,
    CommandApplied,
    Ping,
    Pong,
    SensorReport,
    TailBeat,
)
from spi_bus.transports.base import READ_BYTES


class Clock:
    """Seconds that pass when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class HostClock(Clock):
    """The host's own clock; to have it go on is to sleep."""

    def __init__(self) -> None:
        """Nothing to set."""

    def __call__(self) -> float:
        return time.monotonic()

    @property
    def now_s(self) -> float:  # type: ignore[override]
        """What it shows."""
        return time.monotonic()

    @now_s.setter
    def now_s(self, value: float) -> None:
        time.sleep(max(0.0, value - time.monotonic()))


class FarSide:
    """A transport with a board at its other end that says something every `period_s`."""

    openings = 1
    wants_writable = False
    room = 4096
    pending = 0
    description = "the far side"

    def __init__(self, role: Role, clock: Clock, period_s: float, *, answers: bool = True) -> None:
        self.link = Link(role, 9, LinkConfig(queue_limit=64))
        self.made = 0
        self.received: list[object] = []
        """The last hundred messages."""
        self.count = 0
        self._answers = answers
        self._clock = clock
        self._period_s = period_s
        self._next_s = clock()
        self._out = bytearray()

    def _now_us(self) -> int:
        return round(self._clock() * 1e6)

    def _send(self, message: object) -> bool:
        try:
            self.link.send(message)
        except LinkFull:
            return False
        return True

    def _work(self) -> None:
        now_us = self._now_us()
        deadline_us = self.link.next_deadline_us()
        if deadline_us is not None and deadline_us <= now_us:
            self.link.handle_timer(now_us)
        while self.link.connected and self._clock() >= self._next_s:
            self._next_s += self._period_s
            number = (self.made + 1) & 0xFFFF
            if self.link.role is Role.MASTER:
                message: object = TailBeat(number, 0.1, 0.2, 0.9, 3.0)
            else:
                values = (0.1, 0.0, 0.0, 9.8, 0.5, 0.5, 0.2, 7.4, 0.3, 18.0, None)
                message = SensorReport(now_us, number, *values)
            self.made += self._send(message)
        self._out += self.link.data_to_send(now_us)

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what the far board has sent."""
        self._work()
        data = bytes(self._out[:limit])
        del self._out[:limit]
        return data

    def write(self, data: bytes) -> None:
        """Let the far board take bytes and answer."""
        for event in self.link.receive(data, self._now_us()):
            if not isinstance(event, MessageReceived):
                continue
            message = event.message
            self.count += 1
            self.received = [*self.received[-99:], message]
            if not self._answers:
                continue
            if isinstance(message, Ping):
                self._send(Pong(message.token))
            elif isinstance(message, ClockRequest):
                self._send(ClockReport(message.token, self._now_us()))
            elif isinstance(message, TailBeat):
                self._send(CommandApplied(message.command_id, self._now_us()))

    def flush(self) -> None:
        """Nothing is pending."""

    def close(self) -> None:
        """Nothing to give back."""

    def fileno(self) -> int:
        """Return -1: no descriptor."""
        return -1

    def next_deadline_s(self) -> float | None:
        """Return when the far board says something next."""
        if self._out or self.link.wants_to_send:
            return self._clock()
        deadline_us = self.link.next_deadline_us()
        times = [] if deadline_us is None else [deadline_us / 1e6]
        if self.link.connected:
            times.append(self._next_s)
        return min(times, default=None)

    def wait(self, timeout_s: float) -> None:
        """Let the clock go on."""
        deadline_s = self.next_deadline_s()
        if deadline_s is not None:
            timeout_s = min(timeout_s, deadline_s - self._clock())
        self._clock.now_s += max(timeout_s, 1e-6)
