"""Time synchronisation by flooding: all boards know the root's time (FTSP, Maróti et al., 2004).

Every board sends, once a period, the root's time at the moment when its frame's SFD goes out, by
its own estimate; receivers note their own time at that SFD. Each number of the root is taken once,
the first time it is heard, so estimates spread away from the root. From the last eight pairs a line
gives offset and drift. The root is the board with the lowest address of those that compete: a board
that hears no new number for five periods competes, going on with the time that it knows.

Two things are not in FTSP as TinyOS has it. A pair that does not fit is not taken at all (TinyOS
counts it and takes it). And the number of a root that has died is remembered for a while, so its
last marks, which boards with more patience still repeat, do not bring it back.

Times are ticks of the 32 768 Hz crystal; local ones are as long as you like, the root's wrap at
2^32. Stamps are the MAC's: `take` gives a message without time, `stamped` its octets once the SFD's
time is known. On an MSP430: 8 pairs of 8 octets, a division of 64 bits a period.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from procboard.routing.machine import BROADCAST, Chance, Outgoing
from radio_802154.routing_messages import TIME_AM, TIME_MARK, TimeMark
from spi_bus.errors import PayloadError

PERIOD_MS: Final = 10_000
"""Between marks (TIMESYNC_RATE of TinyOS; the paper has 30 s), by chance up to an eighth less."""
PAIRS: Final = 8
"""MAX_ENTRIES of TinyOS, and of the paper."""
PAIRS_TO_TELL: Final = 3
"""ENTRY_SEND_LIMIT of TinyOS."""
PAIRS_TO_TRUST: Final = 4
"""ENTRY_VALID_LIMIT of TinyOS."""
ROOT_TIMEOUT: Final = 5
"""Periods without a new number, then a board competes (ROOT_TIMEOUT of TinyOS)."""
DEAD_ROOT_PERIODS: Final = 2 * ROOT_TIMEOUT
"""How long a dead root's number is remembered: until all others have given it up too."""
OUTLIER_TICKS: Final = 100
"""A pair that is off by more (3 ms) is an outlier (ENTRY_THROWOUT_LIMIT of TinyOS)."""
OUTLIERS: Final = 3
"""So many in a row are ignored; with one more the time has really changed (TinyOS)."""
_SKEW_BITS: Final = 24
"""Binary places of the drift: 0.06 ppm, 0.2 ticks in 100 s."""
_MASK: Final = 0xFFFFFFFF

TICKS_PER_MS: Final = 32.768


def signed(ticks: int) -> int:
    """Return the difference of two wrapped times, −2^31 to 2^31 − 1."""
    return (ticks + 0x80000000 & _MASK) - 0x80000000


@dataclass(frozen=True, slots=True)
class RootChanged:
    """Another board's time counts now; `jumped` by more than an outlier's limit."""

    root: int
    jumped: bool


