"""Small matrices against LAPACK through SciPy, and their bits against those of one machine."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from procboard.survey.algebra import independent_columns, inverse, product, svd
from tests.procboard.survey.known_fields import low_rank

MATRICES = hnp.arrays(
    np.float64,
    hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9),
    elements=st.floats(-1e3, 1e3).map(lambda x: round(x, 6)),
)


@given(MATRICES)
def test_singular_values_are_those_of_lapack(matrix):
    u, s, v = svd(matrix)
    largest = max(float(np.abs(matrix).max()), 1e-300) * max(matrix.shape)
    assert s == pytest.approx(scipy.linalg.svdvals(matrix), abs=1e-14 * largest)
    assert list(s) == sorted(s, reverse=True)
    assert np.abs(u * s @ v.T - matrix).max() <= 1e-14 * largest
    turned, stretched = (v, u) if matrix.shape[0] >= matrix.shape[1] else (u, v)
    assert turned.T @ turned == pytest.approx(np.eye(s.size), abs=1e-13)
    some = stretched[:, s > 1e-6 * s[0]]
    assert some.T @ some == pytest.approx(np.eye(some.shape[1]), abs=1e-8)


def test_small_singular_values_of_a_graded_matrix_are_exact():
    """Jacobi keeps them to the last digits, where LAPACK's are lost (Demmel and Veselić 1992)."""
    q, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((6, 6)))
    graded = q * 10.0 ** -np.arange(0, 24, 4)
    assert svd(graded).s == pytest.approx(10.0 ** -np.arange(0, 24, 4), rel=1e-13)


@given(st.integers(0, 200), st.integers(1, 8), st.integers(1, 8))
def test_columns_are_those_of_pivoted_qr(seed, rows, columns):
    matrix = np.random.default_rng(seed).standard_normal((rows, columns))
    pivots = scipy.linalg.qr(matrix, pivoting=True, mode="r")[1]
    count = min(rows, columns)
    assert independent_columns(matrix, count) == sorted(pivots[:count])


def test_columns_of_rank_r_are_independent_and_the_leftmost_of_equals_counts():
    field = low_rank(np.random.default_rng(2), (9, 9), 4)
    chosen = independent_columns(field, 4)
    assert np.linalg.matrix_rank(field[:, chosen]) == 4
    assert independent_columns(np.ones((3, 4)), 1) == [0]
    assert independent_columns(np.eye(4)[:, [0, 0, 2, 2, 3]], 3) == [0, 2, 4]


def test_the_pseudo_inverse_of_a_rank():
    field = low_rank(np.random.default_rng(3), (7, 5), 3)
    assert inverse(svd(field), 3) == pytest.approx(scipy.linalg.pinv(field, rtol=1e-10), abs=1e-12)


def test_products():
    rng = np.random.default_rng(4)
    a, b = rng.standard_normal((3, 5)), rng.standard_normal((5, 2))
    assert product(a, b) == pytest.approx(a @ b, rel=1e-13)
    assert product(np.zeros((2, 0)), np.zeros((0, 3))) == pytest.approx(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="product"):
        product(a, a)


def test_the_same_bits_everywhere():
    """As one machine had them, in hexadecimal: on any other a survey must go the same way."""
    n = np.arange(1.0, 9.0)
    matrix = 1.0 / (n[:, None] + n) + (n[:, None] * n) % 5.0  # no function of a C library in it
    u, s, v = svd(matrix)
    whole = math.fsum([*u.ravel(), *s, *v.ravel(), *product(u, v.T).ravel()])
    assert whole.hex() == WHOLE


WHOLE = "0x1.6ccb8f9b7c888p+5"
