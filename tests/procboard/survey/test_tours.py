"""Tours against known optima: dynamic programming, grids, circles, clusters; and what all obey."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.local_search import Objective
from procboard.survey.tours import LONGEST, TOTAL, Tours, _Table, tours_anywhere, tours_from
from tests.procboard.survey.exact import best_shares, shortest_by_set

PLACES = st.tuples(st.integers(0, 12), st.integers(0, 12)).map(
    lambda place: (float(place[0]), float(place[1]))
)
POINTS = st.lists(PLACES, max_size=24)
STARTS = st.lists(PLACES, min_size=1, max_size=4)
OBJECTIVES = st.sampled_from([TOTAL, LONGEST])


def walked(
    start: tuple[float, float], order: Sequence[int], points: Sequence[tuple[float, float]],
    closed: bool,
) -> float:  # fmt: skip
    path = [start, *(points[point] for point in order), *([start] if closed else [])]
    return sum(math.dist(a, b) for a, b in pairwise(path))


def array(places: Sequence[tuple[float, float]]) -> np.ndarray:
    return np.array(places, dtype=float).reshape(-1, 2)


@settings(max_examples=150, deadline=None)
@given(POINTS, STARTS, st.booleans(), OBJECTIVES, st.sampled_from([0, 20]))
def test_every_point_once_lengths_as_walked_and_never_worse_than_begun(
    points: list[tuple[float, float]],
    starts: list[tuple[float, float]],
    closed: bool,
    objective: Objective,
    kicks: int,
) -> None:
    found = tours_from(
        array(starts), array(points), closed=closed, objective=objective, kicks=kicks
    )
    visited = [point for order in found.orders for point in order]
    assert sorted(visited) == list(range(len(points)))
    assert found.lengths == pytest.approx(
        [walked(s, o, points, closed) for s, o in zip(starts, found.orders, strict=True)]
    )
    table = _Table(array(starts), array(points), closed=closed)
    begun = table.measured(table.inserted(objective))
    assert objective.cost(found.lengths)[0] <= objective.cost(begun.lengths)[0] + 1e-9
    again = tours_from(
        array(starts), array(points), closed=closed, objective=objective, kicks=kicks
    )
    assert again == found


@settings(max_examples=100, deadline=None)
@given(POINTS, st.integers(1, 4), OBJECTIVES)
def test_tours_from_anywhere_visit_every_point_once(
    points: list[tuple[float, float]], robots: int, objective: Objective
) -> None:
    found = tours_anywhere(robots, array(points), objective=objective)
    assert sorted(p for order in found.orders for p in order) == list(range(len(points)))
    assert len(found.orders) == len(found.lengths) == robots
    for order, length in zip(found.orders, found.lengths, strict=True):
        assert length == pytest.approx(
            walked(points[order[0]], order[1:], points, True) if order else 0.0
        )


def cross(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Whether the segments a-b and c-d meet at one inner point of both."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float(np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def crossings(start: tuple[float, float], order: Sequence[int], points: np.ndarray) -> int:
    path = np.array([start, *points[list(order)], start])
    pairs = combinations(list(pairwise(path)), 2)
    return sum(cross(a, b, c, d) for (a, b), (c, d) in pairs)


@settings(max_examples=60, deadline=None)
@given(st.lists(PLACES, max_size=40), STARTS, OBJECTIVES)
def test_no_closed_tour_crosses_itself(
    points: list[tuple[float, float]], starts: list[tuple[float, float]], objective: Objective
) -> None:
    found = tours_from(array(starts), array(points), objective=objective)
    for start, order in zip(starts, found.orders, strict=True):
        assert crossings(start, order, array(points)) == 0


def test_no_tour_crosses_itself_between_heaps_whose_nearest_neighbours_are_their_own() -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        middles = rng.uniform(0.0, 100.0, (5, 1, 2))
        points = (middles + rng.uniform(-1.0, 1.0, (5, 12, 2))).reshape(-1, 2)
        (order,) = tours_from(points[:1], points).orders
        assert crossings((points[0, 0], points[0, 1]), order, points) == 0


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("objective", [TOTAL, LONGEST])
def test_two_robots_are_near_the_optimum_of_dynamic_programming(
    closed: bool, objective: Objective
) -> None:
    rng = np.random.default_rng(5)
    shares = []
    for _ in range(25):
        points, starts = rng.uniform(0.0, 10.0, (7, 2)), rng.uniform(0.0, 10.0, (2, 2))
        found = tours_from(starts, points, closed=closed, objective=objective, kicks=30)
        exact = best_shares(
            [(float(x), float(y)) for x, y in starts],
            [(float(x), float(y)) for x, y in points],
            closed,
            lambda lengths: objective.cost(lengths)[0],
        )
        shares.append(objective.cost(found.lengths)[0] / exact)
    assert min(shares) >= 1.0 - 1e-9
    assert np.mean(shares) < 1.02
    assert np.mean(np.array(shares) < 1.0 + 1e-9) > 0.6


def test_one_robot_finds_the_optimum_of_ten_points() -> None:
    rng = np.random.default_rng(6)
    for _ in range(5):
        points = rng.uniform(0.0, 10.0, (9, 2))
        listed = [(float(x), float(y)) for x, y in points]
        found = tours_anywhere(1, points, kicks=50)
        assert found.length == pytest.approx(shortest_by_set(None, listed, True)[-1])


@pytest.mark.parametrize(("rows", "columns"), [(4, 4), (6, 10), (10, 10)])
def test_a_grid_of_even_sides_is_walked_in_steps_of_one(rows: int, columns: int) -> None:
    """As many unit steps as points: none can be shorter, and even sides allow it."""
    grid = np.array([(x, y) for y in range(rows) for x in range(columns)], dtype=float)
    found = tours_anywhere(1, grid, kicks=300)
    assert found.length == pytest.approx(rows * columns)


def test_points_on_a_circle_are_visited_around_it() -> None:
    count = 60
    angles = 2.0 * np.pi * np.random.default_rng(2).permutation(count) / count
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    side = 2.0 * math.sin(math.pi / count)
    assert tours_anywhere(1, circle).length == pytest.approx(count * side)
    start = circle[:1]
    assert tours_from(start, circle, closed=False).length == pytest.approx((count - 1) * side)
    # two starts on opposite sides, ways one way: half the circle each
    both = np.concatenate((start, -start))
    shared = tours_from(both, circle, closed=False, objective=LONGEST, kicks=100)
    assert max(shared.lengths) == pytest.approx((count / 2 - 1) * side)


def test_a_hundred_robots_sample_what_is_near_to_them() -> None:
    corners = np.array([(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    starts = 100.0 * np.array([(x, y) for y in range(10) for x in range(10)], dtype=float)
    points = (starts[:, None, :] + corners).reshape(-1, 2)
    for objective in (TOTAL, LONGEST):
        found = tours_from(starts, points, objective=objective)
        assert found.lengths == pytest.approx([4.0] * 100)


def test_the_longest_tour_is_shorter_where_that_is_what_is_wanted() -> None:
    points = np.random.default_rng(3).uniform(0.0, 10.0, (60, 2))
    starts = np.array([(0.0, 0.0)] * 3)
    total = tours_from(starts, points)
    longest = tours_from(starts, points, objective=LONGEST)
    assert total.length < longest.length
    assert max(longest.lengths) < 0.7 * max(total.lengths)


def test_kicks_shorten() -> None:
    points = np.random.default_rng(4).uniform(0.0, 10.0, (120, 2))
    lengths = [tours_anywhere(1, points, kicks=kicks).length for kicks in (0, 300)]
    assert lengths[1] < lengths[0]


def test_what_cannot_be_planned_is_refused_and_nothing_is_planned_for_nobody() -> None:
    none, one = np.empty((0, 2)), np.zeros((1, 2))
    for call in (lambda: tours_from(none, one), lambda: tours_anywhere(0, one)):
        with pytest.raises(SurveyError, match="no robot"):
            call()
    with pytest.raises(SurveyError, match="finite"):
        tours_from(one, np.array([(math.nan, 0.0)]))
    assert tours_from(one, none) == Tours(((),), (0.0,))
    assert tours_from(none, none) == Tours((), ())
    assert tours_anywhere(2, one) == Tours(((0,), ()), (0.0, 0.0))
