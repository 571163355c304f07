"""Algorithms 2 and 3: exact recovery, counts by formula, and copies told in other orders."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.rank import boustrophedon
from procboard.survey.successive import algorithm_2, algorithm_3
from tests.procboard.survey.known_fields import late_rank, low_rank, swim

GRIDS = st.tuples(st.integers(0, 10_000), st.integers(1, 14), st.integers(1, 14))


def condition(field, rank):
    s = np.linalg.svd(field[:rank, :rank], compute_uv=False)
    return float(s[0] / s[-1])


@given(GRIDS, st.integers(1, 6))
def test_any_field_whose_first_block_has_its_rank_is_recovered(grid, rank):
    seed, n, m = grid
    rank = min(rank, n, m)
    field = low_rank(np.random.default_rng(seed), (n, m), rank)
    for survey in (algorithm_2((n, m), rank), algorithm_3((n, m), rank)):
        swim(survey, field)
        bound = 1e-13 * condition(field, rank) ** 2 * np.abs(field).max()
        assert np.abs(survey.reconstruction() - field).max() <= bound
        assert survey.sampled.sum() == rank * (n + m - rank)


@pytest.mark.parametrize(("n", "rank", "share"), [(24, 6, 0.4375), (20, 8, 0.64), (10, 10, 1.0)])
def test_samples_of_a_square_are_the_sources(n, rank, share):
    field = low_rank(np.random.default_rng(n), (n, n), rank)
    survey = algorithm_2((n, n), rank)
    swim(survey, field)
    assert survey.sampled.sum() == rank * rank + rank * 2 * (n - rank) == share * n * n


@given(GRIDS, st.integers(1, 5))
def test_a_rank_that_is_not_given_is_found(grid, rank):
    seed, n, m = grid
    rank = min(rank, n, m)
    field = low_rank(np.random.default_rng(seed), (n, m), rank)
    for survey in (algorithm_2((n, m)), algorithm_3((n, m))):
        swim(survey, field)
        found = survey.reconstruction()
        assert np.abs(found - field).max() <= 1e-6 * np.abs(field).max()
    # one cell a side more than with the rank given, where the grid has one
    swim(survey := algorithm_2((n, m)), field)
    block = min(rank + 1, n, m)
    assert survey.sampled.sum() == block**2 + rank * (n + m - 2 * block)


@given(st.integers(0, 10_000), st.integers(2, 6), st.integers(0, 3))
def test_a_rank_that_comes_late_defeats_algorithm_2_and_not_3(seed, rank, more):
    late = rank + more
    field = late_rank(np.random.default_rng(seed), late + 6, rank, late)
    shape = field.shape
    swim(two := algorithm_2(shape, rank), field)
    assert np.abs(two.reconstruction() - field).max() > 1e-3 * np.abs(field).max()
    swim(three := algorithm_3(shape, rank, seed), field)
    assert np.abs(three.reconstruction() - field).max() < 1e-6 * np.abs(field).max()
    # by the count: a block, steps with one extra cell a line, a row in full, steps without
    looks = more * 2 * rank + (late + (rank - 1) + 1 + 1)
    assert three.sampled.sum() == rank * rank + looks + (field.shape[0] - late - 1) * 2 * rank


@given(st.integers(0, 10_000))
def test_a_column_and_a_row_at_once_bring_two_ranks(seed):
    rng = np.random.default_rng(seed)
    left, right = rng.standard_normal((12, 4)), rng.standard_normal((4, 12))
    left[:6, 3] = right[2, :6] = 0.0  # the first 6 × 6 has rank 2, the first 7 × 7 has rank 4
    survey = algorithm_3((12, 12), 4, seed)
    swim(survey, left @ right)
    assert np.abs(survey.reconstruction() - left @ right).max() < 1e-6
    assert survey.sampled[:7, 6].all()
    assert survey.sampled[6, :7].all()


def test_the_extra_cells_are_drawn_from_the_seed():
    field = late_rank(np.random.default_rng(1), 20, 5, 12)
    masks = [swim(algorithm_3((20, 20), 5, seed), field) for seed in (1, 1, 2)]
    assert masks[0] == masks[1] != masks[2]


def test_a_field_of_zeros_is_known_by_its_block():
    for survey in (algorithm_2((7, 9), 2), algorithm_2((7, 9)), algorithm_3((7, 9))):
        swim(survey, np.zeros((7, 9)))
        assert not survey.reconstruction().any()


def orders(field, make):
    """The cells that a survey wants, told in the order of the visit, backwards, and shuffled."""
    path = swim(make(), field)
    rng = np.random.default_rng(0)
    every = [(int(i), int(j)) for i, j in np.argwhere(np.isfinite(field))]
    return path, [path[::-1], list(rng.permutation(path)), list(rng.permutation(every))]


@pytest.mark.parametrize(
    "make",
    [
        lambda: algorithm_2((11, 13), 5),
        lambda: algorithm_2((11, 13)),
        lambda: algorithm_3((11, 13), 5, 3),
        lambda: algorithm_3((11, 13), None, 3),
    ],
)
def test_copies_agree_after_the_same_samples_in_any_order(make):
    """Also before the end: whatever has been told, the order of telling does not show."""
    field = late_rank(np.random.default_rng(4), 13, 5, 7)[:11]
    path, others = orders(field, make)
    ahead = make()
    swim(ahead, field)
    for other in others:
        copy = make()
        for number, cell in enumerate(other):
            copy.tell((int(cell[0]), int(cell[1])), field[tuple(cell)])
            if number % 17 == 5:
                fresh = make()
                for known in sorted(map(tuple, other[: number + 1])):
                    fresh.tell((int(known[0]), int(known[1])), field[tuple(known)])
                assert fresh.wanted() == copy.wanted()
                assert fresh.done == copy.done
                assert np.array_equal(fresh.reconstruction(), copy.reconstruction(), equal_nan=True)
        assert copy.done
        if len(other) == len(path):
            assert np.array_equal(copy.reconstruction(), ahead.reconstruction())
        else:
            assert copy.reconstruction() == pytest.approx(field)
    assert len(path) == len(set(path))


@given(st.permutations([0.5, 1.25, 3.0]), st.integers(0, 3))
def test_repeated_readings_count_once_as_their_mean_in_any_order(readings, twice):
    field = low_rank(np.random.default_rng(2), (8, 8), 3)
    survey = algorithm_2((8, 8), 3)
    swim(survey, field)
    before = survey.reconstruction()
    survey.tell((1, 1), float(field[1, 1]))  # a message that came twice
    assert np.array_equal(survey.reconstruction(), before)
    for reading in [*readings, *readings[:twice]]:
        survey.tell((1, 1), reading)
    truth = np.array(field)
    truth[1, 1] = math.fsum({float(field[1, 1]), *readings}) / 4
    other = algorithm_2((8, 8), 3)
    swim(other, truth)
    assert survey.done
    assert survey.reconstruction() == pytest.approx(other.reconstruction(), abs=1e-10)


def test_a_survey_tells_what_it_knows_so_far():
    field = low_rank(np.random.default_rng(3), (9, 9), 2)
    survey = algorithm_2((9, 9), 2)
    assert survey.wanted() == boustrophedon(range(2), range(2))
    survey.tell((8, 8), 5.0)
    found = survey.reconstruction()
    assert found[8, 8] == 5.0
    assert np.isnan(found).sum() == 80
    for cell in survey.wanted():
        survey.tell(cell, field[cell])
    assert not survey.done
    for cell in survey.wanted():
        survey.tell(cell, field[cell])
    found = survey.reconstruction()
    assert found[:3, :3] == pytest.approx(field[:3, :3])
    assert np.isfinite(found).sum() == 9 + 1
    found[:] = 0.0  # what is handed out is the caller's
    assert survey.reconstruction()[0, 0] == field[0, 0]
    assert survey.sampled.sum() == 4 + 4 + 1


def test_a_robot_swims_from_ring_to_ring():
    """Steps from cell to cell along the path; only the gap round the block's corner is longer."""
    field = low_rank(np.random.default_rng(3), (12, 12), 3)
    path = swim(algorithm_2((12, 12), 3), field)
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(path)]
    # from the row's last cell to the column's: over the corner
    gaps = [math.dist((k, 2), (2, k)) for k in range(3, 12)]
    assert sum(lengths) == pytest.approx(8 + 1 + 8 + 9 * 4 + sum(gaps), abs=3.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: algorithm_2((0, 5)), "at least one cell"),
        (lambda: algorithm_2((4, 5), 0), "rank 0"),
        (lambda: algorithm_3((4, 5), 5), "rank 5"),
        (lambda: algorithm_2((4, 5)).tell((4, 0), 1.0), r"no cell \(4, 0\)"),
        (lambda: algorithm_2((4, 5)).tell((0, -1), 1.0), "no cell"),
        (lambda: algorithm_2((4, 5)).tell((0, 0), math.nan), "not finite"),
    ],
)
def test_what_makes_no_survey_is_refused(call, words):
    with pytest.raises(SurveyError, match=words):
        call()


def test_a_correction_takes_the_place_of_what_was_told():
    field = low_rank(np.random.default_rng(3), (8, 8), 2)
    survey, other = algorithm_2((8, 8), 2), algorithm_2((8, 8), 2)
    swim(survey, field)
    swim(other, 2.0 * field)
    for cell in sorted(survey.used):
        survey.correct(cell, 2.0 * float(field[cell]))
    assert survey.done
    assert survey.used == other.used
    assert np.array_equal(survey.reconstruction(), other.reconstruction())


def test_all_that_wait_for_the_same_have_used_the_same():
    field = low_rank(np.random.default_rng(3), (8, 8), 2)
    plain, ahead = algorithm_2((8, 8), 2), algorithm_2((8, 8), 2)
    ahead.tell((7, 7), float(field[7, 7]))
    while not plain.done:
        assert plain.request == ahead.request
        assert plain.used == ahead.used
        for cell in plain.request:
            plain.tell(cell, float(field[cell]))
            ahead.tell(cell, float(field[cell]))
