"""Accuracy against the C library, and the same bits compiled and interpreted."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant import elementary
from plant.hull import atan2 as compiled_atan2
from plant.tail_input import sincos as compiled_sincos

ANGLES = st.floats(-8e5, 8e5)
COORDINATES = st.floats(-1e6, 1e6)


def ulps(ours: float, true: float) -> float:
    """Distance in units in the last place of the true value."""
    return abs(ours - true) / math.ulp(true)


@pytest.mark.parametrize("span", [1e-8, 0.8, 4.0, 1e2, 1e4, 8e5])
def test_sine_and_cosine_within_one_ulp(span: float) -> None:
    for x in np.random.default_rng(7).uniform(-span, span, 4000):
        sine, cosine = elementary.sincos(float(x))
        assert ulps(sine, math.sin(x)) <= 1.0
        assert ulps(cosine, math.cos(x)) <= 1.0


@pytest.mark.parametrize("quarter", [*range(-9, 10), 12345, -99999, 500000])
def test_sine_and_cosine_near_multiples_of_a_quarter_turn(quarter: int) -> None:
    # where cancellation in the reduction would show
    x = quarter * (math.pi / 2)
    for y in (math.nextafter(x, -math.inf), x, math.nextafter(x, math.inf)):
        sine, cosine = elementary.sincos(y)
        assert ulps(sine, math.sin(y)) <= 1.0
        assert ulps(cosine, math.cos(y)) <= 1.0


def test_the_short_way_for_small_angles_changes_nothing() -> None:
    # both sides of the border of the branch are on the same curve
    for x in (0.78, math.nextafter(0.78, 0.0), math.nextafter(0.78, 1.0)):
        assert ulps(elementary.sincos(x)[0], math.sin(x)) <= 1.0
        assert elementary.sincos(-x)[0] == -elementary.sincos(x)[0]


@pytest.mark.parametrize("span", [1e-6, 1.0, 1e5])
def test_arctangent_within_two_ulp(span: float) -> None:
    for y, x in np.random.default_rng(8).uniform(-span, span, (4000, 2)):
        assert ulps(elementary.atan2(float(y), float(x)), math.atan2(y, x)) <= 2.0


@given(y=COORDINATES, x=COORDINATES)
def test_arctangent_anywhere(y: float, x: float) -> None:
    true = math.atan2(y, x)
    ours = elementary.atan2(y, x)
    if y == 0.0:
        assert abs(ours) == abs(true)  # the sign of zero is not kept for x < 0
    else:
        assert abs(ours - true) <= 2.0 * math.ulp(true)


@pytest.mark.parametrize(("y", "x"), [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (2.0, 2.0)])
def test_arctangent_on_the_axes(y: float, x: float) -> None:
    assert elementary.atan2(y, x) == math.atan2(y, x)


def test_exponential_within_one_ulp() -> None:
    for x in np.random.default_rng(9).uniform(-700.0, 700.0, 8000):
        assert ulps(elementary.exp(float(x)), math.exp(x)) <= 1.0
    assert elementary.exp(0.0) == 1.0
    assert elementary.exp(-1e4) == 0.0
    assert elementary.exp(1e4) == math.inf


@given(x=ANGLES)
def test_compiled_sine_is_the_interpreted_one_to_the_bit(x: float) -> None:
    assert compiled_sincos(x) == elementary.sincos(x)


@given(y=COORDINATES, x=COORDINATES)
def test_compiled_arctangent_is_the_interpreted_one_to_the_bit(y: float, x: float) -> None:
    assert compiled_atan2(y, x) == elementary.atan2(y, x)


@given(x=ANGLES)
def test_sine_is_odd_and_cosine_even_to_the_bit(x: float) -> None:
    sine, cosine = elementary.sincos(x)
    assert elementary.sincos(-x) == (-sine, cosine)
