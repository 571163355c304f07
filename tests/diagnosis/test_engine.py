"""The whole diagnosis on a linear model: what is hidden is found, and nothing where nothing is."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.diagnosis.linear_model import LinearModel, drawn, empty_runs, one
from tools.diagnosis import selection
from tools.diagnosis.calibration import NullLaw
from tools.diagnosis.engine import diagnose
from tools.diagnosis.evidence import neutral, start_problem
from tools.diagnosis.model import Noise, Parameter, Run
from tools.diagnosis.options import Options
from tools.diagnosis.refit import cost_at, costs_beside, fit
from tools.diagnosis.result import Diagnosis, Report
from tools.diagnosis.workers import Workers

NOISE = Noise(np.array([0.3, 0.2]), np.array([0.3]), np.array([1.0]))
NAMES = ("a", "b", "c", "d", "e", "f")
TOLERANCE = Parameter("tolerance.t", "1", prior_sd=0.05, scale=0.05)
TERM = Parameter("term.q", "m", scale=0.1)
OPTIONS = Options(draws=120, workers=1)
HIDDEN = ("hidden",)


def a_model() -> LinearModel:
    causes = tuple(one(name, least=0.0 if name == "c" else -math.inf) for name in NAMES)
    return LinearModel(causes, (TOLERANCE,), (TERM,), (), guess=NOISE)


def runs_of(seed: int, count: int = 4) -> list[Run]:
    names = [f"{name}.k" for name in NAMES]
    return empty_runs([*names, "tolerance.t", "term.q", "hidden"], count, 120, seed)


def diagnosed(seed: int, options: Options = OPTIONS, count: int = 4, **sizes: float) -> Diagnosis:
    model = a_model()
    values = {name.replace("_", "."): size for name, size in sizes.items()}
    return diagnose(model, drawn(model, runs_of(seed, count), values, NOISE, seed), options)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    found = diagnosed(seed, tolerance_t=0.05)
    assert found.report.verdict == "nothing_wrong"
    assert found.report.causes == []
    assert not found.report.remaining_structure.found
    assert found.report.held_out.gain == 0.0
    assert set(found.report.smallest_detectable) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_hidden_cause_is_named_with_its_size(name: str) -> None:
    found = diagnosed(21, **{f"{name}_k": 0.7})
    assert found.report.verdict == "named"
    (cause,) = found.report.causes
    assert cause.name == name
    assert cause.p_value < 1e-6
    size = cause.parameters["k"]
    assert abs(size.estimate - 0.7) < 3.5 * size.standard_error
    assert cause.statement == f"{name} is {size.estimate:.3g}."
    held = found.report.held_out
    assert held.gain > 0.6
    assert held.gain_ci95[0] <= held.gain <= held.gain_ci95[1]
    assert held.gain_ci95[1] > 0.95


def test_two_causes_are_both_named() -> None:
    found = diagnosed(12, b_k=0.8, e_k=-0.7)
    assert found.report.verdict == "named"
    assert {cause.name for cause in found.report.causes} == {"b", "e"}


def test_a_force_of_the_library_is_unknown_not_a_wrong_name() -> None:
    found = diagnosed(13, term_q=0.9)
    assert found.report.verdict == "unexplained"
    (cause,) = found.report.causes
    assert cause.name == "unknown_force"
    assert cause.parameters["term.q"].estimate == pytest.approx(0.9, abs=0.15)


def test_what_nothing_knows_is_never_named() -> None:
    found = diagnosed(14, hidden=2.0)
    assert found.report.verdict in ("unexplained", "nothing_wrong")
    assert all(cause.name == "unknown_force" for cause in found.report.causes)
    assert found.report.remaining_structure.found
    assert found.report.remaining_structure.where


def test_causes_that_act_alike_come_as_a_set() -> None:
    model = a_model()
    runs = [
        replace(run, inputs={**run.inputs, "b.k": 1.3 * run.inputs["a.k"]}) for run in runs_of(15)
    ]
    found = diagnose(model, drawn(model, runs, {"a.k": 0.8}, NOISE, 15), OPTIONS)
    assert found.report.verdict == "ambiguous"
    assert {cause.name for cause in found.report.causes} == {"a", "b"}
    assert [sorted(group) for group in found.report.confusable] == [["a", "b"]]
    where = [found.names.index(name) for name in ("a", "b")]
    assert found.cosines[where[0], where[1]] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("size", "named"), [(0.5, "a"), (0.9, "unknown_force")])
def test_a_term_that_is_a_guise_of_a_cause_takes_its_place_only_by_far(
    size: float, named: str
) -> None:
    """The library's term is the cause but for one run, at a cosine above 0.9, and fits better."""
    model = a_model()
    runs = [
        replace(run, inputs={**run.inputs, "term.q": (1.0 if i else 2.2) * run.inputs["a.k"]})
        for i, run in enumerate(runs_of(19))
    ]
    found = diagnose(model, drawn(model, runs, {"term.q": size}, NOISE, 19), OPTIONS)
    assert [cause.name for cause in found.report.causes] == [named]


def test_starts_are_compared_once_nuisances_have_given_way() -> None:
    """A tolerance that stands in for a cause makes it costly; where all is straight none does."""
    model = a_model()
    runs = [
        replace(run, inputs={**run.inputs, "tolerance.t": run.inputs["a.k"]}) for run in runs_of(22)
    ]
    problem = start_problem(model, drawn(model, runs, {"a.k": 0.2}, NOISE, 22), Workers(1))
    without = fit(problem, neutral(problem), (), {})
    point = without.point.moved({"a.k": 0.2})
    least = fit(problem, point, (), {}).objective
    (cost,) = costs_beside(problem, [point], without.nuisances)
    assert cost == pytest.approx(least, rel=1e-6)
    assert cost_at(problem, point, without.nuisances) > without.objective > least


