"""Data that look like numbers and are none: other units, spikes, times apart, wrong descriptions.

Each rule is tried on what it must find, and on honest data, in which it must find nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tests.diagnosis.fish.test_experiments import DEGREE, cell, experiment, measured, times
from tests.diagnosis.fish.test_steady import table
from tools import scenario
from tools.bench.bench import Bench
from tools.diagnosis.data.course import check_course
from tools.diagnosis.data.experiment import believed_model, read_experiment
from tools.diagnosis.data.notice import Notice
from tools.diagnosis.data.pieces import between
from tools.diagnosis.data.spikes import AROUND, FASTEST, LARGEST, spikes
from tools.diagnosis.data.units import check_units
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray, Noise, Run
from tools.errors import UserError
from tools.practice.experiment import Effect, shape_of, swim_experiment
from tools.practice.hidden import HIDDEN


def refused(place: Path) -> str:
    with pytest.raises(UserError) as error:
        believed_model(read_experiment(place))
    assert "\n" not in str(error.value)
    return str(error.value)


# The description

MISTAKES: dict[str, tuple[str, str]] = {
    "scale nan": ("[channels.x_m]\nscale = nan\n", "[channels.x_m] scale = nan: must be a finite"),
    "scale inf": ("[channels.x_m]\nscale = inf\n", "[channels.x_m] scale = inf: must be a finite"),
    "scale 0": ("[channels.time_s]\nscale = 0\n", "[channels.time_s] scale = 0: must be"),
    "negative time": ("[channels.time_s]\nscale = -1\n", "scale = -1: must be above zero"),
    "sigma inf": ("[channels.y_m]\nsigma = inf\n", "[channels.y_m] sigma = inf: must be a finite"),
    "sigma nan": ("[channels.y_m]\nsigma = nan\n", "[channels.y_m] sigma = nan"),
    "sigma 0": ("[channels.y_m]\nsigma = 0\n", "[channels.y_m] sigma = 0: must be a finite"),
    "sigma below 0": ("[channels.y_m]\nsigma = -2\n", "[channels.y_m] sigma = -2"),
    "sigma in words": (
        '[channels.x_m]\nsigma = 1.0\n[channels.y_m]\nsigma = "low"\n',
        "[channels.y_m] sigma: expected",
    ),
    "sigma of a clock": ("[channels.time_s]\nsigma = 1\n", "has no noise to be told"),
    "no such column": (
        '[channels.gyro_z_rad_s]\ncolumn = "gyro_z_rads"\n',
        "no file has such a column (is it gyro_z_rad_s?)",
    ),
    "one column for two": (
        '[channels.x_m]\ncolumn = "x"\n[channels.y_m]\ncolumn = "x"\n',
        "is that of [channels.x_m] too",
    ),
    "a quote": (
        '[set]\n"plant.body.mass_kg" = "heavy \\"quote\\" \\\\"\n',
        'plant.body.mass_kg = \'heavy "quote"',
    ),
    "a nested table": ("[set.plant.body]\nmass_kg = 1\n", "[set] plant (write whole keys in quo"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_in_the_description_have_a_place(case: str, tmp_path: Path) -> None:
    toml, says = MISTAKES[case]
    told = refused(experiment(tmp_path, toml=toml))
    assert says in told
    assert "experiment.toml" in told


def test_a_run_is_listed_once(tmp_path: Path) -> None:
    place = experiment(tmp_path, runs=1)
    file = place / "experiment.toml"
    file.write_text(file.read_text() + '[[runs]]\nfile = "./run01.csv"\n')
    assert "is listed twice" in refused(place)


def test_a_column_that_some_files_lack_is_said(tmp_path: Path) -> None:
    place = experiment(tmp_path, toml='[channels.gyro_z_rad_s]\ncolumn = "w"\n')
    (place / "run01.csv").write_text(
        (place / "run01.csv").read_text().replace("gyro_z_rad_s", "w", 1)
    )
    found = read_experiment(place)
    assert any("no column w in run02.csv" in notice.text for notice in found.notices)


def test_renamed_columns_do_not_make_a_run_of_steady_motion(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    place = experiment(
        run,
        lambda header, rows: (
            ["t", *header[1:], "speed_m_s"],
            [[*row, "0.02"] for row in rows],
        ),
        toml='[channels.time_s]\ncolumn = "t"\n',
    )
    assert not read_experiment(place).steady
    (tmp_path / "table.csv").write_text(
        table().replace("turn_radius_m", "R").replace("turn_period_s", "T")
    )
    (tmp_path / "experiment.toml").write_text(
        'runs = [{file = "table.csv"}]\n[channels.turn_radius_m]\ncolumn = "R"\n'
    )
    assert read_experiment(tmp_path).steady


# Units


def swum(bias: float, duration_s: float = 40.0, amplitude: float = 0.3) -> Run:
    """A run with one beat from rest, in still water and with good instruments."""
    inputs = FishInputs(TailProgramme.steady(TailBeat(bias, amplitude, 0.9)))
    run = replace(blank(7, duration_s), inputs=inputs)
    model = FishModel(wang2014(), NAMES)
    still = Noise(0.3 * NOISE.sigma, 0.0 * NOISE.disturbance, NOISE.correlation_s)
    return model.draw(run, {}, still, np.random.default_rng(7))


def of(run: Run, *names: str) -> Run:
    """Only some channels of a run."""
    kept = [NAMES.index(name) for name in names]
    here = np.isin(run.channel, kept)
    return replace(
        run,
        time_s=run.time_s[here],
        channel=np.searchsorted(kept, run.channel[here]),
        value=run.value[here],
    )


def scaled(run: Run, names: tuple[str, ...], **scales: float) -> Run:
    value = run.value.copy()
    for name, scale in scales.items():
        value[run.channel == names.index(name)] *= scale
    return replace(run, value=value)


@pytest.mark.parametrize("bias", [0.0, 0.4])
@pytest.mark.parametrize("names", [("x_m", "y_m", "heading_rad"), NAMES, ("compass_rad",)])
def test_degrees_are_seen_on_a_straight_way_too(names: tuple[str, ...], bias: float) -> None:
    run = of(between(swum(bias, 60.0, 0.15), 30.0, 60.0), *names)
    model = FishModel(wang2014(), names)
    check_units(model, (run,))
    angle = "heading_rad" if "heading_rad" in names else "compass_rad"
    straight = scaled(run, names, **{angle: DEGREE})
    if bias == 0.0:  # fewer of them than radians in a turn
        assert np.ptp(straight.value[run.channel == names.index(angle)]) < 7.0
    with pytest.raises(UserError, match=rf"{angle}.*degrees"):
        check_units(model, (straight,))


def test_minutes_are_no_degrees_and_no_centimetres() -> None:
    run = swum(0.3, 400.0)
    programme = TailProgramme((TailBeat(0.3, 0.3, 0.9),), (0.0,))
    slow = replace(run, time_s=run.time_s / 60.0, inputs=FishInputs(programme))
    for names in (NAMES, ("x_m", "y_m")):
        with pytest.raises(UserError, match=r"minutes.*scale = 60"):
            check_units(FishModel(wang2014(), names), (of(slow, *names),))


def test_short_runs_may_be_minutes(tmp_path: Path) -> None:
    assert "are these minutes?" in refused(experiment(tmp_path, times(("time_s", 1.0 / 60.0))))


LENGTHS = {
    "inches": (1 / 0.0254, "inches (scale = 0.0254)"),
    "cm": (100.0, "centimetres (scale = 0.01)"),
}


@pytest.mark.parametrize("unit", LENGTHS)
def test_the_nearest_unit_of_length_is_named_first(unit: str, tmp_path: Path) -> None:
    scale, says = LENGTHS[unit]
    told = refused(experiment(tmp_path, times(("x_m", scale), ("y_m", scale))))
    assert f"these are {says}" in told


def test_one_axis_alone_is_named(tmp_path: Path) -> None:
    told = refused(experiment(tmp_path, times(("x_m", 100.0))))
    assert "column x_m: moves" in told
    assert "[channels.y_m]" not in told


def test_milliseconds_are_seen_though_rows_are_exchanged(tmp_path: Path) -> None:
    def change(header: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
        header, rows = times(("time_s", 1e3))(header, rows)
        return header, [*rows[:300], rows[301], rows[300], *rows[302:]]

    assert "milliseconds" in refused(experiment(tmp_path, change))


@pytest.mark.parametrize("names", [("x_m", "gyro_z_rad_s"), ("heading_rad",), ("compass_rad",)])
def test_a_frequency_in_radians_per_second_is_seen(names: tuple[str, ...]) -> None:
    run = of(swum(0.3), *names)
    model = FishModel(wang2014(), names)
    told = TailBeat(0.3, 0.3, 0.9 * 2.0 * math.pi)
    wrong = replace(run, inputs=FishInputs(TailProgramme.steady(told)))
    with pytest.raises(UserError, match=r"wags 0\.9 times a second.*scale = 0\.1591549"):
        check_units(model, (wrong,))


def test_a_fast_tail_is_none() -> None:
    inputs = FishInputs(TailProgramme.steady(TailBeat(0.2, 0.15, 4.0)))
    model = FishModel(wang2014(), NAMES)
    fast = model.draw(replace(blank(3), inputs=inputs), {}, NOISE, np.random.default_rng(3))
    check_units(model, (fast,))


def test_a_tail_command_in_degrees_is_seen(tmp_path: Path) -> None:
    def change(header: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
        told = [repr(20.0 * math.sin(6.0 * float(row[0]))) for row in rows]
        kept = [[row[0], text, *row[4:]] for row, text in zip(rows, told, strict=True)]
        return [header[0], "tail_command_rad", *header[4:]], kept

    assert "tail_command_rad: 20 is no tail angle" in refused(experiment(tmp_path, change))


def test_latitude_and_longitude_are_seen() -> None:
    names = ("gps_x_m", "gps_y_m", "gyro_z_rad_s")
    model = FishModel(wang2014(), names)
    inputs = FishInputs(TailProgramme.steady(TailBeat(0.0, 0.3, 0.9)))
    time_s = np.repeat(np.arange(40.0), 3)
    channel = np.tile(np.arange(3), 40)
    empty = Run("gps", time_s, channel, np.zeros(120), inputs)
    noise = Noise(np.array([1.0, 1.0, 0.01]), NOISE.disturbance, NOISE.correlation_s)
    run = model.draw(empty, {}, noise, np.random.default_rng(1))
    check_units(model, (run,))
    degrees = run.value / 111320.0 + np.array([42.7, -84.4, 0.0])[channel]
    degrees[channel == 2] = run.value[channel == 2]
    with pytest.raises(UserError, match="latitude and longitude"):
        check_units(model, (replace(run, value=degrees),))


def test_a_heading_that_is_not_followed_is_said() -> None:
    run = swum(0.0)
    notices: list[Notice] = []
    check_course(run, NAMES, notices)
    assert notices == []
    check_course(scaled(run, NAMES, heading_rad=20.0 * DEGREE), NAMES, notices)
    assert [notice.kind for notice in notices] == ["course"]


# Spikes and times apart


def channels(seed: int, *names: str) -> list[tuple[str, FloatArray, FloatArray]]:
    """Times and samples of a laboratory's run, with effects hidden in it or healthy."""
    effects = tuple(Effect(name, HIDDEN[name].most, shape_of(name, seed)) for name in names)
    series = swim_experiment(seed, effects, 1, 15.0)
    return [
        (name, each.time_s[kept], each.value[kept])
        for run in series.values()
        for name, each in run.items()
        if name in LARGEST
        for kept in (np.isfinite(each.value),)
    ]


