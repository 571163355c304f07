"""What a link is told and what it tells: role, sizes and times, events, counters.

Apart from the state machine because applications need only these. `spi_bus.link` offers them too.
"""

from dataclasses import dataclass, field
from enum import StrEnum

from spi_bus.frame import MAX_WINDOW, ErrorKind
from spi_bus.messages import MASTER, SLAVE

__all__ = [
    "Event",
    "LinkConfig",
    "LinkError",
    "LinkUp",
    "MessageAcknowledged",
    "MessageReceived",
    "PeerReset",
    "Role",
    "Statistics",
    "StreamReceived",
    "Timer",
]


class Role(StrEnum):
    """Which side of the link this is; the values are the senders' names in the message table."""

    MASTER = MASTER
    SLAVE = SLAVE

    @property
    def other(self) -> "Role":
        """The peer's role."""
        return Role.SLAVE if self is Role.MASTER else Role.MASTER


@dataclass(frozen=True, slots=True)
class MessageReceived:
    """The next message of the peer, exactly once."""

    message: object


@dataclass(frozen=True, slots=True)
class StreamReceived:
    """A message of the peer's stream, from this session; as the line brought it.

    A line that loses, repeats or reorders frames does so with these: their numbers tell.
    """

    message: object


@dataclass(frozen=True, slots=True)
class MessageAcknowledged:
    """The peer's link has handed the message on; it will never be sent again."""

    token: int


@dataclass(frozen=True, slots=True)
class LinkUp:
    """First contact with a peer since this link began."""

    peer_epoch: int


@dataclass(frozen=True, slots=True)
class PeerReset:
    """The peer restarted and is connected again: its state is gone, ours is kept.

    The first `unacknowledged` messages of our queue had been sent to the earlier incarnation; they
    are sent again to this one.
    """

    peer_epoch: int
    previous_epoch: int
    unacknowledged: int


@dataclass(frozen=True, slots=True)
class LinkError:
    """Bytes were thrown away: what was wrong, how often within this `receive`, and any detail."""

    kind: ErrorKind
    count: int = 1
    detail: str = ""


Event = MessageReceived | StreamReceived | MessageAcknowledged | LinkUp | PeerReset | LinkError


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """Sizes and times of a link; both sides may differ.

    The retransmission time must exceed what an acknowledgement takes to come back: the peer's
    acknowledgement delay, both frames on the wire, and on SPI the wait for the master's clock.

    Raises:
        ValueError: a size or time out of its range.

    """

    window: int = 4
    """Most messages sent and not acknowledged, 1 to 15."""
    queue_limit: int = 16
    """Most messages queued, those sent and not acknowledged included."""
    ack_delay_us: int = 10_000
    """Longest wait for data that an acknowledgement could ride on."""
    retransmit_us: int = 60_000
    """Least retransmission time: of a slow line twice the round trip; it doubles at time-outs."""
    retransmit_max_us: int = 1_000_000
    """Longest retransmission time."""

    def __post_init__(self) -> None:
        if not 1 <= self.window <= MAX_WINDOW:
            raise ValueError(f"window = {self.window} is outside 1 to {MAX_WINDOW}")
        if self.queue_limit < 1:
            raise ValueError(f"queue_limit = {self.queue_limit} is below 1")
        if not 0 <= self.ack_delay_us < self.retransmit_us <= self.retransmit_max_us:
            raise ValueError(
                f"not 0 <= ack_delay_us ({self.ack_delay_us}) < retransmit_us "
                f"({self.retransmit_us}) <= retransmit_max_us ({self.retransmit_max_us})"
            )


@dataclass(slots=True)
class Statistics:
    """Counters of one link since it began."""

    frames_sent: int = 0
    frames_received: int = 0
    """Intact frames of our version, whatever became of them."""
    messages_sent: int = 0
    """Messages accepted by `send`."""
    messages_acknowledged: int = 0
    messages_received: int = 0
    crc_errors: int = 0
    framing_errors: int = 0
    """Pieces between zeros that are no frame: COBS, length, version, contents, echoes."""
    retransmissions: int = 0
    """DATA frames sent again."""
    duplicates: int = 0
    """Messages received again and suppressed."""
    gaps: int = 0
    """DATA frames dropped because one before them was missing."""
    refused: int = 0
    """DATA frames dropped because the receive window was closed."""
    stale: int = 0
    """Frames of another session, dropped."""
    lost: int = 0
    """Messages acknowledged and not delivered: numbers or contents that our table does not know."""
    peer_resets: int = 0
    streamed: int = 0
    """STREAM frames sent."""
    stream_received: int = 0
    replaced: int = 0
    """Stream messages that never went: a newer one came, or the session ended, before the line
    took them."""


@dataclass(slots=True)
class Timer:
    """A deadline with exponential back-off."""

    first_us: int
    longest_us: int
    interval_us: int = field(init=False)
    deadline_us: int | None = None

    def __post_init__(self) -> None:
        self.interval_us = self.first_us

    def start(self, now_us: int) -> None:
        """Set the deadline one interval from now."""
        self.deadline_us = now_us + self.interval_us

    def stop(self) -> None:
        """Forget deadline and back-off."""
        self.deadline_us = None
        self.interval_us = self.first_us

    def back_off(self, now_us: int) -> None:
        """Double the interval and set the deadline again."""
        self.interval_us = min(2 * self.interval_us, self.longest_us)
        self.start(now_us)
