"""Who samples which of the wanted cells, in which order: least energy by (6.4) or (6.5).

A survey that expands (Algorithms 2 and 3) wants a few cells at a time: those of an outer row and an
outer column. Each time they are shared among the robots from where these are, by open tours of the
least length (`procboard.survey.tours`); where turns cost, too, cells are then moved and parts of
tours reversed as long as the energy falls. Two robots so come to take the row and the column, from
the end that they are nearer to, to and fro from one expansion to the next, as in the source's
Fig. 6.8.

What is made small is the energy of the robot that needs most, then the sum. Nobody can go on before
the last cell is known, and a robot that waits draws as much as one that swims. The sum alone is
short-sighted: at the first expansion the row is one step from the column, one robot takes both, and
the farther they are apart, the farther the other one is behind.

Cells and robots are put in order first and nothing is drawn at random, so that boards that know the
same come to the same shares without a word, whatever the order in which they learnt it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray
from procboard.survey.energy import EMULATED, Effort, EnergyModel, effort
from procboard.survey.local_search import Objective
from procboard.survey.rank import Cell
from procboard.survey.tours import LONGEST, tours_from

Place = tuple[float, float]

NEIGHBOURS = 8
"""Cells and robots beside which a cell is tried: all that touch a cell of a full grid."""
LONGEST_MOVED = 3
"""Cells that are moved at once, as in Or-opt."""
_LEAST_SHARE = 1e-9
"""Of the energy, that a change must save: less is rounding."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot is, m, and where it heads, rad from x to y.

    Without a heading, turning onto the first leg is free.
    """

    x_m: float
    y_m: float
    heading_rad: float | None = None

    @property
    def place(self) -> Place:
        """Position, m."""
        return (self.x_m, self.y_m)


def shares(
    cells: Collection[Cell],
    robots: Mapping[int, Pose],
    spacing_m: float,
    model: EnergyModel = EMULATED,
    objective: Objective = LONGEST,
) -> dict[int, tuple[Cell, ...]]:
    """For each robot, the cells that it samples in this order; together each wanted cell once.

    Cell (row, column) lies at x = column · spacing, y = row · spacing. Robots are told apart by
    their numbers. With `procboard.survey.tours.TOTAL` the sum of the energies alone is made small.
    Raises ``SurveyError`` for cells and no robot, or a spacing or pose that is none.
    """
    if not 0.0 < spacing_m < math.inf:
        raise SurveyError(f"the spacing of cells is more than 0 m, got {spacing_m!r}")
    wanted, names = sorted(set(cells)), sorted(robots)
    if not names and not wanted:
        return {}
    poses = [robots[name] for name in names]
    points = [(column * spacing_m, row * spacing_m) for row, column in wanted]
    starts = np.array([pose.place for pose in poses]).reshape(-1, 2)
    begun = tours_from(starts, np.array(points).reshape(-1, 2), closed=False, objective=objective)
    orders = [list(order) for order in begun.orders]
    if model.joules_per_square_radian:
        orders = _Refined(points, poses, model, objective, orders).orders
    return {
        name: tuple(wanted[cell] for cell in order)
        for name, order in zip(names, orders, strict=True)
    }


class _Refined:
    """Orders whose energy no move of a few cells and no reversal makes less."""

    def __init__(
        self,
        points: list[Place],
        poses: list[Pose],
        model: EnergyModel,
        objective: Objective,
        orders: list[list[int]],
    ) -> None:
        self.orders = orders
        self._points, self._poses = points, poses
        self._model, self._objective = model, objective
        self._joules = [self._energy(robot, order) for robot, order in enumerate(orders)]
        places = np.array(points).reshape(-1, 2)
        self._near = _nearest(places, places, 1)
        self._robots_near = _nearest(places, np.array([pose.place for pose in poses]), 0)
        gained = True
        while gained:
            gained = False
            for cell in range(len(points)):
                gained |= self._improve(cell)

    def _energy(self, robot: int, order: list[int]) -> float:
        """Energy of a robot's way, of one straight leg after the other."""
        x, y = self._poses[robot].place
        heading = self._poses[robot].heading_rad
        metres = square_radians = 0.0
        for cell in order:
            to_x, to_y = self._points[cell]
            along, up = to_x - x, to_y - y
            if along or up:
                metres += math.hypot(along, up)
                new = math.atan2(up, along)
                if heading is not None:
                    square_radians += math.remainder(new - heading, math.tau) ** 2
                heading = new
            x, y = to_x, to_y
        return self._model.joules(Effort(metres, len(order), square_radians))

    def _take(self, changed: dict[int, list[int]]) -> bool:
        """Take new orders of some robots if that costs less."""
        joules = list(self._joules)
        for robot, order in changed.items():
            joules[robot] = self._energy(robot, order)
        new, old = self._objective.cost(joules), self._objective.cost(self._joules)
        least = _LEAST_SHARE * sum(self._joules)
        if new[0] > old[0] - least and (new[0] > old[0] or new[1] > old[1] - least):
            return False
        self._joules = joules
        for robot, order in changed.items():
            self.orders[robot] = order
        return True

    def _improve(self, cell: int) -> bool:
        """Try every move and reversal about a cell; whether one was made."""
        changed = False
        for other in self._near[cell]:
            changed |= self._reverse(cell, other)
            for count in range(1, LONGEST_MOVED + 1):
                home, first = self._at(cell)
                part = self.orders[home][first : first + count]
                if len(part) == count and other not in part:
                    away, place = self._at(other)
                    changed |= self._move(home, first, part, away, place)
        for robot in self._robots_near[cell]:
            home, first = self._at(cell)
            changed |= self._move(home, first, [cell], robot, 0)
            changed |= self._reverse_begin(cell)
        return changed

    def _at(self, cell: int) -> tuple[int, int]:
        for robot, order in enumerate(self.orders):
            if cell in order:
                return robot, order.index(cell)
        raise AssertionError("a cell is nobody's")

    def _reverse(self, cell: int, other: int) -> bool:
        (home, i), (away, j) = self._at(cell), self._at(other)
        if home != away:
            return False
        order, low, high = self.orders[home], min(i, j), max(i, j)
        return any(
            self._take({home: order[:first] + order[first:last][::-1] + order[last:]})
            for first, last in ((low + 1, high + 1), (low, high))
        )

    def _reverse_begin(self, cell: int) -> bool:
        """Reverse a robot's way up to a cell, or from it on: what has an open end."""
        home, i = self._at(cell)
        order = self.orders[home]
        return any(
            self._take({home: new})
            for new in (order[i::-1] + order[i + 1 :], order[:i] + order[i:][::-1])
        )

    def _move(self, home: int, first: int, part: list[int], away: int, place: int) -> bool:
        """Put a part beside a place of another robot's order or its own, either way round."""
        rest = self.orders[home][:first] + self.orders[home][first + len(part) :]
        target = rest if home == away else self.orders[away]
        if home == away and place > first:
            place -= len(part)
        for gap in (place, place + 1):
            for turned in (part, part[::-1]):
                changed = {home: rest, away: target[:gap] + turned + target[gap:]}
                if self._take(changed):
                    return True
        return False


