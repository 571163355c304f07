"""What a board knows of a survey: a function of the set of items that it has, in no order.

Items come late, twice, out of order, and at each board at another time. What follows from them here
(who lives, what a cell's value is, who stands where) depends on which they are and on nothing else:
boards with the same items know the same. So there is nothing to negotiate, and a board that was cut
off or reset agrees as soon as it has caught up.

Who lives: an item of a robot says so, a `Gone` ends it up to the number that it names, and any
later item of that robot overrules it. A robot that says `Gone` of itself is out until it says more.

Repeats: readings of a cell by two robots, or by one twice, make one value, each weighted by its
precision 1/σ²; their errors are independent. An item that came twice is one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Final, NamedTuple
from zlib import crc32

from procboard.survey.items import ITEMS, Done, Gone, Item, Present, Sample, Skip
from procboard.survey.rank import Cell
from procboard.survey.sweeps import Place, Pose
from spi_bus.errors import PayloadError

TRIES: Final = 2
"""Robots that try a cell before it is given up; ours. What stops one robot may be the other one,
what stops two stands there."""


class Reading(NamedTuple):
    """A value with the standard deviation of its error."""

    value: float
    deviation: float


def together(readings: Sequence[Reading]) -> Reading:
    """Return what one or more readings of a cell make together, each weighted by its precision."""
    if len(readings) == 1:
        return readings[0]
    precisions = [reading.deviation**-2 for reading in readings]
    whole = math.fsum(precisions)
    pairs = zip(precisions, readings, strict=True)
    return Reading(math.fsum(p * reading.value for p, reading in pairs) / whole, whole**-0.5)


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells of a survey: how many, the spacing, and where the centre of cell (0, 0) lies."""

    rows: int
    columns: int
    spacing_m: float
    x_m: float = 0.0
    y_m: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def centre(self, cell: Cell) -> Place:
        """Return x and y of a cell's centre, m."""
        return self.x_m + cell[1] * self.spacing_m, self.y_m + cell[0] * self.spacing_m

    def has(self, cell: Cell) -> bool:
        """Whether it is a cell of this grid."""
        return 0 <= cell[0] < self.rows and 0 <= cell[1] < self.columns


class Knowledge:
    """All items of a survey that a board has."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.latest: dict[int, int] = {}
        """Highest number of an item, by origin."""
        self.samples: dict[Cell, dict[tuple[int, int], Sample]] = {}
        """By cell, then by origin and number."""
        self.skips: dict[Cell, set[int]] = {}
        """Who did not reach a cell."""
        self.final: set[Cell] = set()
        """Cells that nobody was left to try."""
        self.bad_items = 0
        self._gone: dict[int, int] = {}
        self._stays: dict[int, dict[int, tuple[Place, Cell | None]]] = {}
        self._done: dict[int, tuple[int, Done]] = {}

    def receive(self, origin: int, number: int, octets: bytes) -> Item | None:
        """Take an item, own ones too; None where there is no sense in it.

        One with a number whose item is known already changes nothing.
        """
        try:
            item = ITEMS.decode(octets)
        except PayloadError:
            item = None
        if isinstance(item, Sample | Skip) and not self.grid.has(item.cell):
            item = None
        # what makes no sense also is an item: its origin lives
        self.latest[origin] = max(number, self.latest.get(origin, 0))
        if isinstance(item, Sample):
            self.samples.setdefault(item.cell, {})[origin, number] = item
            self._stays.setdefault(origin, {})[number] = self.grid.centre(item.cell), item.cell
        elif isinstance(item, Skip):
            self.skips.setdefault(item.cell, set()).add(origin)
            if item.final:
                self.final.add(item.cell)
        elif isinstance(item, Gone):
            last = number if item.address == origin else item.last
            self._gone[item.address] = max(last, self._gone.get(item.address, 0))
        elif isinstance(item, Present):
            if item.joined:
                self._stays.setdefault(origin, {})[number] = (item.x_m, item.y_m), None
        elif isinstance(item, Done):
            self._done[origin] = max(
                (number, item), self._done.get(origin, (0, item)), key=lambda told: told[0]
            )
        else:
            self.bad_items += 1
            return None
        return item

    # --- cells --------------------------------------------------------------------------

    def reading(self, cell: Cell) -> Reading | None:
        """Return what all samples of a cell make together; None where there is none."""
        samples = self.samples.get(cell)
        if not samples:
            return None
        return together([Reading(one.value, one.deviation) for one in samples.values()])

    def given_up(self) -> list[Cell]:
        """Cells without a sample that nobody tries any more, in order."""
        return [
            cell
            for cell, who in sorted(self.skips.items())
            if cell not in self.samples and (len(who) >= TRIES or cell in self.final)
        ]

    def digest(self) -> int:
        """Return 32 bits that tell whether two boards have the same samples."""
        names = sorted((*cell, *name) for cell, samples in self.samples.items() for name in samples)
        return crc32(b"".join(struct.pack(">BBHH", *name) for name in names))

    # --- robots -------------------------------------------------------------------------

    def lives(self, robot: int) -> bool:
        """Whether a robot takes part, for all that is known."""
        return self.latest.get(robot, 0) > self._gone.get(robot, 0)

    def poses(self, used: Set[Cell]) -> dict[int, Pose]:
        """Where each of the living was last, counting samples of ``used`` cells alone.

        All boards that are as far in a survey have used the same cells, so that they agree on it
        while robots swim on. Robots heard of whose place nobody has told are left out.
        """
        return {
            robot: _last(stays, used)
            for robot, stays in sorted(self._stays.items())
            if self.lives(robot)
        }

    def done(self, robot: int) -> Done | None:
        """Return what a robot last said of the end; None where it did not."""
        return self._done[robot][1] if robot in self._done else None


def _last(stays: dict[int, tuple[Place, Cell | None]], used: Set[Cell]) -> Pose:
    """Place of the last stay that counts (else the first), heading as from the one before."""
    places = [
        place for _, (place, cell) in sorted(stays.items()) if cell is None or cell in used
    ] or [stays[min(stays)][0]]
    x, y = places[-1]
    before = next((place for place in reversed(places) if place != (x, y)), None)
    if before is None:
        return Pose(x, y)
    return Pose(x, y, math.atan2(y - before[1], x - before[0]))
