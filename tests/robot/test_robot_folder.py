"""What a run leaves: the tables of the contract, instruments that are no truth, a valid folder."""

from __future__ import annotations

import csv
import json
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools import scenario
from tools.records.folder import FILES, is_run_folder
from tools.records.read import read_run_folder

# Written here once more, from the contract: what users' scripts read must not change by itself.
COLUMNS = [
    "time_s", "tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz", "tail_command_rad", "x_m",
    "y_m", "heading_rad", "gyro_z_rad_s", "accel_x_m_s2", "accel_y_m_s2", "compass_rad", "gps_x_m",
    "gps_y_m", "tail_angle_rad", "battery_v", "servo_current_a", "temperature_c",
]  # fmt: skip
SUMMARY = {"scenario", "seed", "duration_s", "wall_s", "version", "trace_sha256", "metrics"}
METRICS = {
    "speed_m_s", "turn_radius_m", "turn_period_s", "path_length_m", "energy_j", "spi_frames",
    "spi_crc_errors", "spi_lost", "radio_sent", "radio_received", "samples_stored", "samples_lost",
}  # fmt: skip

# Column, its true column, the least and the largest spread of the difference that the instrument's
# noise, resolution and tolerance allow.
NOISY = (
    ("x_m", "x_m", 3e-4, 3e-3),
    ("y_m", "y_m", 3e-4, 3e-3),
    ("heading_rad", "heading_rad", 3e-3, 0.05),
    ("gyro_z_rad_s", "yaw_rate_rad_s", 1e-3, 0.05),
    ("compass_rad", "heading_rad", 1e-3, 0.1),
    ("tail_angle_rad", "tail_angle_rad", 1e-3, 0.02),
    ("battery_v", "battery_v", 2e-3, 0.05),
    ("servo_current_a", "servo_current_a", 1e-3, 0.05),
    ("temperature_c", "temperature_c", 0.02, 0.2),
    ("gps_x_m", "x_m", 0.01, 2.0),
    ("gps_y_m", "y_m", 0.01, 2.0),
)

ALL_FITTED = ("navboard.gps.fitted=true", "navboard.tail_potentiometer.fitted=true")