@cache
def emulated() -> list[tuple[str, FloatArray, FloatArray]]:
    """All channels that the emulated robot's boards record, in a short run."""
    bench = Bench.from_scenario(scenario.load("fishbed-robot", duration_s=6.0))
    bench.run(lambda seconds: None, lambda: False)
    found = bench.run_data(compare=False).channels
    return [(name, s.time_s, s.value) for name, s in found.items() if name in LARGEST]


HONEST = [(seed,) for seed in range(60, 66)] + [
    (67, name) for name in HIDDEN if name != "tail_flexibility"
]


@pytest.mark.parametrize("asked", HONEST, ids=str)
def test_no_spike_is_found_in_honest_data(asked: tuple[int, ...]) -> None:
    for name, time_s, values in channels(*asked):
        for unit in (1.0, 100.0, 1e3) if name in ("x_m", "y_m") else (1.0, DEGREE):
            assert not spikes(name, time_s, unit * values).any(), (name, unit)


def test_no_spike_is_found_in_the_emulated_robots_records() -> None:
    assert {"battery_v", "accel_x_m_s2", "gyro_z_rad_s", "x_m"} <= {n for n, _, _ in emulated()}
    for name, time_s, values in emulated():
        assert not spikes(name, time_s, values).any(), name


@pytest.mark.parametrize("seed", range(5))
def test_spikes_are_found_wherever_they_are(seed: int) -> None:
    draw = np.random.default_rng(seed)
    for name, time_s, values in [*channels(60 + seed), *emulated()]:
        usual = np.median(np.abs(np.diff(values)))
        spent_s = float(np.max(time_s[2 * AROUND :] - time_s[: -2 * AROUND]))
        least = LARGEST[name] + FASTEST.get(name, 0.0) * spent_s + 200.0 * usual + np.ptp(values)
        first = int(draw.integers(0, values.size - AROUND))
        rows = np.arange(first, first + int(draw.integers(1, AROUND - 1)))
        if first < AROUND or first > values.size - 2 * AROUND:
            rows = rows[:1]
        size = least * 10.0 ** draw.uniform(0.0, 300.0 if seed else 1.0)
        wrong = values.copy()
        wrong[rows] += size * draw.choice([-1.0, 1.0])
        assert np.array_equal(np.flatnonzero(spikes(name, time_s, wrong)), rows), (name, rows, size)


