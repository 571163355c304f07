"""Tables, summary and metrics: what is written is what was measured."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tools import scenario
from tools.records.csv import read_columns, write_channels, write_truth
from tools.records.data import CHANNEL_COLUMNS, METRICS, TRUTH_COLUMNS, RunData, Series
from tools.records.folder import RunFolder
from tools.records.metrics import path_metrics, turn_change, unsettled
from tools.records.read import read_run_folder
from tools.records.summary import summary, to_json
from tools.records.write import write_run

CONTRACT_COLUMNS = (
    "time_s,tail_bias_rad,tail_amplitude_rad,tail_frequency_hz,tail_command_rad,x_m,y_m,"
    "heading_rad,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,compass_rad,gps_x_m,gps_y_m,"
    "tail_angle_rad,battery_v,servo_current_a,temperature_c"
)
MakeRun = Callable[..., RunData]


def test_channels_have_the_columns_of_the_contract_and_gaps_stay_gaps(tmp_path: Path) -> None:
    channels = {
        "x_m": Series(np.array([0.0, 0.1]), np.array([1.0, 1 / 3])),
        "battery_v": Series(np.array([0.1, 0.2]), np.array([8.25, math.nan])),
        "pollutant_ug_l": Series(np.array([0.3]), np.array([4.0])),
    }
    write_channels(tmp_path / "channels.csv", channels)
    lines = (tmp_path / "channels.csv").read_text().splitlines()
    assert lines[0] == CONTRACT_COLUMNS
    x, battery = CHANNEL_COLUMNS.index("x_m"), CHANNEL_COLUMNS.index("battery_v")
    cells = [line.split(",") for line in lines[1:]]
    assert [row[0] for row in cells] == ["0.0", "0.1", "0.2"]
    assert [row[x] for row in cells] == ["1.0", "0.3333333333333333", ""]
    assert [row[battery] for row in cells] == ["", "8.25", ""]


def test_tables_read_back_bit_for_bit(tmp_path: Path, make_run: MakeRun) -> None:
    data = make_run(5.0)
    write_truth(tmp_path / "truth.csv", data.truth)
    write_channels(tmp_path / "channels.csv", data.channels)
    truth = read_columns(tmp_path / "truth.csv")
    assert tuple(truth) == TRUTH_COLUMNS
    for name, values in data.truth.items():
        assert truth[name].value.tobytes() == values.tobytes()
    channels = read_columns(tmp_path / "channels.csv")
    for name in set(data.channels) & set(CHANNEL_COLUMNS):
        assert channels[name].value.tobytes() == data.channels[name].value.tobytes()
        assert channels[name].time_s.tobytes() == data.channels[name].time_s.tobytes()


def test_an_empty_run_gives_headers_only(tmp_path: Path) -> None:
    write_channels(tmp_path / "channels.csv", {})
    write_truth(tmp_path / "truth.csv", {"time_s": np.empty(0)})
    assert (tmp_path / "channels.csv").read_text() == CONTRACT_COLUMNS + "\n"
    assert (tmp_path / "truth.csv").read_text() == ",".join(TRUTH_COLUMNS) + "\n"
    assert read_columns(tmp_path / "truth.csv") == {}


def test_the_summary_has_the_keys_of_the_contract(make_run: MakeRun) -> None:
    data = make_run(20.0)
    document = summary(data)
    assert list(document) == [
        "scenario",
        "seed",
        "duration_s",
        "wall_s",
        "version",
        "trace_sha256",
        "metrics",
    ]
    assert list(document["metrics"]) == list(METRICS)
    assert document["metrics"]["turn_radius_m"] is None
    marked = summary(replace(data, interrupted=True))
    assert marked["interrupted"] is True


def test_the_summary_is_plain_json_whatever_the_metrics_are(make_run: MakeRun) -> None:
    data = make_run(20.0)
    strange = {"speed_m_s": np.float64(0.1), "spi_frames": np.int64(3), "energy_j": math.nan}
    metrics = json.loads(to_json(replace(data, metrics=strange)))["metrics"]
    assert (metrics["speed_m_s"], metrics["spi_frames"], metrics["energy_j"]) == (0.1, 3, None)


def circle(radius_m: float, period_s: float, duration_s: float) -> dict[str, np.ndarray]:
    time = np.arange(0.0, duration_s, 0.02)
    phase = 2 * math.pi * time / period_s
    wobble = 0.1 * np.sin(2 * math.pi * 0.9 * time)
    return {
        "time_s": time,
        "x_m": radius_m * np.sin(phase),
        "y_m": radius_m * (1 - np.cos(phase)),
        "heading_rad": np.angle(np.exp(1j * (phase + wobble))),
    }


def test_metrics_of_a_circle_are_its_radius_and_period() -> None:
    found = path_metrics(circle(0.275, 40.0, 90.0), 0.9)
    assert found["turn_radius_m"] == pytest.approx(0.275, rel=2e-3)
    assert found["turn_period_s"] == pytest.approx(40.0, rel=2e-3)
    chord = 2 * 0.275 * math.sin(math.pi * (10 / 0.9) / 40)
    assert found["speed_m_s"] == pytest.approx(chord / (10 / 0.9), rel=1e-3)
    assert found["path_length_m"] == pytest.approx(2 * math.pi * 0.275 * 90 / 40, rel=1e-3)


def test_straight_unsteady_and_short_runs_have_no_turn() -> None:
    straight = circle(1e4, 1e8, 60.0)
    assert path_metrics(straight, 0.9)["turn_radius_m"] is None
    bend = circle(0.3, 40.0, 60.0)
    bend["heading_rad"] = np.where(bend["time_s"] > 55.0, 1.0, 0.0)
    assert path_metrics(bend, 0.9)["turn_radius_m"] is None
    short = path_metrics(circle(0.3, 40.0, 5.0), 0.9)
    assert short["turn_radius_m"] is None
    assert short["speed_m_s"] is not None
    assert path_metrics(circle(0.3, 40.0, 5.0), 0.0)["speed_m_s"] is None
    none = path_metrics({name: np.empty(0) for name in straight}, 0.9)
    assert set(none.values()) == {None}


def test_a_run_folder_reads_back(tmp_path: Path, make_run: MakeRun) -> None:
    config = scenario.load("circle", ["scenario.seed=3"])
    data = replace(make_run(30.0, 0.16, seed=3), interrupted=True)
    with RunFolder(tmp_path / "run") as folder:
        write_run(folder, config, data)
        folder.commit()
    again = read_run_folder(tmp_path / "run")
    assert (again.scenario, again.seed, again.interrupted) == ("circle", 3, True)
    assert dict(again.metrics) == summary(data)["metrics"]
    for name, values in data.truth.items():
        assert again.truth[name].tobytes() == values.tobytes()
    assert again.tank.size_m == config.tank.size_m
    assert scenario.load(tmp_path / "run" / "scenario.toml") == config


def test_a_series_needs_as_many_values_as_times() -> None:
    with pytest.raises(ValueError, match="as many"):
        Series(np.zeros(3), np.zeros(2))


def test_what_a_plant_has_beyond_the_columns_stands_behind_them(
    make_run: Callable[..., RunData], tmp_path: Path
) -> None:
    truth = {"depth_m": make_run(1.0).truth["x_m"] + 1.0, **make_run(1.0).truth}
    write_truth(tmp_path / "truth.csv", truth, 5)
    header = (tmp_path / "truth.csv").read_text().partition("\n")[0]
    assert header.split(",") == [*TRUTH_COLUMNS, "depth_m"]
    read = read_columns(tmp_path / "truth.csv")
    assert np.array_equal(read["depth_m"].value, truth["depth_m"][::5])


@pytest.mark.parametrize("growth_per_s", [0.0, 0.02, -0.02])
def test_a_radius_that_still_changes_is_said_to(growth_per_s: float) -> None:
    time = np.arange(0.0, 30.0, 0.01)
    heading = 0.1 * time
    speed = 0.02 * np.exp(growth_per_s * time)  # at a constant rate the radius grows as the speed
    x, y = (np.cumsum(speed * part(heading)) * 0.01 for part in (np.cos, np.sin))
    truth = {"time_s": time, "x_m": x, "y_m": y, "heading_rad": heading}
    change = turn_change(truth, 1.0)
    # each half is averaged over a beat at both ends: their middles are five beats apart
    assert change == pytest.approx(math.expm1(5.0 * growth_per_s), abs=2e-3)
    assert (unsettled(truth, 1.0) == "") is (growth_per_s == 0.0)
    short = {name: values[:500] for name, values in truth.items()}
    assert unsettled(short, 1.0) == ""
