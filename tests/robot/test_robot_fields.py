"""Water from a file: the robot swims in it, its folder keeps it, and damage is told in one line."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from plant.grid_field import from_csv
from tools import scenario
from tools.bench import Bench
from tools.cli import main
from tools.field_files import COPIES
from tools.records.folder import RUN
from tools.records.read import read_run_folder

TABLE = "temperature_c,-0.5,0.5,2.5\n-0.6,18,20,24\n0.6,19,22,27\n"
SCENARIO = """\
[scenario]
name = "gridded"
duration_s = 3.0

[tank]
size_m = [3.0, 1.2]
corner_m = [-0.5, -0.6]

[tank.temperature]
file = "water/table.csv"

[tank.pollutant]
file = "oil.npz"
"""


@pytest.fixture
def place(tmp_path):
    """A scenario in one folder, its files beside and below it."""
    home = tmp_path / "scenarios"
    (home / "water").mkdir(parents=True)
    (home / "water" / "table.csv").write_text(TABLE, encoding="utf-8")
    np.savez(
        home / "oil.npz", x_m=[0.0, 1.0], y_m=[0.0, 1.0],
        pollutant_ug_l=np.array([[10.0, 30.0], [10.0, 30.0]]),
    )  # fmt: skip
    (home / "gridded.toml").write_text(SCENARIO, encoding="utf-8")
    return home


def test_truth_and_sensors_see_the_grid(place):
    bench = Bench.from_scenario(scenario.load(place / "gridded.toml"))
    bench.run(lambda _seconds: None, lambda: False)
    data = bench.run_data()
    field = from_csv(TABLE, "temperature_c")
    places = zip(data.truth["x_m"].tolist(), data.truth["y_m"].tolist(), strict=True)
    assert data.truth["temperature_c"].tolist() == [field.value(x, y) for x, y in places]
    seen = data.channels["temperature_c"].value
    assert abs(float(seen[-20:].mean()) - field.value(0.0, 0.0)) < 2.0  # TMP36: ±2 °C
    assert data.truth["pollutant_ug_l"][-1] == pytest.approx(10.0, abs=1.0)


def test_a_run_folder_keeps_its_own_water_and_replays(place, tmp_path, capsys, monkeypatch):
    out = tmp_path / "run"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)  # a file is meant relative to its scenario
    assert main(["run", str(place / "gridded.toml"), "--out", str(out), "--quiet"]) == 0
    assert (out / "temperature.csv").read_text(encoding="utf-8") == TABLE
    written = (out / "scenario.toml").read_text(encoding="utf-8")
    assert 'file = "temperature.csv"' in written
    assert str(tmp_path) not in written
    shutil.rmtree(place)  # whatever becomes of the original
    moved = tmp_path / "kept"
    out.rename(moved)
    assert main(["replay", str(moved), "--quiet"]) == 0
    assert read_run_folder(moved).truth["pollutant_ug_l"][-1] == pytest.approx(10.0, abs=1.0)
    # Other water, another trace: the copy is what is swum in.
    (moved / "temperature.csv").write_text(TABLE.replace("20", "25"), encoding="utf-8")
    assert main(["replay", str(moved), "--quiet"]) == 1
    assert "another trace" in capsys.readouterr().out
    # And a run without files over it leaves none of them behind.
    assert main(["run", "swim-forward", "--duration", "2", "--out", str(moved), "--quiet"]) == 0
    assert not set(COPIES) & {path.name for path in moved.iterdir()}


def test_on_the_command_line_a_file_is_meant_from_where_one_is(place, monkeypatch):
    monkeypatch.chdir(place)
    config = scenario.load("swim-forward", ['tank.temperature.file="water/table.csv"'])
    assert Bench.from_scenario(config).robot.temperature.value(-0.5, -0.6) == 18.0
    assert scenario.keys(scenario.load("swim-forward"))["tank.temperature.file"] == ""


BAD = {
    "missing": (None, "cannot be read: No such file"),
    "ragged": ("temperature_c,0,1\n0,20\n", "row 2: 2 cells, the first row has 3"),
    "kelvin": ("temperature_c,0,1\n0,293,294\n1,293,294\n", "row 2, column 2"),
    "binary": (b"\xff\xfe\x00", "not a text file in UTF-8"),
}


@pytest.mark.parametrize("case", BAD)
def test_damage_is_told_in_one_line_and_nothing_is_written(place, tmp_path, capsys, case):
    data, words = BAD[case]
    table = place / "water" / "table.csv"
    table.unlink()
    if data is not None:
        table.write_bytes(data if isinstance(data, bytes) else data.encode())
    out = tmp_path / "run"
    code = main(["run", str(place / "gridded.toml"), "--out", str(out), "--quiet"])
    told = capsys.readouterr()
    assert code == 2
    assert told.err.count("\n") == 1
    for part in ("tank.temperature.file", "table.csv", words):
        assert part in told.err
    assert not out.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scenarios"]


def test_other_kinds_of_file_are_refused(place, capsys):
    (place / "table.xlsx").write_bytes(b"PK")
    setting = f"tank.temperature.file={str(place / 'table.xlsx')!r}"
    assert main(["run", "swim-forward", "--set", setting, "--quiet"]) == 2
    assert "must end in .csv or .npz" in capsys.readouterr().err


def test_copies_are_files_of_a_run():
    assert set(COPIES) <= set(RUN.files)
