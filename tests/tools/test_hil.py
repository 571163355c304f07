"""Hardware in the loop: two processes on ptys in real time, and every mistake in one line.

Nothing here asserts how long anything took: a busy machine is late, and says so.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.cable import Cable
from tools.cli import main

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 90.0
"""Longest that anything is waited for, on a machine that has better things to do."""


@contextmanager
def program(*args: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "tools", *args],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def where(process: subprocess.Popen[str]) -> str:
    """Return the path of the pty that a program has announced."""
    assert process.stderr is not None
    line = process.stderr.readline()
    assert line.startswith("fishbed: the other board is expected at pty /"), line
    return line.split()[-1]


def stopped(process: subprocess.Popen[str]) -> dict[str, Any]:
    """End a program as Ctrl-C does and return its document."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    document: dict[str, Any] = json.loads(out)
    return document


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Wait for a run and return its summary."""
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    document: dict[str, Any] = json.loads(out)
    return document


def test_a_navigation_board_on_a_pty_and_the_robot_around_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with program("board", "nav", "--on", "pty:", "--json") as board:
        url = f"serial://{where(board)}"
        with program("hil", "--nav", url, "--duration", "4", "--out", str(folder), "--json") as hil:
            run = result(hil)
        other = stopped(board)
    told = run["hil"]
    assert told["connected"]
    assert told["reports"]["delivered"] > 20
    assert told["reports"]["repeated"] == 0
    assert told["commands"]["given"] >= 1
    assert told["commands"]["applied"] >= told["commands"]["given"] - 1  # one may be on its way
    assert told["commands"]["surplus"] == 0
    assert run["metrics"]["spi_lost"] == 0
    assert told["round_trip"]["count"] > 5
    assert 0 < told["round_trip"]["median_s"] <= told["round_trip"]["maximum_s"]
    assert told["clock"]["reports"] > 20
    assert told["lateness"]["count"] > 1000
    assert told["outages"]["outages"] == 0
    assert other["connected"]
    assert other["real"] == "processing board"
    table = (folder / "channels.csv").read_text(encoding="utf-8").splitlines()
    column = table[0].split(",").index("tail_command_rad")
    angles = [float(cell) for row in table[1:] if (cell := row.split(",")[column])]
    assert max(angles) > 0.2  # of 15°: the tail beats as commanded
    assert min(angles) < -0.2
    assert (folder / "truth.csv").read_text(encoding="utf-8").count("\n") == 1
    assert "The real board" in (folder / "report.html").read_text(encoding="utf-8")
    assert main(["replay", str(folder)]) == 2


def test_a_processing_board_on_a_pty_swims_the_fish(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with program("board", "proc", "--on", "pty:", "--json") as board:
        url = f"serial://{where(board)}"
        args = ("--duration", "4", "--out", str(folder), "--json")
        with program("hil", "--proc", url, *args) as hil:
            run = result(hil)
        other = stopped(board)
    assert run["hil"]["connected"]
    assert run["metrics"]["path_length_m"] > 0.005  # the far board's command moved our water
    assert run["hil"]["acknowledged"]["count"] > 20
    assert run["metrics"]["spi_lost"] == 0
    assert other["reports"]["delivered"] > 20
    assert other["reports"]["repeated"] == 0
    assert other["round_trip"]["count"] > 5


def test_a_cable_is_pulled_once_and_nothing_is_applied_twice(tmp_path: Path) -> None:
    with program("board", "nav", "--on", "pty:", "--json") as board:
        far = where(board)
        near = tmp_path / "near"
        context = OpenContext()
        cable = Cable(
            lambda: open_transport(f"pty:?link={near}", context),
            lambda: open_transport(f"serial://{far}", context),
        )
        done = threading.Event()

        def carry() -> None:
            began_s = time.monotonic()
            while not done.is_set() and not (tmp_path / "go").exists():
                cable.run(0.05)
                if time.monotonic() - began_s > PATIENCE_S:
                    return
            cable.run(0.5)
            cable.pull()
            time.sleep(0.4)
            cable.plug()
            while not done.is_set():
                cable.run(0.05)
            cable.pull()

        carrier = threading.Thread(target=carry)
        carrier.start()
        try:
            url = f"serial://{near}"
            args = ("--duration", "6", "--out", str(tmp_path / "run"), "--json")
            with program("hil", "--nav", url, *args) as hil:
                before = 0
                while before < 3000 and hil.poll() is None:  # bytes: the two are talking
                    time.sleep(0.05)
                    before = cable.carried
                (tmp_path / "go").touch()
                run = result(hil)
            stopped(board)
        finally:
            done.set()
            carrier.join()
    told = run["hil"]
    assert told["outages"]["outages"] == 1
    assert told["outages"]["resumptions"] == 1
    assert told["outages"]["down_s"] > 0.2
    assert told["commands"]["given"] >= 1
    assert told["commands"]["surplus"] == 0
    assert told["reports"]["repeated"] == 0
    assert run["metrics"]["spi_lost"] == 0
    assert told["reports"]["delivered"] > 30


def test_a_run_that_must_not_be_late_ends_when_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with program("board", "nav", "--on", "pty:") as board:
        url = f"serial://{where(board)}"
        args = ["hil", "--nav", url, "--duration", "60", "--out", str(tmp_path / "run")]
        # No machine starts every event within half a millisecond for a minute; if one does, the
        # pause of this process does not.
        code = main([*args, "--late", "stop", "--late-bound", "0.0005", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["hil"]["lateness"]["stopped"]
    assert told["duration_s"] < 60
    assert code in (1, 2)  # 2 where it ended before the link was up


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["hil"], "no line to a real board"),
        (["hil", "--nav", "serial:///dev/no-such-port"], "no port /dev/no-such-port"),
        (["hil", "--nav", "seriell:///dev/x"], "no transport is called"),
        (["hil", "--nav", "no url at all"], "no url at all"),
        (["hil", "--nav", "pty:?baud=3"], "baud"),
        (["hil", "--nav", "pty:", "--proc", "pty:"], "not allowed with"),
        (["board", "nav", "--on", "can://socketcan/no0?tx=1&rx=2"], "no0"),
        (["board", "nav"], "--on"),
        (["board", "gps", "--on", "pty:"], "gps"),
        (["hil", "--nav", "pty:", "--late-bound", "-1"], "above 0"),
        (["hil", "--nav", "pty:", "--late-bound", "1e-6"], "--late-bound"),
        (["hil", "--nav", "pty:", "--set", "hil.late='never'"], "hil.late"),
        (["hil", "--nav", "pty:", "--set", "hil.proc='pty:'"], "name one line"),
        (["run", "--set", "hil.nav='pty:'", "--speed", "5"], "5 times as fast"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert err.count("\n") == 1
    assert not list(tmp_path.rglob("*.toml"))  # and nothing is left behind


def test_a_busy_port_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    pty = open_transport(f"pty:?link={tmp_path / 'port'}")
    holder = open_transport(f"serial://{tmp_path / 'port'}")
    try:
        assert main(["hil", "--nav", f"serial://{tmp_path / 'port'}"]) == 2
        assert "in use" in capsys.readouterr().err
    finally:
        holder.close()
        pty.close()


def test_a_line_on_which_nobody_answers_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["hil", "--nav", "pty:", "--duration", "1", "--out", str(out), "--quiet"]) == 2
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2  # where it is expected, and that it did not come
    assert "nothing came: is the other side running" in err[1]
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["hil"]["diagnosis"]
