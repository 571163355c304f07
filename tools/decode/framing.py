"""What the stream protocols share: pieces between delimiters, and sequence numbers that are missed.

`Splitter` keeps where and when a piece began, which the decoders of `spi_bus` and `radio_802154`
neither know nor need. `Numbers` follows eight-bit counters: a number ahead of its turn opens a gap,
one that comes later closes it, one that was there before is a repetition. `PieceStream` puts the
two together for each direction; what a piece says is left to the protocol.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from tools.decode.items import Item, Octets, Tally, What

HALF: Final = 128
"""A number further ahead than this is behind."""


@dataclass(frozen=True, slots=True)
class Piece:
    """What stood between two delimiters; `cut` where it was too long to be kept."""

    data: bytes
    time_s: float | None
    offset: int
    cut: bool = False


class Splitter:
    """Cuts the octets of one direction at a delimiter."""

    def __init__(self, delimiter: bytes, longest: int) -> None:
        self._delimiter = delimiter
        self._longest = longest
        self._data = b""
        self._cut = False
        self._begin: tuple[float | None, int] = (None, 0)

    def feed(self, octets: Octets) -> Iterator[Piece]:
        """Yield the pieces that end in these octets; empty ones are filler and left out."""
        position = 0
        for part in octets.data.split(self._delimiter):
            if position:
                yield from self.finish()
            if part:
                if not self._data:
                    self._begin = octets.at(position)
                self._data += part
                if len(self._data) > self._longest:
                    self._cut = True
                    self._data = self._data[: self._longest]
            position += len(part) + 1

    def finish(self) -> Iterator[Piece]:
        """Yield what is there."""
        if self._data:
            yield Piece(self._data, *self._begin, self._cut)
        self._data = b""
        self._cut = False


class Numbers:
    """An eight-bit counter of one sender, as it is heard."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._missing: set[int] = set()
        self.lost = 0
        """Numbers given up: those of earlier rounds that never came."""

    @property
    def missing(self) -> int:
        """Numbers that have not come yet."""
        return len(self._missing)

    def heard(self, number: int) -> int:
        """Take a number; return how many are missing before it: 0, or the size of a new gap."""
        if self._next is None:
            self._next = (number + 1) & 0xFF
            return 0
        ahead = (number - self._next) & 0xFF
        if ahead < HALF:
            gap = [(self._next + step) & 0xFF for step in range(ahead)]
            for old in (*gap, number):  # the same numbers of the round before
                if old in self._missing:
                    self._missing.discard(old)
                    self.lost += 1
            self._missing.update(gap)
            self._next = (number + 1) & 0xFF
            return ahead
        self._missing.discard(number)
        return 0

    def restart(self) -> None:
        """Begin anew, as after a reset of the sender."""
        self.lost += len(self._missing)
        self._missing.clear()
        self._next = None


class Side:
    """One direction of a stream; a protocol adds what it remembers of it."""

    def __init__(self, delimiter: bytes, longest: int) -> None:
        self.splitter = Splitter(delimiter, longest)
        self.numbers = Numbers()


S = TypeVar("S", bound=Side)


class PieceStream(ABC, Generic[S]):
    """A decoder of pieces between delimiters.

    Args:
        tally: where it counts.
        new_side: makes a direction's state.
        unit: what the protocol calls a piece.

    """

    def __init__(self, tally: Tally, new_side: Callable[[], S], unit: str) -> None:
        self._tally = tally
        self._unit = unit
        self._sides = defaultdict[str, S](new_side)

    def feed(self, octets: Octets) -> Iterator[Item]:
        """Yield what these octets complete."""
        side = self._sides[octets.direction]
        for piece in side.splitter.feed(octets):
            self._tally.frames += 1
            yield from self._piece(piece, octets.direction, side)

    def finish(self) -> Iterator[Item]:
        """Yield what is left: half a piece, and the numbers that never came."""
        for direction, side in self._sides.items():
            for piece in side.splitter.finish():
                self._tally.errors["unfinished"] += 1
                text = f"{len(piece.data)} octets of a {self._unit} that does not end"
                yield Item(What.GAP, "unfinished", piece.time_s, direction, piece.offset, text)
            self._tally.lost += side.numbers.lost + side.numbers.missing

    @abstractmethod
    def _piece(self, piece: Piece, direction: str, side: S) -> Iterator[Item]:
        """Yield what a whole piece says."""
