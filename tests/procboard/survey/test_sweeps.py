"""Shares of wanted cells: least energy by trying everything, the source's pattern, agreement."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.energy import EnergyModel, effort
from procboard.survey.local_search import Objective
from procboard.survey.sweeps import Cell, Pose, shares, walk
from procboard.survey.tours import LONGEST, TOTAL

WAY = EnergyModel(1.0)
TURNS = EnergyModel(46.0, 3e-4, 3.2)
MODELS = st.sampled_from([WAY, TURNS])
OBJECTIVES = st.sampled_from([TOTAL, LONGEST])
CELLS = st.sets(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=16)
HEADINGS = st.none() | st.floats(-4.0, 4.0)
POSES = st.builds(Pose, st.floats(0.0, 9.0), st.floats(0.0, 9.0), HEADINGS)
ROBOTS = st.dictionaries(st.integers(0, 99), POSES, min_size=1, max_size=5)


def joules(pose: Pose, cells: Sequence[Cell], spacing_m: float, model: EnergyModel) -> float:
    path = [pose.place, *((spacing_m * column, spacing_m * row) for row, column in cells)]
    return model.joules(effort(np.array(path), len(cells), pose.heading_rad))


@settings(max_examples=80, deadline=None)
@given(CELLS, ROBOTS, MODELS, OBJECTIVES, st.randoms(use_true_random=False))
def test_each_cell_once_and_the_same_whatever_the_order_in_which_it_is_known(
    cells: set[Cell],
    robots: dict[int, Pose],
    model: EnergyModel,
    objective: Objective,
    order: random.Random,
) -> None:
    found = shares(cells, robots, 1.0, model, objective)
    assert sorted(cell for share in found.values() for cell in share) == sorted(cells)
    shuffled, names = list(cells), list(robots)
    order.shuffle(shuffled)
    order.shuffle(names)
    others = {name: robots[name] for name in names}
    assert shares(shuffled, others, 1.0, model, objective) == found


@pytest.mark.parametrize("objective", [TOTAL, LONGEST])
@pytest.mark.parametrize("model", [WAY, TURNS])
def test_shares_are_near_the_least_that_trying_everything_finds(
    model: EnergyModel, objective: Objective
) -> None:
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(12):
        places = rng.choice(36, 5, replace=False)
        cells = [(int(place) // 6, int(place) % 6) for place in places]
        robots = {name: Pose(*rng.uniform(0.0, 5.0, 2), rng.uniform(-3.0, 3.0)) for name in (1, 2)}
        least = math.inf
        for order, split in product(permutations(cells), range(6)):
            costs = [
                joules(robots[1], order[:split], 0.5, model),
                joules(robots[2], order[split:], 0.5, model),
            ]
            least = min(least, objective.cost(costs)[0])
        found = shares(cells, robots, 0.5, model, objective)
        cost = objective.cost([joules(robots[name], found[name], 0.5, model) for name in (1, 2)])
        ratios.append(cost[0] / least)
    assert min(ratios) > 1.0 - 1e-9
    assert np.mean(ratios) < 1.05
    assert sum(ratio < 1.0 + 1e-9 for ratio in ratios) >= 6


def test_turns_that_cost_are_avoided() -> None:
    """A robot that heads north finds the northern cell nearer than the western one."""
    robots = {1: Pose(0.0, 0.0, math.pi / 2)}
    cells = [(0, 3), (4, 0)]
    assert shares(cells, robots, 1.0, WAY) == {1: ((0, 3), (4, 0))}
    assert shares(cells, robots, 1.0, EnergyModel(1.0, 0.0, 10.0)) == {1: ((4, 0), (0, 3))}


def test_the_heading_of_the_last_leg_counts_in_the_next_expansion() -> None:
    steep = EnergyModel(1.0, 0.0, 10.0)
    north = walk([[(1, 0)], [(1, 3), (5, 0)]], {1: Pose(0.0, 0.0)}, 1.0, steep)
    assert north.cells[1] == ((1, 0), (5, 0), (1, 3))
    east = walk([[(0, 1)], [(3, 1), (0, 5)]], {1: Pose(0.0, 0.0)}, 1.0, steep)
    assert east.cells[1] == ((0, 1), (0, 5), (3, 1))


def expansions(size: int, rank: int) -> Iterator[list[Cell]]:
    yield [(i, j) for i in range(rank) for j in range(rank)]
    for k in range(rank, size):
        yield [(k, j) for j in range(rank)] + [(i, k) for i in range(rank)]


def test_one_takes_the_rows_to_and_fro_and_the_other_the_columns() -> None:
    robots = {1: Pose(0.0, 5.0), 2: Pose(5.0, 0.0)}
    outer = list(expansions(24, 6))[1:]
    found = walk(outer, robots, 1.0, WAY, back=False)
    rows = [(k, j) for k in range(6, 24) for j in (range(6) if k % 2 == 0 else range(5, -1, -1))]
    assert found.cells[1] == tuple(rows)
    assert found.cells[2] == tuple((j, i) for i, j in rows)
    assert found.efforts[1].metres == found.efforts[2].metres == 18 * 6
    assert found.effort.samples == 2 * 108


def test_a_whole_survey_samples_as_much_as_the_source_prints_and_comes_back() -> None:
    robots = {1: Pose(2.0, 5.0), 2: Pose(5.0, 2.0)}
    found = walk(expansions(24, 6), robots, 1.0, WAY)
    assert found.effort.samples / 24**2 == 0.4375
    for name, path in found.paths_m.items():
        assert tuple(path[0]) == tuple(path[-1]) == robots[name].place
    ways = [effort(path, 0).metres for path in found.paths_m.values()]
    assert found.effort.metres == pytest.approx(sum(ways))
    # no step between cells is shorter than 1, and the ends of the rows are 18 and more away
    assert found.effort.metres >= 252 - 2 + 2 * 18


def test_a_robot_fewer_is_only_a_robot_fewer() -> None:
    cells = next(expansions(24, 6))
    robots = {name: Pose(float(name % 6), float(name // 6)) for name in range(36)}
    assert all(len(share) == 1 for share in shares(cells, robots, 1.0, TURNS).values())
    del robots[7]
    found = shares(cells, robots, 1.0, TURNS)
    assert sum(map(len, found.values())) == 36
    assert max(map(len, found.values())) == 2


def test_a_hundred_robots_share_a_row_among_the_nearest() -> None:
    robots = {name: Pose(float(name % 10), float(name // 10)) for name in range(100)}
    found = shares([(10, j) for j in range(10)], robots, 1.0, TURNS)
    assert {name: share for name, share in found.items() if share} == {
        90 + j: ((10, j),) for j in range(10)
    }


def test_nothing_wanted_is_nothing_to_do_and_what_cannot_be_shared_is_refused() -> None:
    pose = Pose(0.0, 0.0)
    assert shares([], {}, 1.0) == {}
    assert shares([], {3: pose}, 1.0) == {3: ()}
    assert walk([], {3: pose}, 1.0).effort.metres == 0.0
    with pytest.raises(SurveyError, match="no robot"):
        shares([(0, 0)], {}, 1.0)
    for spacing_m in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(SurveyError, match="spacing"):
            shares([(0, 0)], {3: pose}, spacing_m)
    with pytest.raises(SurveyError, match="finite"):
        shares([(0, 0)], {3: Pose(math.nan, 0.0)}, 1.0)
