"""Kriging against the equations with a multiplier, SciPy's likelihood and Bessel functions."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gamma, kv
from scipy.stats import multivariate_normal

from tools.studies.kriging import (
    LEAST_NOISE,
    Kernel,
    Kriged,
    kriged,
    matern_3_2,
    matern_5_2,
    squared_exponential,
)

KERNELS = [squared_exponential, matern_3_2, matern_5_2]
RNG = np.random.default_rng
LENGTHS, NOISE = (1.5, 0.7), 0.05


def covariance(a: np.ndarray, b: np.ndarray, kernel: Kernel) -> np.ndarray:
    return np.array([
        [float(kernel(np.array(math.hypot((p[0] - q[0]) / 1.5, (p[1] - q[1]) / 0.7)))) for q in b]
        for p in a
    ])  # fmt: skip


@pytest.mark.parametrize(("kernel", "order"), [(matern_3_2, 1.5), (matern_5_2, 2.5)])
def test_matern_is_the_bessel_function_it_is_defined_by(kernel: Kernel, order: float) -> None:
    h = np.linspace(0.05, 4.0, 20)
    g = math.sqrt(2.0 * order) * h
    assert kernel(h) == pytest.approx(2.0 ** (1.0 - order) / gamma(order) * g**order * kv(order, g))
    assert float(kernel(np.array(0.0))) == 1.0


@pytest.mark.parametrize("kernel", KERNELS)
def test_values_and_deviations_are_those_of_the_system_with_a_multiplier(kernel: Kernel) -> None:
    rng = RNG(0)
    points, places = rng.uniform(0.0, 5.0, (12, 2)), rng.uniform(0.0, 5.0, (7, 2))
    values = rng.normal(3.0, 2.0, 12)
    field = Kriged(points, values, LENGTHS, NOISE, kernel)
    matrix = np.ones((13, 13))
    matrix[:12, :12] = covariance(points, points, kernel) + NOISE * np.eye(12)
    matrix[12, 12] = 0.0
    right = np.vstack([covariance(points, places, kernel), np.ones(7)])
    solved = np.linalg.solve(matrix, right)
    found, deviation = field.at(places)
    assert solved[:12].sum(axis=0) == pytest.approx(np.ones(7))  # weights of an unbiased estimate
    assert found == pytest.approx(values @ solved[:12])
    share = 1.0 - (solved * right).sum(axis=0)
    assert deviation == pytest.approx(field.deviation * np.sqrt(share))


@pytest.mark.parametrize("kernel", KERNELS)
def test_the_likelihood_is_that_of_the_normal_distribution(kernel: Kernel) -> None:
    rng = RNG(1)
    points, values = rng.uniform(0.0, 5.0, (15, 2)), rng.normal(0.0, 1.0, 15)
    field = Kriged(points, values, LENGTHS, NOISE, kernel)
    matrix = covariance(points, points, kernel) + NOISE * np.eye(15)

    def log_likelihood(mean: float, deviation: float) -> float:
        there = np.full(15, mean)
        return float(multivariate_normal.logpdf(values, there, deviation**2 * matrix))

    best = log_likelihood(field.mean, field.deviation)
    assert field.log_likelihood == pytest.approx(best)
    for mean, deviation in ((0.01, 1.0), (-0.01, 1.0), (0.0, 1.01), (0.0, 0.99)):
        assert log_likelihood(field.mean + mean, field.deviation * deviation) < best


def test_lengths_and_noise_of_a_field_drawn_from_the_process_are_found() -> None:
    rng = RNG(3)
    points = rng.uniform(0.0, 10.0, (250, 2))
    matrix = covariance(points, points, matern_5_2) + 1e-10 * np.eye(250)
    truth = 20.0 + 3.0 * np.linalg.cholesky(matrix) @ rng.normal(size=250)
    values = truth + rng.normal(0.0, 0.8, 250)
    found = kriged(points, values)
    assert found.lengths == pytest.approx(LENGTHS, rel=0.35)
    assert found.noise == pytest.approx(0.8, rel=0.25)
    assert found.deviation == pytest.approx(3.0, rel=0.35)
    assert found.mean == pytest.approx(20.0, abs=2.0)
    fitted, deviation = found.at(points)
    assert np.sqrt(np.mean((fitted - truth) ** 2)) < 0.8  # less than the noise
    assert np.mean(np.abs(fitted - truth) < 2.0 * deviation) == pytest.approx(0.95, abs=0.05)
    (x, y), noise = found.lengths, found.noise_ratio
    for factor in (0.95, 1.05):
        for lengths, ratio in (((x * factor, y), noise), ((x, y * factor), noise),
                               ((x, y), noise * factor)):  # fmt: skip
            assert Kriged(points, values, lengths, ratio).log_likelihood < found.log_likelihood


def test_no_lengths_and_noise_of_a_fine_grid_are_likelier_than_those_found() -> None:
    """Few samples: the likelihood has several maxima, field or noise, long one way or the other."""
    for seed in range(8):
        rng = RNG(seed)
        points = rng.uniform(0.0, 10.0, (12, 2))
        values = np.sin(points[:, 0]) + rng.normal(0.0, 0.5, 12)
        best = max(
            Kriged(points, values, (x, y), noise).log_likelihood
            for x, y in product(np.geomspace(0.3, 90.0, 9), repeat=2)
            for noise in np.geomspace(1e-6, 1e2, 7)
        )
        assert kriged(points, values).log_likelihood > best - 1e-6


def test_without_noise_samples_are_met_and_far_away_only_the_mean_is_known() -> None:
    rng = RNG(4)
    points, values = rng.uniform(0.0, 5.0, (20, 2)), rng.normal(1.0, 2.0, 20)
    field = Kriged(points, values, LENGTHS, LEAST_NOISE)
    at, deviation = field.at(points)
    assert at == pytest.approx(values, abs=1e-5)
    assert np.max(deviation) < 1e-3 * field.deviation
    far, unsure = field.at(np.array([(1e3, 1e3)]))
    assert far[0] == pytest.approx(field.mean)
    assert unsure[0] > field.deviation


def test_a_smooth_field_is_rebuilt_from_a_part_of_its_cells() -> None:
    """Heat about a point, 24 × 24, from 30 % of the cells: within a hundredth of its range."""
    y, x = np.mgrid[0:24, 0:24].astype(float)
    field = 20.0 + 10.0 * np.exp(-0.5 * ((x - 7.0) ** 2 + (y - 15.0) ** 2) / 6.0**2)
    cells = RNG(5).choice(576, 173, replace=False)
    places = np.column_stack((x.ravel(), y.ravel()))
    found, _ = kriged(places[cells], field.ravel()[cells], squared_exponential).at(places)
    assert np.sqrt(np.mean((found - field.ravel()) ** 2)) < 0.01 * 10.0


@settings(max_examples=30, deadline=None)
@given(st.floats(-50.0, 50.0), st.floats(0.1, 20.0), st.integers(0, 99))
def test_units_do_not_matter(shift: float, scale: float, seed: int) -> None:
    rng = RNG(seed)
    points, values = rng.uniform(0.0, 5.0, (9, 2)), rng.normal(0.0, 1.0, 9)
    places = rng.uniform(0.0, 5.0, (4, 2))
    at, deviation = Kriged(points, values, LENGTHS, NOISE).at(places)
    other = Kriged(points * scale, shift + scale * values, (1.5 * scale, 0.7 * scale), NOISE)
    scaled, scaled_deviation = other.at(places * scale)
    assert scaled == pytest.approx(shift + scale * at, abs=1e-7)
    assert scaled_deviation == pytest.approx(scale * deviation, abs=1e-7)


def test_equal_samples_are_a_constant_field_and_nonsense_is_refused() -> None:
    points = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
    found, deviation = kriged(points, np.full(3, 4.0)).at(np.array([(5.0, 5.0)]))
    assert (found[0], deviation[0]) == pytest.approx((4.0, 0.0))
    with pytest.raises(ValueError, match="3 places and 2 values"):
        kriged(points, np.zeros(2))
    with pytest.raises(ValueError, match="nothing"):
        kriged(points[:0], np.zeros(0))
    with pytest.raises(ValueError, match="finite"):
        kriged(points, np.array([0.0, math.nan, 1.0]))
