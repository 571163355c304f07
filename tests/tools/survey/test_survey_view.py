"""What follows from samples and paths: what was known when, what robots did, paths with few points.

Oracles: what the boards themselves ended with, and NumPy's interpolation.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.survey.successive import algorithm_2
from tests.tools.survey.made import nothing
from tools.report.survey_replay import doings, known_over_time
from tools.report.survey_thin import thinned
from tools.report.survey_view import Doing, SampleRow, SurveyView, root_mean_square


def test_a_replay_ends_with_what_the_boards_found(view: SurveyView) -> None:
    assert np.array_equal(view.known[-1].matrix, view.reconstruction)
    assert view.known[-1].wanted == view.sampled
    times = [state.time_s for state in view.known]
    assert times == sorted(times)
    assert all(a.wanted <= b.wanted for a, b in pairwise(view.known))


def test_a_sample_counts_when_it_was_taken_and_no_earlier() -> None:
    """Rank 1 on 3 × 3 cells, by Algorithm 2: each row and column more takes one sample each."""
    field = np.outer([1.0, 2.0, 3.0], [1.0, 3.0, 5.0])
    survey, rows = algorithm_2((3, 3), 1), []
    while not survey.done:
        for cell in survey.wanted():
            at = float(len(rows) + 1)
            rows.append(SampleRow(at, 1, cell, 0.0, 0.0, float(field[cell]), 0.1))
            survey.tell(cell, float(field[cell]))
    known = known_over_time(rows, lambda: algorithm_2((3, 3), 1))
    for state in known:
        taken = sum(row.time_s <= state.time_s for row in rows)
        assert taken <= state.wanted <= len(rows)
        finite = np.isfinite(state.matrix)
        np.testing.assert_allclose(state.matrix[finite], field[finite])
    assert [int(np.isfinite(state.matrix).sum()) for state in known][-1] == 9
    assert len(rows) < 9


def test_a_cell_that_was_given_up_gets_a_stand_in_at_that_time() -> None:
    rows = [SampleRow(1.0, 1, (0, 0), 0.0, 0.0, 2.0, 0.1)]
    known = known_over_time(rows, lambda: algorithm_2((1, 2), 1), {(0, 1): 5.0})
    assert known[-1].time_s == 5.0
    np.testing.assert_array_equal(known[-1].matrix, [[2.0, 2.0]])


def test_order_and_counts_are_of_first_samples(view: SurveyView) -> None:
    first = view.samples[0]
    again = replace(first, time_s=view.samples[-1].time_s + 1.0)
    twice = replace(view, samples=(*view.samples, again))
    assert np.array_equal(twice.order, view.order)
    assert twice.sampled == view.sampled == len({sample.cell for sample in view.samples})
    assert twice.order[first.cell] == 1


def test_a_robot_that_stood_and_swam_and_died() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    x = np.clip(0.03 * (time - 20.0), 0.0, 0.6)
    told = doings(time, x, 0.004 * np.sin(5.0 * time), ((50.0, 60.0),))
    assert [doing for _, doing in told] == [Doing.RESTS, Doing.SWIMS, Doing.RESTS, Doing.DEAD]
    assert told[1][0] == pytest.approx((20.0, 40.0), abs=3.0)
    assert told[-1][0] == (50.0, 60.0)
    assert all(a[1] <= b[0] for (a, _), (b, _) in pairwise(told))


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=60),
    st.floats(1e-3, 0.5),
)
def test_a_thin_path_is_nowhere_farther_off_than_said(
    places: list[tuple[float, float]], tolerance_m: float
) -> None:
    x, y = np.array(places).T
    time = np.cumsum(np.linspace(0.5, 1.5, x.size))
    kept = thinned(time, x, y, tolerance_m)
    assert kept[0] == 0
    assert kept[-1] == x.size - 1
    off = np.hypot(
        np.interp(time, time[kept], x[kept]) - x, np.interp(time, time[kept], y[kept]) - y
    )
    assert off.max() <= tolerance_m * (1 + 1e-9)


def test_an_even_straight_way_has_two_points_and_one_with_a_rest_more() -> None:
    time = np.arange(101.0)
    assert thinned(time, 0.03 * time, time * 0.0, 0.01).tolist() == [0, 100]
    rests = 0.03 * (np.minimum(time, 40.0) + np.maximum(time - 60.0, 0.0))
    kept = thinned(time, rests, time * 0.0, 0.01).tolist()
    assert {40, 60} <= set(kept)
    assert len(kept) <= 6


def test_of_nothing_there_is_a_scale_and_no_error() -> None:
    empty = nothing(3, 4)
    assert empty.span == (0.0, 1.0)
    assert empty.sampled == 0
    assert empty.error is None
    assert root_mean_square(empty.deviation) is None
    assert root_mean_square(np.array([3.0, math.nan, 4.0])) == pytest.approx(math.sqrt(12.5))
