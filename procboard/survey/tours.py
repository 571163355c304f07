"""Several robots share the points of a survey: a short tour for each, closed or open.

Tours begin by cheapest insertion: of all points that wait, the one that lengthens a tour least, put
where it does (Rosenkrantz, Stearns and Lewis, 1977: at most twice the optimum for one salesman).
Then exchanges make them shorter until none helps (`procboard.survey.local_search`), and for as many
``kicks`` as are asked for, a part of a tour is exchanged with the next part, at random, and all is
settled about it, and undone where that is worse: iterated local search.

Random places of kicks come from a generator with a seed of its own, and distances from a square
root, which every processor rounds alike, so that two boards that plan for the same points and
robots find the same tours. Distances are in a table: memory and the time to
begin grow with the square of the number of points, which may be a thousand or two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray
from procboard.survey.local_search import Objective, Path, Search

TOTAL = Objective(lambda lengths: (sum(lengths), 0.0), 0.0)
"""The sum of all tours: the least energy."""
LONGEST = Objective(lambda lengths: (max(lengths), sum(lengths)), 1.0)
"""The longest tour, then the sum: the shortest time until all is sampled."""

LONGEST_KICK = 50
"""Points in each part that a kick exchanges: near ones, so that little has to be settled."""
_SEED = 0
_TURNS_IN_VAIN = 2
"""Times that all tours are begun elsewhere without a gain before they are good."""


@dataclass(frozen=True, slots=True)
class Tours:
    """Who visits which points in which order (numbers of points), and how far each robot goes.

    ``lengths`` has the unit of the points and includes the way from the start and, of closed tours,
    the way back.
    """

    orders: tuple[tuple[int, ...], ...]
    lengths: tuple[float, ...]

    @property
    def length(self) -> float:
        """The sum over all robots."""
        return sum(self.lengths)


def tours_from(
    starts: FloatArray,
    points: FloatArray,
    *,
    closed: bool = True,
    objective: Objective = TOTAL,
    kicks: int = 0,
) -> Tours:
    """Plan tours from ``starts``, shape (m, 2), through all ``points``, shape (n, 2).

    Closed tours lead back to their start, open ones end at any point. A robot may stay where it is.
    Raises ``SurveyError`` for points and no robot, or numbers that are no places.
    """
    starts, points = _places("starts", starts), _places("points", points)
    _need_robots(len(starts), points)
    table = _Table(starts, points, closed=closed)
    return table.improved(table.inserted(objective), objective, kicks)


def tours_anywhere(
    robots: int, points: FloatArray, *, objective: Objective = TOTAL, kicks: int = 0
) -> Tours:
    """Plan closed tours that each robot begins at any point of its own, through all ``points``.

    At most as many robots as points take part, each with a point at least: first ones that are far
    from each other. As long as anything is gained, each tour is then begun somewhere else and
    planned again, so that no robot is bound to a point. Raises ``SurveyError`` as `tours_from`.
    """
    points = _places("points", points)
    _need_robots(robots, points)
    taking_part = min(robots, len(points))
    anchors = _far_apart(taking_part, points)
    orders = [[anchor] for anchor in anchors]
    cost, in_vain = (math.inf, math.inf), 0
    while orders and in_vain < _TURNS_IN_VAIN:
        anchors = [order[0] for order in orders]
        free = np.setdiff1d(np.arange(len(points)), anchors)
        number = {point: place for place, point in enumerate(free.tolist())}
        begun = [[number[point] for point in order[1:]] for order in orders]
        table = _Table(points[anchors], points[free], closed=True)
        if cost[0] == math.inf:
            begun = table.inserted(objective)
        found = table.improved(begun, objective, kicks)
        orders = [
            [anchor, *free[list(order)].tolist()]
            for anchor, order in zip(anchors, found.orders, strict=True)
        ]
        now = objective.cost(found.lengths)
        in_vain = 0 if _is_less(now, cost) else in_vain + 1
        cost, lengths = now, found.lengths
        orders = [order[len(order) // 2 :] + order[: len(order) // 2] for order in orders]
    idle = robots - taking_part
    return Tours(
        tuple(tuple(order) for order in [*orders, *[[]] * idle]),
        (*(lengths if orders else ()), *[0.0] * idle),
    )


class _Table:
    """Points, starts and ends as nodes of a search: points first, then starts, then ends."""

    def __init__(self, starts: FloatArray, points: FloatArray, *, closed: bool) -> None:
        self._points, self._robots = len(points), len(starts)
        places = np.concatenate((points, starts, starts))
        away = places[:, None, :] - places[None, :, :]
        self.distances = np.sqrt((away * away).sum(axis=-1))
        if not closed:  # a step to the end costs nothing, wherever it is from
            ends = self._points + self._robots
            self.distances[ends:] = self.distances[:, ends:] = 0.0

    def _path(self, robot: int, order: Sequence[int]) -> Path:
        start = self._points + robot
        return [start, *order, start + self._robots]

    def measured(self, orders: Sequence[Sequence[int]]) -> Tours:
        """Lengths of tours in given orders."""
        paths = [self._path(robot, order) for robot, order in enumerate(orders)]
        lengths = [float(self.distances[path[:-1], path[1:]].sum()) for path in paths]
        return Tours(tuple(tuple(order) for order in orders), tuple(lengths))

    def inserted(self, objective: Objective) -> list[list[int]]:
        """Cheapest insertion; the lowest number of point and robot where costs are equal."""
        paths = [self._path(robot, ()) for robot in range(self._robots)]
        lengths = np.zeros(self._robots)
        adds = np.full((self._points, self._robots), np.inf)
        gaps = np.zeros((self._points, self._robots), dtype=np.intp)
        waiting = np.arange(self._points)
        changed = list(range(self._robots))
        while waiting.size:
            for robot in changed:
                path = np.array(paths[robot])
                ways = self.distances[np.ix_(waiting, path)]
                steps = self.distances[path[:-1], path[1:]]
                more = ways[:, :-1] + ways[:, 1:] - steps
                gaps[waiting, robot] = more.argmin(axis=1)
                adds[waiting, robot] = more.min(axis=1)
            costs = adds[waiting] + objective.levelling * lengths
            at, robot = divmod(int(costs.argmin()), self._robots)
            point = int(waiting[at])
            paths[robot].insert(int(gaps[point, robot]) + 1, point)
            lengths[robot] += adds[point, robot]
            waiting = np.delete(waiting, at)
            changed = [robot]
        return [path[1:-1] for path in paths]

    def improved(self, orders: Sequence[Sequence[int]], objective: Objective, kicks: int) -> Tours:
        """Exchange until nothing helps, then kick and settle so many times."""
        paths = [self._path(robot, order) for robot, order in enumerate(orders)]
        search = Search(self.distances, 2 * self._robots, paths, objective)
        search.settle()
        if kicks:
            rng = np.random.default_rng(_SEED)
            for _ in range(kicks):
                _kick(search, rng)
            search.settle()
        return self.measured([path[1:-1] for path in search.paths])


def _kick(search: Search, rng: np.random.Generator) -> None:
    """Choose a path by the number of its points, and two parts on it."""
    sizes = np.array([max(len(path) - 3, 0) for path in search.paths])
    ends = np.cumsum(sizes)
    if ends[-1] == 0:
        return
    drawn = int(rng.integers(ends[-1]))
    path = int(np.searchsorted(ends, drawn, side="right"))
    last = len(search.paths[path]) - 1
    first = 1 + drawn - int(ends[path] - sizes[path])
    middle = first + 1 + int(rng.integers(min(LONGEST_KICK, last - first - 1)))
    search.kick(
        path, (first, middle, middle + 1 + int(rng.integers(min(LONGEST_KICK, last - middle))))
    )


def _is_less(cost: tuple[float, float], other: tuple[float, float]) -> bool:
    """Less by more than rounding."""
    share = 1.0 - 1e-12
    return cost[0] < share * other[0] or (cost[0] <= other[0] and cost[1] < share * other[1])


def _far_apart(count: int, points: FloatArray) -> list[int]:
    """Points each as far as can be from those before it; the first, from the middle of all."""
    chosen: list[int] = []
    if count:
        nearest = np.hypot(*(points - points.mean(axis=0)).T)
    while len(chosen) < count:
        nearest[chosen] = -1.0  # also where several points are at one place
        chosen.append(int(nearest.argmax()))
        away = np.hypot(*(points - points[chosen[-1]]).T)
        nearest = away if len(chosen) == 1 else np.minimum(nearest, away)
    return chosen


def _places(what: str, given: FloatArray) -> FloatArray:
    places = np.asarray(given, dtype=np.float64).reshape(-1, 2)
    if not np.isfinite(places).all():
        raise SurveyError(f"{what} must be finite numbers")
    return places


def _need_robots(robots: int, points: FloatArray) -> None:
    if robots < 1 and len(points):
        raise SurveyError(f"{len(points)} points to visit and no robot")
