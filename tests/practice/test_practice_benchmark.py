"""The benchmark counts rightly; its journal resumes. No diagnosis is made here."""

import json
from pathlib import Path
from typing import Any

import pytest

from tools.diagnosis.options import Options
from tools.practice import benchmark
from tools.practice import cases as cases_module
from tools.practice.cases import HEALTHY_EMULATED, PARTS, Case, cases, look_alikes
from tools.practice.hidden import LISTED, UNLISTED
from tools.practice.tally import Line, Share, by_strength, failures, table
from tools.practice.told import draw, markdown

NO_LOOK_ALIKE = "exact cause named at λ = 100, no look-alike"
IN_SET = "true cause in the reported set"
ALARMS = "false alarms on healthy sets"
ORACLE = "held-out gain at least 90 % of the oracle's"
NO_GAIN = "not in the line above: held-out runs on which the oracle gains nothing"
WITHIN = "parameter within three standard errors, wherever its cause was named (numbers)"
TAKEN_OUT = "cause taken out of the table: unexplained or look-alike"
CACHED = "wall time of `fishbed diagnose`, calibration cached"
DRAWN = "wall time of `fishbed diagnose`, calibration drawn"


def row(case: Case, score: str, **more: Any) -> dict[str, Any]:
    return {
        "key": case.key,
        "part": case.part,
        "seed": case.seed,
        "hidden": list(case.names),
        "strength": case.strength,
        "reached": [case.strength] * len(case.names),
        "score": score,
        "verdict": "named",
        "named": list(case.names),
        "look_alikes": [],
        **more,
    }


def estimate(error: float | None, parameter: str = "k") -> dict[str, Any]:
    """An estimate that is so many standard errors off; None: without a standard error."""
    return {
        "cause": "drag_scale",
        "parameter": parameter,
        "truth": 1.0,
        "estimate": 1.0 + 0.1 * (error or 0.0),
        "standard_error": None if error is None else 0.1,
        "unit": "",
    }


def held(extended: float, oracle: float) -> dict[str, Any]:
    """Held-out errors where the extension and the oracle have gained so much."""
    believed = 5000.0
    left = {"extended": believed - extended, "oracle": believed - oracle}
    return {"believed": believed, **left, "truth": believed - oracle}


def lines(rows: list[dict[str, Any]]) -> dict[str, Line]:
    return {line.measure: line for line in table(rows)}


def count(line: Line) -> tuple[str, int, int]:
    """The figure, and of how many sets, how many of which crashed."""
    return line.found, line.sets, line.crashed


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


def test_look_alikes_and_weak_sets_count_where_they_should() -> None:
    one, two, three, four = list(cases("exact", 1))[:4]
    rows = [
        row(one, "exact"),
        row(two, "in_set", look_alikes=["other"]),
        row(three, "wrong"),
        row(four, "missed", named=[]) | {"reached": [20.0]},
    ]
    found = lines(rows)
    assert count(found[NO_LOOK_ALIKE]) == ("50.0% (1)", 2, 0)
    assert count(found["the same, look-alikes included"]) == ("33.3% (1)", 3, 0)
    assert count(found[IN_SET]) == ("66.7% (2)", 3, 0)
    assert count(found[ALARMS]) == ("not run", 0, 0)
    weak = "in no line above: effects that stay below 80 % of the wanted λ at any credible size"
    assert count(found[weak]) == ("25.0% (1)", 4, 0)
    assert found[NO_LOOK_ALIKE].met is False
    assert found[ALARMS].met is None
    assert [(p.strength, p.seen.count) for p in by_strength(rows)] == [(100.0, 3)]


def test_a_crash_is_a_miss_in_every_line() -> None:
    parts = ("exact", "healthy", "two", "unlisted", "taken-out", "emulated", "curve", "timing")
    rows = []
    for part in parts:
        for case in list(cases(part, 1))[:8]:
            made = row(case, "crashed", error="ValueError('no | minimum')")
            # as a solver leaves it that dies before anything is known, or once sizes are
            for key in ("verdict", "named", "look_alikes", "reached"):
                del made[key]
            rows.append(made | ({"reached": [1.0] * len(case.names)} if len(rows) % 2 else {}))
    rows.append(row(Case(HEALTHY_EMULATED, 1, (), 0.0), "crashed"))
    uncounted = {measure for measure, line in lines(rows).items() if not line.sets}
    assert not uncounted
    bad = ("wrong name", "false alarm")
    for measure, line in lines(rows).items():
        assert line.met is not True, measure
        assert line.crashed == line.sets or "in no line" in measure
        if "wall time" not in measure:
            worst = "100.0%" if any(word in measure for word in bad) else "0.0%"
            assert line.found.startswith(worst), measure
    assert all(p.seen.count == p.exact.count == p.in_set.count == 0 for p in by_strength(rows))
    assert len(failures(rows)) == len(rows)
    assert "crashed: ValueError('no ¦ minimum')" in markdown(rows, {}, None)