class TimeSync:
    """One board's part."""

    def __init__(self, address: int, chance: Chance) -> None:
        self.address = address
        self.root: int | None = None
        self.rejected = 0
        """Outliers so far."""
        self.bad_messages = 0
        self._chance = chance
        self._sequence = 0
        self._silent = 0
        self._due_ms: int | None = None
        self._tells = False
        self._pairs: deque[tuple[int, int]] = deque(maxlen=PAIRS)  # local, offset
        self._outliers = 0
        self._local = self._offset = self._skew = 0  # the line: its middle and its slope
        self._dead: tuple[int, int, int] | None = None  # root, number, periods left

    def start(self, now_ms: int) -> None:
        """Begin to listen; the first mark goes when there is something to tell."""
        self._due_ms = now_ms + 1 + self._chance.below(PERIOD_MS)

    # What others use.

    @property
    def synchronised(self) -> bool:
        """Whether `to_global` is the root's time."""
        return self.root == self.address or len(self._pairs) >= PAIRS_TO_TRUST

    @property
    def last_pair_ticks(self) -> int:
        """Local time of the newest pair; that of the estimate's middle without one."""
        return self._pairs[-1][0] if self._pairs else self._local

    def to_global(self, local_ticks: int) -> int:
        """Return the root's time, modulo 2^32."""
        drift = self._skew * (local_ticks - self._local) + (1 << _SKEW_BITS - 1) >> _SKEW_BITS
        return local_ticks + self._offset + drift & _MASK

    def to_local(self, global_ticks: int, near_ticks: int) -> int:
        """Return the local time next to `near_ticks` at which the root's time is this."""
        local = near_ticks + signed(global_ticks - self.to_global(near_ticks))
        return local + signed(global_ticks - self.to_global(local))

    # What the network sees.

    def receive(self, source: int, payload: bytes, sfd_ticks: int) -> list[RootChanged]:
        """Take a mark whose SFD came at this local time."""
        try:
            mark = TIME_MARK.decode(payload)
        except PayloadError:
            self.bad_messages += 1
            return []
        if mark.root == self.root:
            if not _newer(mark.sequence, self._sequence):
                return []
        elif (self.root is not None and mark.root > self.root) or self._is_dead(mark):
            return []
        events = []
        if mark.root != self.root:
            jumped = self.synchronised and self._error(mark, sfd_ticks) > OUTLIER_TICKS
            if jumped or self.root is None:
                self._pairs.clear()
            self._outliers = 0
            self.root = mark.root
            events.append(RootChanged(mark.root, jumped))
        self._sequence = mark.sequence
        if self.root != self.address:
            self._silent = 0
            self._add(mark, sfd_ticks)
        return events

    def take(self, now_ms: int) -> Outgoing | None:
        """Return the mark that is due, its time still missing."""
        if not self._tells or self.root is None:
            return None
        self._tells = False
        mark = TimeMark(self.root, self._sequence, 0)
        return Outgoing(BROADCAST, TIME_AM, TIME_MARK.encode(mark))

    def stamped(self, payload: bytes, sfd_ticks: int) -> bytes:
        """Return the mark with the time at its SFD, whose local time is given."""
        return TIME_MARK.encode(replace(TIME_MARK.decode(payload), time=self.to_global(sfd_ticks)))

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted."""
        return self._due_ms

    def handle_timer(self, now_ms: int) -> list[RootChanged]:
        """Once a period: compete if nobody leads, and tell the time."""
        if self._due_ms is None or now_ms < self._due_ms:
            return []
        self._due_ms = now_ms + PERIOD_MS - self._chance.below(PERIOD_MS // 8)
        if self._dead is not None:
            root, number, periods = self._dead
            self._dead = (root, number, periods - 1) if periods > 1 else None
        events = []
        if self.root != self.address:
            self._silent += 1
            if self._silent > ROOT_TIMEOUT:
                if self.root is not None:
                    self._dead = self.root, self._sequence, DEAD_ROOT_PERIODS
                self.root = self.address
                self._silent = 0
                events.append(RootChanged(self.address, False))
        if self.root == self.address:
            self._sequence = (self._sequence + 1) & 0xFF
            self._tells = True
        elif len(self._pairs) >= PAIRS_TO_TELL:
            self._tells = True
        return events

    # The line.

    def _is_dead(self, mark: TimeMark) -> bool:
        if self._dead is None or mark.root != self._dead[0]:
            return False
        return not _newer(mark.sequence, self._dead[1])

    def _error(self, mark: TimeMark, sfd_ticks: int) -> int:
        return abs(signed(mark.time - self.to_global(sfd_ticks)))

    def _add(self, mark: TimeMark, sfd_ticks: int) -> None:
        if len(self._pairs) >= PAIRS_TO_TRUST and self._error(mark, sfd_ticks) > OUTLIER_TICKS:
            self._outliers += 1
            self.rejected += 1
            if self._outliers <= OUTLIERS:
                return
            self._pairs.clear()
        self._outliers = 0
        self._pairs.append((sfd_ticks, signed(mark.time - sfd_ticks)))
        self._fit()

    def _fit(self) -> None:
        """Least squares around the first pair, so that all numbers are small."""
        count = len(self._pairs)
        first_local, first_offset = self._pairs[0]
        locals_ = [local - first_local for local, _ in self._pairs]
        offsets = [signed(offset - first_offset) for _, offset in self._pairs]
        local_mean = sum(locals_) // count
        offset_mean = (2 * sum(offsets) + count) // (2 * count)
        squares = sum((a - local_mean) ** 2 for a in locals_)
        products = sum(
            (a - local_mean) * (b - offset_mean) for a, b in zip(locals_, offsets, strict=True)
        )
        if squares:
            self._skew = (products << _SKEW_BITS) // squares
        self._local = first_local + local_mean
        self._offset = first_offset + offset_mean


def _newer(number: int, than: int) -> bool:
    """Whether a number that wraps at 256 is ahead."""
    return 0 < (number - than) & 0xFF < 128
