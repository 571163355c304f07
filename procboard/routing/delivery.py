"""Exactly once from an origin's flash to the base: the two ends of the collection tree.

An origin numbers its records without gaps and for ever; they lie on its flash. It sends those of a
small window, and again whatever the base has not acknowledged when a timer runs out. The base
notes, for each origin, below which number it has all, and a bit for each of the next eight: it
takes a record once, whatever the network does. No acknowledgement, no forgetting: a record is at
the base or still on flash.

Every packet says how far its number is from the oldest record that the origin still keeps, so that
the base learns of a flash that gave records up (they are counted as gone), and of an origin's place
where the two have not met before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from procboard.routing.machine import Chance

WINDOW: Final = 8
"""Records sent and not acknowledged, and bits of an acknowledgement: eight records a round trip of
1 s are far more than a robot samples."""
FIRST_WAIT_MS: Final = 15_000
"""First wait for an acknowledgement: the base's delay of 10 s, and ten hops there and back with a
few attempts of 10 ms and some queueing."""
LONGEST_WAIT_MS: Final = 120_000
"""Longest wait: it doubles at every time-out, as TCP's (RFC 6298, section 5.5)."""
LEDGER_LIMIT: Final = 128
"""Origins the base knows; 8 octets each on an MSP430."""


def known_below(following: int, beyond: int) -> int:
    """Return the number after the last record that an acknowledgement speaks of."""
    return following + beyond.bit_length() + 1 if beyond else following


class Origin:
    """What an origin keeps of its records: numbers, not contents."""

    __slots__ = (
        "_acked", "_chance", "_sent", "_wait_ms", "_window", "deadline_ms", "newest", "oldest",
        "repeat", "repeats",
    )  # fmt: skip

    def __init__(self, chance: Chance, oldest: int = 0, newest: int = -1) -> None:
        self.oldest = oldest
        """First record not known to be at the base; below it the flash may forget."""
        self.newest = newest
        self.repeat = 0
        self.repeats = 0
        """Time-outs so far; `repeat` is this modulo 256."""
        self.deadline_ms: int | None = None
        self._chance = chance
        self._acked = 0  # bit n: record oldest + n is at the base
        self._sent = 0  # bit n: it was sent since the last time-out
        self._window = WINDOW
        self._wait_ms = FIRST_WAIT_MS

    def stored(self, number: int) -> None:
        """Take note of a record that the flash holds now.

        Raises:
            ValueError: not the number after the newest.

        """
        if number != self.newest + 1:
            raise ValueError(f"record {number} after {self.newest}: numbers have no gaps")
        self.newest = number

    def restart(self, following: int) -> None:
        """Begin anew with nothing, the next record being `following`: see `LedgerAhead`."""
        self.oldest, self.newest = following, following - 1
        self._acked = self._sent = 0
        self.deadline_ms = None

    def forgotten(self, oldest: int) -> None:
        """Take note that the flash holds no record below `oldest` any more."""
        self._advance(min(oldest, self.newest + 1))

    def wanted(self) -> int | None:
        """Return the record to be sent next; None where the window or the flash has no more."""
        for n in range(min(self._window, self.newest - self.oldest + 1)):
            if not (self._acked | self._sent) >> n & 1:
                return self.oldest + n
        return None

    def sent(self, number: int, now_ms: int) -> None:
        """Take note that a record is on its way."""
        if number >= self.oldest:
            self._sent |= 1 << number - self.oldest
            self._wait(now_ms)

    def acknowledge(self, following: int, beyond: int, now_ms: int) -> bool:
        """Take an acknowledgement: all below `following`, and bits beyond it.

        Returns False, and nothing is done, where it speaks of records that this origin does not
        have: they were another life's, whose numbers must not be used again.
        """
        if known_below(following, beyond) > self.newest + 1:
            return False
        before = self.oldest, self._acked
        self._advance(following)
        self._acked |= beyond << 1 >> self.oldest - following
        if before != (self.oldest, self._acked):
            self._wait_ms = FIRST_WAIT_MS
            self._window = min(self._window + 1, WINDOW)
            if self._sent & ~self._acked:
                self._wait(now_ms)
            else:
                self.deadline_ms = None
        return True

    def expire(self, now_ms: int) -> None:
        """Where no acknowledgement came in time, begin anew, with less at once."""
        if self.deadline_ms is None or now_ms < self.deadline_ms:
            return
        self.deadline_ms = None
        self._sent = 0
        self._window = max(self._window // 2, 1)
        self._wait_ms = min(2 * self._wait_ms, LONGEST_WAIT_MS)
        self.repeats += 1
        self.repeat = self.repeats & 0xFF

    def _advance(self, oldest: int) -> None:
        if oldest > self.oldest:
            self._acked >>= oldest - self.oldest
            self._sent >>= oldest - self.oldest
            self.oldest = oldest

    def _wait(self, now_ms: int) -> None:
        """Set the timer; a quarter of chance keeps origins from repeating together."""
        self.deadline_ms = now_ms + self._wait_ms + self._chance.below(self._wait_ms // 4)


@dataclass(frozen=True, slots=True)
class Taken:
    """What the base makes of a record that came."""

    new: bool
    gone: int
    """Records that the origin gave up before they came."""


class Ledger:
    """What the base has of each origin. It must survive the base: `entries` is what to keep."""

    __slots__ = ("entries",)

    def __init__(self, known: Mapping[int, tuple[int, int]] | None = None) -> None:
        self.entries = dict(known or {})
        """By origin: the first record that is missing, and a bit for each of the eight after it."""

    def take(self, origin: int, number: int, behind: int) -> Taken | None:
        """Take a record; None where the ledger is full or the number is beyond the window.

        A record that is not taken is not acknowledged, so the origin keeps it.
        """
        oldest = number - behind
        entry = self.entries.get(origin)
        if oldest < 0 or behind >= WINDOW or (entry is None and len(self.entries) >= LEDGER_LIMIT):
            return None
        following, beyond = entry or (oldest, 0)
        gone = 0
        if oldest > following:
            bits = beyond << 1
            skipped = oldest - following
            gone = skipped - (bits & (1 << skipped) - 1).bit_count()
            following, beyond = settled(oldest, bits >> skipped)
        place = number - following
        new = place >= 0 and not (beyond << 1) >> place & 1
        if new and place <= WINDOW:
            following, beyond = settled(following, beyond << 1 | 1 << place)
        elif new:
            return None
        self.entries[origin] = following, beyond
        return Taken(new, gone)


def settled(following: int, bits: int) -> tuple[int, int]:
    """Return number and bits beyond it where bit 0 of `bits` is the record `following` itself."""
    while bits & 1:
        following += 1
        bits >>= 1
    return following, bits >> 1
