"""The whole robot swims as the plant alone does: boards, links and servo make less than 3 %.

The plant alone is put together here from `plant` only, with an ideal servo and Table 3.1, so that
it shares nothing with the bench but the equations. Both swim from rest, and both are measured over
the last ten beats.
"""

from __future__ import annotations

import math
import re
from html import unescape
from typing import Any

import numpy as np
import pytest

from plant.integrate import simulate
from plant.metrics import SteadyMotion, steady_motion
from plant.parameters import PlantParameters, Servo
from plant.tail_input import TailBeat, TailProgramme

BEAT_HZ = 0.9
BEATS = 10
SOURCE_RADIUS_M = 0.2745
"""Turning radius at 20° bias, 15°, 0.9 Hz, with the coefficients of chapter 3."""


def plant_alone(bias_deg: float, duration_s: float) -> SteadyMotion:
    parameters = PlantParameters(servo=Servo(ideal=True))
    beat = TailBeat(math.radians(bias_deg), math.radians(15), BEAT_HZ)
    path = simulate(parameters, TailProgramme.steady(beat), duration_s)
    return measured(path.time_s, path.x_m, path.y_m, path.heading_rad)


def measured(time_s: Any, x_m: Any, y_m: Any, heading_rad: Any) -> SteadyMotion:
    return steady_motion(time_s, x_m, y_m, np.unwrap(heading_rad), BEAT_HZ, BEATS)


def of_robot(run: Any) -> SteadyMotion:
    """The robot's motion by its true path, not by its own metrics."""
    truth = run.data.truth
    return measured(truth["time_s"], truth["x_m"], truth["y_m"], truth["heading_rad"])


# A test a scenario, so that each swims once, whichever process has the test.


def test_the_default_scenario_is_as_fast_as_the_plant_alone(swim: Any) -> None:
    run = swim("swim-forward", keep=True)
    ideal = plant_alone(0.0, run.data.duration_s)
    robot = of_robot(run)
    assert robot.speed_m_s == pytest.approx(ideal.speed_m_s, rel=0.03)
    assert run.data.metrics["speed_m_s"] == pytest.approx(robot.speed_m_s, rel=1e-9)
    assert run.data.metrics["turn_radius_m"] is None
    # It swam: not two resting fish that agree.
    assert ideal.speed_m_s > 0.02
    assert run.data.metrics["path_length_m"] > 0.7
    check_report(run, ideal, robot)


def test_the_circle_has_the_radius_of_the_plant_alone_and_of_the_source(swim: Any) -> None:
    run = swim("circle", keep=True)
    ideal = plant_alone(20.0, run.data.duration_s)
    robot = of_robot(run)
    assert ideal.turn_radius_m == pytest.approx(SOURCE_RADIUS_M, rel=0.01)
    assert robot.turn_radius_m == pytest.approx(ideal.turn_radius_m, rel=0.03)
    assert robot.turn_radius_m == pytest.approx(SOURCE_RADIUS_M, rel=0.03)
    assert robot.path_speed_m_s == pytest.approx(ideal.path_speed_m_s, rel=0.03)
    assert run.data.metrics["turn_radius_m"] == pytest.approx(robot.turn_radius_m, rel=1e-9)
    assert run.data.metrics["turn_period_s"] == pytest.approx(robot.turn_period_s, rel=1e-9)
    check_report(run, ideal, robot)


def comparison(html: str) -> list[list[str]]:
    """Cells of the report's table that begins with the ideal plant."""
    for table in re.findall(r"<table>(.*?)</table>", html, re.DOTALL):
        rows = [
            [
                unescape(re.sub(r"<[^>]*>", "", cell))
                for cell in re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)
            ]
            for row in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)
        ]
        rows = [row for row in rows if row]
        if rows and rows[0][0] == "plant alone, ideal servo":
            return rows
    raise AssertionError("the report has no comparison with the plant alone")


def centimetres(cell: str) -> float:
    return float(cell.split()[0]) / 100


def check_report(run: Any, ideal: SteadyMotion, robot: SteadyMotion) -> None:
    """The report says what makes the difference, from the one to the other."""
    rows = comparison((run.folder / "report.html").read_text(encoding="utf-8"))
    turning = robot.turn_radius_m is not None and run.data.metrics["turn_radius_m"] is not None
    assert rows[-1][0] == "whole robot"
    for row, motion in ((rows[0], ideal), (rows[-1], robot)):
        assert centimetres(row[1]) == pytest.approx(motion.speed_m_s, rel=1e-3)
        if turning:
            assert centimetres(row[3]) == pytest.approx(motion.turn_radius_m, rel=1e-3)
    # Every step between says what it adds, and the steps lead from the one to the other.
    assert len(rows) >= 4
    assert all(row[-1] for row in rows)
    assert all(row[0].startswith("+ ") for row in rows[1:-1])
    speeds = [centimetres(row[1]) for row in rows]
    assert speeds[-2] == pytest.approx(speeds[-1], rel=0.01)
