"""The bounded histogram against numpy on the values themselves."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.histogram import DurationHistogram


def test_it_is_empty_and_then_exact_where_it_says_so() -> None:
    durations = DurationHistogram()
    assert len(durations) == 0
    assert durations.quantile_s(0.99) == durations.mean_s == durations.maximum_s == 0.0
    for value in (0.004, 0.001, 0.002, -1e-9):
        durations.record(value)
    assert len(durations) == 4
    assert durations.minimum_s == 0.0
    assert durations.maximum_s == 0.004
    assert durations.total_s == pytest.approx(0.007)
    assert durations.mean_s == pytest.approx(0.00175)
    assert durations.quantile_s(1.0) == 0.004


@pytest.mark.parametrize("q", [0.01, 0.5, 0.9, 0.99, 0.999])
def test_quantiles_are_never_too_small_and_hardly_too_large(q: float) -> None:
    rng = Random(5)
    values = [rng.lognormvariate(-8.0, 1.5) for _ in range(20_000)]
    durations = DurationHistogram()
    for value in values:
        durations.record(value)
    exact = float(np.quantile(values, q, method="inverted_cdf"))
    assert exact <= durations.quantile_s(q) <= exact * 2 ** (1 / 32) + 1e-12


def test_memory_is_bounded_over_every_magnitude() -> None:
    durations = DurationHistogram()
    for step in range(100_000):
        durations.record(10.0 ** (step % 3_000 / 100 - 15))
    assert len(durations._counts) <= 1_281
    assert durations.quantile_s(1.0) == durations.maximum_s == pytest.approx(10**14.99)


def test_a_share_outside_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match="outside 0 to 1"):
        DurationHistogram().quantile_s(99.0)


@given(st.lists(st.floats(0.0, 10.0), max_size=60), st.floats(0.0, 10.0))
def test_exceedances_are_never_fewer_than_there_were(values: list[float], limit_s: float) -> None:
    histogram = DurationHistogram()
    for value in values:
        histogram.record(value)
    found = histogram.above(limit_s)
    assert found >= sum(value > limit_s for value in values)
    assert found <= sum(value * 1.023 + 1e-6 >= limit_s for value in values)
    assert not histogram.above(histogram.maximum_s)