def test_a_crash_is_a_row_that_keeps_what_was_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def dies(*_: Any) -> Any:
        raise ZeroDivisionError("no step")

    monkeypatch.setattr(cases_module, "diagnosed", dies)
    told = cases_module.perform(Case("exact", 1, ("gyro_bias",), 100.0, 1, 15.0), Options())
    assert told["score"] == "crashed"
    assert told["error"] == "ZeroDivisionError('no step')"
    assert told["reached"] == [pytest.approx(100.0, rel=0.1)]


def test_a_healthy_set_of_the_emulated_robot_has_a_line_of_its_own() -> None:
    rows = [
        row(Case(HEALTHY_EMULATED, 1, (), 0.0), "false_alarm"),
        *(row(case, "exact") for case in cases("healthy", 300)),
    ]
    found = lines(rows)
    assert found[ALARMS].found == "0.0% (0), at most 1.0% (95 %, one-sided)"
    assert (found[ALARMS].sets, found[ALARMS].met) == (300, True)
    own = found["false alarms on healthy sets of the emulated robot"]
    assert (own.found[:10], own.sets, own.met) == ("100.0% (1)", 1, False)


def test_no_gain_is_taken_for_granted_beside_an_oracle() -> None:
    drawn = list(cases("exact", 1))
    rows = [
        row(drawn[0], "exact", held_out=held(30.0, 31.0)),
        # a right name with a number that is none of use
        row(drawn[1], "exact", held_out=held(20.0, 31.0)),
        # nothing was named: a chance fit of tolerances is no gain
        row(drawn[2], "missed", named=[], held_out=held(40.0, 31.0)),
        row(drawn[3], "wrong", held_out=held(29.0, 31.0)),
        row(drawn[4], "crashed"),
        # nothing can be said of these
        row(drawn[5], "exact", held_out=held(5.0, 5.0)),
        row(drawn[6], "missed", named=[], held_out=held(0.0, -2.0)),
    ]
    found = lines(rows)
    assert count(found[ORACLE]) == ("40.0% (2)", 5, 1)
    assert count(found[NO_GAIN]) == ("28.6% (2)", 7, 1)


def test_parameters_count_wherever_their_cause_was_named() -> None:
    exact, other, third = list(cases("exact", 1))[:3]
    two, curve = next(cases("two", 1)), next(cases("curve", 1))
    rows = [
        row(exact, "exact", estimates=[estimate(1.0), estimate(-3.5)]),
        row(other, "in_set", estimates=[estimate(2.0)]),
        row(two, "wrong", estimates=[estimate(-2.9)]),
        # weak, but named; and without a standard error
        row(curve, "exact", estimates=[estimate(None)]) | {"reached": [3.0]},
        row(third, "crashed"),
        row(next(cases("taken-out", 1)), "wrong", estimates=[estimate(0.0)]),
    ]
    assert count(lines(rows)[WITHIN]) == ("50.0% (3)", 6, 1)


def test_a_phase_in_the_journal_is_compared_modulo_a_turn() -> None:
    turned = estimate(0.0, "phi_rad") | {"truth": 3.1, "estimate": -3.1}
    rows = [row(next(cases("exact", 1)), "exact", estimates=[turned])]
    assert count(lines(rows)[WITHIN]) == ("100.0% (1)", 1, 0)


def test_what_is_in_no_table_counts_by_its_strength() -> None:
    weak, strong = list(cases("unlisted", 1))[:2]
    assert (weak.strength, strong.strength) == (100.0, 400.0)
    found = lines([row(weak, "missed"), row(strong, "wrong")])
    unexplained = "in no table, λ = 100: unexplained or an unknown force"
    assert count(found[unexplained]) == ("0.0% (0)", 1, 0)
    assert count(found["in no table, λ = 100: a wrong name, or a crash"]) == ("0.0% (0)", 1, 0)
    assert count(found["in no table, λ = 400: a wrong name, or a crash"]) == ("100.0% (1)", 1, 0)


