"""The oracle beside a diagnosis, against generalised least squares with dense covariances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.linear_model import LinearModel, drawn, empty_runs, one
from tools.diagnosis.engine import diagnose
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Noise, Parameter, Run
from tools.diagnosis.options import Options
from tools.diagnosis.result import Diagnosis
from tools.practice.oracle import judge, true_values

NOISE = Noise(np.array([0.3, 0.2]), np.array([0.3]), np.array([1.0]))
TOLERANCE = Parameter("tolerance.t", "1", prior_sd=0.05, scale=0.05)
MODEL = LinearModel((one("a"), one("b")), (TOLERANCE,), (), (), guess=NOISE)
TRUTH = {"a.k": 0.7}
EFFECTS = [{"name": "a", "size": 0.7, "parameters": {"k": 0.7}}]


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    runs = empty_runs(["a.k", "b.k", "tolerance.t"], 4, 120, 3)
    values = {**TRUTH, "tolerance.t": 0.04}
    found = diagnose(MODEL, drawn(MODEL, runs, values, NOISE, 3), Options(draws=60, workers=1))
    assert [cause.name for cause in found.report.causes] == ["a"]
    return found


def left(runs: Sequence[Run], values: dict[str, float]) -> float:
    """eᵀ C⁻¹ e of some runs, with C in full."""
    total = 0.0
    for run in runs:
        error = run.value - MODEL.mean(run, values)
        total += float(error @ np.linalg.solve(MODEL.covariance(run, NOISE), error))
    return total


def fitted(runs: Sequence[Run], free: Sequence[str], given: dict[str, float]) -> dict[str, float]:
    """Values by generalised least squares with the tolerance's prior, by the normal equations."""
    names = ["tolerance.t", *free]
    matrix = np.diag([TOLERANCE.prior_sd**-2, *(0.0 for _ in free)])
    slope = np.zeros(len(names))
    for run in runs:
        columns = np.column_stack([run.inputs[name] for name in names])
        weighted = np.linalg.solve(MODEL.covariance(run, NOISE), columns)
        matrix += weighted.T @ columns
        slope += weighted.T @ (run.value - MODEL.mean(run, given))
    return {**given, **dict(zip(names, np.linalg.solve(matrix, slope).tolist(), strict=True))}


def test_all_four_are_judged_as_by_dense_algebra(diagnosis: Diagnosis) -> None:
    found = judge(diagnosis, EFFECTS, NOISE, 1)
    parts: tuple[list[Run], list[Run]] = ([], [])
    for run, held in zip(diagnosis.problem.runs, diagnosis.traces.held_out, strict=True):
        parts[held].append(run)
    train, held_out = parts
    assert train
    assert held_out
    near = {"abs": 0.05}  # a fit ends where a step promises less than 0.02
    assert found.believed == pytest.approx(left(held_out, fitted(train, [], {})), **near)
    assert found.oracle == pytest.approx(left(held_out, fitted(train, ["a.k"], {})), **near)
    assert found.truth == pytest.approx(left(held_out, fitted(train, [], TRUTH)), **near)
    assert found.extended == pytest.approx(left(held_out, dict(diagnosis.after.shared)), **near)
    assert found.believed - found.oracle > 50.0


def test_a_right_name_is_not_enough(diagnosis: Diagnosis) -> None:
    wrong = replace(diagnosis, after=diagnosis.after.moved({"a.k": 1.4}))
    found, whole = judge(wrong, EFFECTS, NOISE, 1), judge(diagnosis, EFFECTS, NOISE, 1)
    assert (found.believed, found.oracle) == (whole.believed, whole.oracle)
    assert found.believed - found.extended < 0.9 * (found.believed - found.oracle)


def test_an_amplitude_with_a_phase_is_two_components() -> None:
    from plant.robots import wang2014
    from tools.practice.strength import CHANNELS

    causes = {cause.name: cause for cause in FishModel(wang2014(), CHANNELS).causes}
    iron = causes["compass_hard_iron"]
    values = true_values(iron, {"a": 0.1, "phi_rad": math.pi / 6.0})
    assert iron.report([values[p.name] for p in iron.parameters]) == pytest.approx(
        (0.1, math.pi / 6.0)
    )
    assert sorted(values.values()) == pytest.approx([0.05, 0.05 * math.sqrt(3.0)])
    drag = true_values(causes["drag_vs_bias"], {"kd_per_rad": 2e-4, "cd_per_rad2": 1.5})
    assert drag == {"drag_vs_bias.cd_per_rad2": 1.5, "drag_vs_bias.kd_per_rad": 2e-4}
