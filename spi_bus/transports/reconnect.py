"""A transport that survives its line: when that is lost it is opened again.

To the link above it looks like a line that is silent and takes nothing for a while. `openings`
grows when it is back, on which the runner calls `Link.resume`: what was acknowledged stays
delivered once, what was not is sent again.

The first opening is not retried: a port that is not there at the start is a user's mistake more
often than an outage, and its message should be seen at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from spi_bus.errors import TransportClosedError, TransportError, TransportFull, TransportLost
from spi_bus.transports.base import READ_BYTES, Clock, Transport, wait_any
from spi_bus.transports.outage import BackOff, OutageEvent, Supervisor

__all__ = ["ReconnectingTransport"]


class ReconnectingTransport:
    """Opens a transport, and opens it again whenever it is lost.

    Args:
        open_line: opens it; called once now and once an attempt.
        back_off: pace of the attempts.
        clock: monotonic, in seconds.
        notify: hears when an outage begins and ends.
        sleep: how `wait` waits while there is nothing to wait on.

    Raises:
        TransportError: what `open_line` raises the first time.

    """

    def __init__(
        self,
        open_line: Callable[[], Transport],
        back_off: BackOff | None = None,
        clock: Clock = time.monotonic,
        notify: Callable[[OutageEvent], None] = lambda event: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._open_line = open_line
        self._clock = clock
        self._notify = notify
        self._sleep = sleep
        self._line: Transport | None = open_line()
        self._supervisor = Supervisor(back_off or BackOff(), clock())
        self._description = self._line.description
        self._closed = False
        self.openings = 1

    @property
    def line(self) -> Transport | None:
        """The transport in use; None during an outage."""
        return self._line

    @property
    def description(self) -> str:
        """The line's, and what is wrong with it at present."""
        if self._line is not None:
            return self._line.description
        failure = self._supervisor.last_failure
        return f"{self._description} (gone{': ' + failure if failure else ''})"

    @property
    def room(self) -> int:
        """Bytes that `write` takes now; 0 during an outage."""
        return self._line.room if self._line is not None else 0

    @property
    def pending(self) -> int:
        """Bytes that the system has not taken yet."""
        return self._line.pending if self._line is not None else 0

    @property
    def wants_writable(self) -> bool:
        """Whether the descriptor's becoming writable would help."""
        return self._line is not None and self._line.wants_writable

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived; nothing during an outage, at whose end the line is opened."""
        line = self._up()
        if line is None:
            return b""
        try:
            return line.read(limit)
        except TransportLost as error:
            self._lost(line, error)
            return b""

    def write(self, data: bytes) -> None:
        """Take bytes to send; those that meet the loss of the line are lost with it.

        Raises:
            TransportFull: more than `room`, as always during an outage.

        """
        line = self._up()
        if line is None:
            if data:
                raise TransportFull(f"{self.description}: nothing can be sent now")
            return
        try:
            line.write(data)
        except TransportLost as error:
            self._lost(line, error)

    def flush(self) -> None:
        """Hand on what is pending; during an outage, try the line when that is due."""
        line = self._up()
        if line is not None:
            line.flush()

    def fileno(self) -> int:
        """Return the line's descriptor, -1 during an outage."""
        return self._line.fileno() if self._line is not None else -1

    def next_deadline_s(self) -> float | None:
        """Return the line's deadline, or when it is tried again."""
        if self._line is not None:
            return self._line.next_deadline_s()
        return self._supervisor.next_attempt_s

    def wait(self, timeout_s: float) -> None:
        """Block until there may be something to do, at most this long."""
        if self._closed:
            raise TransportClosedError(f"{self._description} was closed: open it again")
        if self._line is not None:
            if self._line.fileno() >= 0:
                wait_any((self._line,), timeout_s, self._clock)
            else:
                self._line.wait(timeout_s)
            return
        attempt_s = self._supervisor.next_attempt_s
        if attempt_s is not None:
            timeout_s = min(timeout_s, attempt_s - self._clock())
        if timeout_s > 0:
            self._sleep(timeout_s)

    def close(self) -> None:
        """Close the line for good."""
        self._closed = True
        if self._line is not None:
            self._line.close()
            self._line = None

    def _up(self) -> Transport | None:
        if self._closed:
            raise TransportClosedError(f"{self._description} was closed: open it again")
        if self._line is None and self._supervisor.attempt_due(self._clock()):
            try:
                self._line = self._open_line()
            except (TransportError, OSError) as error:
                self._supervisor.failed(self._clock(), str(error))
            else:
                self.openings += 1
                self._notify(self._supervisor.restored(self._clock()))
        return self._line

    def _lost(self, line: Transport, error: TransportLost) -> None:
        self._line = None
        line.close()
        self._notify(self._supervisor.lost(self._clock(), str(error)))
