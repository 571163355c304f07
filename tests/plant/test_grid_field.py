"""Grids against scipy's interpolator, against formulas, and against damaged tables."""

import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from plant.grid_field import GridError, GridField, from_csv, from_npz

X = (-1.0, -0.4, 0.1, 0.7, 2.3)
Y = (-0.5, 0.2, 0.9, 1.6)
VALUES = tuple(
    tuple(20.0 + 3.0 * math.sin(2.1 * x) * math.cos(1.3 * y) + 0.7 * x * y for x in X) for y in Y
)
GRID = GridField(X, Y, VALUES)

TABLE = """\
# tank 3, October
temperature_c,-1.0,0.0,0.5
-0.5,20.0,20.5,21

0.5,20.25,21.5,23
"""


@given(st.floats(-3.0, 4.0), st.floats(-2.0, 3.0))
def test_as_scipy_interpolates(x, y):
    """Outside, at the nearest point of the edge: the oracle is asked there."""
    oracle = RegularGridInterpolator((Y, X), np.array(VALUES), method="linear")
    inside = (min(max(y, Y[0]), Y[-1]), min(max(x, X[0]), X[-1]))
    assert GRID.value(x, y) == pytest.approx(oracle(inside).item(), rel=1e-13)


def test_nodes_are_exact_to_the_last_bit():
    for row, y in enumerate(Y):
        for column, x in enumerate(X):
            assert GRID.value(x, y) == VALUES[row][column]
    # and where the difference of two neighbours is rounded: 1e16 + 1
    steep = GridField((0.0, 0.3), (0.0, 0.7), ((1e16, 1.0), (1.0, 1e16)))
    assert steep.value(0.3, 0.0) == 1.0
    assert steep.value(0.0, 0.7) == 1.0


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-5, 5), st.floats(-1.0, 2.3),
    st.floats(-0.5, 1.6),
)  # fmt: skip
def test_what_is_linear_stays_linear(a, b, c, x, y):
    plane = GridField(X, Y, tuple(tuple(a + b * xn + c * yn for xn in X) for yn in Y))
    assert plane.value(x, y) == pytest.approx(a + b * x + c * y, abs=1e-13 * 30)


def test_the_same_bits_everywhere():
    """The exact sum of 1000 looks, in hexadecimal as one machine had it: any other must agree."""
    looks = ((0.0037 * n - 1.3, 0.0029 * n - 0.8) for n in range(1000))
    rational = GridField(X, Y, tuple(tuple(20 + x - y / 4 + x * y for x in X) for y in Y))
    assert math.fsum(rational.value(x, y) for x, y in looks).hex() == SUM


SUM = "0x1.5074b6a01e6e0p+14"


def test_both_forms_hold_the_same():
    from_text = from_csv(TABLE, "temperature_c")
    assert from_text == GridField(
        (-1.0, 0.0, 0.5), (-0.5, 0.5), ((20.0, 20.5, 21.0), (20.25, 21.5, 23.0))
    )
    archive = io.BytesIO()
    np.savez(archive, x_m=from_text.x_m, y_m=from_text.y_m, temperature_c=from_text.values)
    assert from_npz(archive.getvalue(), "temperature_c") == from_text
    np.savez_compressed(
        compressed := io.BytesIO(),
        x_m=np.array([0, 1], np.int16), y_m=np.array([0, 2], np.float32),
        pollutant_ug_l=np.array([[1, 2], [3, 4]]), other=np.zeros(3),
    )  # fmt: skip
    assert from_npz(compressed.getvalue(), "pollutant_ug_l").value(0.5, 1.0) == 2.5
    assert from_csv("\ufeff" + TABLE.replace("\n", "\r\n"), "temperature_c") == from_text


