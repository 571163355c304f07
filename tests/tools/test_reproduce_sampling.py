"""Studies of chapter 6: shares of samples, what is recovered, what fails, and cells as drawn."""

from __future__ import annotations

import base64
import re
import struct

import numpy as np
import pytest

from tools.studies import chapter6_sampling
from tools.studies.chapter6_sampling import late, random_half, relative_error, temperature
from tools.studies.drawing import draw
from tools.studies.study import Cells, Panel
from tools.studies.table import STUDIES

ROWS = [row for row in STUDIES if row.function.startswith("tools.studies.chapter6_sampling")]


def test_all_figures_of_sampling_have_a_study() -> None:
    assert [row.name for row in ROWS] == [f"fig-6.{n}" for n in (4, 5, 6, 9, 10, 11, 12)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_printed_numbers_agree(row, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chapter6_sampling, "DRAWS", 1)
    result = row.load().compute(lambda share: None)
    assert [check.what for check in result.checks if not check.ok] == []
    assert [figure.name for figure in result.figures] == [row.name.replace("fig-", "Fig. ")]


def test_algorithm_2_is_defeated_in_what_the_corner_does_not_show() -> None:
    (figure,) = chapter6_sampling.defeated(lambda share: None).figures
    found, error = figure.panels
    assert isinstance(found, Cells)
    assert isinstance(error, Cells)
    assert relative_error(found.z, late()) > 5.0
    assert np.abs(found.z - late())[:10].max() < 1e-6  # ten rows have rank 7
    assert error.z.max() > 50.0


def test_additional_samples_lie_where_the_rank_was_looked_for() -> None:
    (figure,) = chapter6_sampling.extra_samples(lambda share: None).figures
    (panel,) = figure.panels
    assert isinstance(panel, Panel)
    plain, more = panel.curves
    assert plain.x.size == 7 * (20 + 20 - 7) + 1  # and the corner of the first block
    assert not {*zip(plain.x, plain.y, strict=True)} & {*zip(more.x, more.y, strict=True)}
    assert np.count_nonzero(more.y == 11) >= 11 - 8  # the row that is new, in full


def test_half_of_the_cells_are_drawn_once_each() -> None:
    masks = [random_half((24, 24), seed) for seed in (1, 1, 2)]
    assert [int(mask.sum()) for mask in masks] == [288] * 3
    assert np.array_equal(masks[0], masks[1])
    assert not np.array_equal(masks[0], masks[2])
    assert relative_error(1.1 * temperature(), temperature()) == pytest.approx(10.0)


def test_cells_are_drawn_as_an_image_with_blanks_where_there_is_nothing() -> None:
    z = np.array([[0.0, np.nan, 255.0], [10.0, 20.0, 30.0]])
    axis = np.arange(1.0, 4.0)
    picture = draw(Cells("", "x", "y", "grey", axis, axis[:2], z, (0.0, 255.0)), "salt")
    assert picture == draw(Cells("", "x", "y", "grey", axis, axis[:2], z, (0.0, 255.0)), "salt")
    found = re.search(r'<image [^>]*href="data:image/png;base64,\s*([^"]+)"', picture)
    assert found is not None
    size = base64.b64decode(found[1])[16:24]  # of the PNG's header, IHDR
    assert struct.unpack(">II", size) == (3, 2)  # a pixel a cell
    with pytest.raises(ValueError, match="surface"):
        Cells("", "x", "y", "grey", axis, axis, z, (0.0, 255.0))
