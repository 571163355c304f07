"""Studies of chapter 3: every printed number, what scales exactly, and the page about it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plant.parameters import Hydrodynamics
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat
from tools.studies import chapter3_drag, chapter3_lift, chapter3_turning
from tools.studies.account import Account, state
from tools.studies.markdown import (
    check_lines,
    difference_lines,
    note_lines,
    renewed,
    section,
    tables,
)
from tools.studies.study import Panel, Result
from tools.studies.table import STUDIES
from tools.studies.workers import run_studies

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reproduction.md"
ROWS = tuple(row for row in STUDIES if row.name.split("-")[1].startswith("3."))
FIGURES = {f"Fig. 3.{number}" for number in range(4, 14)}


@pytest.fixture(scope="module")
def account() -> Account:
    return Account(run_studies(ROWS, workers=1))


@pytest.fixture(scope="module")
def results(account: Account) -> dict[str, Result]:
    return {o.row.name: o.result for o in account.outcomes if o.result is not None}


def test_every_printed_number_agrees_and_every_figure_is_there(
    account: Account, results: dict[str, Result]
) -> None:
    assert account.failures() == {}
    assert [(name, check.what, check.error) for name, check in account.off] == []
    drawn = {figure.name for result in results.values() for figure in result.figures}
    assert drawn >= FIGURES
    assert {state(outcome) for outcome in account.outcomes} == {"agrees", "drawn", "differs"}
    checked = {name for name, _ in account.checks}
    assert checked >= {"table-3.1", "table-3.2", "fig-3.4", "fig-3.5", "fig-3.6", "fig-3.7"}


def test_the_one_known_difference_is_the_speed(account: Account) -> None:
    ((name, check),) = account.differences
    assert (name, check.published) == ("fig-3.8", 25.0)
    assert not check.ok
    assert check.computed == pytest.approx(32.0, abs=0.5)


def test_a_faster_beat_is_the_same_circle_in_a_shorter_time() -> None:
    turns = [
        chapter3_turning.turn(wang2014(), TailBeat.degrees(25.0, 18.0, f)) for f in (0.5, 1.0, 3.0)
    ]
    radii = [item.radius_m for item in turns]
    revolutions = [item.period_s * f for item, f in zip(turns, (0.5, 1.0, 3.0), strict=True)]
    assert radii == pytest.approx([radii[0]] * 3, rel=1e-9)
    assert revolutions == pytest.approx([revolutions[0]] * 3, rel=1e-9)


def test_a_straight_path_has_no_turn() -> None:
    with pytest.raises(ValueError, match="does not turn"):
        chapter3_turning.turn(wang2014(), TailBeat.degrees(0.0, 15.0, 0.9))


def test_adapted_drag_is_nearer_to_what_was_measured_as_the_source_says(
    results: dict[str, Result],
) -> None:
    for name in ("fig-3.10", "fig-3.13"):
        for panel in results[name].figures[0].panels:
            assert isinstance(panel, Panel)
            adapted, constant, dots = panel.curves
            at = np.searchsorted(adapted.x, dots.x)
            apart = [np.sum((line.y[at] / dots.y - 1.0) ** 2) for line in (adapted, constant)]
            assert apart[0] < apart[1], (name, panel.title)


def test_radius_and_period_fall_with_the_bias(results: dict[str, Result]) -> None:
    for name in ("fig-3.4", "fig-3.10", "fig-3.12", "fig-3.13"):
        for panel in results[name].figures[0].panels:
            assert isinstance(panel, Panel)
            assert np.all(np.diff(panel.curves[0].y) < 0.0), name


def test_drag_is_identified_from_radius_and_period() -> None:
    hidden = replace(chapter3_lift.SURROGATE, drag=0.25, yaw_drag_n_m_s2=1.3e-3)
    beat = TailBeat.degrees(30.0, 15.0, 0.9)
    target = chapter3_turning.turn(chapter3_turning.robot(hidden), beat)
    drag, yaw = chapter3_lift.identify(30.0, target, (0.2131, 1.144e-3))
    assert (drag, yaw) == pytest.approx((0.25, 1.3e-3), rel=1e-7)


def test_the_fit_is_exact_for_a_law_of_its_own_form() -> None:
    bias = np.radians([10.0, 20.0, 35.0])
    law = chapter3_drag.fit([10.0, 20.0, 35.0], 0.2 + 0.1 * bias**2, 1e-3 + 4e-4 * bias)
    assert law.drag == pytest.approx(0.2)
    assert law.drag_per_bias_squared == pytest.approx(0.1)
    assert law.yaw_drag_n_m_s2 == pytest.approx(1e-3)
    assert law.yaw_drag_per_bias_n_m_s2 == pytest.approx(4e-4)


def test_a_wrong_coefficient_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    worn = replace(wang2014(), hydrodynamics=Hydrodynamics(yaw_drag_n_m_s2=13e-4))
    monkeypatch.setattr(chapter3_turning, "wang2014", lambda: worn)
    monkeypatch.setattr(chapter3_turning, "BIAS_DEG", np.array([20.0, 30.0, 40.0]))
    result = chapter3_turning.over_bias(lambda share: None)
    assert result.checks[0].failed


def test_coefficients_of_the_surrogate_are_the_published_ones() -> None:
    found = COEFFICIENT_SETS["chapter-3-surrogate"]
    published = (0.2131, 1.144e-3, 0.935, 0.0)
    computed = (found.drag, found.yaw_drag_n_m_s2, found.lift_per_bias, found.lift)
    assert computed == published


def test_the_page_says_what_is_computed(account: Account) -> None:
    text = PAGE.read_text(encoding="utf-8")
    checks, known = section(text, "checks"), section(text, "differences")
    more = Account(run_studies(tuple(row for row in STUDIES if row not in ROWS), workers=2))
    lines = [line for line in checks.split("\n") if line.startswith(("| table-", "| fig-"))]
    assert sorted(lines) == sorted(check_lines(account.checks + more.checks))
    lines = [line for line in known.split("\n") if line.startswith(("| table-", "| fig-"))]
    assert sorted(lines) == sorted(difference_lines(account.differences + more.differences))
    notes = section(text, "notes")
    for line in note_lines(account.outcomes + more.outcomes):
        assert line in notes
    named = {line.split("|")[1].strip() for line in (checks + "\n" + known).split("\n")}
    assert named - {row.name for row in STUDIES} == {"study", "---"}
    assert section(renewed(text, account), "checks") == tables(account)["checks"]