def test_wall_time_is_that_of_the_timed_commands() -> None:
    crowded = row(next(cases("exact", 1)), "exact", seconds={"calibration": 900.0})
    assert count(lines([crowded])[CACHED]) == ("not run", 0, 0)
    machine = {"cpu_s": 60.0, "processors": 2, "others": 0.25, "load": 0.5}
    timed = [
        row(
            case,
            "exact",
            times={
                "drawn": {"wall_s": 90.0 + number, **machine},
                "cached": {"wall_s": 40.0 + number, **machine},
            },
        )
        for number, case in enumerate(list(cases("timing", 3))[:10])
    ]
    found = lines([crowded, *timed])
    assert found[CACHED].found == "median 45 s, nine of ten within 48 s, longest 49 s"
    assert found[CACHED].met is True
    assert "0.25 to 0.25 of them busy" in markdown(timed, {}, None)
    found = lines([*timed, row(list(cases("timing", 3))[10], "crashed")])
    assert found[DRAWN].found == "median 95 s, nine of ten within 99 s, longest inf s"
    assert found[DRAWN].met is False


def test_timed_sets_hide_what_takes_different_times() -> None:
    assert [case.kind for case in cases("timing", 1)] == ["none", "one", "two", "unlisted"]


def test_a_wrong_name_for_a_missing_cause_is_honest_only_if_it_looks_alike() -> None:
    one, two, three = list(cases("taken-out", 1))[:3]
    rows = [
        row(one, "wrong", likeness=0.95),
        row(two, "wrong", likeness=0.5),
        row(three, "unexplained"),
    ]
    assert count(lines(rows)[TAKEN_OUT]) == ("66.7% (2)", 3, 0)
    assert [each["key"] for each in failures(rows)] == [two.key]


def test_a_journal_resumes_and_a_line_cut_off_is_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def perform(case: Case, options: Options) -> dict[str, Any]:
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


def test_rows_of_another_engine_are_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = list(cases("healthy", 2))
    old = {"engine": "000000000000", "commit": "0123456789ab", "version": "0.0"}
    journal, page = tmp_path / "journal.jsonl", tmp_path / "page.md"
    journal.write_text(
        json.dumps(row(first, "false_alarm") | old)
        + "\n"
        + json.dumps(row(second, "false_alarm"))  # a row that does not say who made it
        + "\n"
    )
    options = ["--part", "healthy", "--seeds", "2", "--journal", str(journal)]
    options += ["--page", str(page), "--picture", str(tmp_path / "p.svg")]

    benchmark.main([*options, "--sets", "0"])  # nothing of the engine that is here: the last one's
    assert "Engine unknown" in page.read_text()
    assert "Left out, because other engines made them: 1 of 000000000000." in page.read_text()

    monkeypatch.setattr(benchmark, "perform", lambda case, options: row(case, "exact"))
    benchmark.main(options)
    assert "| 0.0% (0), at most 77.6%" in page.read_text()
    said = capsys.readouterr().err
    assert "left out: 1 rows that engine 000000000000 made" in said
    assert "left out: 1 rows that engine unknown made" in said


def test_the_engine_is_named_by_the_sources_that_decide(tmp_path: Path) -> None:
    from tools.practice.origin import engine

    for file in ("plant/a.py", "tools/diagnosis/b.py", "tools/practice/cases.py"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("x = 1\n")
    first = engine(tmp_path)
    (tmp_path / "tools/practice/tally.py").write_text("y = 1\n")
    assert engine(tmp_path) == first
    (tmp_path / "tools/diagnosis/b.py").write_text("x = 2\n")
    assert engine(tmp_path) != first


def test_the_page_tells_failures_and_draws_the_curve(tmp_path: Path) -> None:
    rows = [
        row(
            case,
            "wrong" if case.strength < 60.0 else "exact",
            named=["drag_scale"],
            sizes=[0.25],
            commit="0123456789ab",
        )
        for case in cases("curve", 2)
    ]
    page = markdown(rows, {}, "picture.svg")
    assert "` of 0.25 (λ = 25) | named: `drag_scale` |" in page
    assert "| 400 | 2 | 100.0% (2); 15.8% … 100.0% |" in page
    assert "commit `0123456789ab`" in page
    whole = sum(len(list(cases(part, None))) for part in PARTS)
    assert f"8 sets; the whole benchmark has {whole}." in page
    picture = tmp_path / "picture.svg"
    draw(by_strength(rows), picture)
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