def _nearest(places: FloatArray, others: FloatArray, skip: int) -> list[list[int]]:
    """For each place, the nearest of the others, the lower number first where equally near."""
    if not len(places):
        return []
    away = places[:, None, :] - others[None, :, :]
    distances = np.hypot(away[..., 0], away[..., 1])
    order = np.argsort(distances, axis=1, kind="stable")
    return [[int(n) for n in row] for row in order[:, skip : skip + NEIGHBOURS]]


@dataclass(frozen=True, slots=True)
class Walk:
    """What robots did over a whole survey, by their numbers."""

    cells: Mapping[int, tuple[Cell, ...]]
    """Sampled, in order."""
    paths_m: Mapping[int, FloatArray]
    """From the start over every cell sampled, and back where that was wanted; shape (n, 2)."""
    efforts: Mapping[int, Effort]

    @property
    def effort(self) -> Effort:
        """Of all robots."""
        return sum(self.efforts.values(), Effort())


def walk(
    expansions: Iterable[Collection[Cell]],
    robots: Mapping[int, Pose],
    spacing_m: float,
    model: EnergyModel = EMULATED,
    objective: Objective = LONGEST,
    *,
    back: bool = True,
) -> Walk:
    """Walk from expansion to expansion by `shares`, and where ``back``, straight to the start.

    A robot that has nothing to sample in an expansion stays where it is. Errors as in `shares`.
    """
    poses = dict(robots)
    done: dict[int, list[Cell]] = {name: [] for name in robots}
    paths: dict[int, list[Place]] = {name: [pose.place] for name, pose in robots.items()}
    for cells in expansions:
        for name, order in shares(cells, poses, spacing_m, model, objective).items():
            for row, column in order:
                at, (x, y) = (column * spacing_m, row * spacing_m), poses[name].place
                heading = poses[name].heading_rad
                if at != (x, y):
                    heading = math.atan2(at[1] - y, at[0] - x)
                poses[name] = Pose(*at, heading)
                paths[name].append(at)
            done[name] += order
    if back:
        for path in paths.values():
            path.append(path[0])
    found = {name: np.array(path) for name, path in paths.items()}
    return Walk(
        {name: tuple(cells) for name, cells in done.items()},
        found,
        {
            name: effort(path, len(done[name]), robots[name].heading_rad)
            for name, path in found.items()
        },
    )
