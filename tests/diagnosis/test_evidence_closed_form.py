"""Likelihoods, gains and projections against dense Gaussian algebra, and refits against SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize
from scipy.stats import chi2, multivariate_normal

from tests.diagnosis.linear_model import LinearModel, drawn, empty_runs, one
from tools.diagnosis.calibration import null_law
from tools.diagnosis.evidence import Point, neutral, nuisances, project, start_problem
from tools.diagnosis.judging import one_parameter_scale
from tools.diagnosis.model import Filter, Noise, Parameter, Run, Values
from tools.diagnosis.noise import estimate, minus_twice_log_likelihood, unpack
from tools.diagnosis.options import Options
from tools.diagnosis.refit import fit
from tools.diagnosis.selection import stage
from tools.diagnosis.sparse import forward
from tools.diagnosis.workers import Workers

NOISE = Noise(np.array([0.3, 0.2]), np.array([0.5]), np.array([1.5]))
TOLERANCE = Parameter("tolerance.t", "1", prior_sd=0.4, scale=0.4)
START = Parameter("start.s", "1", prior_sd=0.7, scale=0.7)
NAMES = ("a.k", "b.k", "c.k", "tolerance.t", "start.s")


def a_model() -> LinearModel:
    return LinearModel(
        (one("a"), one("b"), one("c", least=0.0)), (TOLERANCE,), (), (START,), guess=NOISE
    )


def dense(model: LinearModel, run: Run, shared: bool) -> np.ndarray:
    """Covariance of a run with its start (and, if asked, the tolerance) integrated out."""
    start = run.inputs["start.s"]
    total = model.covariance(run, NOISE) + START.prior_sd**2 * np.outer(start, start)
    if shared:
        t = run.inputs["tolerance.t"]
        total = total + TOLERANCE.prior_sd**2 * np.outer(t, t)
    return total


def all_runs_dense(model: LinearModel, runs: list[Run]) -> tuple[np.ndarray, np.ndarray]:
    """Covariance and values of all runs together: the tolerance is the same in all of them."""
    sizes = [run.value.size for run in runs]
    whole = np.zeros((sum(sizes), sum(sizes)))
    offset = 0
    for run in runs:
        rows = slice(offset, offset + run.value.size)
        whole[rows, rows] = dense(model, run, False)
        offset += run.value.size
    t = np.concatenate([run.inputs["tolerance.t"] for run in runs])
    whole += TOLERANCE.prior_sd**2 * np.outer(t, t)
    return whole, np.concatenate([run.value for run in runs])


def test_innovations_have_the_likelihood_of_the_dense_gaussian() -> None:
    model = a_model()
    (run,) = drawn(model, empty_runs(NAMES, 1), {"a.k": 0.4}, NOISE, 1)
    fixed = model.filter(run, {}, NOISE)
    ours = minus_twice_log_likelihood([(model.innovations(run, {}, fixed), fixed.variance)])
    exact = multivariate_normal(np.zeros(run.value.size), model.covariance(run, NOISE))
    constant = run.value.size * np.log(2.0 * np.pi)
    assert ours + constant == pytest.approx(-2.0 * exact.logpdf(run.value), rel=1e-10)


class Weighed(LinearModel):
    """The disturbance shows more by a share of its first cause: gains depend on the cause."""

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        more = 1.0 + values.get("a.k", 0.0)
        return super().filter(run, values, replace(noise, disturbance=more * noise.disturbance))


def test_a_point_with_an_estimator_of_its_own_has_the_likelihood_of_its_own_dense_gaussian() -> (
    None
):
    model = Weighed((one("a"),), guess=NOISE)
    runs = drawn(model, empty_runs(["none"], 2), {}, NOISE, 8)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        own = [problem.likelihood(neutral(problem).moved({"a.k": k})) for k in (0.0, 0.7)]
    larger = replace(NOISE, disturbance=1.7 * NOISE.disturbance)
    exact = [
        -2.0
        * sum(
            multivariate_normal(np.zeros(run.value.size), model.covariance(run, noise)).logpdf(
                run.value
            )
            for run in runs
        )
        for noise in (NOISE, larger)
    ]
    assert own[1] - own[0] == pytest.approx(exact[1] - exact[0], rel=1e-8)


def test_gain_is_the_likelihood_ratio_with_nuisances_integrated_out() -> None:
    model = a_model()
    runs = drawn(model, empty_runs(NAMES), {"a.k": 0.3, "tolerance.t": 0.5}, NOISE, 2)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        found = stage(problem, _no_noise(), (), neutral(problem), {}, Options())
    covariance, values = all_runs_dense(model, runs)
    for name in ("a", "b"):
        column = np.concatenate([run.inputs[f"{name}.k"] for run in runs])
        weighed = np.linalg.solve(covariance, column)
        exact = (weighed @ values) ** 2 / (weighed @ column)
        mine = found.screen.owners.index(name)
        assert found.judgement.plain[mine] == pytest.approx(exact, rel=1e-3)


def test_projection_is_direct_least_squares() -> None:
    model = a_model()
    runs = drawn(model, empty_runs(NAMES), {}, NOISE, 3)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        point = neutral(problem)
        residuals = problem.residuals(point)
        known = nuisances(problem, point, residuals, {})
    columns = [
        np.column_stack(
            [problem.residual(i, {name: 1.0}) - residuals[i] for name in ("a.k", "b.k", "c.k")]
        )
        for i in range(len(runs))
    ]
    found = project(known, columns).information
    # One regression with the priors as rows: shared tolerance, then a start per run.
    count = len(runs)
    design = [
        np.column_stack([n[:, :1], *(n[:, 1:] * (k == i) for k in range(count))])
        for i, n in enumerate(known.columns)
    ]
    priors = np.diag([1.0 / TOLERANCE.prior_sd] + [1.0 / START.prior_sd] * count)
    whole = np.vstack([*design, priors])
    targets = np.vstack([*columns, np.zeros((count + 1, 3))])
    left = targets - whole @ np.linalg.lstsq(whole, targets, rcond=None)[0]
    np.testing.assert_allclose(found, left.T @ left, rtol=1e-8)


def test_a_parameter_with_one_sign_gains_nothing_by_the_other() -> None:
    model = a_model()
    runs = drawn(model, empty_runs(NAMES), {"c.k": -1.0}, NOISE, 4)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        found = stage(problem, _no_noise(), (), neutral(problem), {}, Options())
    assert found.gain("c") == 0.0


def test_noise_is_where_the_dense_likelihood_is_largest() -> None:
    model = replace(a_model(), tolerances=(), start=())
    runs = drawn(model, empty_runs(NAMES, 3), {}, NOISE, 5)
    guess = Noise(np.array([0.5, 0.5]), np.array([0.3]), np.array([1.0]))
    with Workers(1) as workers:
        problem = start_problem(replace(model, guess=guess), runs, workers)
        found = estimate(problem, neutral(problem), guess, guess, iterations=30)

    def cost(logarithms: np.ndarray) -> float:
        noise = unpack(logarithms, guess)
        likelihood = sum(
            multivariate_normal(np.zeros(run.value.size), model.covariance(run, noise)).logpdf(
                run.value
            )
            for run in runs
        )
        first = np.log(np.concatenate([guess.sigma, guess.disturbance, guess.correlation_s]))
        prior = ((logarithms - first) / np.array([1.5, 1.5, 1.5, 0.7])) ** 2
        return float(-2.0 * likelihood + prior.sum())

    start = np.log(np.array([0.5, 0.5, 0.3, 1.0]))
    exact = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3})
    ours = np.log(
        np.concatenate([found.noise.sigma, found.noise.disturbance, found.noise.correlation_s])
    )
    assert cost(ours) <= exact.fun + 1.0


class Curved(LinearModel):
    """Its cause acts as an exponential, so that refits have to iterate."""

    def mean(self, run: Run, values):  # type: ignore[no-untyped-def]
        plain = super().mean(run, {k: v for k, v in values.items() if k != "a.k"})
        return plain + np.exp(values.get("a.k", 0.0) * run.inputs["a.k"]) - 1.0


def test_refit_is_scipys_least_squares() -> None:
    model = Curved((one("a", most=3.0),), (TOLERANCE,), (), (START,), guess=NOISE)
    runs = drawn(model, empty_runs(NAMES), {"a.k": 1.4, "tolerance.t": 0.3}, NOISE, 6)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        found = fit(problem, neutral(problem), model.causes[0].parameters, {}, iterations=40)

        def residuals(x: np.ndarray) -> np.ndarray:
            point = Point({"a.k": x[0], "tolerance.t": x[1]}, tuple({"start.s": s} for s in x[2:]))
            priors = [x[1] / TOLERANCE.prior_sd, *(x[2:] / START.prior_sd)]
            return np.concatenate([*problem.residuals(point), priors])

        exact = least_squares(residuals, np.zeros(2 + len(runs)), x_scale=0.1)
    assert found.objective == pytest.approx(2.0 * exact.cost, abs=0.02)
    covariance = np.linalg.inv(exact.jac.T @ exact.jac)
    assert found.estimates()["a.k"] == pytest.approx(exact.x[0], abs=0.1 * covariance[0, 0] ** 0.5)
    assert found.covariance[0, 0] == pytest.approx(covariance[0, 0], rel=0.1)


def test_refit_stays_within_bounds() -> None:
    model = Curved((one("a", most=0.5),), (TOLERANCE,), (), (START,), guess=NOISE)
    runs = drawn(model, empty_runs(NAMES), {"a.k": 1.4}, NOISE, 7)
    with Workers(1) as workers:
        problem = start_problem(model, runs, workers)
        found = fit(problem, neutral(problem), model.causes[0].parameters, {})
    assert found.estimates()["a.k"] == 0.5


def test_tail_of_the_best_of_many_is_never_too_thin() -> None:
    generator = np.random.default_rng(8)
    mixing = generator.standard_normal((40, 12))
    mixing /= np.linalg.norm(mixing, axis=1, keepdims=True)

    def best(count: int) -> np.ndarray:
        return np.max((generator.standard_normal((count, 12)) @ mixing.T) ** 2, axis=1)

    reference = best(200_000)
    for p in (0.1, 0.01, 1e-3):
        exact = float(np.quantile(reference, 1.0 - p))
        ours = [null_law(best(240)).p_value(exact) for _ in range(40)]
        assert 0.7 * p <= np.median(ours) <= 4.0 * p
    far = float(np.quantile(reference, 1.0 - 1e-4))
    assert np.mean([null_law(best(240)).p_value(far) < 1e-4 / 3.0 for _ in range(40)]) < 0.05


def test_the_tail_of_a_largest_periodogram_value_is_known_unless_draws_are_wild() -> None:
    generator = np.random.default_rng(9)
    several = 2.0 * generator.standard_exponential((100, 96, 1500)).max(axis=2)
    far = 40.0
    exact = 1500.0 * np.exp(-0.5 * far)
    known = np.array([null_law(draws, known=True).p_value(far) for draws in several])
    assert 0.5 * exact < np.median(known) < 2.0 * exact
    assert np.mean(known > 5.0 * exact) < 0.1
    guessed = np.array([null_law(draws).p_value(far) for draws in several])
    assert np.mean(guessed > 5.0 * exact) > 0.25
    wild = several[0].copy()
    wild[:5] *= 5.0
    assert null_law(wild, known=True).p_value(far) == null_law(wild).p_value(far) > 1e-3


@given(st.floats(0.0, 300.0), st.integers(1, 6))
def test_gains_of_several_parameters_are_put_on_one_scale(gain: float, parameters: int) -> None:
    one_scale = float(one_parameter_scale(np.array([gain]), parameters)[0])
    assert 0.0 <= one_scale <= gain + 1e-9
    expected = chi2.logsf(gain, parameters)
    if one_scale < gain:
        assert chi2.logsf(one_scale, 1) == pytest.approx(expected, rel=1e-6, abs=1e-9)


@given(st.integers(0, 2**31 - 1), st.integers(2, 8))
@settings(max_examples=30)
def test_forward_entry_picks_what_explains_most(seed: int, width: int) -> None:
    generator = np.random.default_rng(seed)
    columns = generator.standard_normal((60, width))
    target = generator.standard_normal(60) + 3.0 * columns[:, 0]
    gram, slope = columns.T @ columns, columns.T @ target
    chosen = forward(gram, slope, 2, 0.0)
    single = slope**2 / np.diag(gram)
    assert chosen[0] == int(np.argmax(single))
    if len(chosen) == 2:
        pairs = [
            float(np.linalg.lstsq(columns[:, [chosen[0], k]], target, rcond=None)[1][0])
            for k in range(width)
            if k != chosen[0]
        ]
        picked = np.linalg.lstsq(columns[:, chosen], target, rcond=None)[1][0]
        assert picked == pytest.approx(min(pairs), rel=1e-9)


def _no_noise():  # type: ignore[no-untyped-def]
    from tools.diagnosis.noise import NoiseEstimate

    return NoiseEstimate(NOISE, np.zeros(0, dtype=np.int64), np.zeros((0, 0)))
