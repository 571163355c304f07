"""What a servo makes of recorded commands, and how old samples are: against the emulated robot."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from navboard.chips import lsm303dlh
from plant.robots import fishbed_robot, wang2014
from tools import scenario
from tools.bench.bench import Bench
from tools.bench.model import plant_parameters
from tools.diagnosis.data.csv import read_table
from tools.diagnosis.data.experiment import believed_model, read_experiment
from tools.diagnosis.data.screen import recorded
from tools.diagnosis.fish.channels import NAMES
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.fish.nuisances import sample_age_s
from tools.diagnosis.fish.pulses import followed
from tools.diagnosis.model import FloatArray, Run
from tools.records.csv import write_channels
from tools.records.data import RunData, Series

SECONDS = 10.0
BEATS = (
    "base_station.tail_beats=["
    "{at_s=4.0,bias_rad=-0.3,amplitude_rad=0.2,frequency_hz=1.2},"
    "{at_s=7.0,bias_rad=0.2,amplitude_rad=0.25,frequency_hz=0.8}]"
)
TRUTH = {
    "x_m": "x_m",
    "y_m": "y_m",
    "heading_rad": "heading_rad",
    "gyro_z_rad_s": "yaw_rate_rad_s",
    "tail_angle_rad": "tail_angle_rad",
}


@cache
def swum(name: str) -> tuple[RunData, tuple[tuple[float, float], ...]]:
    """The emulated robot's records, and what its servo took as targets and when."""
    bench = Bench.from_scenario(scenario.load(name, [BEATS], duration_s=SECONDS))
    bench.run(lambda _seconds: None, lambda: False)
    data = bench.run_data(compare=False)
    targets = [(t / 1e15, angle) for t, angle in bench.recorder._targets if angle is not None]
    return data, tuple(targets)


def away(model: FishModel, data: RunData, inputs: FishInputs) -> dict[str, float]:
    """Root mean squares of truth minus replay."""
    time_s = data.truth["time_s"]
    values = [data.truth[name] for name in TRUTH.values()]
    run = Run(
        "truth",
        np.tile(time_s, len(values)),
        np.repeat(np.arange(len(values)), time_s.size),
        np.concatenate(values),
        inputs,
    )
    error = (run.value - model.replay(run, {})).reshape(len(values), -1)
    return dict(zip(TRUTH, np.sqrt(np.mean(error**2, axis=1)).tolist(), strict=True))


def inputs_of(name: str, folder: Path, **without: bool) -> FishInputs:
    """What a diagnosis reads of the commands in the run's own records."""
    data, _ = swum(name)
    write_channels(folder / "run01.csv", data.channels)
    (folder / "experiment.toml").write_text(f'scenario = "{name}"\n[[runs]]\nfile = "run01.csv"\n')
    table = read_table(folder / "run01.csv", [])
    made = recorded(table, NAMES, {}, [])
    assert made is not None
    supply = made.supply_v
    if name == "wang2014":
        return FishInputs(made.programme, None, None, supply)
    assert made.told is not None
    told = made.told.time_s, made.told.value
    return FishInputs(made.programme, *(told if without else followed(*told, 1e-3, 12.0)), supply)


def test_a_servo_follows_the_pulses_and_no_other() -> None:
    data, targets = swum("fishbed-robot")
    told = data.channels["tail_command_rad"]
    times, angles = followed(told.time_s, told.value, 1e-3, 12.0)
    assert times[0] == angles[0] == 0.0
    true_s, true_rad = (np.array(numbers) for numbers in zip(*targets, strict=True))
    assert times.size - 1 == true_s.size
    late_s = times[1:] - true_s
    assert late_s.min() > -1e-4
    assert late_s.max() < 1.1e-3  # to the next step of the plant
    assert np.abs(angles[1:] - true_rad).max() < 1e-3
    assert np.median(np.abs(angles[1:] - true_rad)) < 5e-5  # a tick is 0.9 mrad


