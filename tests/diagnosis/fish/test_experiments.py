"""Experiments as people hand them in: each kind of bad data is recognised, said, and dealt with."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plant.robots import wang2014
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tools.diagnosis.data.experiment import believed_model, read_experiment
from tools.diagnosis.fish.model import FishModel
from tools.errors import UserError

BEAT = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
HEADER = ["time_s", *BEAT, *NAMES]
Rows = list[list[str]]
Change = Callable[[list[str], Rows], tuple[list[str], Rows]]


@cache
def measured() -> tuple[tuple[str, ...], ...]:
    """A run of 40 s as cells: a row for each moment, empty where nothing was sampled."""
    model = FishModel(wang2014(), NAMES)
    run = model.draw(blank(31, 40.0), {}, NOISE, np.random.default_rng(31))
    rows: dict[float, dict[str, str]] = {}
    programme = run.inputs.programme
    for start, beat in zip(programme.starts_s, programme.beats, strict=True):
        told = (beat.bias_rad, beat.amplitude_rad, beat.frequency_hz)
        rows.setdefault(start, {}).update(zip(BEAT, map(repr, told), strict=True))
    for time_s, channel, value in zip(run.time_s, run.channel, run.value, strict=True):
        rows.setdefault(round(float(time_s), 6), {})[NAMES[channel]] = f"{value:.9g}"
    return tuple(
        (repr(at), *(rows[at].get(name, "") for name in HEADER[1:])) for at in sorted(rows)
    )


def experiment(
    folder: Path,
    change: Change = lambda header, rows: (header, rows),
    runs: int = 2,
    toml: str = 'scenario = "wang2014"\n',
) -> Path:
    header, rows = change([*HEADER], [[*row] for row in measured()])
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    for run in range(runs):
        (folder / f"run{run + 1:02d}.csv").write_text(text.getvalue())
        toml += f'[[runs]]\nfile = "run{run + 1:02d}.csv"\n'
    (folder / "experiment.toml").write_text(toml)
    return folder


def times(*scales: tuple[str, float]) -> Change:
    def change(header: list[str], rows: Rows) -> tuple[list[str], Rows]:
        for name, scale in scales:
            place = header.index(name)
            for row in rows:
                if row[place]:
                    row[place] = repr(float(row[place]) * scale)
        return header, rows

    return change


def cell(row: int, name: str, text: str) -> Change:
    def change(header: list[str], rows: Rows) -> tuple[list[str], Rows]:
        rows[row][header.index(name)] = text
        return header, rows

    return change


def all_of(name: str, text: str) -> Change:
    def change(header: list[str], rows: Rows) -> tuple[list[str], Rows]:
        place = header.index(name)
        for row in rows:
            row[place] = text if row[place] else ""
        return header, rows

    return change


DEGREE = 180.0 / math.pi

REFUSED: dict[str, tuple[Change, str]] = {
    "heading in degrees": (
        times(("heading_rad", DEGREE)),
        r"heading_rad.*degrees.*= 0\.0174",
    ),
    "compass in degrees": (times(("compass_rad", DEGREE)), r"compass_rad.*degrees"),
    "gyro in degrees": (times(("gyro_z_rad_s", DEGREE)), r"gyro_z_rad_s.*degrees per second"),
    "all in degrees": (
        times(("gyro_z_rad_s", DEGREE), ("heading_rad", DEGREE), ("compass_rad", DEGREE)),
        "degrees",
    ),
    "clock in milliseconds": (times(("time_s", 1e3)), r"milliseconds.*scale = 0\.001"),
    "clock in microseconds": (times(("time_s", 1e6)), "microseconds"),
    "place in centimetres": (times(("x_m", 100.0), ("y_m", 100.0)), r"centimetres.*0\.01"),
    "place in millimetres": (times(("x_m", 1e3), ("y_m", 1e3)), "millimetres"),
    "heading clockwise": (times(("heading_rad", -1.0)), r"other way.*scale = -1"),
    "tail in degrees": (times(("tail_bias_rad", DEGREE)), r"tail_bias_rad.*no tail angle"),
    "a word": (cell(100, "x_m", "abc"), r"run01\.csv, row 102, column x_m: 'abc'"),
    "a decimal comma": (cell(100, "x_m", "0,5"), "decimal commas"),
    "no time": (cell(7, "time_s", ""), "row 9, column time_s: the time is missing"),
    "a clock that was set back": (
        lambda header, rows: (
            header,
            rows[:900] + [[repr(float(row[0]) - 3.0), *row[1:]] for row in rows[900:]],
        ),
        r"row 902, column time_s: time goes back.*cut the file",
    ),
    "no commands": (
        lambda header, rows: ([header[0], *header[4:]], [[row[0], *row[4:]] for row in rows]),
        "says not what the tail was told",
    ),
    "nothing measured": (
        lambda header, rows: (header[:4], [row[:4] for row in rows]),
        "no measured channel",
    ),
    "no rows": (lambda header, rows: (header, []), "empty"),
    "too short": (lambda header, rows: (header, rows[:200]), "long enough"),
    "a missing cell": (
        lambda header, rows: (header, [*rows[:5], rows[5][:-1], *rows[6:]]),
        "row 7: has 8 cells, the header 9",
    ),
    "two columns of one name": (
        lambda header, rows: ([*header[:-1], "x_m"], rows),
        "two columns are called x_m",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    change, says = REFUSED[case]
    place = experiment(tmp_path, change)
    with pytest.raises(UserError, match=says) as error:
        believed_model(read_experiment(place))
    assert "\n" not in str(error.value)


HANDLED: dict[str, tuple[Change, str, str]] = {
    "not a number": (cell(100, "gyro_z_rad_s", "NaN"), "nan", "row 102, column gyro_z_rad_s"),
    "infinity": (cell(50, "x_m", "inf"), "nan", "row 52, column x_m"),
    "an instrument that is stuck": (
        all_of("gyro_z_rad_s", "0.25"),
        "constant",
        "column gyro_z_rad_s: is 0.25",
    ),
    "a gap": (
        lambda header, rows: (header, [row for row in rows if not 12.0 < float(row[0]) < 16.0]),
        "gap",
        "nothing for 4",
    ),
    "a row twice": (
        lambda header, rows: (header, [*rows[:501], rows[500], *rows[501:]]),
        "repeated",
        "row 503",
    ),
    "two rows exchanged": (
        lambda header, rows: (header, [*rows[:300], rows[301], rows[300], *rows[302:]]),
        "decreasing",
        "rows in the wrong place were sorted",
    ),
    "a column that nobody knows": (
        lambda header, rows: ([*header[:-2], "gyro_z_rads", header[-1]], rows),
        "unknown column",
        "is it gyro_z_rad_s?",
    ),
}


@pytest.mark.parametrize("case", HANDLED)
def test_what_can_be_handled_is_said(case: str, tmp_path: Path) -> None:
    change, kind, says = HANDLED[case]
    found = read_experiment(experiment(tmp_path, change))
    notices = [notice for notice in found.notices if notice.kind == kind]
    assert any(says in notice.text for notice in notices), found.notices
    assert all("\n" not in notice.text for notice in notices)
    model = believed_model(found)
    for run in found.runs:
        assert np.all(np.isfinite(run.value))
        assert np.all(np.diff(run.time_s) >= 0.0)
        fixed = model.filter(run, {}, model.first_noise(found.runs))
        whitened = model.innovations(run, {}, fixed) / np.sqrt(fixed.variance)
        assert np.mean(np.square(whitened)) < 3.0


def test_whole_data_are_read_without_a_word(tmp_path: Path) -> None:
    found = read_experiment(experiment(tmp_path))
    assert found.notices == ()
    assert found.channels == NAMES
    assert [run.name for run in found.runs] == ["run01.csv", "run02.csv"]
    assert all(run.at_rest and run.held_out is None for run in found.runs)
    programme = found.runs[0].inputs.programme
    assert programme == blank(31, 40.0).inputs.programme


def test_the_files_are_left_alone(tmp_path: Path) -> None:
    place = experiment(tmp_path, cell(100, "gyro_z_rad_s", "NaN"))

    def state() -> dict[str, str]:
        return {
            file.name: hashlib.sha256(file.read_bytes()).hexdigest() + str(file.stat().st_mtime_ns)
            for file in sorted(place.iterdir())
        }

    before = state()
    believed_model(read_experiment(place))
    assert state() == before


def test_columns_and_scales_may_be_named(tmp_path: Path) -> None:
    def change(header: list[str], rows: Rows) -> tuple[list[str], Rows]:
        header, rows = times(("heading_rad", DEGREE), ("time_s", 1e3))(header, rows)
        return ["t", *header[1:-3], "psi", *header[-2:]], rows

    toml = (
        '[channels.heading_rad]\ncolumn = "psi"\nscale = 0.017453292519943295\nsigma = 0.01\n'
        '[channels.time_s]\ncolumn = "t"\nscale = 0.001\n'
    )
    found = read_experiment(experiment(tmp_path, change, toml=toml))
    assert found.notices == ()
    plain = tmp_path / "plain"
    plain.mkdir()
    same = read_experiment(experiment(plain))
    assert found.runs[0].value == pytest.approx(same.runs[0].value)
    assert found.runs[0].time_s == pytest.approx(same.runs[0].time_s)
    channels = {channel.name: channel for channel in believed_model(found).channels}
    assert channels["heading_rad"].sigma == 0.01
    assert channels["x_m"].sigma is None


def test_a_single_run_is_cut_into_pieces_that_go_on(tmp_path: Path) -> None:
    found = read_experiment(experiment(tmp_path, runs=1))
    assert [notice.kind for notice in found.notices] == ["single run"]
    assert len(found.runs) == 2
    assert [run.at_rest for run in found.runs] == [True, False]
    model = believed_model(found)
    for run in found.runs:
        fixed = model.filter(run, {}, NOISE)
        whitened = model.innovations(run, {}, fixed) / np.sqrt(fixed.variance)
        assert np.mean(np.square(whitened)) < 1.2


SAID: dict[str, tuple[str, str]] = {
    "an unknown key": ('scenari = "wang2014"\n', "scenari"),
    "an unknown scenario": ('scenario = "wang2015"\n', "no scenario of this name"),
    "a wrong override": ('[set]\n"plant.body.mass" = 1.0\n', r"\[set\].*mass_kg"),
    "an unknown channel": ("[channels.gyro]\nscale = 2.0\n", "no such channel"),
    "a wrong sigma": ("[channels.x_m]\nsigma = -1.0\n", "sigma"),
    "no TOML": ("scenario = wang2014\n", "not valid TOML"),
}


@pytest.mark.parametrize("case", SAID)
def test_mistakes_in_the_description_are_said(case: str, tmp_path: Path) -> None:
    toml, says = SAID[case]
    with pytest.raises(UserError, match=says) as error:
        read_experiment(experiment(tmp_path, toml=toml))
    assert "experiment.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "experiment.toml").write_text('[[runs]]\nfile = "gone.csv"\n')
    with pytest.raises(UserError, match=r"gone\.csv"):
        read_experiment(tmp_path)


def test_a_folder_without_an_experiment_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"holds no experiment\.toml and no run folder"):
        read_experiment(tmp_path)
