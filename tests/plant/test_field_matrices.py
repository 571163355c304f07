"""Fields as matrices: both ways, images by hand, and the source's two experiments made again."""

from __future__ import annotations

import numpy as np
import pytest

from plant.errors import InvalidParameterError
from plant.field_matrices import (
    ImageError,
    SampleGrid,
    as_field,
    from_pgm,
    late_rank,
    sampled,
    scaled,
    tank_temperature,
    to_csv,
    truncated,
)
from plant.fields import AnalyticField, Plume
from plant.grid_field import from_csv

GRID = SampleGrid(3, 5, cell_m=0.25, x_m=-1.0, y_m=2.0)


def test_rows_are_y_and_columns_are_x():
    tilted = AnalyticField(base=1.0, gradient_x_per_m=4.0, gradient_y_per_m=40.0)
    matrix = sampled(tilted, GRID)
    assert matrix[2] == pytest.approx(1 + 40 * 2.5 + 4 * np.array([-1, -0.75, -0.5, -0.25, 0]))
    again = as_field(matrix, GRID)
    assert again.value(-0.6, 2.3) == pytest.approx(tilted.value(-0.6, 2.3))
    assert np.array_equal(sampled(again, GRID), matrix)
    assert GRID.centre(2, 4) == (0.0, 2.5)


def test_a_matrix_goes_through_a_file_bit_for_bit():
    matrix = 20.0 + np.random.default_rng(0).random((3, 5)) / 3.0
    written = to_csv(as_field(matrix, GRID), "temperature_c")
    assert np.array_equal(sampled(from_csv(written, "temperature_c"), GRID), matrix)


def test_a_separable_field_has_the_rank_of_its_terms():
    plumes = AnalyticField(plumes=(Plume(5.0, -0.5, 2.2, 0.4, 0.1), Plume(3.0, 0.0, 2.0, 0.2, 0.3)))
    assert np.linalg.matrix_rank(sampled(plumes, SampleGrid(9, 9, 0.1, -1.0, 2.0))) == 2


PLAIN = b"P2\n# three by two\n3 2\n# white\n10\n0 5 10\n1 2 # a remark\n 3\n"
WIDE = b"P5 2 1 1000\n" + bytes((1, 244, 3, 232))


def test_images_are_read_as_greys():
    assert from_pgm(PLAIN) == pytest.approx(25.5 * np.array([[0, 5, 10], [1, 2, 3]]))
    assert from_pgm(b"P5\n2 2\n255\n" + bytes((0, 10, 35, 255))).tolist() == [[0, 10], [35, 255]]
    assert from_pgm(WIDE) == pytest.approx(np.array([[127.5, 255.0]]))


def test_images_are_what_matplotlib_reads(tmp_path):
    image = pytest.importorskip("PIL.Image")
    greys = np.random.default_rng(1).integers(0, 256, (7, 11), dtype=np.uint8)
    image.fromarray(greys).save(tmp_path / "field.pgm")
    assert np.array_equal(from_pgm((tmp_path / "field.pgm").read_bytes()), greys)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a PGM"),
        (b"P6\n1 1\n255\n\0\0\0", "not a PGM"),
        (b"P5\n0 1\n255\n", "0 × 1"),
        (b"P5\n1 1\n0\n\0", "white 0"),
        (b"P5\n2 2\n255\n\0\0\0", "3 values"),
        (WIDE[:-1], "1 values"),
        (b"P2\n2 1\n9\n1 x\n", "else than numbers"),
        (b"P2\n2 1\n9\n1\n", "1 values"),
    ],
)
def test_what_is_no_image_is_refused(data, words):
    with pytest.raises(ImageError, match=words):
        from_pgm(data)


@pytest.mark.parametrize("wrong", [{"rows": 0}, {"columns": -1}, {"cell_m": 0.0}, {"x_m": np.nan}])
def test_what_is_no_grid_is_refused(wrong):
    with pytest.raises(InvalidParameterError):
        SampleGrid(**{"rows": 3, "columns": 3, **wrong})


def test_the_nearest_of_a_rank_leaves_what_its_singular_values_say():
    matrix = np.random.default_rng(2).standard_normal((8, 6))
    s = np.linalg.svd(matrix, compute_uv=False)
    nearest = truncated(matrix, 4)
    assert np.linalg.matrix_rank(nearest) == 4
    assert np.linalg.norm(matrix - nearest) == pytest.approx(np.hypot(s[4], s[5]))


def test_scaling_reaches_from_black_to_white_and_adds_a_rank():
    matrix = np.outer([1.0, 2.0, 5.0], [3.0, 1.0, 4.0])
    greys = scaled(matrix)
    assert (greys.min(), greys.max()) == (0.0, 255.0)
    assert np.linalg.matrix_rank(greys) == 2
    assert not scaled(np.ones((2, 2))).any()


def test_the_tanks_temperature_is_the_sources_experiment():
    field = tank_temperature()
    assert field.shape == (24, 24)
    assert np.linalg.matrix_rank(field) == 6
    assert np.linalg.matrix_rank(field[:6, :6]) == 6
    assert field.min() == pytest.approx(0.0, abs=3.0)
    assert field.max() == pytest.approx(255.0, abs=3.0)
    row, column = divmod(int(field.argmax()), 24)
    assert (row, column) == (11, 9)  # the heater, at 11.0, 8.7 inches


def test_the_late_rank_is_where_the_source_has_it():
    field = late_rank()
    assert (field.shape, field.min(), field.max()) == ((20, 20), 0.0, 255.0)
    ranks = [int(np.linalg.matrix_rank(field[:k, :k])) for k in (8, 9, 10, 11, 20)]
    assert ranks == [7, 7, 7, 8, 8]
