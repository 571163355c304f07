"""When a line is lost and when to try it again: the rule, without a clock or a port.

The first attempt comes `first_s` after the loss, the next ones `factor` times further apart each,
up to `longest_s`. A line that is lost again before it has been up for `longest_s` has not
recovered: the pace goes on where it was, so that a flapping adapter is not hammered. No chance
enters, so that two runs do the same.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

__all__ = ["BackOff", "OutageBegan", "OutageEnded", "OutageEvent", "OutageLog", "Supervisor"]

_KEPT: Final = 100


@dataclass(frozen=True, slots=True)
class BackOff:
    """Pace of attempts, in seconds.

    Raises:
        ValueError: times that are not 0 < first_s ≤ longest_s, or a factor below 1.

    """

    first_s: float = 0.05
    longest_s: float = 2.0
    factor: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.first_s <= self.longest_s:
            raise ValueError(f"not 0 < first_s ({self.first_s}) <= longest_s ({self.longest_s})")
        if self.factor < 1:
            raise ValueError(f"factor = {self.factor} is below 1")


@dataclass(frozen=True, slots=True)
class OutageBegan:
    """The line was lost."""

    time_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class OutageEnded:
    """The line is back, after so many attempts."""

    time_s: float
    began_s: float
    attempts: int
    reason: str

    @property
    def duration_s(self) -> float:
        """How long it was away."""
        return self.time_s - self.began_s


OutageEvent = OutageBegan | OutageEnded


class Supervisor:
    """State of one line: up, or down since when and tried again when."""

    def __init__(self, back_off: BackOff, now_s: float) -> None:
        self._back_off = back_off
        self._interval_s = back_off.first_s
        self._up_since_s = now_s
        self._began: OutageBegan | None = None
        self._attempts = 0
        self._last_failure = ""
        self.next_attempt_s: float | None = None
        """When the line is tried again; None while it is up."""

    @property
    def up(self) -> bool:
        """Whether the line is there."""
        return self._began is None

    @property
    def last_failure(self) -> str:
        """Why the last attempt failed; "" when none has."""
        return self._last_failure

    def lost(self, now_s: float, reason: str) -> OutageBegan:
        """The line went away."""
        if now_s - self._up_since_s >= self._back_off.longest_s:
            self._interval_s = self._back_off.first_s
        self._began = OutageBegan(now_s, reason)
        self._attempts = 0
        self.next_attempt_s = now_s + self._interval_s
        return self._began

    def attempt_due(self, now_s: float) -> bool:
        """Whether to try now."""
        return self.next_attempt_s is not None and now_s >= self.next_attempt_s

    def failed(self, now_s: float, reason: str) -> None:
        """An attempt failed."""
        self._attempts += 1
        self._last_failure = reason
        self._interval_s = min(self._interval_s * self._back_off.factor, self._back_off.longest_s)
        self.next_attempt_s = now_s + self._interval_s

    def restored(self, now_s: float) -> OutageEnded:
        """An attempt succeeded.

        Raises:
            ValueError: the line was not down.

        """
        began = self._began
        if began is None:
            raise ValueError("the line was not down")
        self._began = None
        self.next_attempt_s = None
        self._up_since_s = now_s
        return OutageEnded(now_s, began.time_s, self._attempts + 1, began.reason)


@dataclass(slots=True)
class OutageLog:
    """Counts outages for a summary, keeps the last hundred; `note` is an `OpenContext.notify`."""

    outages: int = 0
    down_s: float = 0.0
    """Sum over the outages that have ended."""
    longest_s: float = 0.0
    attempts: int = 0
    last: deque[OutageEvent] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def note(self, event: OutageEvent) -> None:
        """Take notice of an event."""
        self.last.append(event)
        if isinstance(event, OutageBegan):
            self.outages += 1
        else:
            self.down_s += event.duration_s
            self.longest_s = max(self.longest_s, event.duration_s)
            self.attempts += event.attempts

    def summary(self) -> dict[str, float]:
        """Counters for a `summary.json`."""
        return {
            "outages": self.outages,
            "down_s": self.down_s,
            "longest_s": self.longest_s,
            "attempts": self.attempts,
        }
