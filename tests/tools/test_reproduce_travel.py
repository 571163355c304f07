"""Travel in chapter 6: what is wanted and walked, what the printed numbers are compared with."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from procboard.survey.genetic import Evolution
from tools.studies import chapter6_travel
from tools.studies.chapter6_travel import DRAWN, RANK, SIZE, expansion, expansions, salesmen
from tools.studies.study import Panel, Result


def length(panel: Panel) -> float:
    return sum(
        math.dist(a, b)
        for curve in panel.curves
        for a, b in pairwise(zip(curve.x, curve.y, strict=True))
    )


def panels(result: Result) -> list[Panel]:
    return [panel for f in result.figures for panel in f.panels if isinstance(panel, Panel)]


def test_expansions_want_what_recovers_the_field_and_nothing_twice() -> None:
    wanted = [cell for cells in expansions(SIZE, RANK) for cell in cells]
    assert len(wanted) == len(set(wanted)) == 252
    # the cross of the first rows and columns: a matrix of this rank follows from it
    assert set(wanted) == {
        (row, column) for row in range(24) for column in range(24) if min(row, column) < 6
    }
    known = RANK
    for cells in list(expansions(SIZE, RANK))[1:]:
        assert {max(cell) for cell in cells} == {known}
        known += 1


def test_the_walk_agrees_with_the_printed_numbers_and_is_the_one_that_is_drawn() -> None:
    told: list[float] = []
    result = expansion(told.append)
    assert [check.what for check in result.checks if not check.ok] == []
    assert told[-1] == 1.0
    (panel,) = panels(result)
    assert result.checks[0].computed == pytest.approx(length(panel))
    visited = {(y, x) for c in panel.curves for x, y in zip(c.x, c.y, strict=True)}
    assert visited == {cell for cells in expansions(SIZE, RANK) for cell in cells}


def test_salesmen_visit_what_was_drawn_and_the_better_heuristic_is_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(chapter6_travel, "Evolution", lambda: Evolution(generations=200))
    monkeypatch.setattr(chapter6_travel, "KICKS", 50)
    result = salesmen(lambda share: None)
    genetic, better = panels(result)
    drawn = chapter6_travel.drawn_cells(np.random.default_rng(chapter6_travel.SEED))
    assert len(drawn) == DRAWN == 288
    for panel in (genetic, better):
        visited = [
            (x, y)
            for curve in panel.curves
            for x, y in zip(curve.x[:-1], curve.y[:-1], strict=True)
        ]
        assert sorted(visited) == sorted((float(x), float(y)) for x, y in drawn)
    (check,) = result.checks
    assert check.computed == pytest.approx(length(genetic))
    assert check.failed  # after 200 generations it is far from what is printed after 50,000
    assert length(better) < 382.0
