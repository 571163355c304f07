"""Sweeps on this machine: the same bytes whoever computes, and nothing lost when somebody dies.

The oracle of a point is `fishbed run` of the same scenario: its trace hash and its metrics.
"""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tools import scenario
from tools.cli import main
from tools.sweep import compute, local
from tools.sweep.compute import code_digest, compute_remotely, encode
from tools.sweep.plan import make_plan
from tools.sweep.sweep import journal_path, sweep

BIAS = "procboard.tail_beat.bias_rad"
SHORT = ("--duration", "1")
LONG_S = 1e5
"""A scenario that lasts until somebody ends it."""


def arguments(out: Path, values: str = "0.1:0.4:4", *more: str) -> list[str]:
    return ["sweep", "circle", "--vary", f"{BIAS}={values}", *SHORT, "--out", str(out), *more]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The table of `arguments`, computed in one process without interruption."""
    out = tmp_path_factory.mktemp("whole") / "t.csv"
    assert main(arguments(out, "0.1:0.4:4", "--jobs", "1", "--quiet")) == 0
    assert [entry.name for entry in out.parent.iterdir()] == ["t.csv"]
    return out.read_bytes()


def test_a_row_is_what_a_run_of_its_own_says(whole: bytes, tmp_path: Path) -> None:
    rows = list(csv.DictReader(whole.decode().splitlines()))
    assert [float(row[BIAS]) for row in rows] == [0.1, 0.2, 0.3, 0.4]
    out = str(tmp_path / "run")
    assert main(["run", "circle", "--set", f"{BIAS}=0.3", *SHORT, "--quiet", "--out", out]) == 0
    said = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert rows[2]["trace_sha256"] == said["trace_sha256"]
    assert len({row["trace_sha256"] for row in rows}) == 4
    for name, value in said["metrics"].items():
        assert rows[2][name] == ("" if value is None else repr(value))


def test_two_processes_make_the_same_bytes(
    whole: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "t.csv"
    assert main(arguments(out, "0.1:0.4:4", "--jobs", "2")) == 0
    assert out.read_bytes() == whole
    assert capfd.readouterr().out.startswith("4 points of circle, in ")


def test_json_is_one_document(
    whole: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "t.json"
    assert main(arguments(out, "0.1,0.2", "--json")) == 0
    said = capfd.readouterr()
    assert said.out == out.read_text()
    rows = json.loads(said.out)["rows"]
    first = next(csv.DictReader(whole.decode().splitlines()))
    assert rows[0]["trace_sha256"] == first["trace_sha256"]


def test_what_the_journal_holds_is_not_computed_again(
    whole: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "t.csv"
    here = local.compute_here
    asked: list[list[int]] = []

    def two(points: list[int], task: Callable[[int], bytes], jobs: int) -> Any:
        asked.append(list(points))
        with closing(here(points, task, jobs)) as results:
            for _ in range(2):
                yield next(results)
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.sweep.sweep.compute_here", two)
    assert main(arguments(out)) == 130
    assert "interrupted; 2 of 4 points are kept in" in capfd.readouterr().err
    kept = journal_path(out).read_bytes()
    assert not out.exists()
    assert main(arguments(out, "0.1:0.4:7")) == 2
    assert "another sweep is unfinished there (4 points of circle)" in capfd.readouterr().err
    assert journal_path(out).read_bytes() == kept

    def rest(points: list[int], task: Callable[[int], bytes], jobs: int) -> Any:
        asked.append(list(points))
        return here(points, task, jobs)

    monkeypatch.setattr("tools.sweep.sweep.compute_here", rest)
    assert main(arguments(out)) == 0
    assert "going on: 2 of 4 points" in capfd.readouterr().err
    done = {json.loads(line)["point"] for line in kept.splitlines()[1:]}
    assert asked == [[0, 1, 2, 3], [point for point in range(4) if point not in done]]
    assert out.read_bytes() == whole
    assert not journal_path(out).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_sweep_that_is_stopped_keeps_its_results_and_leaves_no_process(
    number: signal.Signals,
    tmp_path: Path,
    start_fishbed: Callable[..., subprocess.Popen[str]],
) -> None:
    out = tmp_path / "t.csv"
    # the last point never ends, so there is something left to interrupt
    endless = ["sweep", "circle", "--vary", f"{BIAS}=0.1,0.2", "--out", str(out), "--jobs", "2"]
    endless += ["--vary", f"scenario.duration_s=1,{LONG_S:.0f}"]
    started = start_fishbed(*endless)
    journal = journal_path(out)
    while not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
        assert started.poll() is None, started.communicate()
        time.sleep(0.02)
    started.send_signal(number)
    # ends when every process that has its stderr is gone, the workers among them
    _, said = started.communicate(timeout=60)
    if number == signal.SIGINT:
        assert started.returncode == 130
        assert "points are kept in" in said
        assert "Traceback" not in said
    assert [entry.name for entry in tmp_path.iterdir()] == [journal.name]
    assert journal.read_bytes().count(b"\n") >= 2


def test_a_point_that_diverges_has_its_error_in_its_row(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "t.csv"
    light = ["plant.body.mass_kg=0.002"]
    light += [f"plant.body.added_mass_{axis}_kg=0" for axis in ("surge", "sway")]
    sets = [part for text in light for part in ("--set", text)]
    steps = ["--vary", "plant.step_s=0.001,0.02", "--duration", "1"]
    assert main(["sweep", "circle", *steps, *sets, "--out", str(out)]) == 1
    said = capfd.readouterr()
    assert "2 points of circle, 1 failed" in said.out
    assert "fishbed: point 1: circle: the motion diverged after" in said.err
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert rows[0]["error"] == rows[1]["trace_sha256"] == ""
    assert rows[1]["error"] in said.err
    assert not journal_path(out).exists()
    # quiet about all but this
    assert main(["sweep", "circle", *steps, *sets, "--quiet", "--out", str(out)]) == 1
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err == f"fishbed: point 1: {rows[1]['error']}\n"


def test_a_fault_of_ours_is_a_row_too_and_shows_its_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        @classmethod
        def from_scenario(cls, config: object) -> None:
            raise ZeroDivisionError("by\nnothing")

    monkeypatch.setattr("tools.bench.Bench", Broken)
    record = compute.compute(encode(scenario.load("circle")))
    assert record is not None
    assert record["error"] == "fault in fishbed: ZeroDivisionError: by nothing"
    assert "Traceback" in record["fault"]


def test_a_point_that_is_stopped_has_no_record() -> None:
    config = scenario.load("circle", duration_s=LONG_S)
    assert compute.compute(encode(config), lambda: True) is None


def test_a_scenario_survives_its_way_to_a_worker() -> None:
    for name in scenario.bundled():
        config = scenario.load(name)
        assert msgspec.json.decode(encode(config), type=type(config)) == config


def test_a_worker_with_other_sources_computes_nothing() -> None:
    task = encode(scenario.load("circle", duration_s=0.1))
    assert set(compute_remotely(task, "0" * 64)) == {"other_code"}
    assert set(compute_remotely(task, code_digest())) == {"trace_sha256", "metrics"}


def lasting(duration_s: float) -> bytes:
    return encode(scenario.load("circle", duration_s=duration_s))


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signal")
@pytest.mark.parametrize("deaths", [1, 2, 3])
def test_the_point_of_a_dead_process_is_run_again_and_given_up_at_last(deaths: int) -> None:
    """Whoever gets point 1 is killed while it computes, so many times."""
    tries: list[int] = []
    killers: list[threading.Timer] = []

    def kill() -> None:
        for child in multiprocessing.active_children():
            if child.pid is not None:
                os.kill(child.pid, signal.SIGKILL)

    def task(point: int) -> bytes:
        if point != 1:
            return lasting(0.5)
        tries.append(point)
        if len(tries) > deaths:
            return lasting(0.5)
        killers.append(threading.Timer(0.05, kill))
        killers[-1].start()
        return lasting(LONG_S)

    with closing(local.compute_here([0, 1, 2], task, jobs=1)) as results:
        found = dict(results)
    for killer in killers:
        killer.join()
    assert set(found) == {0, 1, 2}
    expected = compute.compute(lasting(0.5))
    assert found[0] == found[2] == expected
    if deaths < local.MOST_DEATHS:
        assert found[1] == expected
    else:
        assert found[1]["given_up"]
        assert found[1]["error"] == "given up: its process died 3 times (killed by SIGKILL)"
    assert len(tries) == min(deaths + 1, local.MOST_DEATHS)
    assert multiprocessing.active_children() == []


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signal")
def test_other_processes_never_notice_a_death() -> None:
    killed: list[int] = []

    def task(point: int) -> bytes:
        return lasting(0.5 if point != 0 else LONG_S if not killed else 0.4)

    results = local.compute_here(range(6), task, jobs=2)
    found = {}
    with closing(results):
        for point, record in results:  # point 0 keeps one process, the other does the rest
            found[point] = record
            if len(found) == 5 and not killed:
                for child in multiprocessing.active_children():
                    child.kill()
                killed.append(point)
    assert set(found) == set(range(6))
    assert found[0] == compute.compute(lasting(0.4))
    assert all("trace_sha256" in record for record in found.values())


def test_python_code_sweeps_too() -> None:
    plan = make_plan("circle", [f"{BIAS}=0.1,0.2"], duration_s=0.5)
    steps: list[int] = []
    table = sweep(plan, jobs=1, step=lambda: steps.append(1))
    assert table.column(BIAS) == [0.1, 0.2]
    assert table.failed == 0
    assert len(steps) == 2
