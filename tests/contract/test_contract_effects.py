"""Every row of the table of effects, unasked: neutral changes no bit of any motion, others do.

A row without values below fails: who adds an effect says here what is a sensible amount of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant.effects import EFFECTS, with_effects
from plant.integrate import simulate
from plant.parameters import PlantParameters, Servo, Walls
from plant.tail_input import TailBeat, TailProgramme
from tools import scenario
from tools.bench import Bench, model
from tools.commands import listing
from tools.effects import ALL
from tools.errors import ScenarioError

AMOUNTS: dict[str, dict[str, float]] = {
    "water_current": {"cx_m_s": 0.01, "cy_m_s": -0.02},
    "tail_offset": {"delta_rad": 0.02},
    "tail_gain": {"g": -0.1},
    "tail_fade": {"k_per_s": 0.002},
    "servo_lag": {"tau_s": 0.05},
    "servo_delay": {"delay_s": 0.07},
    "servo_rate_limit": {"excess_s_rad": 1.0},
    "servo_deadband": {"delta_rad": 0.02},
    "servo_backlash": {"play_rad": 0.04},
    "drag_scale": {"k": 0.2},
    "yaw_drag_scale": {"k": -0.2},
    "lift_scale": {"k": 0.2},
    "drag_vs_bias": {"cd_per_rad2": 0.3, "kd_per_rad": 1e-3},
    "linear_drag": {"b_n_s_m": 0.01},
    "added_mass_surge": {"k": 0.1},
    "added_mass_sway": {"k": -0.1},
    "added_inertia_yaw": {"k": 0.2},
    "payload": {"dm_kg": 0.03},
    "tail_flexibility": {"compliance_rad_n_m": 20.0},
    "fin_damage": {"k": 0.15},
    "tail_body_coupling": {"k": -0.5},
    "wall_effect": {"k": 1.0},
}
PROGRAMME = TailProgramme(
    (TailBeat.degrees(20, 15, 0.9), TailBeat.degrees(-15, 20, 1.2)), (0.0, 1.5)
)
SECONDS = 2.5
MODELS = ("wang2014", "fishbed-robot")


def plant(name: str, sets: tuple[str, ...] = ()) -> PlantParameters:
    return model.plant_parameters(scenario.load(name, sets))


def rows(parameters: PlantParameters) -> bytes:
    return simulate(parameters, PROGRAMME, 3.0, 2e-3).rows.tobytes()


def neutral(name: str) -> dict[str, float]:
    return {item.name: item.neutral for item in EFFECTS[name].parameters}


def sets(name: str, values: dict[str, float]) -> tuple[str, ...]:
    return tuple(f"effects.{name}.{key}={value!r}" for key, value in values.items())


def test_the_rows_are_listed_and_have_amounts() -> None:
    assert [name for name, _ in listing.rows("effects")] == list(ALL)
    assert list(AMOUNTS) == list(EFFECTS)
    for name, row in EFFECTS.items():
        assert set(AMOUNTS[name]) == {item.name for item in row.parameters}


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("robot", MODELS)
def test_in_the_plain_simulation_neutral_changes_no_bit_and_an_amount_does(
    robot: str, name: str
) -> None:
    believed = plant(robot)
    with_zero = with_effects(believed, {name: neutral(name)})
    assert rows(with_zero) == rows(believed)
    assert rows(with_effects(believed, {name: AMOUNTS[name]})) != rows(believed)
    assert plant(robot, sets(name, AMOUNTS[name])) == with_effects(believed, {name: AMOUNTS[name]})


def emulated(robot: str, options: tuple[str, ...] = ()) -> tuple[str, bytes]:
    """Trace hash and truth of the whole robot, near a wall."""
    here = ("initial.x_m=1.9", *options)
    bench = Bench.from_scenario(scenario.load(robot, here, duration_s=SECONDS))
    bench.run(lambda _seconds: None, lambda: False)
    bench.trace.flush()
    truth = bench.robot.vehicle.truth(bench.scheduler.now)
    assert np.all(np.isfinite(truth))
    return bench.trace.sha256(), truth.tobytes()


@pytest.fixture(scope="module")
def baseline() -> dict[str, tuple[str, bytes]]:
    return {robot: emulated(robot) for robot in MODELS}


@pytest.mark.parametrize("robot", MODELS)
def test_in_the_emulation_all_neutral_is_the_same_trace(
    robot: str, baseline: dict[str, tuple[str, bytes]]
) -> None:
    options = tuple(option for name in EFFECTS for option in sets(name, neutral(name)))
    assert emulated(robot, options) == baseline[robot]


@pytest.mark.parametrize("name", EFFECTS)
def test_in_the_emulation_an_amount_changes_truth_and_trace(
    name: str, baseline: dict[str, tuple[str, bytes]]
) -> None:
    robot = MODELS[list(EFFECTS).index(name) % 2]  # each effect on one, both kinds of servo
    trace, truth = emulated(robot, sets(name, AMOUNTS[name]))
    assert truth != baseline[robot][1]
    assert trace != baseline[robot][0]


def test_a_file_says_it_too_and_what_is_impossible_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "damaged.toml"
    file.write_text('base = "wang2014"\n[effects.fin_damage]\nk = 0.15\n', encoding="utf-8")
    believed = plant("wang2014")
    assert plant(str(file)) == with_effects(believed, {"fin_damage": {"k": 0.15}})
    with pytest.raises(ScenarioError, match=r"effects\.payload: dm_kg = -0.5 makes body.mass_kg"):
        plant("wang2014", ("effects.payload.dm_kg=-0.5",))


def test_the_command_line_refuses_it_with_two(fishbed: Any) -> None:
    ended = fishbed("run", "wang2014", "--set", "effects.tail_body_coupling.k=0.2")
    assert ended.code == 2
    assert "effects.tail_body_coupling" in ended.err
    assert "Traceback" not in ended.err


def test_the_walls_are_those_of_the_scenarios_tank() -> None:
    config = scenario.load("circle")
    assert model.plant_parameters(config).walls == Walls(
        x_min_m=-1.5, y_min_m=-1.5, x_max_m=1.5, y_max_m=1.5
    )


@pytest.mark.parametrize("name", list(AMOUNTS))
def test_a_small_amount_is_a_small_change_also_where_the_beat_changes(name: str) -> None:
    # what a fit needs at zero: with a thousandth, the motion is a thousandth as far off, or less
    robot = PlantParameters(
        servo=Servo(ideal=True), walls=Walls(x_min_m=-0.5, y_min_m=-0.5, x_max_m=0.5, y_max_m=0.5)
    )
    beats = (TailBeat(), TailBeat.degrees(20, 15, 0.9), TailBeat.degrees(-10, 15, 0.9))
    programme = TailProgramme(beats, (0.0, 0.13, 2.0))

    def end(share: float) -> Any:
        amounts = {key: share * value for key, value in AMOUNTS[name].items()}
        return simulate(with_effects(robot, {name: amounts}), programme, 4.0).rows[-1, :6]

    baseline = simulate(robot, programme, 4.0).rows[-1, :6]
    large, small = abs(end(0.1) - baseline).max(), abs(end(1e-4) - baseline).max()
    # a delayed change of beat waits for the next grid point, 1 ms at most
    slack = 1e-4 if name == "servo_delay" else 1e-9
    assert small < 0.01 * large + slack
