"""Shares of a request, and the field with cells that nobody reached."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.expansion import Expansion
from procboard.survey.fixed import at_random, everywhere
from procboard.survey.items import ITEMS, Sample, Skip
from procboard.survey.knowledge import Grid, Knowledge, Reading
from procboard.survey.outcome import outcome, stand_in
from procboard.survey.plan import planned
from procboard.survey.sweeps import Pose, shares
from procboard.survey.tolerant import noise_tolerant
from tests.procboard.survey.known_fields import low_rank, swim

GRID = Grid(8, 8, 0.25, 1.0, 2.0)
CELLS = st.sets(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=12)
POSES = st.dictionaries(
    st.integers(1, 5), st.builds(Pose, st.floats(0, 4), st.floats(0, 4)), min_size=1, max_size=4
)
SKIPS = st.dictionaries(
    st.tuples(st.integers(0, 7), st.integers(0, 7)), st.sets(st.integers(1, 5)), max_size=20
)


@settings(max_examples=50)
@given(CELLS, POSES, SKIPS)
def test_each_cell_goes_to_one_who_has_not_failed_it(cells, poses, skips):
    found = planned(cells, poses, skips, GRID)
    assert set(found) == set(poses)
    given_out = [cell for order in found.values() for cell in order]
    left = {cell for cell in cells if skips.get(cell, set()) >= set(poses)}
    assert sorted(given_out) == sorted(cells - left)
    assert not any(robot in skips.get(cell, ()) for robot, o in found.items() for cell in o)


def test_without_failures_it_is_the_shares_wherever_the_grid_lies():
    cells = [(0, 0), (0, 5), (4, 2), (7, 7), (6, 1)]
    poses = {1: Pose(1.1, 2.1), 2: Pose(2.5, 3.5, 1.0)}
    about = {1: Pose(0.1, 0.1), 2: Pose(1.5, 1.5, 1.0)}
    assert planned(cells, poses, {}, GRID) == shares(cells, about, 0.25)
    assert planned(cells, {}, {}, GRID) == {}


def test_a_cell_that_was_not_reached_goes_to_the_robot_that_ends_nearest():
    poses = {1: Pose(1.0, 2.0), 2: Pose(1.0, 2.75), 3: Pose(2.75, 3.0)}
    found = planned([(0, 1), (7, 2), (2, 5)], poses, {(0, 1): {1}}, GRID)
    assert found == {1: (), 2: ((7, 2),), 3: ((2, 5), (0, 1))}


def test_a_stand_in_is_the_mean_of_the_nearest():
    samples = {(0, 0): Reading(1.0, 0.1), (2, 2): Reading(4.0, 0.1), (1, 2): Reading(6.0, 0.1)}
    assert stand_in((2, 3), samples) == pytest.approx((5.0, math.sqrt(2.0)))
    assert stand_in((0, 1), samples) == pytest.approx((3.5, math.sqrt(12.5)))
    assert stand_in((3, 3), samples) == pytest.approx((5.0, math.sqrt(2.0)))
    value, spread = stand_in((0, 1), {(4, 4): Reading(3.0, 0.1)})
    assert value == 3.0
    assert math.isnan(spread)
    assert stand_in((0, 1), {})[0] == 0.0


def surveyed(field, fresh: Expansion, sigma, missing=(), seed=0):
    """Knowledge of a survey of a field where some cells were not reached."""
    rng, knowledge, number = np.random.default_rng(seed), Knowledge(Grid(*field.shape, 0.25)), 0
    while not fresh.done:
        for cell in fresh.wanted():
            number += 1
            if cell in missing:
                octets = ITEMS.encode(Skip(*cell, final=True))
                knowledge.receive(1, number, octets)
                fresh.correct(cell, stand_in(cell, {}).value)
                continue
            value = float(field[cell] + sigma * rng.standard_normal())
            sample = Sample(*cell, value, sigma, 10, 0.0, 0.0, 0)
            knowledge.receive(1, number, ITEMS.encode(sample))
            reading = knowledge.reading(cell)
            assert reading is not None
            fresh.correct(cell, reading.value)
    return knowledge


def test_without_missing_cells_errors_are_those_of_the_survey():
    field = 30.0 * low_rank(np.random.default_rng(1), (10, 10), 2)
    survey = noise_tolerant((10, 10), 0.5)
    knowledge = surveyed(field, survey, 0.5)
    found = outcome(knowledge, survey, lambda: noise_tolerant((10, 10), 0.5))
    estimate = survey.estimate()
    assert np.array_equal(found.matrix, estimate.matrix)
    assert found.deviation == pytest.approx(estimate.deviation)
    assert (found.complete, found.given_up) == (True, ())
    assert np.array_equal(found.sampled, survey.sampled)


def test_what_a_missing_cell_does_to_others_is_in_their_errors():
    """A smooth field: the stand-in is off by about the spread, what hangs on it by as much more."""
    x = np.linspace(0.0, 1.0, 10)
    field = 100.0 * np.exp(-((x[:, None] - 0.4) ** 2) - (x - 0.3) ** 2) + 50.0 * x
    squares, more = [], []
    for seed, cell in enumerate([(0, 0), (1, 1), (2, 0), (0, 4), (6, 1)]):
        survey = noise_tolerant((10, 10), 0.2, seed=seed)
        knowledge = surveyed(field, survey, 0.2, [cell], seed)
        if not knowledge.given_up():
            continue
        known = {c: r for c in knowledge.samples if (r := knowledge.reading(c))}
        survey.correct(cell, stand_in(cell, known).value)
        while not survey.done:  # the new value may want more
            for wanted in survey.wanted():
                sample = Sample(*wanted, float(field[wanted]), 0.2, 10, 0.0, 0.0, 0)
                number = knowledge.latest[1] + 1
                knowledge.receive(1, number, ITEMS.encode(sample))
                survey.correct(wanted, float(field[wanted]))
        found = outcome(
            knowledge, survey, lambda seed=seed: noise_tolerant((10, 10), 0.2, seed=seed)
        )
        assert found.given_up == (cell,)
        assert not found.sampled[cell]
        assert found.deviation[cell] > 1.0
        off = (found.matrix - field) / found.deviation
        squares.append(np.nanmean(off**2))
        more.append(np.nanmax((found.deviation / survey.estimate().deviation)[~survey.sampled]))
        assert np.nanmax(np.abs(off)) < 6.0
    assert len(squares) >= 3
    assert max(more) > 1.2


def test_everywhere_samples_all_and_random_cells_are_completed():
    field = low_rank(np.random.default_rng(2), (12, 9), 1)
    survey = everywhere((12, 9), 0.3)
    path = swim(survey, field)
    assert len(path) == 108
    assert np.array_equal(survey.reconstruction(), field)
    assert survey.estimate().deviation == pytest.approx(0.3)
    # from cell to cell there is a step, and a way along from band to band
    assert max(math.dist(a, b) for a, b in pairwise(path)) <= 9.0

    survey = at_random((12, 9), 0.7, 0.0, seed=3)
    path = swim(survey, field)
    assert len(path) == round(0.7 * 108)
    assert survey.reconstruction() == pytest.approx(field, abs=1e-3)
    assert np.isnan(survey.estimate().deviation).sum() == 108 - len(path)
    assert swim(at_random((12, 9), 0.7, 0.0, seed=4), field) != path


@pytest.mark.parametrize("share", [0.0, 1.1, math.nan])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(SurveyError):
        at_random((4, 4), share, 0.1)
