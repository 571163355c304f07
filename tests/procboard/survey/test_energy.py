"""Energy models against closed forms, and their coefficients against SciPy's fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from procboard.errors import SurveyError
from procboard.survey.energy import EMULATED, Effort, EnergyModel, effort, fitted

RIGHT = math.pi / 2


def test_a_square_has_four_sides_and_three_corners_on_the_way() -> None:
    square = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (0, 0)], dtype=float)
    found = effort(square, 5)
    assert (found.metres, found.samples) == (8.0, 5)
    assert found.square_radians == pytest.approx(3 * RIGHT**2)
    assert effort(square, 5, RIGHT).square_radians == pytest.approx(4 * RIGHT**2)
    model = EnergyModel(10.0, 2.0, 0.5)
    assert model.joules(found) == pytest.approx(80.0 + 10.0 + 1.5 * RIGHT**2)
    assert EnergyModel(10.0, 2.0).joules(found) == 90.0  # (6.4)


def test_a_turn_is_the_shorter_way_round() -> None:
    west = math.radians(170.0)
    path = np.array([(0.0, 0.0), (math.cos(west), math.sin(west)), (-2.0, 0.0)])
    beyond = math.atan2(-math.sin(west), -2.0 - math.cos(west))
    turned = effort(path, 0).square_radians
    assert turned == pytest.approx((beyond + 2 * math.pi - west) ** 2)
    assert turned < RIGHT**2


def test_staying_turns_nobody_and_back_is_half_a_turn() -> None:
    path = np.array([(0, 0), (1, 0), (1, 0), (0, 0)], dtype=float)
    assert effort(path, 0).square_radians == pytest.approx(math.pi**2)
    assert effort(path[:1], 1, 1.0) == Effort(0.0, 1, 0.0)


@given(st.lists(st.tuples(*[st.floats(-9.0, 9.0)] * 2), min_size=1, max_size=12), st.floats(0, 7))
def test_effort_knows_neither_place_nor_direction(
    places: list[tuple[float, float]], angle: float
) -> None:
    path = np.round(np.array(places), 3)
    x, y, c, s = path[:, 0], path[:, 1], math.cos(angle), math.sin(angle)
    found, moved = effort(path, 0), effort(np.column_stack((c * x - s * y, s * x + c * y)) + 3, 0)
    assert moved.metres == pytest.approx(found.metres, abs=1e-9)
    # half a turn may be one way or the other, which is the same squared
    assert moved.square_radians == pytest.approx(found.square_radians, abs=1e-6)


def test_coefficients_and_their_errors_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    rows = rng.uniform(0.1, 3.0, (30, 3))
    joules = rows @ (46.0, 1.0, 3.0) + rng.normal(0.0, 2.0, 30)
    found = fitted([Effort(*row) for row in rows], list(joules))
    expected, covariance = curve_fit(lambda x, a, b, c: x @ (a, b, c), rows, joules)
    assert found.coefficients == pytest.approx(tuple(expected), rel=1e-6)
    assert found.errors == pytest.approx(tuple(np.sqrt(np.diag(covariance))), rel=1e-5)
    assert found.residual_j == pytest.approx(2.0, rel=0.3)
    assert found.model.joules(Effort(1.0)) == found.coefficients[0]


def test_what_no_effort_has_is_left_out() -> None:
    efforts = [Effort(1.0, 2.0), Effort(2.0, 1.0), Effort(3.0, 5.0)]
    found = fitted(efforts, [EnergyModel(50.0, 3.0).joules(effort) for effort in efforts])
    assert found.coefficients == pytest.approx((50.0, 3.0, 0.0))
    assert found.errors == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    exact = fitted(efforts[:2], [10.0, 11.0])
    assert all(math.isnan(error) for error in exact.errors[:2])


@pytest.mark.parametrize(
    "efforts", [[], [Effort()], [Effort(1.0, 2.0), Effort(2.0, 4.0), Effort(3.0, 6.0)]]
)
def test_what_cannot_be_told_apart_is_refused(efforts: list[Effort]) -> None:
    with pytest.raises(SurveyError, match="tell the coefficients"):
        fitted(efforts, [1.0] * len(efforts))


def test_wrong_numbers_are_refused() -> None:
    with pytest.raises(SurveyError, match="1 efforts and 2 energies"):
        fitted([Effort(1.0)], [1.0, 2.0])
    for bad in (-1.0, math.nan, math.inf):
        with pytest.raises(SurveyError, match="coefficient"):
            EnergyModel(bad)
    with pytest.raises(SurveyError, match="coefficient"):
        _ = fitted([Effort(1.0), Effort(2.0)], [-1.0, -2.0]).model


def test_swimming_costs_the_emulated_robot_most_as_the_source_assumes() -> None:
    inch = 0.0254
    step = Effort(metres=inch, samples=1.0)
    assert EMULATED.joules(step) == pytest.approx(46.0 * inch, rel=1e-3)
