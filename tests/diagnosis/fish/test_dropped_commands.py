"""Commands that never arrived: which ones are found, and at what share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tools.diagnosis.evidence import neutral, start_problem
from tools.diagnosis.fish.dropped import price
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Run
from tools.diagnosis.refit import fit
from tools.diagnosis.workers import Workers

P = "dropped_commands.p"
BIASES = (0.0, 0.45, -0.3, -0.5, 0.2, 0.5)


def without(run: Run, lost: tuple[int, ...]) -> Run:
    """The run as it is swum when some of its commands do not arrive."""
    whole = run.inputs.programme
    kept = [i for i in range(len(whole.beats)) if i not in lost]
    told = TailProgramme(
        tuple(whole.beats[i] for i in kept), tuple(whole.starts_s[i] for i in kept)
    )
    return replace(run, inputs=replace(run.inputs, programme=told))


def measured(seed: int, lost: tuple[int, ...]) -> Run:
    """A run of six beats that differ in bias and frequency, of which some never came."""
    beats = tuple(TailBeat(b, 0.3, 0.8 + 0.1 * i) for i, b in enumerate(BIASES))
    programme = TailProgramme(beats, tuple(4.0 * i for i in range(len(beats))))
    empty = blank(seed, 24.0)
    told = replace(empty, inputs=replace(empty.inputs, programme=programme))
    swum = FishModel(wang2014(), NAMES).draw(
        without(told, lost), {}, NOISE, np.random.default_rng(seed)
    )
    return replace(swum, inputs=told.inputs)


@pytest.mark.parametrize("lost", [(2,), (1, 4), (3, 4), (2, 3, 5), (1, 2, 3)])
def test_what_was_lost_is_found(lost: tuple[int, ...]) -> None:
    model, run = FishModel(wang2014(), NAMES), measured(5, lost)
    fixed = model.filter(run, {}, NOISE)
    assert set(model._lost(run, {P: 0.2}, fixed)) == set(lost)
    replays = [model.replay(run, {P: 0.2}, given) for given in (None, fixed)]
    gyro = run.channel == 3
    off = [float(np.sqrt(np.mean((run.value - r)[gyro] ** 2))) for r in replays]
    assert off[1] < 0.01 < 0.5 * off[0]


def test_the_share_is_that_of_all_runs_with_the_error_of_a_share() -> None:
    model = FishModel(wang2014(), NAMES)
    runs = [measured(6, (2,)), measured(7, ()), measured(8, (1, 4)), measured(9, ())]
    (cause,) = (c for c in model.causes if c.name == "dropped_commands")
    with Workers(1) as workers:
        begun = start_problem(model, runs, workers)
        problem = begun.with_noise(NOISE, neutral(begun))
        found = fit(problem, neutral(problem).moved({P: 0.4}), cause.parameters, {})
    share = found.point.shared[P]
    assert share == pytest.approx(3 / 20, abs=0.01)
    by_counting = np.sqrt(0.15 * 0.85 / 20)
    # a run by itself tells less of a share that is another than its own
    assert by_counting < np.sqrt(found.covariance[0, 0]) < 1.5 * by_counting


def test_the_price_is_that_of_independent_losses() -> None:
    assert price(2, 5, 0.3) == pytest.approx(-2.0 * np.log(0.3**2 * 0.7**3))
    assert price(0, 5, 0.3) == pytest.approx(-10.0 * np.log(0.7))