def test_the_predictor_with_these_pulses_is_the_emulated_robot(tmp_path: Path) -> None:
    data, _ = swum("fishbed-robot")
    model = FishModel(fishbed_robot(), tuple(TRUTH))
    plain = away(model, data, inputs_of("fishbed-robot", tmp_path, pulses=False))
    pulsed = away(model, data, inputs_of("fishbed-robot", tmp_path))
    assert plain["gyro_z_rad_s"] > 8e-3
    assert pulsed["gyro_z_rad_s"] < 1.5e-3
    assert pulsed["tail_angle_rad"] < 0.2 * plain["tail_angle_rad"]
    assert pulsed["x_m"] < 2e-4
    assert pulsed["y_m"] < 2e-4


def test_an_ideal_tail_rests_until_its_board_has_begun(tmp_path: Path) -> None:
    data, _ = swum("wang2014")
    inputs = inputs_of("wang2014", tmp_path)
    assert inputs.programme.beats[0].frequency_hz == 0.0
    assert 0.05 < inputs.programme.starts_s[1] < 0.2
    found = away(FishModel(wang2014(), tuple(TRUTH)), data, inputs)
    assert found["tail_angle_rad"] < 2e-3
    assert found["gyro_z_rad_s"] < 5e-3
    assert found["x_m"] < 1e-3


def test_samples_are_as_old_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: dict[str, list[int]] = {"accel_y_m_s2": [], "compass_rad": []}
    parts = {"accel_y_m_s2": lsm303dlh.Accelerometer, "compass_rad": lsm303dlh.Magnetometer}
    for name, part in parts.items():
        sample = part._sample

        def noted(self: object, now: int, name: str = name, sample: object = sample) -> None:
            taken[name].append(now)
            sample(self, now)  # type: ignore[operator]  # the part's own

        monkeypatch.setattr(part, "_sample", noted)
    bench = Bench.from_scenario(scenario.load("fishbed-robot", duration_s=4.0))
    bench.run(lambda _seconds: None, lambda: False)
    channels = bench.run_data(compare=False).channels
    for name, times in taken.items():
        at_s = np.array(times) / 1e15
        stamps = channels[name].time_s
        age = stamps - at_s[np.searchsorted(at_s, stamps) - 1]
        assert np.abs(age - sample_age_s(50.0)).max() < 1e-3
        assert abs(float(age.mean()) - sample_age_s(50.0)) < 2e-4


def test_what_the_boards_recorded_is_read_as_theirs(tmp_path: Path) -> None:
    inputs_of("fishbed-robot", tmp_path)
    experiment = read_experiment(tmp_path)
    assert experiment.boards
    model = believed_model(experiment)
    assert isinstance(model, FishModel)
    names = {p.name for p in model.tolerances} | {p.name for p in model.starts(experiment.runs[0])}
    assert {"tolerance.compass_late", "tolerance.run_gyro_bias"} <= names
    plain = FishModel(wang2014())
    assert plain.starts(experiment.runs[0]) == ()
    assert "tolerance.compass_late" not in {p.name for p in plain.tolerances}


def test_a_late_sample_shows_what_was(tmp_path: Path) -> None:
    inputs_of("fishbed-robot", tmp_path)
    experiment = read_experiment(tmp_path)
    late = FishModel(plant_parameters(experiment.config), experiment.channels, control_hz=50.0)
    now = FishModel(plant_parameters(experiment.config), experiment.channels)
    run = experiment.runs[0]
    names = [channel.name for channel in late.channels]
    compass = run.channel == names.index("compass_rad")
    series = Series(run.time_s[compass], now.replay(run, {})[compass])
    expected: FloatArray = np.interp(
        series.time_s[5:] - sample_age_s(50.0), series.time_s, np.unwrap(series.value)
    )
    found = np.unwrap(late.replay(run, {})[compass])[5:]
    assert np.abs(found - expected).max() < 5e-3
    gyro = run.channel == names.index("gyro_z_rad_s")
    biased = late.replay(run, {"tolerance.run_gyro_bias": 0.01})[gyro]
    assert np.abs(biased - late.replay(run, {})[gyro] - 0.01).max() < 2e-3
    across = run.channel == names.index("accel_y_m_s2")
    moved = late.replay(run, {"tolerance.run_accel_y_bias": 0.1})
    assert np.allclose((moved - late.replay(run, {}))[across], 0.1, atol=1e-9)
