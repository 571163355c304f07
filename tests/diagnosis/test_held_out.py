"""What an extension gains on runs that its fit never saw: split, evidence, gain, verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.diagnosis.linear_model import LinearModel, drawn
from tests.diagnosis.test_engine import NOISE, OPTIONS, a_model, runs_of
from tools.diagnosis.engine import diagnose
from tools.diagnosis.evidence import neutral, start_problem
from tools.diagnosis.held_out import compare, gain_with_interval, split
from tools.diagnosis.model import FloatArray, Run, Values
from tools.diagnosis.noise import NoiseEstimate
from tools.diagnosis.selection import stage, table
from tools.diagnosis.workers import Workers


def test_flagged_runs_are_held_out_and_others_by_about_a_third() -> None:
    runs = runs_of(1, 6)
    chosen = split(runs, 1.0 / 3.0)
    assert len(chosen.held) == 2
    assert sorted(chosen.train + chosen.held) == list(range(6))
    flagged = [replace(run, held_out=i == 4) for i, run in enumerate(runs)]
    assert split(flagged, 1.0 / 3.0).held == (4,)


def test_held_out_evidence_scatters_as_it_is_told() -> None:
    """(evidence − change) / deviation is standard normal, with few runs to learn from too."""
    deviates, plain = [], []
    for seed in range(60):
        model = a_model()
        data = drawn(model, runs_of(100 + seed, 3), {"b.k": 0.25}, NOISE, 100 + seed)
        told = [replace(run, held_out=i > 0, sealed=i > 0) for i, run in enumerate(data)]
        with Workers(1) as workers:
            bare = start_problem(model, told[:1], workers)
            problem = bare.with_noise(NOISE, neutral(bare))
            member = table(problem)["b"]
            noise = NoiseEstimate(NOISE, np.zeros(0, dtype=np.int64), np.zeros((0, 0)))
            final = stage(problem, noise, [member], neutral(problem), {}, OPTIONS)
            found = compare(final, split(told, 1.0 / 3.0), {}, OPTIONS)
        deviates.append((found.evidence - found.change) / found.deviation)
        plain.append((found.evidence - found.change) / (2.0 * math.sqrt(found.change)))
    assert abs(np.mean(deviates)) < 0.4
    assert 0.75 < np.std(deviates) < 1.25
    assert np.std(plain) > 1.3  # noise of the held-out runs alone does not tell it


def gain_of(
    basis: FloatArray, told: FloatArray, left: FloatArray, generator: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Gain on white data (blocks * 20) where ``told`` was predicted and ``left`` was not."""
    after = left + generator.standard_normal(left.size)
    rows = np.arange(0, left.size, 20)
    removed = np.add.reduceat((after + told) ** 2 - after**2, rows)
    scores = np.add.reduceat(basis * after[:, None], rows)
    pairs = scores @ scores.T
    np.fill_diagonal(pairs, 0.0)
    return gain_with_interval(removed, pairs, generator)


def test_the_gain_is_the_share_that_is_removed_and_its_interval_holds_it() -> None:
    """The share is known here: 1 − |left|² / |told + left|²."""
    generator = np.random.default_rng(8)
    basis = np.linalg.qr(generator.standard_normal((24 * 20, 12)))[0]
    whole = basis @ generator.standard_normal(12)
    whole *= 20.0 / np.linalg.norm(whole)
    for share_left in (0.0, 0.3, 0.6):
        left = share_left * whole
        found = [gain_of(basis, whole - left, left, generator) for _ in range(150)]
        true = 1.0 - share_left**2
        assert abs(np.median([gain for gain, _ in found]) - true) < 0.02
        covered = np.mean([low <= true <= high for _, (low, high) in found])
        assert covered > 0.88


def test_what_removes_as_much_as_it_adds_gains_nothing() -> None:
    generator = np.random.default_rng(9)
    gain, (low, high) = gain_with_interval(np.full(24, 0.05), np.zeros((24, 24)), generator)
    assert (gain, low, high) == (1.0, 1.0, 1.0)  # every block by itself: nothing else is known
    scattered = np.tile([3.0, -3.0], 12)
    gain, (low, high) = gain_with_interval(scattered, np.zeros((24, 24)), generator)
    assert gain == 0.0
    assert low == -1.0
    assert high == 1.0


def flagged(sealed: Sequence[Run], open_: Sequence[Run]) -> list[Run]:
    kept = [replace(run, held_out=False) for run in open_]
    return [*kept, *(replace(run, held_out=True, sealed=True) for run in sealed)]


def swum(values: Values, seed: int = 3, count: int = 6) -> list[Run]:
    return drawn(a_model(), runs_of(seed, count), values, NOISE, seed)


def test_what_is_flagged_changes_nothing_that_is_found() -> None:
    """Neither noise nor threshold nor ranking nor estimates have seen the sealed runs."""
    seen = swum({"a.k": 0.9})[:4]
    same, other = (
        diagnose(a_model(), flagged(swum(values)[4:], seen), OPTIONS)
        for values in ({"a.k": 0.9}, {"e.k": 4.0})
    )
    assert same.report.verdict == "named"
    assert same.threshold == other.threshold
    assert same.ranking == other.ranking
    assert same.report.held_out.runs == ["run4", "run5"]
    assert same.report.causes[0].name == "a"
    assert same.report.held_out.gain > 0.6
    assert same.report.smallest_detectable == other.report.smallest_detectable


def test_a_name_that_sealed_runs_contradict_is_not_given() -> None:
    seen, sealed = swum({"a.k": 0.9})[:4], swum({"a.k": -0.9})[4:]
    found = diagnose(a_model(), flagged(sealed, seen), OPTIONS)
    assert found.report.verdict == "unexplained"
    assert any("held-out" in note for note in found.report.notes)


class Stepped(LinearModel):
    """The first cause acts in whole steps of 0.2, as frames of a camera do."""

    def mean(self, run: Run, values: Values) -> FloatArray:
        size = values.get("a.k", 0.0)
        return super().mean(run, {**values, "a.k": 0.2 * round(size / 0.2)})


def test_an_effect_that_goes_in_steps_has_an_error_by_its_likelihood() -> None:
    plain = a_model()
    model = Stepped(plain.causes, plain.tolerances, plain.library, (), guess=NOISE)
    found = diagnose(model, drawn(model, runs_of(5), {"a.k": 0.8}, NOISE, 5), OPTIONS)
    assert found.report.verdict == "named"
    size = found.report.causes[0].parameters["k"]
    assert found.report.causes[0].name == "a"
    assert abs(size.estimate - 0.8) < 0.25
    assert 0.02 < size.standard_error < 0.25


def test_what_no_size_within_bounds_would_show_has_no_smallest_size() -> None:
    plain = a_model()
    narrow = replace(plain.causes[0].parameters[0], least=-1e-3, most=1e-3)
    causes = (replace(plain.causes[0], parameters=(narrow,)), *plain.causes[1:])
    model = replace(plain, causes=causes)
    report = diagnose(model, drawn(model, runs_of(2), {}, NOISE, 2), OPTIONS).report
    assert report.smallest_detectable["a"] is None
    others = [report.smallest_detectable[cause.name] for cause in causes[1:]]
    assert all(size is not None and 0.01 < size < 1.0 for size in others)
