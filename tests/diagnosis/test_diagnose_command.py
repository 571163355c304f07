"""`fishbed diagnose` from folder to folder, on a steady-state table: quick, and all is used."""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.diagnosis.fish.test_steady import table
from tools import scenario
from tools.cli import main
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.command import EXTENDED, SEPARATING, default_out, diagnose_folder
from tools.diagnosis.engine import diagnose
from tools.diagnosis.options import Options
from tools.diagnosis.result import Diagnosis

DOCS = Path(__file__).resolve().parents[2] / "docs" / "diagnosis.md"


def with_deviations() -> str:
    """The table of the robot whose drag depends on bias, sure to 1 %."""
    head, *rows = table().splitlines()
    lines = [f"{head},turn_radius_m_sd,turn_period_s_sd"]
    for row in rows:
        *_, radius, period = (float(cell) for cell in row.split(","))
        lines.append(f"{row},{0.01 * radius},{0.01 * period}")
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Diagnosis]]:
    """The folder of a whole diagnosis, and what the engine found."""
    kept: list[Diagnosis] = []

    def keeping(*args: Any) -> Diagnosis:
        kept.append(diagnose(*args))
        return kept[-1]

    place = tmp_path_factory.mktemp("steady")
    (place / "radius.csv").write_text(with_deviations())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tools.diagnosis.engine.diagnose", keeping)
        patch.setattr("tools.diagnosis.fish.separating.SEGMENTS", ())
        options = Options(draws=60)
        diagnose_folder(
            place / "radius.csv", place / "out", 0, show_progress=False, options=options
        )
        yield place, kept[0]


def test_drag_that_depends_on_bias_comes_out_of_the_table(done: tuple[Path, Diagnosis]) -> None:
    place, _ = done
    told = json.loads((place / "out" / "diagnosis.json").read_text())
    first = told["causes"][0]
    assert first["name"] == "drag_vs_bias"
    slope = first["parameters"]["cd_per_rad2"]
    assert abs(slope["estimate"] - 0.1412) < 4.0 * slope["standard_error"]
    assert told["held_out"]["gain"] > 0.5
    assert any("wang2014" in note for note in told["notes"])


def test_the_extended_model_is_a_scenario_with_what_was_found(done: tuple[Path, Diagnosis]) -> None:
    place, _ = done
    told = json.loads((place / "out" / "diagnosis.json").read_text())
    assert told["extended_model"] == EXTENDED
    keys = scenario.keys(scenario.load(place / "out" / EXTENDED))
    found = told["causes"][0]["parameters"]["cd_per_rad2"]["estimate"]
    assert keys["effects.drag_vs_bias.cd_per_rad2"] == pytest.approx(found)


def test_the_measured_file_is_as_it_was(done: tuple[Path, Diagnosis]) -> None:
    place, _ = done
    assert (place / "radius.csv").read_text() == with_deviations()


def test_the_page_says_the_verdict_and_needs_nothing_else(done: tuple[Path, Diagnosis]) -> None:
    place, found = done
    page = (place / "out" / "report.html").read_text()
    assert found.report.causes[0].statement.split(":")[0] in page
    assert "drag_vs_bias" in page
    assert "<script" not in page
    assert "src=" not in page
    assert page.count("<section") == page.count("</section")
    assert "± 2 σ" in page


def stand_in(monkeypatch: pytest.MonkeyPatch, found: Diagnosis) -> None:
    monkeypatch.setattr("tools.diagnosis.engine.diagnose", lambda *_: found)
    monkeypatch.setattr("tools.diagnosis.fish.separating.SEGMENTS", ())


def test_json_is_one_document(
    done: tuple[Path, Diagnosis],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stand_in(monkeypatch, done[1])
    out = tmp_path / "out"
    code = main(["diagnose", str(done[0] / "radius.csv"), "--out", str(out), "--json"])
    told = capsys.readouterr()
    assert code == 0
    assert json.loads(told.out) == json.loads((out / "diagnosis.json").read_text())
    assert told.err == ""


def test_words_name_cause_notice_and_page(
    done: tuple[Path, Diagnosis],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stand_in(monkeypatch, done[1])
    assert main(["diagnose", str(done[0] / "radius.csv"), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "drag_vs_bias.cd_per_rad2 = " in told
    assert "note: radius.csv: compared with" in told
    assert "report.html" in told


def test_a_diagnosis_without_a_page_is_kept_and_can_be_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> str:
        raise RuntimeError("no page")

    (tmp_path / "radius.csv").write_text(table())
    arguments = ["diagnose", str(tmp_path / "radius.csv"), "--out", str(tmp_path / "out")]
    with monkeypatch.context() as patched:
        patched.setattr("tools.diagnosis.page.page.render", broken)
        with pytest.raises(RuntimeError, match="no page"):
            main(arguments)
    kept = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert "diagnosis.json" in kept
    assert "report.html" not in kept
    assert main(arguments) == 0
    assert (tmp_path / "out" / "diagnosis.json").read_bytes() == kept["diagnosis.json"]
    assert (tmp_path / "out" / "report.html").is_file()


def test_an_interruption_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any) -> Diagnosis:
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.diagnosis.engine.diagnose", interrupted)
    (tmp_path / "radius.csv").write_text(table())
    assert main(["diagnose", str(tmp_path / "radius.csv")]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["radius.csv"]
    assert capsys.readouterr().out == ""


def test_an_interruption_that_a_compiler_swallows_is_one_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swallowed(*_: Any) -> Diagnosis:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("tools.diagnosis.engine.diagnose", swallowed)
    (tmp_path / "radius.csv").write_text(table())
    assert main(["diagnose", str(tmp_path / "radius.csv")]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["radius.csv"]


@pytest.mark.parametrize(
    "arguments",
    [["nowhere"], ["radius.csv", "--seed", "-1"], ["radius.csv", "--out", " "], ["bad.csv"]],
)
def test_mistakes_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "radius.csv").write_text(table())
    (tmp_path / "bad.csv").write_text("time_s,gyro_z_rad_s\n0,1\n")
    assert main(["diagnose", *arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1


def test_results_lie_inside_an_experiment_and_beside_other_data(tmp_path: Path) -> None:
    run = tmp_path / "circle-1"
    run.mkdir()
    for name in ("scenario.toml", "summary.json"):
        (run / name).touch()
    (tmp_path / "radius.csv").touch()
    (tmp_path / "experiment.toml").touch()
    assert default_out(run) == tmp_path.resolve() / "circle-1-diagnosis"
    assert default_out(tmp_path / "radius.csv") == tmp_path / "radius-diagnosis"
    assert default_out(tmp_path / "experiment.toml") == tmp_path / "diagnosis"
    assert default_out(tmp_path) == tmp_path / "diagnosis"


def test_the_guide_lists_the_causes_as_the_table_has_them() -> None:
    text = DOCS.read_text(encoding="utf-8")
    rows = [f"| `{r.name}` | {r.description} | {r.part} |" for r in CAUSES.values()]
    listed = [line for line in text[text.index("## Causes") :].splitlines() if line[:3] == "| `"]
    assert listed == rows
    assert SEPARATING in text
