"""The studies of chapter 5: every published number within its tolerance, and none that is empty."""

from __future__ import annotations

from dataclasses import replace

import pytest

from plant.averaging.dynamics import Scaling
from tools.studies import chapter5_models
from tools.studies.study import Figure, Panel
from tools.studies.table import STUDIES, Row

ROWS = [
    row
    for row in STUDIES
    if ":" in row.function and row.function.split(":")[0].startswith("tools.studies.chapter5_")
    and row.function.split(":")[0].rsplit("_", 1)[1] in ("average", "scaling", "turning")
]  # fmt: skip


KNOWN = {
    "fig-5.1": ["radius, first-order average"],
    "table-5.2": ["original, 25.0937°, 1.1033 Hz"],
}


def test_every_figure_up_to_5_16_has_a_study() -> None:
    numbers = {*range(1, 10), 11, 12, 14, 15, 16}
    expected = {f"fig-5.{number}" for number in numbers} | {f"table-5.{n}" for n in (1, 2, 3)}
    assert {row.name for row in ROWS} == expected


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_published_numbers_of_chapter_5(row: Row) -> None:
    shares: list[float] = []
    result = row.load().compute(shares.append)
    assert result.checks or result.notes or result.figures
    assert [check.what for check in result.checks if check.failed] == []
    known = [check.what for check in result.checks if check.known_difference]
    assert known == KNOWN.get(row.name, [])
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    for figure in result.figures:
        assert isinstance(figure, Figure)
        for panel in figure.panels:
            assert not isinstance(panel, Panel) or all(curve.x.size > 1 for curve in panel.curves)


def test_another_scaling_would_be_seen() -> None:
    robot, beat = chapter5_models.robot(), chapter5_models.TailBeat.degrees(30, 20, 1.0)
    full = [chapter5_models.original(robot, beat)]
    good = [chapter5_models.average(Scaling(0.8485, -0.0074, 0.4831))(robot, beat)]
    wrong = [chapter5_models.average(Scaling(0.8485, 0.0, 0.4))(robot, beat)]
    assert max(chapter5_models.apart_percent(good, full)) < 3.0
    assert max(chapter5_models.apart_percent(wrong, full)) > 3.0
    heavy = chapter5_models.heavy()
    assert heavy.body.mass_kg == 0.622
    assert replace(heavy, body=robot.body) == robot
