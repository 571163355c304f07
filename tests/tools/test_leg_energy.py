"""κ₁ and κ₃ from a run: a made-up robot whose legs and turns take known times."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tools.studies.leg_energy import NEAR_M, main, of_run

START = (0.1, 0.3)
TARGETS = ((0.5, 0.3), (0.5, 0.8), (0.1, 0.6), (0.7, 0.9), (0.3, 0.9), (0.8, 0.2), (0.1, 0.2))
SPEED_M_S, TURNING_S, WATTS = 0.03, 2.5, 1.4


def made_up_run(folder: Path, targets: int = len(TARGETS)) -> None:
    """Straight at constant speed; at each corner it stands for TURNING_S times (turn in rad)²."""
    corners = np.array([START, *TARGETS])
    knots = [(0.0, *START)]
    for i in range(1, targets + 1):
        step = corners[i] - corners[i - 1]
        knots.append((knots[-1][0] + math.hypot(*step) / SPEED_M_S, *corners[i]))
        if i <= len(TARGETS) - 1:
            onward = corners[i + 1] - corners[i]
            cosine = step @ onward / math.hypot(*step) / math.hypot(*onward)
            knots.append((knots[-1][0] + TURNING_S * math.acos(cosine) ** 2, *corners[i]))
    at = np.array(knots)
    time = np.arange(0.0, at[-1, 0], 0.02)
    rows = np.column_stack([time, *(np.interp(time, at[:, 0], at[:, k]) for k in (1, 2))])
    head = "time_s,x_m,y_m"
    np.savetxt(folder / "truth.csv", rows, "%.9f", ",", header=head, comments="")
    summary = {"duration_s": 100.0, "metrics": {"energy_j": 100.0 * WATTS}}
    (folder / "summary.json").write_text(json.dumps(summary))
    listed = [list(target) for target in TARGETS]
    (folder / "scenario.toml").write_text(f"[procboard.tracking]\ntargets_m = {listed}\n")


def test_way_and_turns_are_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made_up_run(tmp_path)
    found, legs = of_run(tmp_path)
    assert legs == len(TARGETS) - 1
    per_metre, _, per_turn = found.coefficients
    assert per_metre == pytest.approx(WATTS / SPEED_M_S, rel=0.02)
    assert per_turn == pytest.approx(WATTS * TURNING_S, rel=0.05)
    assert found.residual_j < WATTS * NEAR_M / SPEED_M_S
    main(tmp_path)
    assert "6 legs" in capsys.readouterr().out


def test_only_legs_that_were_swum_count(tmp_path: Path) -> None:
    made_up_run(tmp_path, 4)
    assert of_run(tmp_path)[1] == 3
