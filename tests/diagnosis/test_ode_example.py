"""The documented example that is no fish: its page is executed, and its model examined."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools.diagnosis.engine import diagnose
from tools.diagnosis.model import Noise, Run
from tools.diagnosis.noise import minus_twice_log_likelihood
from tools.diagnosis.ode import Inputs, OdeModel, measured
from tools.diagnosis.options import Options

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis-engine.md"
NOISE = Noise(np.array([0.3, 0.02]), np.array([1.0]), np.array([0.5]))


def source() -> str:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return str(code)


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    scope: dict[str, Any] = {}
    exec(compile(source(), str(PAGE), "exec"), scope)
    return scope


def test_the_example_is_under_60_lines_of_code() -> None:
    code = source()
    ast.parse(code)
    assert sum(1 for line in code.splitlines() if line.strip()) < 60


def test_the_example_finds_what_is_hidden(page: dict[str, Any]) -> None:
    report = page["found"].report
    assert report.verdict == "named"
    (cause,) = report.causes
    assert cause.name == "dry_friction"
    size = cause.parameters["size"]
    assert abs(size.estimate - 2e-3) < 3.0 * size.standard_error
    assert report.held_out.gain > 0.8
    for name, before in report.held_out.rmse_before.items():
        assert report.held_out.rmse_after[name] < before


def empty(page: dict[str, Any], seed: int) -> list[Run]:
    generator = np.random.default_rng(seed)
    time_s = page["time_s"]
    return [
        measured(
            f"run{i}",
            time_s,
            np.zeros((time_s.size, 2)),
            Inputs(time_s, np.repeat(generator.uniform(-6.0, 6.0, 10), 40)[:, None], np.zeros(2)),
        )
        for i in range(4)
    ]


def drawn(page: dict[str, Any], seed: int, values: dict[str, float]) -> list[Run]:
    motor: OdeModel = page["motor"]
    generator = np.random.default_rng([seed, 1])
    return [motor.draw(run, values, NOISE, generator) for run in empty(page, seed)]


@pytest.mark.parametrize("seed", [3, 4])
def test_a_healthy_motor_is_healthy(page: dict[str, Any], seed: int) -> None:
    values = {"tolerance.k": 0.012, "tolerance.inertia": -0.02}
    found = diagnose(page["motor"], drawn(page, seed, values), Options(draws=80))
    assert found.report.verdict == "nothing_wrong"


def test_two_faults_of_a_motor_are_both_named(page: dict[str, Any]) -> None:
    values = {"inertia.size": 0.3, "tacho_bias.size": 0.4}
    found = diagnose(page["motor"], drawn(page, 5, values), Options(draws=80))
    assert {cause.name for cause in found.report.causes} == {"inertia", "tacho_bias"}


def test_neutral_values_are_the_believed_motor_exactly(page: dict[str, Any]) -> None:
    motor: OdeModel = page["motor"]
    run = drawn(page, 6, {})[0]
    fixed = motor.filter(run, {}, NOISE)
    believed = motor.innovations(run, {}, fixed)
    for cause in motor.causes:
        neutral = cause.values(*(0.0 for _ in cause.parameters))
        np.testing.assert_array_equal(motor.innovations(run, neutral, fixed), believed)


def test_its_filter_is_the_likeliest_at_the_true_noise(page: dict[str, Any]) -> None:
    motor: OdeModel = page["motor"]
    runs = drawn(page, 7, {})

    def cost(scale: float) -> float:
        noise = Noise(NOISE.sigma, scale * NOISE.disturbance, NOISE.correlation_s)
        filters = [motor.filter(run, {}, noise) for run in runs]
        return minus_twice_log_likelihood(
            [
                (motor.innovations(run, {}, fixed), fixed.variance)
                for run, fixed in zip(runs, filters, strict=True)
            ]
        )

    assert cost(1.0) < cost(0.6)
    assert cost(1.0) < cost(1.7)


def test_whitened_innovations_of_the_true_motor_are_white(page: dict[str, Any]) -> None:
    motor: OdeModel = page["motor"]
    run = drawn(page, 8, {})[0]
    fixed = motor.filter(run, {}, NOISE)
    white = motor.innovations(run, {}, fixed) / np.sqrt(fixed.variance)
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.1


def test_functions_that_numba_cannot_compile_give_the_same(page: dict[str, Any]) -> None:
    compiled: OdeModel = page["motor"]
    rates = page["rates"]

    def plainly(t: float, x: Any, u: Any, p: Any) -> Any:
        return tuple({"rate": rate}["rate"] for rate in list(rates(t, x, u, p)))

    plain = OdeModel(
        plainly,
        compiled.outputs,
        compiled.states,
        compiled.inputs,
        compiled.believed,
        compiled.channels,
        compiled.rows,
        compiled.tolerated,
        compiled.substep_s,
    )
    run = drawn(page, 9, {})[0]
    short = measured("short", run.time_s[::2][:40], run.value.reshape(-1, 2)[:40], run.inputs)
    one, other = compiled.filter(short, {}, NOISE), plain.filter(short, {}, NOISE)
    np.testing.assert_allclose(one.gain, other.gain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        compiled.innovations(short, {}, one),
        plain.innovations(short, {}, other),
        rtol=1e-9,
        atol=1e-12,
    )
