"""The receiving half of a link: what is taken, and what is said about it when.

Messages are taken in order only and none is kept back, so that an MCU needs no memory for them. An
acknowledgement rides on any frame; alone it goes after a delay, or at once where it helps the peer:
half a window waits for it, something came twice or out of turn, a window was closed.
"""

from spi_bus.link_types import LinkConfig, Statistics

__all__ = ["Receiver"]


class Receiver:
    """The next number expected, and the acknowledgement that is owed.

    Args:
        config: window and delay.
        statistics: where duplicates, gaps and refusals are counted.

    """

    __slots__ = (
        "_config", "_gap_due", "_gap_told", "_statistics", "deadline_us", "due", "expected",
        "unacknowledged", "window",
    )  # fmt: skip

    def __init__(self, config: LinkConfig, statistics: Statistics) -> None:
        self._config = config
        self._statistics = statistics
        self.expected = 0
        self.window = config.window
        self.unacknowledged = 0  # messages received since our last frame
        self.due = False
        self._gap_due = False
        self._gap_told = False
        self.deadline_us: int | None = None

    def take(self, sequence: int) -> bool:
        """Return whether a message is in turn and taken; else see to it that the peer hears."""
        statistics = self._statistics
        ahead = (sequence - self.expected) & 0xFF
        if ahead:
            self.due = True
            if ahead >= 0x80:
                statistics.duplicates += 1
            else:
                statistics.gaps += 1
                if not self._gap_told:
                    self._gap_told = self._gap_due = True
            return False
        if not self.window:
            statistics.refused += 1
            self.due = True
            return False
        self.expected = (self.expected + 1) & 0xFF
        self._gap_told = self._gap_due = False
        return True

    def taken(self, now_us: int) -> None:
        """Owe an acknowledgement for a message: now, or after the delay."""
        self.unacknowledged += 1
        if 2 * self.unacknowledged >= self._config.window or not self._config.ack_delay_us:
            self.due = True
        elif self.deadline_us is None:
            self.deadline_us = now_us + self._config.ack_delay_us

    def tell(self) -> bool:
        """A frame goes, and everything owed with it; return whether it tells of a gap."""
        gap = self._gap_due
        self._gap_due = False
        self.due = False
        self.deadline_us = None
        self.unacknowledged = 0
        return gap

    def expire(self, now_us: int) -> None:
        """Acknowledge now if the delay is over."""
        if self.deadline_us is not None and now_us >= self.deadline_us:
            self.deadline_us = None
            self.due = True

    def resume(self) -> None:
        """Say where we are: what we said last may be gone."""
        self.due = True
        self._gap_told = self._gap_due = False

    def restart(self) -> None:
        """Begin a session."""
        self.expected = 0
        self.unacknowledged = 0
        self.due = self._gap_due = self._gap_told = False
        self.deadline_us = None
