"""Trickle: when to say again what others may not know (RFC 6206, section 4.2).

An interval I; at a random moment of its second half the message goes, unless k consistent ones were
heard before. Intervals double up to Imax; an inconsistency sets I back to Imin. So news spreads at
Imin's pace, silence costs a message an Imax, and a crowd says no more than a few boards would.
"""

from __future__ import annotations

from dataclasses import dataclass

from procboard.errors import ProcConfigError
from procboard.routing.machine import Chance


@dataclass(frozen=True, slots=True)
class TrickleConfig:
    """Imin, Imax and k of RFC 6206, section 4.1.

    Raises:
        ProcConfigError: a value that the RFC does not allow.

    """

    minimum_ms: int
    """Imin; at least 2, so that its second half has a moment."""
    doublings: int
    """Imax as the RFC gives it: the doublings of Imin, 16 at most here (the RFC's example)."""
    redundancy: int | None
    """k; None: never suppressed, as in CTP, where every beacon tells something else."""

    def __post_init__(self) -> None:
        if self.minimum_ms < 2 or not 0 <= self.doublings <= 16:
            raise ProcConfigError(
                f"Imin {self.minimum_ms} ms, {self.doublings} doublings: from 2 ms on, 0 to 16"
            )
        if self.redundancy is not None and self.redundancy < 1:
            raise ProcConfigError(f"k = {self.redundancy} suppresses everything: 1 or more")

    @property
    def maximum_ms(self) -> int:
        """The longest interval."""
        return self.minimum_ms << self.doublings


class Trickle:
    """One Trickle timer. It says when; what is sent, and what is consistent, its owner knows."""

    __slots__ = ("_chance", "_config", "_ends_ms", "_fires_ms", "heard", "interval_ms")

    def __init__(self, config: TrickleConfig, chance: Chance) -> None:
        self._config = config
        self._chance = chance
        self.interval_ms = config.minimum_ms
        """I."""
        self.heard = 0
        """c: consistent messages in this interval."""
        self._fires_ms: int | None = None
        self._ends_ms: int | None = None

    def start(self, now_ms: int) -> None:
        """Begin with the shortest interval, which the RFC allows: a new board has news."""
        self.interval_ms = self._config.minimum_ms
        self._begin(now_ms)

    def consistent(self) -> None:
        """Somebody said what this board would say (rule 3)."""
        self.heard += 1

    def inconsistent(self, now_ms: int) -> bool:
        """Somebody knows more or less than this board (rule 6).

        Returns whether the interval was set back; where I is Imin already nothing happens.
        """
        if self.interval_ms <= self._config.minimum_ms:
            return False
        self.start(now_ms)
        return True

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted; None before the start."""
        return self._ends_ms if self._fires_ms is None else self._fires_ms

    def handle_timer(self, now_ms: int) -> bool:
        """Return whether the message is to be sent now (rules 4 and 5)."""
        sends = False
        if self._fires_ms is not None and now_ms >= self._fires_ms:
            self._fires_ms = None
            k = self._config.redundancy
            sends = k is None or self.heard < k
        if self._fires_ms is None and self._ends_ms is not None and now_ms >= self._ends_ms:
            self.interval_ms = min(2 * self.interval_ms, self._config.maximum_ms)
            self._begin(now_ms)
        return sends

    def _begin(self, now_ms: int) -> None:
        interval_ms = self.interval_ms
        half_ms = interval_ms // 2
        self.heard = 0
        self._fires_ms = now_ms + half_ms + self._chance.below(interval_ms - half_ms)
        self._ends_ms = now_ms + interval_ms
