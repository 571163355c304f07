"""The line of a plant in the loop, at either end: a transport, a link, and what passes.

A `LinkRunner` does the work; here it is made to fit a `LineScheduler`, which waits on the line and
asks now and then what came. Messages that a full link does not take wait here, in order and up to a
bound: what waits beyond that is old text of a GPS, and is dropped and counted.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from spi_bus.errors import LinkFull
from spi_bus.link import Event, Link, Role
from spi_bus.plant_messages import PLANT_MESSAGES
from spi_bus.transports.base import Clock, Transport, Waitable, wait_any
from spi_bus.transports.runner import LinkRunner

MOST_WAITING: Final = 64
"""Messages beyond the link's own queue: two seconds of a GPS's characters."""


class PlantLine:
    """One end of the line.

    Args:
        transport: open; `close` closes it.
        role: master where the plant is, slave where the board is.
        epoch: number of this start, unlike those before it.
        clock: monotonic, in seconds; the one that the transport was opened with.

    """

    def __init__(
        self, transport: Transport, role: Role, epoch: int, clock: Clock = time.monotonic
    ) -> None:
        self.transport = transport
        self.link = Link(role, epoch, table=PLANT_MESSAGES)
        self.runner = LinkRunner(
            self.link, transport, on_event=self._note, answer_pings=False, clock=clock
        )
        self.events: deque[tuple[float, Event]] = deque()
        """What came, with the clock's time; whoever is called by `on_incoming` takes it."""
        self.on_incoming: Callable[[], None] = lambda: None
        self.on_streamed: Callable[[float], None] = lambda clock_s: None
        """Called when the transport has taken a frame of our stream, with the clock's time."""
        self.dropped = 0
        """Messages that found too many waiting."""
        self.clock = clock
        self._waiting: deque[object] = deque()
        self._streamed = 0

    def send(self, message: object) -> None:
        """Queue a message that has to arrive."""
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(message)
        self._turn()

    def send_newest(self, message: object) -> None:
        """Hand over the newest message of our stream."""
        self.link.send_newest(message)
        self._turn()

    def poll(self) -> bool:
        """Do what there is to do now; return whether something came."""
        self._turn()
        return bool(self.events)

    def wait(self, timeout_s: float) -> None:
        """Block until there may be something to do, at most this long."""
        deadline_s = self.next_deadline_s()
        if deadline_s is not None:
            timeout_s = min(timeout_s, deadline_s - self.clock())
        if timeout_s > 0:
            wait_any((self.transport,), timeout_s, self.clock)

    def waitables(self) -> list[Waitable]:
        """Return what to wait on: the transport, and our own timers."""
        return [self]

    @property
    def wants_writable(self) -> bool:
        """Whether room in the transport would help."""
        return self.transport.wants_writable

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self.transport.fileno()

    def next_deadline_s(self) -> float | None:
        """Return when there is something to do even if no byte comes."""
        if self.events:
            return self.clock()
        moments = (self.transport.next_deadline_s(), self.runner.next_moment_s())
        return min((moment for moment in moments if moment is not None), default=None)

    def close(self) -> None:
        """Close the transport."""
        self.transport.close()

    def _note(self, event: Event) -> None:
        self.events.append((self.clock(), event))

    def _turn(self) -> None:
        self._hand_over()
        self.runner.turn()
        if self._waiting and self._hand_over():
            self.runner.turn()
        streamed = self.link.statistics.streamed
        if streamed != self._streamed:
            self._streamed = streamed
            self.on_streamed(self.clock())

    def _hand_over(self) -> bool:
        """Give the link what it takes; return whether that was anything."""
        before = len(self._waiting)
        while self._waiting:
            try:
                self.link.send(self._waiting[0])
            except LinkFull:
                break
            self._waiting.popleft()
        return len(self._waiting) < before
