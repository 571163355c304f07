"""Nothing is wrong with the emulated robot: where a run that it swam begins, where it is, and what
is said of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plant.layout import State
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from tools import scenario
from tools.bench.bench import Bench
from tools.diagnosis.data.experiment import fish_model, read_experiment
from tools.diagnosis.engine import diagnose
from tools.diagnosis.fish.channels import NAMES
from tools.diagnosis.fish.inputs import FishInputs, in_motion
from tools.diagnosis.fish.model import FishModel, _guessed
from tools.diagnosis.model import Noise, Run
from tools.diagnosis.options import Options
from tools.diagnosis.whiteness import regimes
from tools.records.csv import write_channels
from tools.records.data import RunData

SECONDS = 31.0
SERVO, SERVO_DOT = State._fields.index("servo"), State._fields.index("servo_dot")
MOVING = [State._fields.index(name) for name in ("u", "v", "r")]
TRUE = Noise(
    np.array([7e-4, 7e-4, 0.0141, 3.7e-3, 0.0167, 0.011, 0.011]),
    np.array([1e-5, 1e-5, 6e-5]),
    np.ones(3),
)
"""Of camera (its scenario), gyro, compass and accelerometer (their chips), in still water."""


@cache
def swum() -> RunData:
    """A robot as it is bundled that turns at one beat."""
    bench = Bench.from_scenario(scenario.load("fishbed-robot", duration_s=SECONDS, seed=9))
    bench.run(lambda _seconds: None, lambda: False)
    return bench.run_data(compare=False)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The same as an experiment of one run."""
    write_channels(tmp_path / "run01.csv", swum().channels)
    text = 'scenario = "fishbed-robot"\n[[runs]]\nfile = "run01.csv"\n'
    (tmp_path / "experiment.toml").write_text(text)
    return tmp_path


def test_pieces_of_a_run_begin_as_the_robot_moved(folder: Path) -> None:
    experiment = read_experiment(folder)
    model = fish_model(experiment)
    truth = swum().truth
    assert len(experiment.runs) == 2
    last_s = max(s.time_s[-1] for name, s in swum().channels.items() if name in NAMES)
    begin_s, run = 0.5 * last_s, experiment.runs[1]
    prepared, plan = model._of({}), model._plans.of(run)
    start = _guessed(prepared, run, plan, model._drives(prepared, run))
    at = {name: np.interp(begin_s, truth["time_s"], truth[name]) for name in truth}
    assert abs(at["tail_rate_rad_s"]) > 0.5  # the servo is on its way
    assert start[SERVO] == pytest.approx(at["tail_angle_rad"], abs=2e-3)
    assert start[SERVO_DOT] == pytest.approx(at["tail_rate_rad_s"], abs=0.05)
    moving = [at[name] for name in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")]
    assert np.all(np.abs(start[MOVING] - moving) < (0.02, 0.02, 0.1))


@pytest.mark.parametrize("begin_s", [9.3, 9.6, 9.9, 10.2])
def test_a_run_that_begins_anywhere_is_predicted_to_its_noise(folder: Path, begin_s: float) -> None:
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(text + 'start = "unknown"\n')
    rows = (folder / "run01.csv").read_text().splitlines(keepends=True)
    late = [row for row in rows[1:] if float(row.partition(",")[0]) >= begin_s]
    (folder / "run01.csv").write_text(rows[0] + "".join(late))
    experiment = read_experiment(folder)
    model, run = fish_model(experiment), experiment.runs[0]
    fixed = model.filter(run, {}, TRUE)
    white = model.innovations(run, {}, fixed) / np.sqrt(fixed.variance)
    for index, channel in enumerate(model.channels):
        # the accelerometer's bias is not known yet, that of the gyro does little in a second
        if not channel.name.startswith("accel"):
            first = white[(run.channel == index) & (run.time_s < 1.0)]
            assert np.sqrt(np.mean(first**2)) < 1.6


def test_commands_before_a_record_go_on_as_the_beat() -> None:
    time_s = np.arange(0.01, 2.0, 0.02)
    for hertz in (0.0, 0.37, 1.3):
        told = 0.1 + 0.3 * np.sin(2.0 * np.pi * hertz * time_s + 0.7)
        times, angles = in_motion(time_s, told)
        assert times[0] == pytest.approx(-0.49)
        assert np.all(angles[-time_s.size :] == told)
        before = (times < time_s[0]) & (times > time_s[0] - 0.2)
        truth = 0.1 + 0.3 * np.sin(2.0 * np.pi * hertz * times[before] + 0.7)
        assert np.abs(angles[before] - truth).max() < 3e-3


def test_the_place_of_a_sample_does_not_know_its_noise() -> None:
    """Along the edge of a square every frame's noise says on which side it lies."""
    draw = np.random.default_rng(5)
    count = 3000
    time_s = np.repeat(np.arange(count) / 30.0, 2)
    channel = np.tile(np.array([0, 1]), count)
    noise = draw.standard_normal(2 * count)
    value = 7e-4 * noise + np.where(channel == 0, 0.05 + 0.01 * time_s, 0.0)
    model = FishModel(wang2014(), ("x_m", "y_m"))
    inputs = FishInputs(TailProgramme((TailBeat(0.0, 0.0, 0.0),), (0.0,)))
    run = Run("edge", time_s, channel, value, inputs)
    cells = model.signals(run, {})["the place in the tank"]
    label = [cells[channel == 1].astype(np.int64)]
    assert np.unique(label[0]).size == 6  # three squares along x, both sides of the edge
    # of χ²₁: beyond 16 in one of 16,000 experiments
    assert regimes([[noise[channel == 1]]], [label]) < 16.0


def test_nothing_is_wrong_with_a_healthy_robot(folder: Path) -> None:
    experiment = read_experiment(folder)
    model = fish_model(experiment)
    model.restrict(("gyro_scale", "drag_scale", "tail_offset", "servo_delay"))
    found = diagnose(model, experiment.runs, Options(draws=48, workers=1))
    assert found.report.verdict == "nothing_wrong"
    assert found.stage.problem.noise.sigma == pytest.approx(TRUE.sigma, rel=0.1)