def test_look_alikes_are_told_together_though_one_fits_better() -> None:
    """The second is the first with noise of its own: some evidence, at a cosine above 0.9."""
    model = a_model()
    generator = np.random.default_rng(3)
    runs = []
    for run in runs_of(20):
        column = run.inputs["a.k"]
        other = generator.standard_normal(column.size) * float(np.std(column))
        runs.append(
            replace(
                run, inputs={**run.inputs, "b.k": 0.97 * column + math.sqrt(1 - 0.97**2) * other}
            )
        )
    found = diagnose(model, drawn(model, runs, {"a.k": 0.45}, NOISE, 20), OPTIONS)
    where = [found.names.index(name) for name in ("a", "b")]
    assert 0.9 < found.cosines[where[0], where[1]] < 0.995
    assert found.selection is not None
    best, second = found.selection.rivals[0][:2]
    assert OPTIONS.margin < best.evidence - second.evidence < OPTIONS.alike_margin
    assert found.report.verdict == "ambiguous"


def test_wild_healthy_data_are_drawn_again_around_the_causes() -> None:
    """Where the first law alarms late, the one that judges the rest is of the extended model."""
    model = a_model()
    data = drawn(model, runs_of(21), {"a.k": 0.9}, NOISE, 21)
    early = diagnose(model, data, replace(OPTIONS, least_gain=0.0, least_more=0.0))
    late = diagnose(model, data, replace(OPTIONS, least_gain=20.0))
    assert early.report.verdict == late.report.verdict == "named"
    assert early.calibration.gains.shape[1] == late.calibration.gains.shape[1] - 1


def test_the_estimator_favours_no_candidate() -> None:
    """Filters are those of the nuisances alone, wherever the causes stand."""
    model = a_model()
    with Workers(1) as workers:
        problem = start_problem(model, drawn(model, runs_of(22), {}, NOISE, 22), workers)
    values = {"tolerance.t": 0.02, "a.k": 0.3, "term.q": 0.1, "one: offset": 0.2}
    assert problem.believed(values) == {"tolerance.t": 0.02}


def test_a_single_run_is_split_in_time_and_says_so() -> None:
    found = diagnosed(16, count=1, a_k=1.5)
    assert any("one run only" in note for note in found.report.notes)
    assert found.report.held_out.runs == ["run0"]
    assert [cause.name for cause in found.report.causes] == ["a"]


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    one_thread = diagnosed(17, a_k=0.8)
    three = diagnosed(17, replace(OPTIONS, workers=3), a_k=0.8)
    assert msgspec.json.encode(one_thread.report) == msgspec.json.encode(three.report)


def test_a_calibration_is_drawn_once(tmp_path: Path) -> None:
    first = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    second = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    assert not first.calibration.cached
    assert second.calibration.cached
    np.testing.assert_array_equal(first.calibration.gains, second.calibration.gains)
    assert [path.suffix for path in tmp_path.iterdir()] == [".npz"]


def test_a_spoilt_cache_is_drawn_anew(tmp_path: Path) -> None:
    first = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(b"not an archive")
    second = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    assert not second.calibration.cached
    assert second.report == first.report


def test_the_report_survives_json() -> None:
    report = diagnosed(11, a_k=0.7).report
    assert msgspec.json.decode(msgspec.json.encode(report), type=Report) == report


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_a_sigma_that_the_data_contradict_is_estimated_and_said(factor: float) -> None:
    plain = a_model()
    first = replace(plain.channels[0], sigma=factor * float(NOISE.sigma[0]))
    other = replace(plain.channels[1], sigma=float(NOISE.sigma[1]))
    guess = replace(NOISE, sigma=np.array([first.sigma, other.sigma]))
    model = replace(plain, channels=(first, other), guess=guess)
    found = diagnose(model, drawn(plain, runs_of(31), {}, NOISE, 31), OPTIONS)
    assert found.report.verdict == "nothing_wrong"
    (note,) = found.report.notes
    assert note.startswith(f"one: sigma is given as {first.sigma:.3g}")
    assert found.problem.noise.sigma[0] == pytest.approx(NOISE.sigma[0], rel=0.2)
    assert found.problem.noise.sigma[1] == NOISE.sigma[1]


def test_no_runs_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one run"):
        diagnose(a_model(), [])


def test_a_further_cause_that_gains_too_little_in_the_end_is_left_out_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever was promised where it was screened: as refitted it gains 106."""

    def offered(
        final: selection.Stage, sizes: dict[str, float], options: Options, _law: NullLaw
    ) -> selection.Alternative | None:
        if len(final.members) > 1:
            return None
        return selection.alternatives(final, sizes, options)[0]

    def included(least_more: float) -> list[str]:
        options = replace(OPTIONS, draws=40, least_more=least_more)
        found = diagnosed(39, options, a_k=0.9, b_k=0.33)
        assert found.selection is not None
        return [member.cause.name for member in found.selection.final.members]

    monkeypatch.setattr(selection, "_more", offered)
    assert included(100.0) == ["a", "b"]
    assert included(112.0) == ["a"]
