"""What is believed to be wrong already is the neutral point: found once, it is not found again."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plant.packing import pack
from tests.diagnosis.fish.fish_runs import NOISE
from tests.diagnosis.fish.test_experiments import experiment
from tests.diagnosis.fish.test_steady import table
from tools import scenario
from tools.configuration import Scenario
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.command import EXTENDED, with_files
from tools.diagnosis.data.experiment import (
    Experiment,
    believed_model,
    fish_model,
    read_experiment,
)
from tools.diagnosis.engine import diagnose
from tools.diagnosis.extended import extended
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Run
from tools.diagnosis.options import Options
from tools.effects import ALL, INSTRUMENTS
from tools.practice import folder
from tools.practice.experiment import Effect, shape_of, swim_experiment
from tools.practice.hidden import HIDDEN
from tools.practice.strength import sized

NAMED = [name for name in CAUSES if name != "unknown_force"]


def sizes(name: str) -> dict[str, float]:
    """Values of a cause that matter, within what a robot can be."""
    cause = CAUSES[name].cause
    if name == "tail_body_coupling":
        return cause.values(-0.2)
    return {p.name: 3.0 * p.scale if p.most > 0.0 else -p.scale for p in cause.parameters}


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return read_experiment(experiment(tmp_path_factory.mktemp("measured")))


def model_of(measured: Experiment, config: Scenario) -> FishModel:
    return fish_model(replace(measured, config=config))


@pytest.mark.parametrize("name", [*NAMED, "unknown_force"])
def test_who_believes_what_was_found_predicts_it(name: str, measured: Experiment) -> None:
    assert name in ALL
    values = sizes(name) if name in NAMED else {"unknown_force.surge:u|u|": -0.06}
    first = model_of(measured, measured.config)
    again = model_of(measured, extended(measured.config, values).config)
    run = cut(measured.runs[0], 5.0 if name == "tail_flexibility" else 14.0)
    noise = first.first_noise([run])
    fixed = first.filter(run, {}, noise)
    found = first.innovations(run, values, fixed)
    assert again.innovations(run, {}, fixed) == pytest.approx(found, rel=1e-7, abs=1e-9)
    assert again.replay(run, {}) == pytest.approx(first.replay(run, values), rel=1e-7, abs=1e-9)
    assert np.abs(found - first.innovations(run, {}, fixed)).max() > 1e-5 or name in UNSEEN


def cut(run: Run, until_s: float) -> Run:
    """The beginning of a run: a tail that bends takes long."""
    here = run.time_s < until_s
    return replace(run, time_s=run.time_s[here], channel=run.channel[here], value=run.value[here])


UNSEEN = ("wall_effect", "stale_samples", "dropped_commands")
"""These runs keep away from walls, and neither stall nor lose anything."""


@pytest.mark.parametrize("name", NAMED)
def test_a_change_beyond_what_is_believed_makes_one_with_it(name: str) -> None:
    neutral = scenario.load("wang2014")
    values = sizes(name)
    once = extended(neutral, values).config
    if name == "tail_body_coupling":
        values = {"tail_body_coupling.k": 0.1}
    twice = extended(once, values).config
    assert twice.effects != once.effects
    setups = []
    for config, change in ((once, values), (twice, {})):
        model = fish_model(replace(nothing(), config=config))
        setups.append(model.setup(change))
    one, other = setups
    assert pack(one.plant) == pytest.approx(pack(other.plant), rel=1e-9)
    for field in INSTRUMENT_FIELDS:
        assert getattr(one, field) == pytest.approx(getattr(other, field), rel=1e-9, abs=1e-15)


INSTRUMENT_FIELDS = (
    "gyro_bias_rad_s",
    "gyro_scale",
    "compass_offset_rad",
    "hard_iron_rad",
    "soft_iron_rad",
    "camera_scale",
    "camera_rotation_rad",
    "camera_delay_s",
    "clock_drift",
    "hold_s",
    "dropped",
)


@cache
def nothing() -> Experiment:
    """An experiment without runs."""
    config = scenario.load("wang2014")
    return Experiment("", Path(), config, (), ("x_m", "y_m", "gyro_z_rad_s"), {}, ())


def test_an_angle_stays_within_half_a_turn() -> None:
    believed = scenario.load("wang2014", ["effects.compass_offset.delta_rad=3.0"])
    made = extended(believed, {"compass_offset.delta_rad": 0.3}).config
    keys = scenario.keys(made)
    assert keys["effects.compass_offset.delta_rad"] == pytest.approx(3.3 - 2.0 * np.pi)


SEED = 5


@cache
def whiteness(name: str | None, place: Path, *, believed: bool) -> float:
    """Mean square of whitened innovations of an experiment in which something is hidden."""
    effects: tuple[Effect, ...] = ()
    numbers: dict[str, float] = {}
    if name is not None:
        effects = (Effect(name, HIDDEN_SIZES[name], shape_of(name, SEED)),)
        numbers = effects[0].parameters()
    swum = swim_experiment(SEED, effects, 2, 20.0)
    folder.write(place, "set", "wang2014", swum, folder.answer(SEED, "none", 0.0, effects))
    if believed:
        lines = "".join(f'"effects.{name}.{key}" = {x!r}\n' for key, x in numbers.items())
        file = place / "experiment.toml"
        file.write_text(file.read_text() + f"[set]\n{lines}")
    return squares(read_experiment(place), {})


def squares(found: Experiment, values: dict[str, float]) -> float:
    """Mean square of whitened innovations, with some values of causes."""
    model = believed_model(found)
    parts = []
    for run in found.runs:
        fixed = model.filter(run, {}, NOISE)
        parts.append(np.square(model.innovations(run, values, fixed)) / fixed.variance)
    return float(np.mean(np.concatenate(parts)))


HIDDEN_SIZES = {
    "gyro_bias": 0.1,
    "gyro_scale": 0.3,
    "compass_offset": 0.3,
    "compass_hard_iron": 0.2,
    "compass_soft_iron": 0.2,
    "camera_scale": 0.1,
    "camera_rotation": 0.5,
    "camera_delay": 0.3,
    "clock_drift": 0.05,
    "stale_samples": 0.5,
    "dropped_commands": 0.25,
}


def test_every_instrument_is_hidden_once() -> None:
    assert {*HIDDEN_SIZES} == {*INSTRUMENTS}
    assert {*HIDDEN_SIZES} <= {*HIDDEN}


@pytest.mark.parametrize("name", HIDDEN_SIZES)
def test_who_believes_the_truth_sees_noise_alone(name: str, tmp_path: Path) -> None:
    """The laboratory is another program; its instruments know nothing of the predictor's."""
    healthy = whiteness(None, tmp_path / "healthy", believed=False)
    wrong = whiteness(name, tmp_path / "wrong", believed=False)
    right = whiteness(name, tmp_path / "right", believed=True)
    assert wrong > 1.15 * healthy
    if (
        name == "dropped_commands"
    ):  # which were lost is searched for step by step, and may be missed
        numbers = {f"{name}.p": HIDDEN_SIZES[name]}
        assert right == pytest.approx(squares(read_experiment(tmp_path / "wrong"), numbers))
        assert right < wrong
        return
    assert right < 1.03 * healthy


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro_scale", "camera_delay", "drag_scale"])
def test_a_cause_that_was_found_and_is_believed_is_not_found_again(
    name: str, tmp_path: Path
) -> None:
    size, _ = sized(SEED, name, 400.0, 4, 25.0)
    effects = (Effect(name, size, shape_of(name, SEED)),)
    swum = swim_experiment(SEED, effects, 4, 25.0)
    folder.write(tmp_path, "set", "wang2014", swum, folder.answer(SEED, "one", 400.0, effects))
    options = Options(draws=48)
    first = read_experiment(tmp_path)
    found = diagnose(believed_model(first), first.runs, options)
    assert name in [cause.name for cause in found.report.causes]
    (tmp_path / EXTENDED).write_text(with_files(found, first, options).files[EXTENDED])
    file = tmp_path / "experiment.toml"
    file.write_text(file.read_text().replace('"wang2014"', f'"{EXTENDED}"'))
    again = read_experiment(tmp_path)
    assert again.config.effects != first.config.effects
    report = diagnose(believed_model(again), again.runs, options).report
    assert report.verdict == "nothing_wrong"


