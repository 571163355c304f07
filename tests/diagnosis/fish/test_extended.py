"""The extended scenario is the robot that was fitted; the emulated one shows what was found."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from plant.integrate import simulate
from plant.packing import pack
from plant.tail_input import TailBeat, TailProgramme
from tools import scenario
from tools.bench.bench import Bench
from tools.bench.model import plant_parameters
from tools.configuration import Scenario
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.extended import extended
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Run
from tools.effects import INSTRUMENTS
from tools.records.data import RunData


@pytest.mark.parametrize("name", [name for name in CAUSES if name != "unknown_force"])
def test_every_cause_is_a_section_that_loads(name: str, tmp_path: Path) -> None:
    believed = scenario.load("wang2014")
    cause = CAUSES[name].cause
    values = {p.name: 2.0 * p.scale if p.most > 0.0 else -p.scale for p in cause.parameters}
    if name == "tail_body_coupling":
        values = {"tail_body_coupling.k": -0.2}
    file = tmp_path / "extended.toml"
    made = extended(believed, values, "found")
    assert made.left_out == ()
    file.write_text(made.to_toml())
    loaded = scenario.load(file)
    assert loaded == made.config
    assert loaded.scenario.name == "found"
    assert loaded.effects != believed.effects
    model = FishModel(plant_parameters(believed))
    assert pack(plant_parameters(loaded)) == pytest.approx(pack(model.setup(values).plant))


def test_fitted_tolerances_are_in_the_robots_numbers() -> None:
    believed = scenario.load("wang2014")
    values = {
        "tolerance.mass": 0.01,
        "tolerance.drag": -0.02,
        "tolerance.gyro_bias": 0.003,
        "drag_scale.k": 0.3,
    }
    made = extended(believed, values).config
    model = FishModel(plant_parameters(believed))
    assert pack(plant_parameters(made)) == pytest.approx(pack(model.setup(values).plant))
    assert scenario.keys(made)["effects.gyro_bias.b_rad_s"] == 0.003


def test_what_cannot_be_said_is_named() -> None:
    believed = scenario.load("fishbed-robot")
    made = extended(believed, {"x_m: drift": 0.01, "dropped_commands.p": 0.2})
    assert made.left_out == ("x_m: drift",)
    assert scenario.keys(made.config)["effects.dropped_commands.p"] == 0.2
    assert "# left out" in made.to_toml()


FORCE = {
    "unknown_force.surge:u|u|": -0.06,
    "unknown_force.yaw:a": -2e-5,
    "unknown_force.sway:t": 1e-5,
    "unknown_force.current_x:y": 3e-3,
}


def test_an_unknown_force_is_said_and_swum_as_the_diagnosis_predicts_it(tmp_path: Path) -> None:
    believed = scenario.load("wang2014")
    file = tmp_path / "extended.toml"
    file.write_text(extended(believed, FORCE).to_toml())
    loaded = scenario.load(file)
    assert "surge:u|u|" in file.read_text()
    robot = plant_parameters(loaded)
    beats = TailProgramme(
        (TailBeat.degrees(15, 15, 0.9), TailBeat.degrees(-20, 18, 1.1)), (0.0, 9.0)
    )
    swum = simulate(robot, beats, 20.0, 1e-3, save_every=100)
    plain = simulate(plant_parameters(believed), beats, 20.0, 1e-3, save_every=100)
    count = swum.time_s.size
    values = np.concatenate([swum.x_m, swum.y_m, swum.heading_rad])
    run = Run(
        "swum",
        np.tile(swum.time_s, 3),
        np.repeat(np.arange(3), count),
        values,
        FishInputs(beats, None, None, None),
    )
    model = FishModel(plant_parameters(believed), ("x_m", "y_m", "heading_rad"))
    assert np.abs(model.replay(run, FORCE) - values).max() < 2e-4
    assert np.abs(model.replay(run, {}) - values).max() > 0.05
    assert np.abs(swum.x_m - plain.x_m).max() > 0.01
    # who believes the extended scenario predicts the same without any cause
    again = FishModel(robot, ("x_m", "y_m", "heading_rad"))
    assert np.array_equal(again.replay(run, {}), model.replay(run, FORCE))
    twice = extended(loaded, FORCE).config
    assert scenario.keys(twice)["effects.unknown_force.surge:u|u|"] == -0.12
    assert scenario.keys(twice)["plant.water.shear_x_per_y_s"] == 6e-3


def test_the_emulated_robot_feels_the_force_too() -> None:
    force = {"unknown_force.surge:1": 5e-4, "unknown_force.yaw:1": 1e-5}
    for name in ("wang2014", "fishbed-robot"):
        believed = scenario.load(name, duration_s=3.0)
        truth = []
        for config in (believed, extended(believed, force).config):
            bench = Bench.from_scenario(config)
            bench.run(lambda _seconds: None, lambda: False)
            truth.append(bench.run_data(compare=False).truth)
        assert truth[1]["x_m"][-1] > truth[0]["x_m"][-1] + 1e-3
        assert truth[1]["heading_rad"][-1] > truth[0]["heading_rad"][-1] + 1e-3


def swum(*sets: str) -> RunData:
    config: Scenario = scenario.load(
        "wang2014",
        [
            "navboard.gyro.noise_scale=0.0",
            "navboard.gyro.bias_rad_s=0.0",
            "navboard.compass.noise_scale=0.0",
            "camera.led_noise_m=0.0",
            *sets,
        ],
        duration_s=6.0,
    )
    bench = Bench.from_scenario(config)
    bench.run(lambda seconds: None, lambda: False)
    return bench.run_data(compare=False)


def looked(data: RunData, name: str, at_s: np.ndarray) -> np.ndarray:
    return np.interp(at_s, data.truth["time_s"], data.truth[name])


@pytest.fixture(scope="module")
def plain() -> RunData:
    return swum()


def test_the_gyro_reads_what_is_wrong_with_it(plain: RunData) -> None:
    wrong = swum("effects.gyro_bias.b_rad_s=0.1", "effects.gyro_scale.k=0.5")
    a, b = plain.channels["gyro_z_rad_s"].value, wrong.channels["gyro_z_rad_s"].value
    assert np.abs(b - 1.5 * a - 0.1).max() < 0.01


def test_the_compass_reads_what_is_wrong_with_it(plain: RunData) -> None:
    wrong = swum(
        "effects.compass_offset.delta_rad=0.1",
        "effects.compass_hard_iron.a=0.2",
        "effects.compass_hard_iron.phi_rad=0.5",
        "effects.compass_soft_iron.a=0.1",
    )
    series = wrong.channels["compass_rad"]
    psi = plain.channels["compass_rad"].value
    error = np.angle(np.exp(1j * (series.value - psi)))
    expected = 0.1 + 0.2 * np.sin(psi - 0.5) + 0.1 * np.sin(2.0 * psi)
    assert np.abs(error - expected).max() < 0.03


def test_the_camera_shows_another_frame(plain: RunData) -> None:
    wrong = swum("effects.camera_scale.k=0.1", "effects.camera_rotation.delta_rad=0.3")
    time_s = wrong.channels["x_m"].time_s
    x, y = looked(plain, "x_m", time_s), looked(plain, "y_m", time_s)
    assert (
        np.abs(wrong.channels["x_m"].value - 1.1 * (x * math.cos(0.3) - y * math.sin(0.3))).max()
        < 1e-3
    )
    heading = looked(plain, "heading_rad", time_s) + 0.3
    away = wrong.channels["heading_rad"].value - heading
    assert np.abs(np.angle(np.exp(1j * away))).max() < 5e-3


def test_the_camera_is_late(plain: RunData) -> None:
    wrong = swum("effects.camera_delay.delay_s=0.35")
    series = wrong.channels["heading_rad"]
    before = looked(plain, "heading_rad", np.maximum(series.time_s - 0.35, 0.0))
    assert np.abs(np.angle(np.exp(1j * (series.value - before)))).max() < 5e-3


def test_the_camera_stalls(plain: RunData) -> None:
    wrong = swum("effects.stale_samples.hold_s=0.5")
    series = wrong.channels["x_m"]
    same = np.concatenate(([False], np.diff(series.value) == 0.0))
    fresh = series.time_s[~same]
    assert same.mean() > 0.5
    assert 0.2 < np.diff(fresh).max() < 0.55
    assert not np.any(np.diff(plain.channels["x_m"].value[60:]) == 0.0)


def test_the_clock_runs_fast(plain: RunData) -> None:
    wrong = swum("effects.clock_drift.k=0.01")
    for name, series in plain.channels.items():
        assert np.allclose(wrong.channels[name].time_s, 1.01 * series.time_s)
        assert np.array_equal(wrong.channels[name].value, series.value)


def test_commands_are_lost_on_the_way_to_the_tail() -> None:
    beats = "base_station.tail_beats=[{at_s=2.0,bias_rad=-0.3,amplitude_rad=0.2,frequency_hz=1.0}]"
    kept, lost = swum(beats), swum(beats, "effects.dropped_commands.p=1.0")
    for data in (kept, lost):
        assert data.channels["tail_bias_rad"].value[-1] == pytest.approx(-0.3, abs=1e-3)
    assert kept.truth["tail_angle_rad"][-200:].mean() < -0.2
    assert lost.truth["tail_angle_rad"][-200:].mean() > -0.1


def test_neutral_effects_leave_the_trace_alone(plain: RunData) -> None:
    rows = INSTRUMENTS.values()
    neutral = swum(*(f"effects.{row.name}.{p.name}=0.0" for row in rows for p in row.parameters))
    assert neutral.trace_sha256 == plain.trace_sha256


def means(data: RunData, *after_s: float) -> list[float]:
    """The true tail's mean angle over a beat of 1 s from each of some times on."""
    angle, time_s = data.truth["tail_angle_rad"], data.truth["time_s"]
    return [float(angle[(time_s > t) & (time_s <= t + 1.0)].mean()) for t in after_s]


