"""The sending half of a link: a queue, what of it is in flight, and when it is sent again.

Go-back-N: the peer takes messages in order only, so that everything behind a loss is sent again.
Indices count in the queue, whose first message has the sequence number `base`; `next` is what is
sent next, `high` how many have been sent in this session. Whether there is a session is the link's
business: here messages wait or go.

How long an acknowledgement takes depends on the line: at 115 200 baud two windows of the largest
frames are 0.18 s. So the round trip is measured, of one message at a time from its first sending,
and twice its mean is waited for, `retransmit_us` at the least. RFC 6298 measures no message that
was sent twice (Karn's rule) and keeps its back-off instead, which on a line that loses most frames
costs seconds; here one time-out in between is let pass, or the wait would never become longer, two
are not.
"""

from collections import deque
from typing import Final

from spi_bus.errors import LinkFull
from spi_bus.frame import MAX_WINDOW
from spi_bus.link_types import LinkConfig, Statistics, Timer

__all__ = ["PROBE_AFTER_TIMEOUTS", "Sender"]

PROBE_AFTER_TIMEOUTS: Final = 4
"""Time-outs in a row after which the peer is asked for a HELLO as well: is it who it was?"""


class Sender:
    """Messages queued and in flight.

    Args:
        config: window, length of the queue, times.
        statistics: where messages and repetitions are counted.

    """

    __slots__ = (
        "_config", "_next", "_probe", "_queue", "_round_trip_us", "_statistics", "_timed",
        "_timed_us", "_timeouts", "_token", "_went_back", "base", "high", "peer_window", "timer",
    )  # fmt: skip

    def __init__(self, config: LinkConfig, statistics: Statistics) -> None:
        self._config = config
        self._statistics = statistics
        self._queue: deque[tuple[int, bytes]] = deque()  # token, payload
        self._token = 0
        self.base = 0  # sequence of the queue's first message
        self._next = 0
        self.high = 0
        self.peer_window = 1
        self._probe = False
        self._went_back = False
        self._timeouts = 0
        self.timer = Timer(config.retransmit_us, config.retransmit_max_us)
        self._timed: int | None = None  # sequence of the message whose round trip is measured
        self._timed_us = 0
        self._round_trip_us = 0  # mean; 0: not known yet

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def silent_peer(self) -> bool:
        """Whether so many time-outs came in a row that the peer may be another one."""
        return self._timeouts >= PROBE_AFTER_TIMEOUTS

    @property
    def sendable(self) -> bool:
        """Whether the windows let a message go, or a closed one is to be probed."""
        index = self._next
        if index >= len(self._queue):
            return False
        window = min(self._config.window, self.peer_window)
        return index < window or (self._probe and not index)

    def check_room(self) -> None:
        """Raise `LinkFull` where no message can be queued."""
        if len(self._queue) >= self._config.queue_limit:
            raise LinkFull(f"{len(self._queue)} messages wait for the peer")

    def push(self, payload: bytes, now_us: int) -> int:
        """Queue a payload and return its token."""
        self._token += 1
        self._queue.append((self._token, payload))
        self._statistics.messages_sent += 1
        if self.peer_window == 0 and self.timer.deadline_us is None:
            self.timer.start(now_us)
        return self._token

    def take(self, now_us: int) -> tuple[int, bytes]:
        """Return index and payload of the message to send now; only while `sendable`."""
        index = self._next
        self._next = index + 1
        self._probe = False
        if index < self.high:
            self._statistics.retransmissions += 1
        else:
            self.high = index + 1
            if self._timed is None:
                self._timed = (self.base + index) & 0xFF
                self._timed_us = now_us
        if self.timer.deadline_us is None:
            self.timer.start(now_us)
        return index, self._queue[index][1]

    def acknowledge(self, expected: int, window: int, now_us: int, *, gap: bool) -> list[int]:
        """Take what the peer says of itself; return the tokens that it has now acknowledged.

        Args:
            expected: the sequence number that it expects next.
            window: messages that it takes from there on.
            now_us: the time.
            gap: it missed one.

        """
        count = (expected - self.base) & 0xFF
        if count > self.high:
            return []  # older than what we know already
        reopened = window and not self.peer_window
        self.peer_window = window
        timer = self.timer
        queue = self._queue
        tokens = []
        if count:
            tokens = [queue.popleft()[0] for _ in range(count)]
            self._statistics.messages_acknowledged += count
            self.base = expected
            self.high -= count
            self._next = max(self._next - count, 0)
            self._went_back = False
            self._measure(expected, now_us)
            self._timeouts = 0
            timer.stop()
            if self.high:
                timer.start(now_us)
        if (gap or reopened) and self.high and not self._went_back:
            self._next = 0  # what was in flight behind the gap or the closed window is gone
            self._went_back = True
            self._timed = None
            timer.start(now_us)
        if not window:
            self._timed = None  # the application's time, and not the line's
            if queue and timer.deadline_us is None:
                timer.start(now_us)  # the update that opens the window again may be lost: probe
        return tokens

    def _measure(self, expected: int, now_us: int) -> None:
        """Take the round trip, if the message that is timed is acknowledged now."""
        if self._timed is None or not 0 < (expected - self._timed) & 0xFF <= MAX_WINDOW:
            return
        self._timed = None
        config = self._config
        now_trip_us = min(now_us - self._timed_us, config.retransmit_max_us)
        mean_us = self._round_trip_us
        self._round_trip_us = mean_us - mean_us // 8 + now_trip_us // 8 if mean_us else now_trip_us
        wait_us = max(config.retransmit_us, 2 * self._round_trip_us)
        self.timer.first_us = min(wait_us, config.retransmit_max_us)

    def expire(self, now_us: int) -> bool:
        """Go back if the time is out; return whether it was."""
        timer = self.timer
        if timer.deadline_us is None or now_us < timer.deadline_us:
            return False
        timer.back_off(now_us)
        self._next = 0
        self._probe = True
        self._went_back = False
        self._timeouts += 1
        if self._timeouts > 1:
            self._timed = None
        return True

    def resume(self, now_us: int) -> None:
        """Send again at once what is in flight: it is gone."""
        self._next = 0
        self._timed = None
        self._went_back = True
        self.timer.stop()
        if self.high or (not self.peer_window and self._queue):
            self.timer.start(now_us)

    def restart(self, window: int, now_us: int) -> None:
        """Begin a session: nothing that waits has been sent in it."""
        self.base = self._next = self.high = 0
        self.peer_window = window
        self._timed = None
        self._probe = self._went_back = False
        self._timeouts = 0
        self.timer.stop()
        if not window and self._queue:
            self.timer.start(now_us)
