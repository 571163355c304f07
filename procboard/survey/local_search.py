"""Make given paths shorter by exchanging a few of their steps, until no exchange helps.

Every robot has a path from its begin to its end, which both stay where they are: in a closed tour
they are the same place, in an open one every step to the end costs nothing. So the two kinds, and
one robot or many, are one search. What is tried, for a node and its nearest neighbours:

- 2-opt (Croes, 1958): a part of a path reversed;
- Or-opt (Or, 1976): one to three nodes moved to another place, turned round where that is better,
  on the same path or another one's;
- 2-opt* (Potvin and Rousseau, 1995): two robots exchange the rest of their paths, or the rest of
  one for the way so far of the other, reversed.

Nodes wait in a queue until a step beside them has changed ("don't look bits": Bentley, ORSA Journal
on Computing 4 (1992) 387-411). When the queue is empty, all nodes are tried again and all reversals
as well, near or far, so that in the end no path in the plane crosses itself. Nothing here is drawn
at random: the same nodes give the same paths.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from procboard.survey.algebra import FloatArray

Path = list[int]

NEIGHBOURS = 10
"""Of a node, to which a new step may lead: Johnson and McGeoch, in Aarts and Lenstra (eds), Local
Search in Combinatorial Optimization (1997), found more to gain next to nothing."""
LONGEST_MOVED = 3
"""Nodes that Or-opt moves at once, after Or."""
_LEAST_GAIN = 1e-9
"""As a share of the longest distance: less is rounding, and could go on for ever."""


@dataclass(frozen=True, slots=True)
class Objective:
    """What is to be small: the first number of ``cost``, and the second where the first is equal.

    ``cost`` takes the paths' lengths. It must not grow when a path becomes shorter. ``levelling``:
    how much a path's length counts, when paths begin, beside what a new point adds to it.
    """

    cost: Callable[[Sequence[float]], tuple[float, float]]
    levelling: float


class Search:
    """Paths of several robots over one table of distances.

    Nodes are numbers of rows of ``distances``, shape (n, n), symmetric. ``fixed`` of them, the last
    ones, are begins and ends; the others are points. A path is a list of nodes from its begin to
    its end, and together the paths must hold every node once.
    """

    def __init__(
        self, distances: FloatArray, fixed: int, paths: Iterable[Path], objective: Objective
    ) -> None:
        self.paths: list[Path] = []
        self.lengths: list[float] = []
        self._so_far: list[list[float]] = []
        self._objective = objective
        self._distances = distances
        self._rows: list[list[float]] = distances.tolist()
        self._points = len(distances) - fixed
        self._least = _LEAST_GAIN * float(distances.max(initial=0.0))
        self._near = _neighbours(distances, self._points)
        self._path_of = [0] * len(distances)
        self._place = [0] * len(distances)
        self._queue: deque[int] = deque()
        self._waits = [False] * len(distances)
        for path in paths:
            self.paths.append([])
            self.lengths.append(0.0)
            self._so_far.append([])
            self._set(len(self.paths) - 1, path)

    @property
    def cost(self) -> tuple[float, float]:
        """What the objective says of the paths as they are."""
        return self._objective.cost(self.lengths)

    def settle(self) -> None:
        """Exchange until nothing helps."""
        changed = True
        while changed:
            for path in self.paths:
                self._wake(path)
            changed = self._drain()
            for index in range(len(self.paths)):
                changed |= self._reversals(index)

    def kick(self, path: int, cuts: tuple[int, int, int]) -> bool:
        """Exchange two parts that follow each other, settle about them; back if that was no good.

        The parts are the places ``cuts[0]`` up to ``cuts[1]`` and from there up to ``cuts[2]`` of a
        path; that is the move that 2-opt and Or-opt undo least easily (Martin, Otto and Felten,
        1991). Returns whether the cost fell.
        """
        cost, before = self.cost, list(self.paths)
        nodes, (i, j, k) = self.paths[path], cuts
        self._set(path, nodes[:i] + nodes[j:k] + nodes[i:j] + nodes[k:])
        self._wake(nodes[at] for at in (i - 1, i, j - 1, j, k - 1, k))
        self._drain()
        if self.cost <= cost:
            return self.cost < cost
        for index, old in enumerate(before):
            if self.paths[index] is not old:
                self._set(index, old)
        return False

    def _set(self, index: int, path: Path) -> None:
        rows, so_far, total, before = self._rows, [], 0.0, path[0]
        for place, node in enumerate(path):
            total += rows[before][node] if place else 0.0
            so_far.append(total)
            self._path_of[node], self._place[node] = index, place
            before = node
        self.paths[index], self.lengths[index], self._so_far[index] = path, total, so_far

    def _wake(self, nodes: Iterable[int]) -> None:
        for node in nodes:
            if not self._waits[node]:
                self._waits[node] = True
                self._queue.append(node)

    def _drain(self) -> bool:
        """Improve about every node that waits; whether anything was gained."""
        changed = False
        while self._queue:
            node = self._queue.popleft()
            self._waits[node] = False
            while self._improve(node):
                changed = True
        return changed

    def _improve(self, a: int) -> bool:
        """Make the first exchange found that leads from `a` to a neighbour and helps."""
        rows = self._rows
        path, i = self.paths[self._path_of[a]], self._place[a]
        longest = max(
            rows[path[i - 1]][a] if i else 0.0, rows[a][path[i + 1]] if i + 1 < len(path) else 0.0
        )
        for c in self._near[a]:
            gains = rows[a][c] < longest
            if self._path_of[c] == self._path_of[a]:
                if gains and (self._reverse(a, c) or self._move(a, c)):
                    return True
            elif (gains or self._objective.levelling) and (
                self._move(a, c) or self._exchange_rests(a, c)
            ):
                return True
        return False

    def _helps(self, path: int, length: float, other: int, other_length: float) -> bool:
        """Whether new lengths of two paths are better than those they have."""
        lengths = self.lengths
        gain = lengths[path] + lengths[other] - length - other_length
        if not self._objective.levelling:
            return gain > self._least
        new = list(lengths)
        new[path], new[other] = length, other_length
        (first, second), (was, then) = self._objective.cost(new), self.cost
        return first < was - self._least or (first <= was and second < then - self._least)

    def _reverse(self, a: int, c: int) -> bool:
        """2-opt: `a` and `c` become neighbours, by their steps onwards or by those before."""
        rows, index = self._rows, self._path_of[a]
        path = self.paths[index]
        low, high = sorted((self._place[a], self._place[c]))
        for first, last in ((low + 1, high), (low, high - 1)):
            if first < 1 or last + 1 >= len(path) or first >= last:
                continue
            before, begin, end, after = path[first - 1], path[first], path[last], path[last + 1]
            new = rows[before][end] + rows[begin][after]
            if rows[before][begin] + rows[end][after] - new > self._least:
                self._set(index, path[:first] + path[first : last + 1][::-1] + path[last + 1 :])
                self._wake((before, begin, end, after))
                return True
        return False

    def _move(self, a: int, c: int) -> bool:
        """Or-opt: up to three nodes from `a` on, or back from it, come to lie with `a` beside c."""
        if a >= self._points:
            return False
        rows, home, away = self._rows, self._path_of[a], self._path_of[c]
        path, i, j, target = self.paths[home], self._place[a], self._place[c], self.paths[away]
        for count in range(1, LONGEST_MOVED + 1):
            for first, last in ((i, i + count - 1), (i - count + 1, i)):
                if first < 1 or last + 1 >= len(path) or (home == away and first <= j <= last):
                    continue
                before, begin, end, after = path[first - 1], path[first], path[last], path[last + 1]
                inner = self._so_far[home][last] - self._so_far[home][first]
                out = rows[before][begin] + inner + rows[end][after] - rows[before][after]
                b = end if a == begin else begin
                for gap in (j, j + 1):  # the nodes come between the places gap - 1 and gap
                    if not 0 < gap < len(target) or (home == away and first <= gap <= last + 1):
                        continue
                    d = target[gap] if gap == j + 1 else target[gap - 1]
                    into = rows[a][c] + inner + rows[b][d] - rows[c][d]
                    if home == away:
                        good = out - into > self._least
                    else:
                        good = self._helps(
                            home, self.lengths[home] - out, away, self.lengths[away] + into
                        )
                    if good:
                        part = path[first : last + 1]
                        if (part[0] == a) != (gap == j + 1):
                            part.reverse()
                        self._put(home, first, last, away, gap, part)
                        self._wake((before, after, begin, end, c, d))
                        return True
                if count == 1:
                    break  # both ways of one node are the same
        return False

    def _put(self, home: int, first: int, last: int, away: int, gap: int, part: Path) -> None:
        path, target = self.paths[home], self.paths[away]
        rest = path[:first] + path[last + 1 :]
        if home != away:
            self._set(home, rest)
            self._set(away, target[:gap] + part + target[gap:])
        else:
            gap -= len(part) if gap > last else 0
            self._set(home, rest[:gap] + part + rest[gap:])

    def _exchange_rests(self, a: int, c: int) -> bool:
        """2-opt*: `a` and `c`, of different paths, become neighbours; begins and ends stay."""
        rows, home, away = self._rows, self._path_of[a], self._path_of[c]
        path, other, i, j = self.paths[home], self.paths[away], self._place[a], self._place[c]
        if i + 1 == len(path):
            return False
        so_far, far = self._so_far[home], self._so_far[away]
        onward, last = path[i + 1], path[-2]
        rest = so_far[-2] - so_far[i + 1] if i + 2 < len(path) else None
        end, begin, other_end = path[-1], other[0], other[-1]
        ours = so_far[i] + rows[a][c] + far[-2] - far[j] + rows[other[-2]][end]
        theirs = far[j - 1] + (
            rows[other[j - 1]][other_end]
            if rest is None
            else rows[other[j - 1]][onward] + rest + rows[last][other_end]
        )
        if self._helps(home, ours, away, theirs):
            new = path[: i + 1] + other[j:-1] + path[-1:]
            new_other = other[:j] + path[i + 1 : -1] + other[-1:]
        else:
            after = other[j + 1]
            ours = so_far[i] + rows[a][c] + far[j] - far[1] + rows[other[1]][end]
            theirs = (far[-1] - far[j + 1]) + (
                rows[begin][after]
                if rest is None
                else rows[begin][last] + rest + rows[onward][after]
            )
            if not self._helps(home, ours, away, theirs):
                return False
            new = path[: i + 1] + other[j:0:-1] + path[-1:]
            new_other = other[:1] + path[-2:i:-1] + other[j + 1 :]
        joints = (a, c, onward, last, end, other[j - 1], other[j + 1], other[1], other[-2])
        self._set(home, new)
        self._set(away, new_other)
        self._wake((*joints, begin, other_end))
        return True

    def _reversals(self, index: int) -> bool:
        """Try all reversals on a path, and make the best until there is none."""
        changed = False
        while True:
            path = np.array(self.paths[index])
            table = self._distances[np.ix_(path, path)]
            steps = np.diagonal(table, 1)
            gains = steps[:, None] + steps[None, :] - table[:-1, :-1] - table[1:, 1:]
            at = int(np.triu(gains, 2).argmax()) if len(path) > 3 else 0
            i, j = divmod(at, len(path) - 1)
            if j <= i or gains[i, j] <= self._least:
                return changed
            nodes = self.paths[index]
            self._set(index, nodes[: i + 1] + nodes[i + 1 : j + 1][::-1] + nodes[j + 1 :])
            changed = True


def _neighbours(distances: FloatArray, points: int) -> list[list[int]]:
    """The nearest points of every node, nearest first, the lower number first where equally near.

    Far ends of open paths are equally near to all, so nothing leads to them: they have none.
    """
    own = distances[:, :points].copy()
    own[np.arange(points), np.arange(points)] = np.inf
    order = np.argsort(own, axis=1, kind="stable")[:, : min(NEIGHBOURS, max(points - 1, 1))]
    nowhere = own.max(axis=1, initial=0.0) == 0.0
    return [[] if none else row for none, row in zip(nowhere, order.tolist(), strict=True)]