def test_an_ideal_tail_loses_a_command_whole_or_not_at_all() -> None:
    """The motion controller slews to a new bias in steps; half of them lost is half a command."""
    biases = (0.2, -0.2, 0.2, -0.2)
    beats = ",".join(
        f"{{at_s={1.5 * i + 1.0},bias_rad={bias},amplitude_rad=0.2,frequency_hz=1.0}}"
        for i, bias in enumerate(biases)
    )
    first = [f"procboard.tail_beat.{key}" for key in ("bias_rad=0.0", "frequency_hz=1.0")]
    sets = (f"base_station.tail_beats=[{beats}]", *first)
    times = [1.5 * i + 1.4 for i in range(3)]
    assert means(swum(*sets), *times) == pytest.approx(biases[:3], abs=0.03)
    lost = means(swum(*sets, "effects.dropped_commands.p=0.5", "scenario.seed=3"), *times)
    nearest = [min((0.0, 0.2, -0.2), key=lambda level, m=mean: abs(level - m)) for mean in lost]
    assert lost == pytest.approx(nearest, abs=0.03)
    assert nearest != list(biases[:3])


def test_a_real_servos_robot_misses_what_is_lost_on_the_air() -> None:
    beats = "base_station.tail_beats=[{at_s=1.5,bias_rad=-0.3,amplitude_rad=0.2,frequency_hz=1.0}]"
    first = [f"procboard.tail_beat.{key}" for key in ("bias_rad=0.2", "frequency_hz=1.0")]
    for share, bias in ((0.0, -0.3), (1.0, 0.2)):
        sets = [beats, *first, f"effects.dropped_commands.p={share}"]
        bench = Bench.from_scenario(scenario.load("fishbed-robot", sets, duration_s=4.0))
        bench.run(lambda _seconds: None, lambda: False)
        data = bench.run_data(compare=False)
        assert means(data, 2.9) == pytest.approx([bias], abs=0.03)
        # its own records say what it did
        assert data.channels["tail_bias_rad"].value[-1] == pytest.approx(bias, abs=1e-3)