def table(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, rows


def filled(path: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a column's cells that are not empty."""
    header, rows = table(path)
    at = header.index(name)
    cells = [(float(row[0]), float(row[at])) for row in rows if row[at]]
    return tuple(np.array(cells).T) if cells else (np.empty(0), np.empty(0))


@pytest.fixture
def run(swim: Any) -> Any:
    return swim("swim-forward", *ALL_FITTED, duration_s=8.0, keep=True)


def test_the_folder_has_the_files_and_keys_of_the_contract(run: Any) -> None:
    assert sorted(entry.name for entry in run.folder.iterdir()) == sorted(FILES)
    assert all((run.folder / name).stat().st_size > 100 for name in FILES)
    summary = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
    assert summary.keys() >= SUMMARY
    assert summary["metrics"].keys() >= METRICS
    assert summary["trace_sha256"] == run.data.trace_sha256
    assert "interrupted" not in summary


def test_channels_have_the_columns_of_the_contract_and_times_that_rise(run: Any) -> None:
    header, rows = table(run.folder / "channels.csv")
    assert header == COLUMNS
    times = [float(row[0]) for row in rows]
    assert times == sorted(set(times))
    assert all(any(row[1:]) for row in rows), "a row without any sample"
    assert all(len(row) == len(COLUMNS) for row in rows)


@pytest.mark.parametrize(
    ("name", "per_second"),
    [
        ("tail_command_rad", 50), ("gyro_z_rad_s", 50), ("accel_x_m_s2", 25), ("compass_rad", 15),
        ("x_m", 30), ("gps_x_m", 1), ("battery_v", 10),
    ],
)  # fmt: skip
def test_every_channel_has_samples_at_its_own_rate_and_empty_cells_between(
    run: Any, name: str, per_second: int
) -> None:
    times, _ = filled(run.folder / "channels.csv", name)
    _, rows = table(run.folder / "channels.csv")
    assert times.size == pytest.approx(8 * per_second, abs=max(2.5, 0.03 * 8 * per_second))
    assert times.size < len(rows)


def test_what_is_not_fitted_is_empty(swim: Any) -> None:
    run = swim("swim-forward", "camera.fitted=false", duration_s=1.0, keep=True)
    for name in ("gps_x_m", "gps_y_m", "tail_angle_rad", "x_m", "y_m", "heading_rad"):
        times, _ = filled(run.folder / "channels.csv", name)
        assert times.size == 0
    times, _ = filled(run.folder / "channels.csv", "gyro_z_rad_s")
    assert times.size > 40


@pytest.mark.parametrize(("name", "true_name", "least", "most"), NOISY)
def test_channels_are_never_the_truth_and_never_far_from_it(
    run: Any, name: str, true_name: str, least: float, most: float
) -> None:
    times, values = filled(run.folder / "channels.csv", name)
    true_times, truth = filled(run.folder / "truth.csv", true_name)
    inside = (times > 1.0) & (times < true_times[-1])
    error = values[inside] - np.interp(times[inside], true_times, truth)
    if "heading" in name or "compass" in name:
        error = (error + np.pi) % (2 * np.pi) - np.pi
    assert not np.any(error == 0.0)
    if name.startswith("gps"):
        assert least < np.abs(error).max() < 5 * most
    else:
        assert least < error.std() < most


def test_the_folder_reads_back(run: Any) -> None:
    read = read_run_folder(run.folder)
    assert scenario.load(run.folder / "scenario.toml") == run.config
    assert read.trace_sha256 == run.data.trace_sha256
    for name, series in read.channels.items():
        assert np.array_equal(series.value, run.data.channels[name].value)
    for name, column in read.truth.items():
        kept = run.data.truth[name][:: run.data.truth_every]
        assert np.array_equal(column, kept[~np.isnan(kept)])


def test_ctrl_c_leaves_a_valid_marked_folder(
    start_fishbed: Callable[..., Any], fishbed: Callable[..., Any], tmp_path: Path
) -> None:
    """SIGINT to the process as a terminal sends it, at whatever moment it comes."""
    out = tmp_path / "run"
    # Much traffic, so that the first blocks of it are soon full.
    options = ("--set", "navboard.report_period_s=0.02", "--duration", "900000", "--quiet")
    process = start_fishbed("run", "circle", *options, "--out", str(out), cwd=tmp_path)
    # It swims once bytes of it have reached the disk; how soon that is does not matter.
    while process.poll() is None:
        if any(file.stat().st_size > 0 for file in tmp_path.glob(".run.*/spi.vcd")):
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, complained = process.communicate(timeout=60)
    assert process.returncode == 130, complained
    assert said == ""
    assert "Traceback" not in complained

    assert [entry.name for entry in tmp_path.iterdir()] == ["run"], "something is left over"
    assert is_run_folder(out)
    assert sorted(entry.name for entry in out.iterdir()) == sorted(FILES)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["interrupted"] is True
    assert 0 < summary["duration_s"] < 900_000
    assert "interrupted" in (out / "report.html").read_text(encoding="utf-8")
    read = read_run_folder(out)
    assert read.interrupted
    assert read.truth["time_s"][-1] == pytest.approx(summary["duration_s"], abs=0.05)
    header, rows = table(out / "channels.csv")
    assert header == COLUMNS
    assert float(rows[-1][0]) == pytest.approx(summary["duration_s"], abs=0.1)
    # As far as it came it can be repeated.
    done = fishbed("replay", str(out), "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["same"] is True


@pytest.mark.parametrize(
    "sets",
    [
        ("--set", 'procboard.application="telemetry"'),
        ("--set", "procboard.tail_beat.amplitude_rad=0.0"),
        ("--set", "battery.initial_charge=0.0"),
        ("--set", "plant.servo.ideal=true"),
        ("--duration", "0.01"),
    ],
)
def test_a_robot_that_hardly_moves_is_reported_too(
    fishbed: Callable[..., Any], tmp_path: Path, sets: tuple[str, ...]
) -> None:
    options = () if "--duration" in sets else ("--duration", "25")
    done = fishbed("run", *sets, *options, "--quiet", "--out", str(tmp_path / "run"))
    assert (done.code, done.err) == (0, "")
    assert is_run_folder(tmp_path / "run")
