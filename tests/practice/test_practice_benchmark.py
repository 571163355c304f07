"""The benchmark counts rightly; its journal resumes. No diagnosis is made here."""

import json
from pathlib import Path
from typing import Any

import pytest

from tools.practice import benchmark
from tools.practice.cases import PARTS, Case, cases, look_alikes
from tools.practice.hidden import LISTED, UNLISTED
from tools.practice.tally import Share, by_strength, markdown, table


def row(case: Case, score: str, **more: Any) -> dict[str, Any]:
    return {
        "key": case.key,
        "part": case.part,
        "seed": case.seed,
        "hidden": list(case.names),
        "strength": case.strength,
        "reached": [case.strength] * len(case.names),
        "score": score,
        "errors": {},
        "look_alikes": [],
        **more,
    }


def test_bounds_are_those_of_clopper_and_pearson() -> None:
    # 0 of n: 1 − 0.025^(1/n); the table of Clopper and Pearson for 8 of 10 is 0.444 … 0.975
    assert Share(0, 300).most == pytest.approx(1.0 - 0.025 ** (1 / 300))
    assert Share(0, 300).most_one_sided == pytest.approx(1.0 - 0.05 ** (1 / 300))
    assert Share(8, 10).least == pytest.approx(0.444, abs=5e-4)
    assert Share(8, 10).most == pytest.approx(0.975, abs=5e-4)


def test_every_listed_cause_is_drawn_for_every_seed_and_no_set_twice() -> None:
    for part, names, strengths in (
        ("exact", LISTED, 1),
        ("taken-out", LISTED, 1),
        ("unlisted", UNLISTED, 2),
    ):
        drawn = list(cases(part, 2))
        assert len(drawn) == 2 * strengths * len(names)
        assert {case.names[0] for case in drawn} == set(names)
    keys = [case.key for part in PARTS for case in cases(part, 3)]
    assert len(keys) == len(set(keys))


def test_two_hide_two() -> None:
    assert all(len(set(case.names)) == 2 for case in cases("two", 20))


def test_look_alikes_and_crashes_count_where_they_should() -> None:
    one, two, three, four = list(cases("exact", 1))[:4]
    rows = [
        row(one, "exact", errors={"a": 1.0, "b": -3.5}),
        row(two, "in_set", look_alikes=["other"]),
        row(three, "crashed"),
        row(four, "missed") | {"reached": [20.0]},
    ]
    found = {line.measure: line.found for line in table(rows)}
    assert found["exact cause named at λ = 100, no look-alike"].startswith("50.0% (1 of 2;")
    assert found["the same, all sets"].startswith("33.3% (1 of 3;")
    assert found["true cause in the reported set"].startswith("66.7% (2 of 3;")
    assert found["parameter within three standard errors"].startswith("50.0% (1 of 2;")
    assert found["false alarms on healthy sets"] == "not run"
    assert [(p.strength, p.seen.count) for p in by_strength(rows)] == [(100.0, 2)]


def test_what_is_in_no_table_counts_by_its_strength() -> None:
    weak, strong = list(cases("unlisted", 1))[:2]
    assert (weak.strength, strong.strength) == (100.0, 400.0)
    lines = {
        line.measure: line.found for line in table([row(weak, "missed"), row(strong, "wrong")])
    }
    assert lines["in no table, λ = 100: unexplained or an unknown force"].startswith("0.0% (0 of 1")
    assert lines["in no table, λ = 100: a wrong name"].startswith("0.0% (0 of 1")
    assert lines["in no table, λ = 400: a wrong name"].startswith("100.0% (1 of 1")


def test_wall_time_is_told_by_sets_that_had_the_machine_alone() -> None:
    crowded = row(next(cases("exact", 1)), "exact", diagnosis_s=900.0, calibration_s=1.0)
    timed = [
        row(case, "exact", diagnosis_s=40.0 + number, calibration_s=10.0)
        for number, case in enumerate(list(cases("timing", 1))[:10])
    ]
    lines = {line.measure: line.found for line in table([crowded, *timed])}
    within = "median 35 s, nine of ten within 38 s, longest 39 s"
    assert lines["wall time, calibration cached"] == within
    assert "wall time, calibration cached" not in {line.measure for line in table([crowded])}


def test_a_wrong_name_for_a_missing_cause_is_honest_only_if_it_looks_alike() -> None:
    one, two, three = list(cases("taken-out", 1))[:3]
    rows = [
        row(one, "wrong", likeness=0.95),
        row(two, "wrong", likeness=0.5),
        row(three, "unexplained"),
    ]
    lines = {line.measure: line.found for line in table(rows)}
    measure = "cause taken out of the table: unexplained or look-alike"
    assert lines[measure].startswith("66.7% (2 of 3;")


def test_a_journal_resumes_and_a_line_cut_off_is_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def perform(case: Case, workers: int | None, cache: Path | None) -> dict[str, Any]:
        done.append(case.key)
        return row(case, "exact")

    monkeypatch.setattr(benchmark, "perform", perform)
    journal = tmp_path / "journal.jsonl"
    options = ["--part", "healthy", "--seeds", "3", "--journal", str(journal)]
    options += ["--page", str(tmp_path / "page.md"), "--picture", str(tmp_path / "p.svg")]
    benchmark.main([*options, "--sets", "2"])
    text = journal.read_text()
    journal.write_text(text[:-20])
    benchmark.main(options)
    assert done == [
        "healthy/200000//0",
        "healthy/200001//0",
        "healthy/200001//0",
        "healthy/200002//0",
    ]
    assert "at most 63.2%" in (tmp_path / "page.md").read_text()
    assert len(benchmark.read(journal)) == 3


def test_the_page_tells_failures_and_draws_the_curve(tmp_path: Path) -> None:
    rows = [
        row(case, "wrong" if case.strength < 60.0 else "exact", named=["drag_scale"])
        for case in cases("curve", 2)
    ]
    page = markdown(rows, "picture.svg")
    assert "`curve/100000/" in page
    assert "| 400 | 100.0% (2 of 2;" in page
    picture = tmp_path / "picture.svg"
    benchmark.draw(by_strength(rows), picture)
    assert "share of sets" in picture.read_text(encoding="utf-8")


def test_look_alikes_are_those_of_the_map() -> None:
    import numpy as np

    class Found:
        names = ("a", "b", "c")
        cosines = np.array([[1.0, 0.95, 0.2], [0.95, 1.0, 0.3], [0.2, 0.3, 1.0]])

    found: Any = Found()
    assert look_alikes(found, "a") == ["b"]
    assert look_alikes(found, "c") == []
    assert look_alikes(found, "d") is None
    assert json.dumps(look_alikes(found, "a")) == '["b"]'
