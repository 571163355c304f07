"""The benchmark works and keeps to the accuracy it speaks of; how fast anything is, is no test."""

from __future__ import annotations

import json
import math

import pytest

from tools.benchmark import main
from tools.benchmarks.measure import QUICK, best_s
from tools.benchmarks.plant import ACCURACY
from tools.benchmarks.table import CASES, PARTS


@pytest.mark.parametrize(
    "name",
    [
        "rigid",
        "segments",
        "ensemble",
        "orbit",
        "search",
        "robot",
        "shoal",
        "reconstruction",
        "codec",
        "messages",
    ],
)
def test_a_case_measures_and_tells(name: str) -> None:
    case = CASES[name]
    figures = case.measure(QUICK)
    assert all(math.isfinite(value) and value >= 0.0 for value in figures.values())
    errors = [value for what, value in figures.items() if what.endswith("error")]
    assert all(value <= ACCURACY for value in errors)
    assert len(errors) == {"rigid": 3, "segments": 3, "orbit": 12}.get(name, 0)
    rows = case.rows(figures)
    assert rows
    assert all(row.what and row.measured for row in rows)


def test_a_case_by_itself_is_one_json_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--case", "default-step", "--quick"]) == 0
    assert json.loads(capsys.readouterr().out)["ratio"] > 0.0


def test_every_part_can_be_asked_for_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert PARTS == ("plant", "many", "robot", "shoal", "survey", "link")
    with pytest.raises(SystemExit):
        main(["--only", "weather"])
    assert "invalid choice: 'weather'" in capsys.readouterr().err


def test_the_best_of_several_times_counts_and_all_take_turns() -> None:
    calls: list[str] = []
    times = best_s(3, lambda: calls.append("a"), lambda: calls.append("b"))
    assert calls == ["a", "b"] * 3
    assert all(0.0 <= time_s < 60.0 for time_s in times)
