"""The command line: exit codes, one-line complaints, folders, interruption, and what it imports.

The bench is replaced by one that fills in a made-up run: what a bench computes is tested elsewhere.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import os
import signal
import subprocess
import sys
import tomllib
import types
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from firmware_model.trace import Trace
from tools import scenario
from tools.cli import main
from tools.commands import doctor, listing
from tools.configuration import Scenario
from tools.records.data import RunData
from tools.records.folder import FILES, is_run_folder

ROOT = Path(__file__).resolve().parents[2]


class MadeUpBench:
    """Has the bench's face; `behaviour` is called when it runs."""

    make_run: Callable[..., RunData]
    behaviour: Callable[[], None]
    speeds: list[float | None]
    live: None = None  # no real board, no tracker

    def __init__(self, config: Scenario, speed: float | None) -> None:
        self.config = config
        self.trace = Trace()
        self.reached_s = 0.0
        self.stopped = False
        type(self).speeds.append(speed)

    @classmethod
    def from_scenario(
        cls, config: Scenario, *, speed: float | None, announce: Callable[[str], None]
    ) -> MadeUpBench:
        del announce  # no real board here
        return cls(config, speed)

    def close(self) -> None:
        pass

    def run(self, progress: Callable[[float], None], interrupted: Callable[[], bool]) -> None:
        duration_s = self.config.scenario.duration_s
        while self.reached_s < duration_s and not interrupted():
            self.reached_s = min(self.reached_s + 1.0, duration_s)
            progress(self.reached_s)
            self.trace.channel("x").record(
                int(self.reached_s * 1e15), scenario.to_toml(replace_duration(self.config))
            )
            type(self).behaviour()
        self.stopped = interrupted()

    def run_data(self) -> RunData:
        made = type(self).make_run(self.reached_s)
        return replace(
            made,
            scenario=self.config.scenario.name,
            seed=self.config.scenario.seed,
            duration_s=self.reached_s,
            interrupted=self.stopped,
            trace_sha256=self.trace.sha256(),
        )


def replace_duration(config: Scenario) -> Scenario:
    """The scenario without its duration: a trace depends on it by its length only."""
    return scenario.from_mapping({"scenario": {"seed": config.scenario.seed}})


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, make_run: Callable[..., RunData]) -> type[MadeUpBench]:
    module: Any = types.ModuleType("tools.bench")
    made = type("Bench", (MadeUpBench,), {})
    made.make_run = staticmethod(make_run)
    made.behaviour = staticmethod(lambda: None)
    made.speeds = []
    module.Bench = made
    monkeypatch.setitem(sys.modules, "tools.bench", module)
    return made


