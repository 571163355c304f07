"""The predictor against the plant's own run, another integrator, and its own filter."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from plant.effects import with_effects
from plant.integrate import simulate
from plant.layout import Column, Drive, Packed, State
from plant.packing import pack
from plant.parameters import Linkage, PlantParameters, Servo
from plant.rigid_tail import rates
from plant.robots import wang2014
from plant.trajectory import Start
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.fish.inputs import drives
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Filter, FloatArray, Run

START = Start(0.3, -0.2, 0.7)


@cache
def model() -> FishModel:
    return FishModel(wang2014(), NAMES)


def whole_seconds(run: Run) -> Run:
    """The same run with its changes on the grid of any step."""
    programme = replace(run.inputs.programme, starts_s=(0.0, 6.0, 13.0))
    return replace(run, inputs=replace(run.inputs, programme=programme))


def open_loop(plant: PlantParameters, run: Run, start: Start) -> FloatArray:
    """What the predictor makes of a run without gains: minus the innovations of zeros."""
    fish = FishModel(plant, NAMES)
    plan = fish._plans.of(run)
    result = np.full(run.value.size, np.nan)
    prepared = fish._of({})
    fish._predict(prepared, run, plan, result, None, start=np.array(start.state()))
    return -result


SERVOS = {
    "ideal": PlantParameters(servo=Servo(ideal=True)),
    "real": PlantParameters(),
    "delayed": PlantParameters(servo=Servo(ideal=True, command_delay_s=0.25, command_lag_s=0.1)),
    "slow": PlantParameters(servo=Servo(ideal=True, slowness_s_rad=1.0)),
    "dead band": PlantParameters(servo=Servo(ideal=True, extra_dead_band_rad=0.05)),
    "play": PlantParameters(
        servo=Servo(ideal=True), linkage=Linkage(play_rad=0.1, gain_error=0.1, fade_per_s=0.005)
    ),
}


@pytest.mark.parametrize("kind", SERVOS)
def test_without_gains_it_is_the_plants_own_run(kind: str) -> None:
    plant = SERVOS[kind]
    run = whole_seconds(blank(1))
    swum = simulate(plant, run.inputs.programme, 20.0, 1e-3, START)
    predicted = open_loop(plant, run, START)
    # a servo's rate has kinks, which steps of 5 ms meet at other places than those of 1 ms
    bound = 1e-6 if kind in ("ideal", "delayed") else 2e-4
    for channel, column in enumerate((Column.X, Column.Y, Column.PSI, Column.R, Column.PSI)):
        here = run.channel == channel
        # between grid points a cubic: its error in the yaw rate is far below the bound
        look = CubicSpline(swum.time_s, swum.column(column))(run.time_s[here])
        away = predicted[here] - look
        if column is Column.PSI:
            away = np.arctan2(np.sin(away), np.cos(away))
        near = np.ones(away.size, dtype=bool)
        for jump_s in (*run.inputs.programme.starts_s, 6.25, 13.25):
            near &= np.abs(run.time_s[here] - jump_s) > 0.02  # no spline follows a kink
        assert np.abs(away[near]).max() < (bound if column is not Column.R else 20 * bound)


@pytest.mark.parametrize("kind", ["ideal", "real"])
def test_what_is_predicted_does_not_depend_on_what_else_is_measured(kind: str) -> None:
    run = blank(6, 8.0)
    whole = open_loop(SERVOS[kind], run, START)
    kept = run.channel != 3
    kept[0] = True  # a run's clock begins with its first row
    alone = replace(run, time_s=run.time_s[kept], channel=run.channel[kept], value=run.value[kept])
    assert np.array_equal(open_loop(SERVOS[kind], alone, START), whole[kept])


def test_another_integrator_finds_the_same() -> None:
    plant = wang2014()
    run = blank(2, 10.0)
    packed = pack(plant)
    packed = Packed(*(float(value) for value in packed))
    table = drives(run.inputs, plant.servo)
    ends = [*table[1:, 5].tolist(), 10.0]
    now = np.array(START.state())
    states: list[FloatArray] = []
    for row, end in zip(table, ends, strict=True):
        drive = Drive(*row.tolist())

        def slope(t: float, y: FloatArray, drive: Drive = drive) -> FloatArray:
            return np.array(rates(packed, drive, t - drive.start, State(*y.tolist()))[:11])

        inside = run.time_s[(run.time_s >= drive.start) & (run.time_s < end)]
        found = solve_ivp(
            slope, (drive.start, end), now, "DOP853", dense_output=True, rtol=1e-10, atol=1e-12
        )
        states.append(found.sol(inside))
        now = found.y[:, -1]
    state = np.concatenate(states, axis=1)
    predicted = open_loop(plant, run, START)
    for channel, element in enumerate((0, 1, 2, 5)):
        here = run.channel == channel
        away = predicted[here] - state[element][here]
        if element == 2:
            away = np.arctan2(np.sin(away), np.cos(away))
        assert np.abs(away).max() < 1e-6


def test_innovations_of_the_filter_are_white_with_the_variance_that_it_says() -> None:
    generator = np.random.default_rng(5)
    runs = [model().draw(blank(seed, 30.0), {}, NOISE, generator) for seed in range(3)]
    whitened = []
    for run in runs:
        fixed = model().filter(run, {}, NOISE)
        whitened.append(model().innovations(run, {}, fixed) / np.sqrt(fixed.variance))
    for channel in range(len(NAMES)):
        one = np.concatenate(
            [z[run.channel == channel] for z, run in zip(whitened, runs, strict=True)]
        )
        assert abs(np.mean(one**2) - 1.0) < 6.0 / np.sqrt(0.5 * one.size)
        assert abs(np.mean(one[1:] * one[:-1])) < 5.0 / np.sqrt(one.size)


def test_a_wrong_model_is_seen() -> None:
    run = model().draw(blank(7), {"drag_scale.k": 0.5}, NOISE, np.random.default_rng(1))
    fixed = model().filter(run, {}, NOISE)
    weight = 1.0 / fixed.variance
    believed = float(weight @ model().innovations(run, {}, fixed) ** 2)
    true = float(weight @ model().innovations(run, {"drag_scale.k": 0.5}, fixed) ** 2)
    assert believed - true > 50.0


def test_the_predictor_gives_the_same_bits_again() -> None:
    run = model().draw(blank(3), {}, NOISE, np.random.default_rng(3))
    fixed = model().filter(run, {}, NOISE)
    once = model().innovations(run, {"payload.dm_kg": 0.05}, fixed)
    again = FishModel(wang2014(), NAMES).innovations(run, {"payload.dm_kg": 0.05}, fixed)
    assert once.tobytes() == again.tobytes()


def test_what_no_robot_can_be_is_far_off() -> None:
    run = model().draw(blank(3), {}, NOISE, np.random.default_rng(3))
    fixed = model().filter(run, {}, NOISE)
    away = model().innovations(run, {"payload.dm_kg": -0.9}, fixed)
    assert np.all(np.isfinite(away))
    assert np.all(np.abs(away) > 100.0 * np.sqrt(fixed.variance))


def test_replay_begins_where_the_run_did() -> None:
    run = model().draw(blank(4), {}, NOISE, np.random.default_rng(4))
    replayed = model().replay(run, {})
    here = run.channel == 0
    away = run.value[here] - replayed[here]
    assert np.sqrt(np.mean(away[:30] ** 2)) < 1.5e-3
    assert np.sqrt(np.mean(away**2)) < 0.05


RECOVERED = {
    "water_current": (0.01, -0.006),
    "tail_gain": (0.08,),
    "servo_delay": (0.05,),
    "yaw_drag_scale": (0.3,),
    "drag_vs_bias": (0.7, 4e-4),
    "gyro_bias": (0.02,),
    "compass_hard_iron": (0.05, -0.08),
    "camera_rotation": (0.06,),
    "camera_delay": (0.08,),
    "clock_drift": (0.004,),
}


@pytest.mark.parametrize("name", RECOVERED)
def test_an_injected_effect_is_recovered(name: str) -> None:
    cause = CAUSES[name].cause
    true = np.array(RECOVERED[name])
    generator = np.random.default_rng(11)
    runs = [
        model().draw(blank(seed), cause.values(*true.tolist()), NOISE, generator)
        for seed in range(3)
    ]
    filters: list[Filter] = [model().filter(run, {}, NOISE) for run in runs]

    def errors(numbers: FloatArray) -> FloatArray:
        values = cause.values(*numbers.tolist())
        return np.concatenate(
            [
                model().innovations(run, values, fixed) / np.sqrt(fixed.variance)
                for run, fixed in zip(runs, filters, strict=True)
            ]
        )

    scale = np.array([p.scale for p in cause.parameters])
    found = 0.5 * true
    for _ in range(8):
        base = errors(found)
        little = 1e-2 * scale
        slopes = np.column_stack(
            [
                (errors(found + little * unit) - base) / step
                for unit, step in zip(np.eye(true.size), little, strict=True)
            ]
        )
        covariance = np.linalg.inv(slopes.T @ slopes)
        found = found - covariance @ slopes.T @ base
    assert np.all(np.abs(found - true) < 4.0 * np.sqrt(np.diag(covariance)))
    assert np.all(np.abs(found - true) < 0.25 * np.abs(true) + 0.1 * scale)


def test_the_extended_robot_is_the_plants() -> None:
    # what a physical cause makes is exactly what [effects] makes of the believed robot
    values = {"fin_damage.k": 0.1, "tail_offset.delta_rad": 0.05}
    effects = {"fin_damage": {"k": 0.1}, "tail_offset": {"delta_rad": 0.05}}
    assert model().setup(values).plant == with_effects(wang2014(), effects)


def test_a_stalled_camera_is_drawn_as_it_stalled() -> None:
    run = model().draw(blank(5), {}, NOISE, np.random.default_rng(5))
    value = run.value.copy()
    frames = np.unique(run.time_s[run.channel == 0])
    stalled = [(60, 75), (200, 231), (400, 404)]
    for first, last in stalled:
        for channel in (0, 1, 2):
            mine = np.flatnonzero(run.channel == channel)
            inside = (run.time_s[mine] >= frames[first]) & (run.time_s[mine] <= frames[last])
            value[mine[inside]] = value[mine[inside][0]]
    given = replace(run, value=value)
    drawn = model().draw(given, {"stale_samples.hold_s": 2.0}, NOISE, np.random.default_rng(6))
    for channel in (0, 1, 2):
        was, is_ = (r.value[r.channel == channel] for r in (given, drawn))
        assert np.array_equal(np.diff(was) == 0.0, np.diff(is_) == 0.0)
    plain = model().draw(given, {}, NOISE, np.random.default_rng(6))
    assert not np.any(np.diff(plain.value[plain.channel == 0]) == 0.0)
    gyro = run.channel == 3
    # what has no stalls is the same, but for another grouping of steps
    assert np.abs(drawn.value[gyro] - plain.value[gyro]).max() < 0.05