def test_a_steady_table_is_read_with_the_camera_and_clock_that_are_believed(
    tmp_path: Path,
) -> None:
    lines = [line.split(",") for line in table().splitlines()]
    wrong = [lines[0]] + [
        [*cells[:3], repr(float(cells[3]) * 1.1), repr(float(cells[4]) * 1.02)]
        for cells in lines[1:]
    ]
    places = []
    for name, rows, believed in (
        ("true", lines, ""),
        ("wrong", wrong, "camera_scale.k = 0.1\nclock_drift.k = 0.02\ngyro_scale.k = 0.3\n"),
    ):
        place = tmp_path / name
        place.mkdir()
        (place / "radius.csv").write_text("\n".join(",".join(cells) for cells in rows))
        effects = "".join(f"effects.{line}\n" for line in believed.split("\n") if line)
        toml = f'runs = [{{file = "radius.csv"}}]\n[set]\n{effects}'
        toml = toml.replace("effects.", '"effects.').replace(" = 0.", '" = 0.')
        (place / "experiment.toml").write_text(toml)
        places.append(read_experiment(place))
    true, read = places
    for one, other in zip(true.runs, read.runs, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-12)
    said = [notice.text for notice in read.notices if notice.kind == "believed"]
    assert len(said) == 3
    assert any("gyro_scale" in text and "no part in steady motion" in text for text in said)
