"""Optimal design: closed forms, exhaustive search, and what no manoeuvre can separate."""

from __future__ import annotations

import itertools
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tools import scenario
from tools.bench.model import plant_parameters
from tools.configuration import Scenario
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.experiment_design import (
    ENOUGH,
    Choice,
    Explanation,
    classes,
    exchange,
    repeats,
    separations,
)
from tools.diagnosis.fish import separating
from tools.diagnosis.fish.manoeuvres import (
    LONGEST_S,
    SEGMENTS,
    as_scenario,
    blank,
    intervals,
    place,
    programme,
)
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray

NAMES = ("x_m", "y_m", "heading_rad", "gyro_z_rad_s", "compass_rad")
SLOW = [0.2] * 5


def grams(seed: int, count: int, nuisances: int, differences: int) -> list[FloatArray]:
    draw = np.random.default_rng(seed)
    width = nuisances + differences
    return [
        (lambda m: m.T @ m)(draw.standard_normal((12, width)) * draw.uniform(0.2, 2.0, width))
        for _ in range(count)
    ]


def test_separation_is_what_least_squares_leaves() -> None:
    draw = np.random.default_rng(3)
    nuisance, difference = draw.standard_normal((40, 4)), draw.standard_normal((40, 2))
    precision = np.array([0.5, 1.0, 2.0, 4.0])
    both = np.column_stack([nuisance, difference])
    found = separations(both.T @ both, precision)

    def left(delta: FloatArray) -> float:
        rows = np.vstack([nuisance, np.diag(np.sqrt(precision))])
        right = np.concatenate([delta, np.zeros(4)])
        fitted = np.linalg.lstsq(rows, right, rcond=None)[0]
        return float(np.sum((right - rows @ fitted) ** 2))

    a, b = difference.T
    np.testing.assert_allclose(found, [left(a), left(b), left(a - b)], rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_exchange_comes_near_the_best_of_all_programmes(seed: int) -> None:
    precision = np.ones(3)
    choices = [Choice(20.0 if i % 3 == 0 else 10.0, g) for i, g in enumerate(grams(seed, 6, 3, 2))]

    def value(picked: tuple[int, ...]) -> float:
        total = np.sum([choices[i].gram for i in picked], axis=0)
        return float(np.min(separations(total, precision)))

    programmes = [
        picked
        for n in (1, 2, 3, 4)
        for picked in itertools.combinations_with_replacement(range(6), n)
        if sum(choices[i].duration_s for i in picked) <= 40.0
    ]
    chosen = exchange(choices, precision, 40.0)
    assert sum(choices[i].duration_s for i in chosen) <= 40.0
    assert value(chosen) >= 0.9 * max(value(picked) for picked in programmes)


def test_what_can_only_come_first_does_so_once() -> None:
    big = np.diag([1.0, 100.0])
    choices = [Choice(10.0, np.diag([1.0, 1.0])), Choice(10.0, big, first=True)]
    chosen = exchange(choices, np.ones(1), 40.0)
    assert chosen[0] == 1
    assert chosen.count(1) == 1


def test_enough_is_twenty_to_one_in_nine_of_ten() -> None:
    favoured = ENOUGH - 1.2816 * 2.0 * math.sqrt(ENOUGH)
    assert math.exp(favoured / 2.0) == pytest.approx(20.0, rel=0.3)
    assert repeats(ENOUGH) == 1
    assert repeats(ENOUGH / 2.5) == 3


def test_every_cause_with_a_name_can_be_looked_at() -> None:
    assert set(separating.DIRECTLY) == set(CAUSES) - {"unknown_force"}


def test_segments_are_within_what_the_robot_does() -> None:
    for segment in SEGMENTS:
        assert 0.0 < segment.duration_s <= LONGEST_S
        for _, beat in segment.beats:
            assert abs(beat.bias_rad) + beat.amplitude_rad <= math.radians(60.0) + 1e-9


@pytest.mark.parametrize("index", [0, 5, len(SEGMENTS) - 1])
def test_a_programme_is_a_scenario_that_stays_in_its_tank(tmp_path: Path, index: int) -> None:
    believed = scenario.load("wang2014")
    plant = plant_parameters(believed)
    segments = [SEGMENTS[index], SEGMENTS[4]]
    start = place(plant, believed, segments)
    assert start is not None
    file = tmp_path / "separating.toml"
    file.write_text(scenario.to_toml(as_scenario(believed, segments, start, "told")))
    loaded = scenario.load(file)
    assert loaded.scenario.duration_s == sum(s.duration_s for s in segments)
    assert [b.at_s for b in loaded.base_station.tail_beats] == [*programme(segments).starts_s[1:]]
    model = FishModel(plant, NAMES)
    path = model.replay(blank(segments, start, NAMES, SLOW), {})
    run = blank(segments, start, NAMES, SLOW)
    assert np.all(np.abs(path[run.channel < 2]) < 2.0)


def test_a_tank_that_is_too_small_is_told() -> None:
    believed = scenario.load("wang2014", ["tank.size_m=[0.4,0.4]", "tank.corner_m=[-0.2,-0.2]"])
    assert place(plant_parameters(believed), believed, [SEGMENTS[1]]) is None


def test_samples_come_as_often_as_before() -> None:
    believed = scenario.load("wang2014")
    start = place(plant_parameters(believed), believed, [SEGMENTS[0]])
    assert start is not None
    steps = [0.1, None, 0.1, 0.05, 0.2]
    run = blank([SEGMENTS[0]], start, NAMES, steps)
    assert intervals([run], 5) == pytest.approx([0.1, None, 0.1, 0.05, 0.2])


def explained(name: str, size: float) -> Explanation:
    return Explanation(name.partition(".")[0], {name: size}, {name: 0.05 * abs(size)})


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(separating, "SEGMENTS", (SEGMENTS[0], SEGMENTS[3], SEGMENTS[5]))


def laboratory(believed: Scenario) -> separating.Laboratory:
    model = FishModel(plant_parameters(believed), NAMES)
    return separating.Laboratory(model, separating.TYPICAL, believed, NAMES, tuple(SLOW), None)


@pytest.mark.usefixtures("few")
def test_mass_and_drag_are_separated_by_a_manoeuvre() -> None:
    believed = scenario.load("wang2014")
    group = [explained("drag_scale.k", 0.3), explained("tail_offset.delta_rad", 0.05)]
    told = laboratory(believed).propose(group)
    assert told.separation > ENOUGH
    assert told.toml is not None
    assert tomllib.loads(told.toml)["scenario"]["duration_s"] <= LONGEST_S
    assert "20 to 1" in told.why


@pytest.mark.usefixtures("few")
def test_a_turned_camera_and_a_turned_compass_need_another_look() -> None:
    believed = scenario.load("wang2014")
    group = [
        explained("camera_rotation.delta_rad", 0.1),
        explained("compass_offset.delta_rad", -0.1),
    ]
    told = laboratory(believed).propose(group)
    assert told.toml is None
    assert told.separation < 1.0
    assert "straight edge" in told.why


@pytest.mark.usefixtures("few")
def test_what_can_be_told_apart_is_although_some_look_the_same() -> None:
    """A dead band and play are the same operator: no reason not to ask whether it is the fin."""
    group = [
        explained("fin_damage.k", 0.25),
        explained("servo_deadband.delta_rad", 0.07),
        explained("servo_backlash.play_rad", 0.14),
    ]
    told = laboratory(scenario.load("wang2014")).propose(group)
    assert told.toml is not None
    assert told.separation > ENOUGH / 5
    assert "servo deadband and servo backlash look the same" in told.why
    assert "with the servo held" in told.why


def test_classes_are_chains_of_what_is_too_near() -> None:
    # two directions, no nuisance: differences of the second to fourth explanation from the first
    apart = np.array([[5.0, 0.0], [5.0, 0.3], [0.0, 9.0]])
    total = apart @ apart.T
    assert classes(total, np.empty(0), 1.0) == [[0], [1, 2], [3]]
    assert classes(total, np.empty(0), 0.01) == [[0], [1], [2], [3]]
    assert classes(total, np.empty(0), 1e3) == [[0, 1, 2, 3]]