def test_run_leaves_a_whole_folder_and_says_so(
    bench: type[MadeUpBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["run", "--duration", "12", "--seed", "5", "--out", str(out)]) == 0
    assert is_run_folder(out)
    assert sorted(entry.name for entry in out.iterdir()) == sorted(FILES)
    said = capsys.readouterr()
    assert "swim-forward (seed 5) swam for 12 s" in said.out
    assert str(out) in said.out
    assert said.err == ""
    written = scenario.load(out / "scenario.toml")
    assert (written.scenario.duration_s, written.scenario.seed) == (12.0, 5)


def test_json_prints_the_summary_and_nothing_else(
    bench: type[MadeUpBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["run", "circle", "--duration", "3", "--json", "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads((out / "summary.json").read_text())
    assert said.err == ""


def test_quiet_is_quiet_and_the_default_place_is_in_runs(
    bench: type[MadeUpBench],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert main(["run", "circle", "--duration", "2", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert sorted(entry.name for entry in (tmp_path / "runs").iterdir()) == [
        "circle-1",
        "circle-1.2",
    ]


def test_real_time_and_speed_reach_the_bench(bench: type[MadeUpBench], tmp_path: Path) -> None:
    for options in ([], ["--realtime"], ["--speed", "2.5"]):
        out = str(tmp_path / "run")
        assert main(["run", "--duration", "1", "--quiet", "--out", out, *options]) == 0
    assert bench.speeds == [None, 1.0, 2.5]


def test_ctrl_c_leaves_a_valid_marked_folder(
    bench: type[MadeUpBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(signal.SIGINT)
    bench.behaviour = staticmethod(lambda: signal.raise_signal(signal.SIGINT))
    out = tmp_path / "run"
    assert main(["run", "--duration", "30", "--out", str(out)]) == 130
    summary = json.loads((out / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert summary["duration_s"] == 1.0
    assert all((out / name).exists() for name in FILES)
    assert "interrupted after 1 s" in capsys.readouterr().out
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_ctrl_c_gives_up_and_leaves_nothing(
    bench: type[MadeUpBench], tmp_path: Path
) -> None:
    def twice() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    bench.behaviour = staticmethod(twice)
    assert main(["run", "--duration", "30", "--out", str(tmp_path / "run")]) == 130
    assert list(tmp_path.iterdir()) == []


def test_replay_compares_hashes_also_of_interrupted_runs(
    bench: type[MadeUpBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    bench.behaviour = staticmethod(lambda: signal.raise_signal(signal.SIGINT))
    assert main(["run", "--duration", "30", "--out", str(out)]) == 130
    bench.behaviour = staticmethod(lambda: None)
    capsys.readouterr()
    assert main(["replay", str(out)]) == 0
    assert capsys.readouterr().out.startswith("same trace: ")

    summary = json.loads((out / "summary.json").read_text())
    summary["trace_sha256"] = hashlib.sha256(b"another").hexdigest()
    (out / "summary.json").write_text(json.dumps(summary))
    assert main(["replay", str(out)]) == 1
    assert capsys.readouterr().out.startswith("another trace: ")
    assert main(["replay", str(out), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["same"] is False


def test_a_fault_of_ours_keeps_its_trace(bench: type[MadeUpBench], tmp_path: Path) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    bench.behaviour = staticmethod(fail)
    with pytest.raises(ZeroDivisionError):
        main(["run", "--duration", "3", "--quiet", "--out", str(tmp_path / "run")])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("maker", ["page.render", "path.path_picture"])
def test_a_report_that_fails_is_a_fault_of_ours_and_keeps_the_run(
    bench: type[MadeUpBench], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, maker: str
) -> None:
    out = tmp_path / "run"
    command = ["run", "--duration", "3", "--quiet", "--out", str(out)]
    assert main(command) == 0  # an earlier report does not stay beside the later run

    def fail(data: RunData) -> str:
        raise ZeroDivisionError

    monkeypatch.setattr(f"tools.report.{maker}", fail)
    with pytest.raises(ZeroDivisionError) as raised:
        main(command)
    assert raised.value.__notes__ == [f"fishbed: the run is kept without a report in {out}"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]
    missing = {"report.html", "path.svg"}
    assert {entry.name for entry in out.iterdir()} == set(FILES) - missing
    assert is_run_folder(out)


WRONG = {
    ("run", "nowhere"): "no scenario of this name",
    ("run", "none.toml"): "cannot be read",
    ("run", "--duration", "-3"): "-3 must be above 0",
    ("run", "--duration", "nan"): "nan must be above 0",
    ("run", "--duration", "inf"): "inf must be finite",
    ("run", "--duration", "abc"): "'abc' is no number",
    ("run", "--out", ""): "--out: an empty text names no folder",
    ("run", "--seed", "x"): "invalid int value",
    ("run", "--seed", "-1"): "scenario.seed = -1",
    ("run", "--speed", "0"): "must be above 0",
    ("run", "--realtime", "--speed", "2"): "contradict",
    ("run", "--set", "plant.body.mass_kg"): "KEY=VALUE",
    ("run", "--set", "plant.body.mass_kg=-1"): "must be a number > 0",
    ("run", "--out", "/dev/null"): "is a file",
    ("run", "--out", "/dev/null/run"): "/dev/null is a file",
    ("run", "--out", "/"): "holds other files",
    ("replay", "/nowhere"): "no run folder",
    ("list", "fishes"): "invalid choice",
    ("swim",): "invalid choice",
    (): "required",
    ("run", "--colour"): "unrecognized arguments",
}


@pytest.mark.parametrize("arguments", WRONG)
def test_a_mistake_is_one_line_and_exit_2(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("fishbed: ")
    assert said.err.count("\n") == 1
    assert WRONG[arguments] in said.err


def test_damaged_run_folders_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scenario.toml").write_text("")
    for text in ("{", "[]", '{"scenario": "x"}'):
        (tmp_path / "summary.json").write_text(text)
        assert main(["replay", str(tmp_path)]) == 2
        assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("duration_s", None),
        ("duration_s", -1.0),
        ("duration_s", "40"),
        ("duration_s", True),
        ("duration_s", math.inf),
        ("trace_sha256", 3),
        ("trace_sha256", "abc"),
        ("metrics", []),
        ("metrics", {"speed_m_s": "fast"}),
        ("seed", 1.5),
        ("version", None),
    ],
)
def test_a_summary_with_a_wrong_value_is_refused(
    key: str,
    value: object,
    bench: type[MadeUpBench],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "run"
    assert main(["run", "--duration", "2", "--quiet", "--out", str(out)]) == 0
    document = json.loads((out / "summary.json").read_text())
    (out / "summary.json").write_text(json.dumps({**document, key: value}))
    assert main(["replay", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"summary.json: {key} = " in said


def test_list_shows_what_exists_and_says_what_does_not(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(listing.TABLES, "causes", ("tools.nothing.of.the.kind", "CAUSES"))
    assert main(["list"]) == 0
    said = capsys.readouterr().out
    assert "swim-forward 40 s from rest, tail-beat 15°, 0.9 Hz, no bias" in " ".join(said.split())
    assert "causes\n  none" in said
    for category in listing.CATEGORIES:
        assert f"{category}\n" in said
    assert main(["list", "scenarios", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["scenarios"]) == list(scenario.bundled())


def test_list_reads_tables_of_rows_and_of_names(monkeypatch: pytest.MonkeyPatch) -> None:
    module: Any = types.ModuleType("made_up_table")
    module.__spec__ = types.SimpleNamespace(name="made_up_table")
    row = types.SimpleNamespace(name="gyro", description="yaw rate")
    monkeypatch.setitem(sys.modules, "made_up_table", module)
    monkeypatch.setitem(listing.TABLES, "sensors", ("made_up_table", "ROWS"))
    module.ROWS = (row,)
    assert listing.rows("sensors") == [("gyro", "yaw rate")]
    module.ROWS = {"pty": "a pseudo-terminal"}
    assert listing.rows("sensors") == [("pty", "a pseudo-terminal")]


def test_doctor_tells_what_it_found_and_what_would_help(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "ORACLES", (("no-such-program", "no-such-package", "is needed"),))
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert "apt install no-such-package" in said.split("What would help:")[1]
    assert "numpy" in said
    monkeypatch.setattr(doctor, "PACKAGES", ("no-such-distribution",))
    assert main(["doctor", "--json"]) == 2
    said_json = capsys.readouterr()
    assert {row["what"] for row in json.loads(said_json.out)} >= {"Python", "CAN", "serial ports"}
    assert "a run needs: no-such-distribution" in said_json.err


def outside(*arguments: str, code: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python on the checkout in a process of its own."""
    command = [sys.executable, "-c", code] if code else [sys.executable, "-m", "tools"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*command, *arguments], capture_output=True, text=True, check=False, env=environment
    )


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom tools.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'matplotlib', 'rich', 'msgspec', 'can', 'serial'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)"
    )
    done = outside(code=code)
    assert done.stderr.strip() == "[]"
    for command in ("run", "replay", "list", "doctor"):
        assert f"    {command} " in done.stdout


def test_a_reader_that_goes_away_is_no_fault() -> None:
    code = (
        "import os, sys\nread, write = os.pipe()\nos.close(read)\nos.dup2(write, 1)\n"
        "from tools.cli import main\nsys.exit(main(['list']))"
    )
    done = outside(code=code)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a full disk at hand")
def test_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "tools", "list", "--json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=ROOT,
        )
    assert done.returncode == 2
    assert done.stderr == "fishbed: output cannot be written: No space left on device\n"


def test_version_and_module_entry() -> None:
    assert outside("--version").stdout.startswith("fishbed ")
    done = outside("run", "nowhere")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_progress_is_shown_where_somebody_looks(
    bench: type[MadeUpBench],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    out = str(tmp_path / "run")
    assert main(["run", "--duration", "4", "--out", out]) == 0
    assert "of 4 s" in capsys.readouterr().err
    assert main(["run", "--duration", "4", "--out", out, "--quiet"]) == 0
    assert main(["run", "--duration", "4", "--out", out, "--json"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("module", ["argparse", "tools.cli", "tools.commands.table"])
def test_ctrl_c_while_the_program_is_still_read_ends_it_quietly(module: str) -> None:
    script = (
        "import runpy, signal, sys\n"
        "class Hit:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}:\n"
        "            signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Hit())\n"
        "sys.argv = ['fishbed', '--version']\n"
        "runpy.run_module('tools', run_name='__main__')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "fishbed: interrupted\n")


def test_the_installed_command_is_the_one_of_the_checkout() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, function = project["scripts"]["fishbed"].partition(":")
    assert (module, function) == ("tools.__main__", "main")
    assert callable(getattr(importlib.import_module(module), function))