def test_a_spike_is_set_aside_and_said(tmp_path: Path) -> None:
    row = next(i for i, cells in enumerate(measured()) if i > 500 and cells[4])
    plain, spoilt = tmp_path / "plain", tmp_path / "spoilt"
    plain.mkdir()
    spoilt.mkdir()
    found = read_experiment(experiment(spoilt, cell(row, "x_m", "1e9")))
    (first, _) = [notice.text for notice in found.notices if notice.kind == "spike"]
    assert first.startswith(f"run01.csv, row {row + 2}, column x_m: 1e+09 lies beyond all reach")
    whole = read_experiment(experiment(plain))
    assert found.runs[0].value.size == whole.runs[0].value.size - 1


def test_an_instrument_of_spikes_is_refused(tmp_path: Path) -> None:
    def change(header: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
        place = header.index("x_m")
        full = [row for row in rows if row[place]]
        for row in full[::20]:
            row[place] = "1e6"
        return header, rows

    told = refused(experiment(tmp_path, change))
    assert "column x_m: 1e+06 lies beyond all reach of its neighbours, and so do" in told


@pytest.mark.parametrize("row", [0, 700, -1])
@pytest.mark.parametrize("text", ["1e300", "-1e300", "86400"])
def test_a_time_apart_is_set_aside(row: int, text: str, tmp_path: Path) -> None:
    moved = {0: "-1e300", 700: text, -1: text}[row]
    found = read_experiment(experiment(tmp_path, cell(row, "time_s", moved)))
    strays = [notice for notice in found.notices if notice.kind == "stray time"]
    assert len(strays) == 2
    assert "stands apart from all other times" in strays[0].text
    assert all(run.time_s[-1] < 41.0 for run in found.runs)
    believed_model(found)


@pytest.mark.parametrize("runs", [1, 2])
def test_a_run_is_cut_where_nothing_was_recorded_for_hours(runs: int, tmp_path: Path) -> None:
    def change(header: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
        beat_s = 1.0 / float(rows[0][header.index("tail_frequency_hz")])
        hours = round(36000.0 / beat_s) * beat_s  # the tail went on meanwhile
        late = [[repr(float(row[0]) + hours), *row[1:]] for row in rows[1200:]]
        return header, rows[:1200] + late

    found = read_experiment(experiment(tmp_path, change, runs=runs))
    assert len(found.runs) == 2 * runs
    assert [run.at_rest for run in found.runs] == [True, False] * runs
    assert sum("nothing at all for 3.6e+04 s" in notice.text for notice in found.notices) == runs
    model = believed_model(found)
    for run in found.runs:
        fixed = model.filter(run, {}, NOISE)
        whitened = model.innovations(run, {}, fixed) / np.sqrt(fixed.variance)
        assert np.mean(np.square(whitened)) < 1.3


@pytest.mark.parametrize("name", [name for name in HIDDEN if name != "tail_flexibility"])
def test_no_unit_is_doubted_in_honest_data(name: str, tmp_path: Path) -> None:
    from tools.practice import folder

    effects = (Effect(name, HIDDEN[name].most, shape_of(name, 5)),)
    series = swim_experiment(5, effects, 2, 20.0)
    folder.write(tmp_path, "set", "wang2014", series, folder.answer(5, "one", 0.0, effects))
    found = read_experiment(tmp_path)
    assert {notice.kind for notice in found.notices} <= {"course"}
    believed_model(found)
