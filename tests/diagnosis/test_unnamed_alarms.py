"""What alarms without a name (many small terms, stretched tolerances), and which runs test it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, gamma, kstest, ncx2

from tests.diagnosis.linear_model import LinearModel, drawn, empty_runs, one
from tools.diagnosis.engine import diagnose
from tools.diagnosis.evidence import start_problem
from tools.diagnosis.model import Noise, Parameter, Run
from tools.diagnosis.options import Options
from tools.diagnosis.screening import ANY_FORCE, families
from tools.diagnosis.whiteness import TONE_STEP_S, alike, regimes, tone
from tools.diagnosis.workers import Workers

NOISE = Noise(np.array([0.3, 0.2]), np.array([0.3]), np.array([1.0]))
TOLERANCE = Parameter("tolerance.t", "1", prior_sd=0.05, scale=0.05)
TERMS = tuple(Parameter(f"push.x:{i}", "m", scale=0.1) for i in range(16))
NAMES = ("a", "b", "c")
COLUMNS = [*(f"{name}.k" for name in NAMES), "tolerance.t", *(term.name for term in TERMS)]
OPTIONS = Options(draws=96, workers=1)


def a_model() -> LinearModel:
    return LinearModel(tuple(one(name) for name in NAMES), (TOLERANCE,), TERMS, guess=NOISE)


def runs_of(seed: int, count: int = 4) -> list[Run]:
    return empty_runs(COLUMNS, count, 120, seed)


def test_a_term_belongs_to_its_axis_and_to_all_forces_and_an_error_to_its_sensor() -> None:
    with Workers(1) as workers:
        problem = start_problem(a_model(), runs_of(1), workers)
    found = families(problem)
    assert list(found) == ["push.x", ANY_FORCE, "one", "two"]
    assert found["push.x"] == found[ANY_FORCE]
    assert found["push.x"][1] == [term.name for term in TERMS]
    assert "one: offset" in found["one"][1]


def test_many_terms_none_of_which_stands_out_are_an_alarm_without_a_name() -> None:
    model = a_model()
    values = {term.name: 0.085 * (-1.0) ** i for i, term in enumerate(TERMS)}
    found = diagnose(model, drawn(model, runs_of(6), values, NOISE, 6), OPTIONS)
    assert found.selection is None  # no single candidate reaches the threshold
    assert found.report.verdict == "unexplained"
    assert all(cause.name == "unknown_force" for cause in found.report.causes)
    assert "like a sum of terms of push.x" in found.report.remaining_structure.where


def test_a_stretched_tolerance_is_an_alarm_that_says_which() -> None:
    model = a_model()
    data = drawn(model, runs_of(3), {"tolerance.t": 0.45}, NOISE, 3)
    found = diagnose(model, data, OPTIONS)
    assert found.report.verdict == "unexplained"
    assert found.report.causes == []
    assert "stretches tolerance.t to" in found.report.remaining_structure.where
    usual = drawn(model, runs_of(3), {"tolerance.t": 0.08}, NOISE, 3)
    assert diagnose(model, usual, OPTIONS).report.verdict == "nothing_wrong"


def test_a_tone_is_added_up_over_channels_and_runs_and_judged_beside_its_neighbours() -> None:
    """A sine of amplitude A adds n A²/4 to a periodogram whose mean is one; two runs, four."""
    time_s = 0.1 * np.arange(1200.0)
    channel = np.repeat([0, 1], 600)
    moments = np.concatenate([time_s[::2], time_s[::2]])
    order = np.argsort(moments, kind="stable")
    run = Run("sine", moments[order], channel[order], np.zeros(1200), dict.fromkeys(COLUMNS, 0.0))
    with Workers(1) as workers:
        problem = start_problem(a_model(), [run, run], workers)
    assert alike(problem) == {"m": [0, 1]}
    hertz = 247.0 / (16384 * TONE_STEP_S)  # of the grid of 2¹⁴ moments
    sine = 0.35 * np.sin(2.0 * np.pi * hertz * run.time_s + 0.3)
    power = 600 * 0.35**2 / 4.0
    generator = np.random.default_rng(6)
    told = []
    for _ in range(30):
        noise = generator.standard_normal((2, 1200))
        improbable, found = tone(problem, [*(noise + sine)], (0, 1))
        again, same = tone(problem, [*(0.3 * (noise + sine))], (0, 1))
        assert again == pytest.approx(improbable)  # whatever the noise was taken for
        assert found == same == pytest.approx(hertz, abs=0.01)
        told.append(improbable)
    middle = ncx2.median(8, 8.0 * power) / 2.0  # four periodograms of two degrees of freedom
    assert np.median(told) == pytest.approx(-2.0 * gamma(4).logsf(middle), rel=0.1)


def test_runs_are_held_out_so_that_others_can_show_what_is_included() -> None:
    """The cause acts in two runs of six only: those that would be held out by default."""
    model = a_model()
    runs = runs_of(4, 6)
    default = diagnose(model, drawn(model, runs, {"a.k": 0.8}, NOISE, 4), OPTIONS)
    held = {i for i, flag in enumerate(default.traces.held_out) if flag}
    assert len(held) == 2
    rare = [
        replace(run, inputs={**run.inputs, "a.k": (i in held) * run.inputs["a.k"]})
        for i, run in enumerate(runs)
    ]
    found = diagnose(model, drawn(model, rare, {"a.k": 1.5}, NOISE, 4), OPTIONS)
    assert [cause.name for cause in found.report.causes] == ["a"]
    now = {i for i, flag in enumerate(found.traces.held_out) if flag}
    assert len(now) == 2
    assert len(now & held) == 1
    told = [replace(run, held_out=i in held) for i, run in enumerate(rare)]
    flagged = diagnose(model, drawn(model, told, {"a.k": 1.5}, NOISE, 4), OPTIONS)
    assert {i for i, flag in enumerate(flagged.traces.held_out) if flag} == held


def test_regimes_whose_means_differ_are_told_as_chi_squared() -> None:
    """Over seeds the p-values are uniform in noise; a shift in one regime is seen."""
    generator = np.random.default_rng(5)
    label = [generator.integers(0, 7, 900)]
    quiet = [regimes([[generator.standard_normal(900)]], [label]) for _ in range(400)]
    p_values = chi2.sf(quiet, 1)
    assert kstest(p_values, "uniform").pvalue > 1e-3
    shift = 0.6 * (label[0] == 3)
    shifted = [generator.standard_normal(900) + shift for _ in range(100)]
    found = [regimes([[each]], [label]) for each in shifted]
    middle = chi2.isf(chi2.sf(ncx2.median(7, float(shift @ shift)), 7), 1)
    assert np.median(found) == pytest.approx(middle, rel=0.1)
    assert regimes([[shifted[0][:10]]], [[label[0][:10]]]) == 0.0
