"""The noise-tolerant survey: its errors against the deviations it states, and what it finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.tolerant import exceeded, noise_tolerant
from tests.procboard.survey.known_fields import late_rank, low_rank, swim


def noisy(field, sigma, seed):
    return field + sigma * np.random.default_rng(seed).standard_normal(field.shape)


@given(st.integers(0, 10_000), st.integers(1, 12), st.integers(1, 12), st.integers(0, 4))
def test_exact_samples_give_an_exact_field_of_any_shape(seed, n, m, rank):
    field = low_rank(np.random.default_rng(seed), (n, m), rank)
    survey = noise_tolerant((n, m), 0.0, seed=seed)
    swim(survey, field)
    assert np.abs(survey.reconstruction() - field).max() <= 1e-9 * np.abs(field).max(initial=1.0)


def test_errors_are_as_large_as_stated():
    """Root mean square of error over stated deviation, over 30 surveys of 3 fields: 1."""
    errors = []
    for seed in range(30):
        rng = np.random.default_rng(seed % 3)
        field = 40.0 * low_rank(rng, (20, 20), 2 + seed % 3)
        sigma = 0.1 * 10.0 ** (seed % 3)
        survey = noise_tolerant((20, 20), sigma, seed=seed)
        swim(survey, noisy(field, sigma, 100 + seed))
        found, unknown = survey.estimate(), ~survey.sampled
        assert unknown.sum() > 120
        errors.append(((found.matrix - field) / found.deviation)[unknown])
        assert found.deviation[~unknown] == pytest.approx(sigma)
    rms = math.sqrt(float(np.mean(np.concatenate(errors) ** 2)))
    assert rms == pytest.approx(1.0, abs=0.06)


def test_the_deviation_of_each_cell_is_what_many_surveys_show():
    """Mean square of error over stated deviation, cell by cell, where it was left out often."""
    field = 10.0 * low_rank(np.random.default_rng(5), (10, 12), 2)
    squares, count = np.zeros(field.shape), np.zeros(field.shape)
    for seed in range(250):
        survey = noise_tolerant(field.shape, 1e-3, seed=seed)
        swim(survey, noisy(field, 1e-3, seed))
        found, unknown = survey.estimate(), ~survey.sampled
        squares += np.where(unknown, ((found.matrix - field) / found.deviation) ** 2, 0.0)
        count += unknown
    often = count > 100
    assert often.sum() >= 40
    ratio = squares[often] / count[often]
    assert ratio.mean() == pytest.approx(1.0, abs=0.06)
    assert np.abs((ratio - 1.0) / np.sqrt(2.0 / count[often])).max() < 4.0


@pytest.mark.parametrize(("amplification", "most"), [(1.5, 0.9), (3.0, 0.7), (10.0, 0.63)])
def test_no_cell_is_amplified_beyond_the_bound(amplification, most):
    shares = []
    for seed in range(5):
        field = 50.0 * low_rank(np.random.default_rng(seed), (16, 16), 4)
        survey = noise_tolerant((16, 16), 1.0, amplification=amplification, seed=seed)
        swim(survey, noisy(field, 1.0, seed))
        assert survey.estimate().deviation.max() <= amplification
        shares.append(survey.sampled.mean())
    assert most - 0.1 < np.mean(shares) < most


def test_a_corner_that_says_little_of_the_field_asks_for_lines_across_it():
    """exp(−(x − y)²/2w²) is smooth: its first 7 × 7 block has a condition of 1e9."""
    x = np.linspace(0.0, 1.0, 24)
    field = 255.0 * np.exp(-((x[:, None] - x) ** 2) / 0.5)
    survey = noise_tolerant((24, 24), 0.5)
    swim(survey, noisy(field, 0.5, 1))
    error = survey.reconstruction() - field
    assert math.sqrt(float(np.mean(error**2))) < 1.5 * 0.5
    assert survey.sampled.mean() < 0.6
    full = np.flatnonzero(survey.sampled.all(axis=1))
    assert full.size
    assert full.max() > 12


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_what_begins_outside_the_first_block_is_found(seed):
    """Two patches that share no row and no column: Algorithm 3 never looks at the second."""
    field = np.zeros((16, 16))
    field[:6, :7] = 100.0
    field[8:, 9:] = -70.0
    survey = noise_tolerant((16, 16), 1.0, seed=seed)
    swim(survey, noisy(field, 1.0, seed))
    error = survey.reconstruction() - field
    assert math.sqrt(float(np.mean(error**2))) < 2.0
    late = 40.0 * late_rank(np.random.default_rng(seed), 16, 3, 9)
    survey = noise_tolerant((16, 16), 0.5, seed=seed)
    swim(survey, noisy(late, 0.5, seed))
    assert math.sqrt(float(np.mean((survey.reconstruction() - late) ** 2))) < 2.0


def test_noise_alone_asks_for_little_and_a_field_of_full_rank_for_everything():
    survey = noise_tolerant((20, 20), 1.0)
    swim(survey, noisy(np.full((20, 20), 30.0), 1.0, 3))
    assert survey.sampled.mean() < 0.3
    assert np.abs(survey.reconstruction() - 30.0).max() < 10.0
    field = np.random.default_rng(4).standard_normal((9, 11))
    survey = noise_tolerant((9, 11), 0.0)
    swim(survey, field)
    assert np.array_equal(survey.reconstruction(), field)


def test_copies_agree_after_the_same_noisy_samples_in_any_order():
    field = noisy(30.0 * late_rank(np.random.default_rng(4), 13, 4, 7)[:11], 1.0, 9)
    ahead = noise_tolerant(field.shape, 1.0, seed=2)
    path = swim(ahead, field)
    rng = np.random.default_rng(0)
    every = [(int(i), int(j)) for i, j in np.ndindex(field.shape)]
    for other in (path[::-1], [every[k] for k in rng.permutation(len(every))]):
        copy = noise_tolerant(field.shape, 1.0, seed=2)
        for number, cell in enumerate(other):
            copy.tell(cell, field[cell])
            if number % 23 == 5:
                fresh = noise_tolerant(field.shape, 1.0, seed=2)
                for known in sorted(other[: number + 1]):
                    fresh.tell(known, field[known])
                assert (fresh.wanted(), fresh.done) == (copy.wanted(), copy.done)
                here, there = fresh.estimate(), copy.estimate()
                assert np.array_equal(here.matrix, there.matrix, equal_nan=True)
                assert np.array_equal(here.deviation, there.deviation, equal_nan=True)
        assert copy.done
    assert np.array_equal(copy.sampled, np.ones(field.shape, dtype=bool))


def test_an_estimate_can_be_had_at_any_moment():
    field = noisy(30.0 * late_rank(np.random.default_rng(6), 12, 4, 6), 1.0, 1)
    survey = noise_tolerant(field.shape, 1.0)
    known = 0
    while not survey.done:
        cell = survey.wanted()[0]
        survey.tell(cell, field[cell])
        found = survey.estimate()
        assert np.isfinite(found.matrix).sum() >= known
        known = int(np.isfinite(found.matrix).sum())
        assert found.matrix[cell] == field[cell]
    assert known == field.size


@pytest.mark.parametrize("freedom", [1, 2, 3, 8])
def test_the_quantile_of_chi_squared(freedom):
    assert exceeded(freedom) == pytest.approx(scipy.stats.chi2.isf(1e-3, freedom), rel=0.04)


@pytest.mark.parametrize("wrong", [{"sigma": -1.0}, {"sigma": math.nan}, {"amplification": 1.0}])
def test_what_makes_no_survey_is_refused(wrong):
    with pytest.raises(SurveyError):
        noise_tolerant((4, 4), **{"sigma": 1.0, **wrong})
