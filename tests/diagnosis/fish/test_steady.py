"""Steady-state tables: the source's own discovery, drag that depends on bias, is in one."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat
from tools.diagnosis.data.experiment import believed_model, read_experiment
from tools.diagnosis.data.notice import DataError
from tools.diagnosis.fish.steady import CHANNELS, SteadyModel
from tools.diagnosis.model import FloatArray, Run

BIASES = (10, 15, 20, 25, 30, 35, 40, 45)


@cache
def table() -> str:
    """What the robot with (3.32, 3.33) does at eight biases, with 1 % of noise."""
    adapted = PlantParameters(
        servo=Servo(ideal=True), hydrodynamics=COEFFICIENT_SETS["chapter-3-adapted"]
    )
    model = SteadyModel(adapted)
    generator = np.random.default_rng(4)
    lines = ["tail_bias_rad,tail_amplitude_rad,tail_frequency_hz,turn_radius_m,turn_period_s"]
    for bias in BIASES:
        beat = TailBeat.degrees(bias, 15.0, 0.9)
        motion = model._orbit(adapted, beat)
        radius, period = (x * (1.0 + 0.01 * generator.standard_normal()) for x in motion[:2])
        lines.append(f"{beat.bias_rad},{beat.amplitude_rad},0.9,{radius},{period}")
    return "\n".join(lines) + "\n"


def read(tmp_path: Path, text: str) -> tuple[SteadyModel, tuple[Run, ...]]:
    file = tmp_path / "radius.csv"
    file.write_text(text)
    experiment = read_experiment(file)
    model = believed_model(experiment)
    assert isinstance(model, SteadyModel)
    return model, experiment.runs


def test_rows_are_dealt_to_runs(tmp_path: Path) -> None:
    _, runs = read(tmp_path, table())
    assert [run.held_out for run in runs] == [False] * 5 + [True] * 3
    assert sum(run.value.size for run in runs) == 2 * len(BIASES)


@pytest.mark.parametrize("count", range(3, 9))
def test_what_is_held_out_lies_between_rows_that_train(count: int, tmp_path: Path) -> None:
    lines = table().splitlines()
    _, runs = read(tmp_path, "\n".join([lines[0], *lines[count:0:-1]]) + "\n")
    biases = {
        kept: [beat.bias_rad for run in runs if run.held_out is kept for beat in run.inputs.beats]
        for kept in (True, False)
    }
    assert len(biases[True]) == max(round(count / 3), 1)
    assert min(biases[False]) < min(biases[True])
    assert max(biases[True]) < max(biases[False])


def test_a_radius_alone_is_said_to_show_little(tmp_path: Path) -> None:
    lines = [",".join(line.split(",")[:4]) for line in table().splitlines()]
    file = tmp_path / "radius.csv"
    file.write_text("\n".join(lines) + "\n")
    notes = [notice.text for notice in read_experiment(file).notices]
    assert any("a turning radius alone hardly shows resistance" in note for note in notes)
    file.write_text(table())
    assert not any("alone" in notice.text for notice in read_experiment(file).notices)


def test_drag_that_depends_on_bias_explains_the_table(tmp_path: Path) -> None:
    model, runs = read(tmp_path, table())
    noise = model.first_noise(runs)
    noise.sigma[:] = 0.01
    filters = [model.filter(run, {}, noise) for run in runs]

    def errors(values: dict[str, float]) -> FloatArray:
        whitened = [
            model.innovations(run, values, fixed) / np.sqrt(fixed.variance)
            for run, fixed in zip(runs, filters, strict=True)
        ]
        prior = [values.get(p.name, 0.0) / p.prior_sd for p in model.tolerances]
        return np.concatenate([*whitened, prior])

    def fitted(names: list[str]) -> float:
        scales = {
            p.name: p.scale
            for p in (*model.tolerances, *(q for c in model.causes for q in c.parameters))
        }
        free = [*(p.name for p in model.tolerances), *names]
        values = dict.fromkeys(free, 0.0)
        for _ in range(6):
            base = errors(values)
            slopes = np.column_stack(
                [
                    (errors({**values, n: values[n] + 0.1 * scales[n]}) - base) / (0.1 * scales[n])
                    for n in free
                ]
            )
            step = -np.linalg.lstsq(slopes, base, rcond=None)[0]
            values = {n: values[n] + float(d) for n, d in zip(free, step, strict=True)}
        return float(np.sum(np.square(errors(values))))

    believed = fitted([])
    slopes = ["drag_vs_bias.cd_per_rad2", "drag_vs_bias.kd_per_rad"]
    adapted = fitted(slopes)
    others = [fitted([f"{name}.k"]) for name in ("drag_scale", "yaw_drag_scale", "lift_scale")]
    assert believed - adapted > 30.0
    assert adapted < min(others) - 10.0
    # (3.32) and (3.33) lie below the believed constants at no bias, by more than the tolerance
    whole = fitted([*slopes, "drag_scale.k", "yaw_drag_scale.k"])
    assert whole < 30.0  # 16 measurements


def test_the_neutral_values_are_the_orbit_of_the_believed_robot(tmp_path: Path) -> None:
    model, runs = read(tmp_path, table())
    run = runs[0]
    motion = model.replay(run, {})
    for row, channel, value in zip(run.inputs.row, run.channel, motion, strict=True):
        assert value == model._orbit(wang2014(), run.inputs.beats[row])[channel]
    for cause in model.causes:
        neutral = cause.values(*(0.0 for _ in cause.parameters))
        assert model.replay(run, neutral).tobytes() == motion.tobytes()


def test_lengths_and_times_scale(tmp_path: Path) -> None:
    model, runs = read(tmp_path, table())
    base = model.replay(runs[0], {})
    wide = model.replay(runs[0], {"camera_scale.k": 0.1})
    slow = model.replay(runs[0], {"clock_drift.k": 0.1})
    for a, b, c, channel in zip(base, wide, slow, runs[0].channel, strict=True):
        radius = CHANNELS[channel].name == "turn_radius_m"
        assert b / a == pytest.approx(1.1 if radius else 1.0)
        assert c / a == pytest.approx(1.0 if radius else 1.1)


BAD = {
    "degrees": (",".join(["20", "0.26", "0.9", "0.3", "9"]), "degrees"),
    "negative": (",".join(["0.3", "0.26", "0.9", "-0.3", "9"]), "no size"),
    "empty beat": (",".join(["", "0.26", "0.9", "0.3", "9"]), "is empty"),
    "at rest": (",".join(["0.3", "0", "0.9", "0.3", "9"]), "at rest"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_rows_are_named(tmp_path: Path, case: str) -> None:
    row, says = BAD[case]
    with pytest.raises(DataError, match=says) as error:
        read(tmp_path, table() + row + "\n")
    assert "radius.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_standard_deviations_are_used(tmp_path: Path) -> None:
    lines = table().splitlines()
    text = [lines[0] + ",turn_radius_m_sd", *(f"{line},0.002" for line in lines[1:])]
    model, runs = read(tmp_path, "\n".join(text))
    assert model.channels[0].sigma == 1.0
    share = model.channels[1].sigma
    assert share is not None
    assert 0.003 < share < 0.05  # of 1 %, by eight numbers alone
    noise = model.first_noise(runs)
    run = runs[0]
    variance = model.filter(run, {}, noise).variance
    assert np.allclose(variance[run.channel == 0], 0.002**2)
    assert np.allclose(variance[run.channel == 1], (share * run.value[run.channel == 1]) ** 2)
    assert math.isfinite(float(model.innovations(run, {}, model.filter(run, {}, noise)).sum()))
