"""Hardware in the loop: two processes on ptys in real time, and every mistake in one line.

Nothing here asserts how long anything took: a busy machine is late, and says so.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from spi_bus.link import Role
from tests.tools.far_side import FarSide, HostClock
from tests.tools.processes import program, result, stopped, where
from tools.cli import main


def test_a_navigation_board_on_a_pty_and_the_robot_around_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with program("board", "nav", "--on", "pty:", "--json") as board:
        url = f"serial://{where(board)}"
        with program("hil", "--nav", url, "--duration", "3", "--out", str(folder), "--json") as hil:
            run = result(hil)
        other = stopped(board)
    told = run["hil"]
    assert told["connected"]
    assert told["reports"]["delivered"] > 15
    assert told["reports"]["repeated"] == 0
    assert told["commands"]["given"] >= 1
    assert told["commands"]["applied"] >= told["commands"]["given"] - 1  # one may be on its way
    assert told["commands"]["surplus"] == 0
    assert run["metrics"]["spi_lost"] == 0
    assert told["round_trip"]["count"] > 5
    assert 0 < told["round_trip"]["median_s"] <= told["round_trip"]["maximum_s"]
    assert told["clock"]["reports"] > 15
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


def test_one_board_serves_one_run_after_the_other(tmp_path: Path) -> None:
    """Each run is a new boot of its board: the link's other end has to see that."""
    with program("board", "nav", "--on", "pty:", "--json") as board:
        url = f"serial://{where(board)}"
        for number in (1, 2):
            args = ("--duration", "3", "--out", str(tmp_path / str(number)), "--json")
            with program("hil", "--nav", url, *args) as hil:
                told = result(hil)["hil"]
            assert told["reports"]["delivered"] > 15
            assert told["reports"]["repeated"] == 0
            assert told["commands"]["applied"] >= 1
            assert told["commands"]["surplus"] == 0
        other = stopped(board)
    assert other["link"]["peer_resets"] == 1


def test_a_processing_board_on_a_pty_swims_the_fish(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with program("board", "proc", "--on", "pty:", "--json") as board:
        url = f"serial://{where(board)}"
        args = ("--duration", "3", "--out", str(folder), "--json")
        with program("hil", "--proc", url, *args) as hil:
            run = result(hil)
        other = stopped(board)
    assert run["hil"]["connected"]
    assert run["metrics"]["path_length_m"] > 0.005  # the far board's command moved our water
    assert run["hil"]["acknowledged"]["count"] > 15
    assert run["hil"]["round_trip"]["count"] > 3  # our board asks for the other's clock
    assert run["hil"]["clock"]["reports"] > 3
    assert run["metrics"]["spi_lost"] == 0
    assert other["reports"]["delivered"] > 15
    assert other["reports"]["repeated"] == 0
    assert other["round_trip"]["count"] > 5


def test_a_run_that_must_not_be_late_ends_when_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class SlowLine(FarSide):
        """A line that takes 0.2 s of our time whenever it is looked at, once the link is up."""

        def read(self, limit: int = 65_536) -> bytes:
            if self.link.connected:
                time.sleep(0.2)
            return super().read(limit)

    far = SlowLine(Role.SLAVE, HostClock(), 0.1)
    monkeypatch.setattr("tools.bench.outages.open_transport", lambda url, context: far)
    args = ["hil", "--nav", "pty:", "--duration", "60", "--out", str(tmp_path / "run"), "--json"]
    code = main([*args, "--late", "stop", "--late-bound", "0.05"])
    told = json.loads(capsys.readouterr().out)
    assert told["hil"]["lateness"]["stopped"]
    assert told["hil"]["lateness"]["worst"][0]["late_s"] > 0.05
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
        (["board", "nav"], "--on"),
        (["board", "gps", "--on", "pty:"], "gps"),
        (["hil", "--nav", "pty:", "--late-bound", "-1"], "above 0"),
        (["hil", "--nav", "pty:", "--late-bound", "1e-6"], "--late-bound"),
        (["hil", "--nav", "pty:", "--set", "hil.late='never'"], "hil.late"),
        (["hil", "--nav", "pty:", "--set", "hil.proc='pty:'"], "name one line"),
        (["hil", "--nav", "pty:", "--late-bound", "0.1"], "--late-bound goes with --late stop"),
        (["hil", "--nav", "pty:", "--rate", "50"], "--rate goes with --plant-for"),
        (["hil", "--nav", "pty:", "--camera-id", "7"], "--camera-id goes with --camera"),
        (["hil", "--nav", "pty:", "--emulate", "robot"], "--emulate: "),
        (["hil", "--plant-for", "pty:", "--rate", "5"], "--rate: 5 is outside 10 to 1000"),
        (["hil", "--nav", "pty:?link=x", "--mote", "pty:?link=x"], "hil.nav already: each has"),
        (["board", "nav", "--on", "pty:?link=x", "--plant", "pty:?link=x"], "each has its own"),
        (["run", "--set", "hil.nav='pty:'", "--speed", "5"], "5 times as fast"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, complaint: Callable[[list[str]], str]
) -> None:
    assert says in complaint(args)
