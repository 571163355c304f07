"""The genetic algorithm: what all its solutions obey, a known optimum, and that it gets better."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.genetic import Evolution, evolved
from tests.procboard.survey.exact import shortest_by_set


@settings(max_examples=40, deadline=None)
@given(
    salesmen=st.integers(1, 4),
    least=st.integers(1, 4),
    spare=st.integers(0, 12),
    seed=st.integers(0, 99),
)
def test_every_point_once_enough_on_each_tour_and_the_length_as_walked(
    salesmen: int, least: int, spare: int, seed: int
) -> None:
    count = salesmen * least + spare
    points = np.random.default_rng(seed).uniform(0.0, 10.0, (count, 2))
    settings = Evolution(population=16, generations=30, least_points=least)
    found = evolved(points, salesmen, np.random.default_rng(seed), settings)
    assert sorted(point for tour in found.tours for point in tour) == list(range(count))
    assert len(found.tours) == salesmen
    assert min(map(len, found.tours)) >= least
    walked = sum(
        math.dist(points[tour[i - 1]], points[tour[i]])
        for tour in found.tours
        for i in range(len(tour))
    )
    assert found.length == pytest.approx(walked)
    assert found == evolved(points, salesmen, np.random.default_rng(seed), settings)


def test_two_salesmen_find_the_optimum_of_eight_points() -> None:
    for seed in range(3):
        points = np.random.default_rng(seed).uniform(0.0, 10.0, (8, 2))
        table = shortest_by_set(None, [(float(x), float(y)) for x, y in points], True)
        all_points = (1 << 8) - 1
        optimum = min(
            table[mask] + table[all_points ^ mask]
            for size in (3, 4, 5)
            for mask in (sum(1 << p for p in chosen) for chosen in combinations(range(8), size))
        )
        found = evolved(points, 2, np.random.default_rng(1), Evolution(generations=1500))
        assert found.length == pytest.approx(optimum)


def test_more_generations_are_never_longer_and_the_last_gain_is_told() -> None:
    points = np.random.default_rng(0).uniform(0.0, 10.0, (40, 2))
    lengths = []
    for generations in (0, 100, 1000):
        settings = Evolution(generations=generations)
        found = evolved(points, 2, np.random.default_rng(7), settings)
        assert 0 <= found.generation <= generations
        lengths.append(found.length)
    assert lengths[0] > lengths[1] > lengths[2]


def test_the_first_population_knows_the_points_in_the_order_given() -> None:
    angles = 2.0 * np.pi * np.arange(50) / 50
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    found = evolved(circle, 1, np.random.default_rng(0), Evolution(generations=0))
    assert found.length == pytest.approx(100.0 * math.sin(math.pi / 50))


def test_what_cannot_evolve_is_refused() -> None:
    rng, points = np.random.default_rng(0), np.zeros((5, 2))
    with pytest.raises(SurveyError, match="5 points are too few for 2 tours of 3 or more"):
        evolved(points, 2, rng)
    with pytest.raises(SurveyError, match="0 tours"):
        evolved(points, 0, rng)
    with pytest.raises(SurveyError, match="groups of 8"):
        Evolution(population=20)
    with pytest.raises(SurveyError, match="points on a tour 1 or more"):
        Evolution(least_points=0)
