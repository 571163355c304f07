"""The collection tree: which neighbour is the next hop to the base (TEP 123; Gnawali et al. 2009).

A board's cost is its parent's plus the link's, in ETX; it takes the neighbour with the least. Three
things keep the tree sane: a new parent must be better by `SWITCH_ETX`, so noise does not turn it
over; a neighbour whose parent is this board is no candidate; costs end at `MAX_PATH_ETX`, so boards
cut off from the base, whose costs rise by turns, soon know that they have no route. Longer loops
can exist for a while: packets find them (`collection.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from procboard.routing.machine import NOBODY
from procboard.routing.neighbours import ETX_ONE, NO_ROUTE, Neighbours

SWITCH_ETX: Final = 24
"""1.5 transmissions [1/16]: PARENT_SWITCH_THRESHOLD of CTP and of RFC 6719, section 5."""
MAX_PATH_ETX: Final = 64 * ETX_ONE
"""No way is so long [1/16]: 32 hops of two transmissions. TEP 123, section 4, asks for "a
reasonable constant"; RFC 6719 has 256, which takes four times as long to count up to."""


@dataclass(frozen=True, slots=True)
class ParentChanged:
    """The next hop is another; None: there is no route."""

    parent: int | None


class Tree:
    """One board's place in the tree; what its beacons tell of it."""

    def __init__(self, neighbours: Neighbours, *, base: bool) -> None:
        self.base = base
        self.parent: int | None = None
        self.etx = 0 if base else NO_ROUTE
        self._neighbours = neighbours
        neighbours.route = (neighbours.address if base else NOBODY, self.etx)

    @property
    def has_route(self) -> bool:
        """Whether there is a way to the base, or this is it."""
        return self.etx != NO_ROUTE

    def update(self, now_ms: int) -> list[ParentChanged]:
        """Choose anew: after a beacon, a unicast's outcome, a neighbour's loss."""
        if self.base:
            return []
        neighbours = self._neighbours
        best, best_etx, current_etx = None, MAX_PATH_ETX, MAX_PATH_ETX
        for neighbour in neighbours.table.values():
            if neighbour.parent == neighbours.address or not neighbour.mature:
                continue
            etx = neighbour.path_etx(now_ms)
            if etx < best_etx:
                best, best_etx = neighbour.address, etx
            if neighbour.address == self.parent:
                current_etx = min(etx, MAX_PATH_ETX)
        before, was = self.parent, self.etx
        if current_etx == MAX_PATH_ETX or best_etx + SWITCH_ETX < current_etx:
            self.parent, current_etx = best, best_etx
        self.etx = NO_ROUTE if self.parent is None else current_etx
        neighbours.route = (NOBODY if self.parent is None else self.parent, self.etx)
        if self.etx + SWITCH_ETX <= was or (self.etx == NO_ROUTE) != (was == NO_ROUTE):
            neighbours.hurry(now_ms)
        if self.parent == before:
            return []
        neighbours.pin(NOBODY if self.parent is None else self.parent)
        return [ParentChanged(self.parent)]
