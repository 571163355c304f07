"""Sweeps on a real Dask cluster of two workers on the loopback: the same bytes as without one.

The cluster is three processes that the tests start and end. One worker is killed in the middle.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tools import errors
from tools.cli import main
from tools.sweep import cluster
from tools.sweep.sweep import journal_path

ROOT = Path(__file__).resolve().parents[2]
POINTS = 10
needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None,
    reason="the optional packages of fishbed[cluster] are not installed",
)


def arguments(out: Path, *more: str) -> list[str]:
    vary = f"procboard.tail_beat.bias_rad=0.05:0.5:{POINTS}"
    return ["sweep", "circle", "--vary", vary, "--duration", "8", "--out", str(out), *more]


class Cluster:
    """A scheduler and its workers, each a process."""

    def __init__(self, folder: Path, surroundings: dict[str, str]) -> None:
        self.folder = folder
        self.surroundings = surroundings
        self.processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
        while not file.exists():
            assert self.processes[0].poll() is None
            time.sleep(0.02)
        self.address = json.loads(file.read_text())["address"]

    def start(self, what: str, *more: str) -> subprocess.Popen[bytes]:
        program = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard"]
        with (self.folder / f"{what}.log").open("ab") as log:
            process = subprocess.Popen(
                [*program, *more],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=self.folder,
                env=self.surroundings,
            )
        self.processes.append(process)
        return process

    def worker(self) -> subprocess.Popen[bytes]:
        return self.start("worker", self.address, "--nthreads", "1", "--no-nanny")

    def end(self) -> None:
        for process in reversed(self.processes):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def dask_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:

    started = Cluster(tmp_path_factory.mktemp("cluster"), {**os.environ, "PYTHONPATH": str(ROOT)})
    try:
        yield started
    finally:
        started.end()


def client(*call: str, answer_s: float) -> list[str]:
    """The command line in a process of its own, that waits for a cluster only so long."""
    patched = (
        "import sys; from tools.sweep import cluster; from tools.cli import main; "
        f"cluster.ANSWER_S = {answer_s}; sys.exit(main(sys.argv[1:]))"
    )
    return [sys.executable, "-c", patched, *call]


@needs_dask
def test_a_cluster_makes_the_same_bytes_though_a_worker_is_killed(
    dask_cluster: Cluster, tmp_path: Path
) -> None:
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"

    # nobody works there yet: one line, and nothing is left behind
    alone = subprocess.run(
        client(*arguments(there, "--scheduler", dask_cluster.address), answer_s=1.0),
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert alone.returncode == 2
    assert alone.stderr.splitlines()[0].startswith("fishbed: --scheduler tcp://127.0.0.1:")
    assert "the scheduler has no workers" in alone.stderr
    assert len(alone.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []

    workers = [dask_cluster.worker(), dask_cluster.worker()]
    sweeping = subprocess.Popen(
        client(*arguments(there, "--scheduler", dask_cluster.address), answer_s=60.0),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    journal = journal_path(there)
    try:
        while not (journal.exists() and journal.read_bytes().count(b"\n") >= 3):
            assert sweeping.poll() is None, sweeping.communicate()
            time.sleep(0.01)
        workers[0].kill()
        done = journal.read_bytes().count(b"\n") - 1
        out, err = sweeping.communicate(timeout=300)
    finally:
        sweeping.kill()
        sweeping.communicate()
    assert done < POINTS - 2, "too late: the worker that was killed had no point any more"
    assert (sweeping.returncode, out[:20]) == (0, "10 points of circle,"), err
    assert main(arguments(here, "--quiet")) == 0
    assert there.read_bytes() == here.read_bytes()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["here.csv", "there.csv"]


@needs_dask
def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path: Path) -> None:
    out = tmp_path / "t.csv"
    done = subprocess.run(
        client(*arguments(out, "--scheduler", "tcp://127.0.0.1:9"), answer_s=0.5),
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 2
    assert done.stderr == (
        "fishbed: --scheduler tcp://127.0.0.1:9: no Dask scheduler answers within 0.5 s; "
        "start one with: dask scheduler\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(arguments(tmp_path / "t.csv", "--scheduler", "tcp://127.0.0.1:9")) == 2
    said = capsys.readouterr().err
    assert said.startswith("fishbed: --scheduler needs distributed: install Dask")
    assert "pip install distributed" in said
    assert list(tmp_path.iterdir()) == []


class Ended:
    """A future that has ended."""

    def __init__(self, status: str, outcome: Any) -> None:
        self.status = status
        self.outcome = outcome

    def exception(self) -> Any:
        return self.outcome if self.status == "error" else None

    def result(self) -> Any:
        return self.outcome


WRONG: dict[str, Callable[[], Ended]] = {
    "other sources of fishbed (0.0.9)": lambda: Ended("finished", {"other_code": "0.0.9"}),
    "ModuleNotFoundError: no tools": lambda: Ended("error", ModuleNotFoundError("no tools")),
    "the connection to the scheduler is lost": lambda: Ended("cancelled", None),
}


@needs_dask
@pytest.mark.parametrize("says", WRONG)
def test_what_a_cluster_cannot_do_ends_the_sweep_in_one_line(says: str) -> None:
    import distributed

    with pytest.raises(errors.UserError) as raised:
        cluster._record(distributed, WRONG[says](), "tcp://a:1")
    assert says in str(raised.value)
    assert str(raised.value).startswith("--scheduler tcp://a:1: ")


@needs_dask
def test_a_point_that_kills_every_worker_is_given_up() -> None:
    import distributed

    killed = distributed.scheduler.KilledWorker("point", None, 3)
    record = cluster._record(distributed, Ended("error", killed), "tcp://a:1")
    assert record["given_up"]


@pytest.mark.parametrize(
    ("address", "good"),
    {
        "tcp://127.0.0.1:8786": True,
        "tls://cluster.example:8786": True,
        "127.0.0.1:8786": True,
        "tcp://[::1]:8786": True,
        "tcp://127.0.0.1": False,
        "8786": False,
        "http://127.0.0.1:8786": False,
        "tcp://a b:8786": False,
    }.items(),
)
def test_addresses(address: str, good: bool) -> None:
    assert bool(cluster.ADDRESS.fullmatch(address)) is good
