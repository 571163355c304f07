"""Two programs on a pty pair at 100 Hz, as samples of the ten minutes of `tools.hil_soak`.

How late they are is the machine's affair. What counts is that nothing is lost, and that the account
of it can tell: every kind of fault is put into a good run's figures and must be found.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest

from tools.hil_soak import Soak, faults, main


def sample(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """Run it, and return its figures."""
    code = main(["--json", *arguments])
    out, err = capsys.readouterr()
    assert out, err
    figures: dict[str, Any] = json.loads(out)
    assert figures["faults"] == []
    assert code == 0
    return figures


def test_at_100_hz_nothing_is_lost(capsys: pytest.CaptureFixture[str]) -> None:
    figures = sample(capsys, "--seconds", "8")
    hil, board = figures["hil"], figures["board"]
    reports = hil["reports"]
    made = reports["delivered"] + reports["missing"] - reports["backlog"]
    assert 100 < made <= 805  # a machine that is late has a rest in its queues
    assert board["link"]["sent"] >= reports["delivered"]
    assert hil["round_trip"]["count"] > 10
    assert hil["outages"]["outages"] == board["outages"]["outages"] == 0
    assert len(hil["lateness"]["worst"]) <= 10


def test_a_processing_board_whose_cable_is_pulled_loses_nothing_either(
    capsys: pytest.CaptureFixture[str],
) -> None:
    figures = sample(capsys, "--seconds", "8", "--pulls", "2", "--real", "proc")
    hil, board = figures["hil"], figures["board"]
    assert hil["outages"]["outages"] >= 2
    assert board["outages"]["outages"] >= 2
    assert hil["outages"]["resumptions"] >= 2
    assert board["reports"]["delivered"] > 200
    assert hil["round_trip"]["count"] > 5  # answers to questions after its clock
    assert hil["clock"]["reports"] > 5
    assert hil["clock"]["resets"] == 0


LINK = {"sent": 100, "acknowledged": 98, "received": 50, "lost": 0, "retransmissions": 0,
        "duplicates": 0, "damaged": 0, "peer_resets": 0}  # fmt: skip
REPORTS = {"delivered": 0, "backlog": 0, "missing": 0, "repeated": 0, "refused": 0, "lost": 0}
GOOD: dict[str, Any] = {
    "hil": {
        "connected": True,
        "link": LINK | {"sent": 51, "acknowledged": 49, "received": 99},
        "reports": REPORTS | {"delivered": 90},
        "commands": {"given": 3, "applied": 3, "surplus": 0},
        "outages": {"outages": 2},
    },
    "board": {
        "connected": True,
        "link": LINK,
        "reports": REPORTS,
        "commands": {"given": 0, "applied": 0, "surplus": 0},
        "outages": {"outages": 2},
    },
}


def set_to(value: object, *path: str) -> Callable[[dict[str, Any]], None]:
    def change(figures: dict[str, Any]) -> None:
        for step in path[:-1]:
            figures = figures[step]
        figures[path[-1]] = value

    return change


FAULTS = {
    "acknowledged and not delivered": (set_to(97, "hil", "link", "received"), "were acknowledged"),
    "delivered and never sent": (set_to(101, "hil", "link", "received"), "were acknowledged"),
    "commands too": (set_to(48, "board", "link", "received"), "hil sent 51"),
    "not understood": (set_to(1, "board", "link", "lost"), "not delivered"),
    "a reset": (set_to(1, "hil", "link", "peer_resets"), "reset 1 times"),
    "a gap": (set_to(1, "hil", "reports", "lost"), "1 sensor reports lost"),
    "a repetition": (set_to(1, "hil", "reports", "repeated"), "1 sensor reports repeated"),
    "a command twice": (set_to(1, "hil", "commands", "surplus"), "carried out twice"),
    "no link": (set_to(False, "board", "connected"), "never came up"),
    "no reports": (set_to(0, "hil", "reports", "delivered"), "no sensor report came"),
    "no outage": (set_to(1, "hil", "outages", "outages"), "saw 1 outages"),
}


def test_a_good_account_has_no_fault() -> None:
    assert faults(Soak(pulls=2), GOOD) == []


@pytest.mark.parametrize("case", FAULTS)
def test_every_fault_is_found(case: str) -> None:
    change, says = FAULTS[case]
    figures = copy.deepcopy(GOOD)
    change(figures)
    found = faults(Soak(pulls=2), figures)
    assert len(found) == 1
    assert says in found[0]


@pytest.mark.parametrize(
    "arguments",
    [["--seconds", "0"], ["--pulls", "-1"], ["--seconds", "3", "--pulls", "4"], ["--rate", "5"],
     ["--rate", "400"], ["--real", "gps"]],
)  # fmt: skip
def test_wrong_options_are_refused(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "hil_soak: error:" in capsys.readouterr().err