DAMAGED = {
    "": "no table",
    "# nothing\n\n": "no table",
    "temperature_k,0,1\n0,293,294\n1,293,294\n": "row 1, column 1: must be temperature_c",
    "pollutant_ug_l,0,1\n0,1,1\n1,1,1\n": "row 1, column 1: must be temperature_c",
    "temperature_c,0,1\n0,20,21\n1,20\n": "row 3: 2 cells, the first row has 3",
    "temperature_c,0,1\n0,20,21\n1,20,21,22\n": "row 3: 4 cells",
    "temperature_c,0,1\n0,20,warm\n1,20,21\n": "row 2, column 3: 'warm' is no number",
    "temperature_c,0,1\n0,20,\n1,20,21\n": "row 2, column 3: an empty cell is no number",
    "temperature_c,0,1\n0,20,nan\n1,20,21\n": "row 2, column 3: nan is not finite",
    "temperature_c,0,1\n0,20,21\n1,inf,21\n": "row 3, column 2: inf is not finite",
    "temperature_c,0,inf\n0,20,21\n1,20,21\n": "row 1, column 3: inf is not finite",
    "temperature_c,0,x\n0,20,21\n1,20,21\n": "row 1, column 3: 'x' is no number",
    "temperature_c,0,0\n0,20,21\n1,20,21\n": "x_m (row 1, column 3): must ascend",
    "temperature_c,1,0\n0,20,21\n1,20,21\n": "x_m (row 1, column 3): must ascend, 0.0 comes after",
    "temperature_c,0,1\n1,20,21\n0.5,20,21\n": "row 3, column 1: y_m must ascend",
    "temperature_c,0\n0,20\n1,21\n": "x_m: at least two nodes",
    "temperature_c,0,1\n0,20,21\n": "y_m: at least two nodes",
    "temperature_c\n": "x_m: at least two nodes",
    "temperature_c,0,1\n0,20,293.15\n1,20,21\n": "row 2, column 3: temperature_c = 293.15 lies",
    'temperature_c,0,"1\n0,20,21': "not a CSV table",
}


@pytest.mark.parametrize("text", DAMAGED)
def test_a_damaged_table_is_refused_where_it_is_damaged(text):
    with pytest.raises(GridError) as caught:
        from_csv(text, "temperature_c")
    assert DAMAGED[text] in str(caught.value)


def test_no_pollutant_is_less_than_none():
    with pytest.raises(GridError, match=r"row 3, column 2: pollutant_ug_l = -1 lies outside 0"):
        from_csv("pollutant_ug_l,0,1\n0,1,1\n1,-1,1\n", "pollutant_ug_l")


def npz(**arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def bare():
    buffer = io.BytesIO()
    np.save(buffer, np.zeros((2, 2)))
    return buffer.getvalue()


AXES = {"x_m": np.array([0.0, 1.0, 2.0]), "y_m": np.array([0.0, 1.0])}
BROKEN = {
    "empty": (b"", "not an NPZ"),
    "text": (b"temperature_c,0,1\n", "not an NPZ"),
    "cut off": (npz(**AXES, temperature_c=np.ones((2, 3)))[:200], "not an NPZ"),
    "an array alone": (bare(), "not an NPZ archive"),
    "no axis": (npz(x_m=AXES["x_m"], temperature_c=np.ones((2, 3))), "no array y_m in it"),
    "other": (npz(**AXES, temperature_k=np.ones((2, 3))), "it holds x_m, y_m, temperature_k"),
    "turned": (npz(**AXES, temperature_c=np.ones((3, 2))), "shape (3, 2) is not that of y_m × x_m"),
    "words": (npz(**AXES, temperature_c=np.array([["a"] * 3] * 2)), "array of numbers"),
    "objects": (npz(**AXES, temperature_c=np.array([[None] * 3] * 2)), "not an NPZ"),
    "flat": (npz(**AXES, temperature_c=np.ones(6)), "2 dimension(s) are wanted, got 1"),
    "NaN": (
        npz(**AXES, temperature_c=np.array([[20, 20, 20], [20, math.nan, 20]])),
        "row 3, column 3: nan is not finite",
    ),
    "descending": (
        npz(x_m=AXES["x_m"][::-1], y_m=AXES["y_m"], temperature_c=np.ones((2, 3))),
        "must ascend",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_archive_is_refused(case):
    data, words = BROKEN[case]
    with pytest.raises(GridError) as caught:
        from_npz(data, "temperature_c")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
