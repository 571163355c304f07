"""Two processes on a pty pair in real time: nothing lost, repeated or out of order.

A few seconds of what `python -m spi_bus.transports.soak` does for ten minutes. Lateness is measured
and not judged: this machine may be busy.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
ROOT = Path(__file__).resolve().parents[3]


def soak(*options: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "spi_bus.transports.soak", "--json", *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_two_processes_at_100_hz_lose_nothing() -> None:
    report = soak("--seconds", "2.5")
    assert (report["lost"], report["wrong"]) == (0, 0)
    for side in ("master", "slave"):
        board = report[side]
        assert board["settled"]
        assert board["made"] == board["ticks"] > 100
        assert board["ticks"] + board["ticks_skipped"] == pytest.approx(250, abs=2)
        assert board["tick_lateness"]["count"] == board["ticks"]
        assert board["outages"] == 0
    assert report["master"]["round_trip"]["count"] > 10
    assert (
        0 < report["master"]["round_trip"]["p99_s"] <= report["master"]["round_trip"]["maximum_s"]
    )


def test_a_pulled_cable_loses_nothing_either() -> None:
    report = soak("--seconds", "3", "--pulls", "2")
    assert (report["lost"], report["wrong"]) == (0, 0)
    for side in ("master", "slave"):
        board = report[side]
        assert board["settled"]
        assert board["outages"] == board["resumptions"] == 2
        assert board["down_s"] > 0.8
        assert board["peer_resets"] == 0
        assert board["longest_backlog"] > 10, "the application had to wait for the line"
    assert report["master"]["retransmissions"] + report["slave"]["retransmissions"] > 0


def test_wrong_options_are_said(capfd: pytest.CaptureFixture[str]) -> None:
    from spi_bus.transports.soak import main

    assert main(["--side", "slave", "--url", "serial:///dev/nothing", "--seconds", "1"]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("soak: serial:///dev/nothing: no port /dev/nothing")
    assert err.count("\n") == 1
    with pytest.raises(SystemExit, match="2"):
        main(["--seconds", "0"])
