"""A fixed sample of the benchmark: effects are hidden in data, and the diagnosis has to find them.

The sets are smaller than the benchmark's (four runs of 25 s, fewer draws for the calibration), the
strength is λ = 150 in the very data of the set, 400 for what is in no table: nothing looks for its
shape. `python -m tools.practice.benchmark` is the whole of it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest

from plant.robots import wang2014
from tools.diagnosis.engine import diagnose
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.options import Options
from tools.practice import folder
from tools.practice.cases import take_out
from tools.practice.experiment import Effect, shape_of, swim_experiment
from tools.practice.hidden import HIDDEN
from tools.practice.reveal import Revealed, score
from tools.practice.strength import CHANNELS, measured_runs, sized

RUNS, DURATION_S, DRAWS = 4, 25.0, 48
STRENGTH, UNKNOWN_STRENGTH = 150.0, 400.0

pytestmark = pytest.mark.slow


@dataclass(frozen=True, slots=True)
class Found:
    """A diagnosis and its score."""

    scored: Revealed
    diagnosis: Any


def diagnosed(seed: int, name: str | None, *, known: bool = True) -> Found:
    """Hide an effect, diagnose, score; with ``known`` off its cause is not in the table."""
    effects: tuple[Effect, ...] = ()
    strength = STRENGTH
    if name is not None:
        strength = STRENGTH if HIDDEN[name].listed else UNKNOWN_STRENGTH
        size, reached = sized(seed, name, strength, RUNS, DURATION_S)
        assert reached == pytest.approx(strength, rel=0.2)
        effects = (Effect(name, size, shape_of(name, seed)),)
    swum = swim_experiment(seed, effects, RUNS, DURATION_S)
    model = FishModel(wang2014(), CHANNELS)
    if name is not None and not known:
        take_out(model, name)
    diagnosis = diagnose(model, measured_runs(seed, swum, DURATION_S), Options(draws=DRAWS))
    kind = "none" if name is None else "one" if HIDDEN[name].listed else "unlisted"
    answer = folder.answer(seed, kind, strength, effects)
    document = json.loads(msgspec.json.encode(diagnosis.report))
    return Found(score(answer, document), diagnosis)


@pytest.mark.parametrize("seed", [21, 24])
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    assert diagnosed(seed, None).scored.verdict == "nothing_wrong"


@pytest.mark.parametrize(
    ("seed", "name"),
    [(22, "drag_scale"), (22, "camera_delay"), (23, "tail_offset"), (21, "gyro_scale")],
)
def test_the_hidden_cause_is_named_or_is_among_look_alikes(seed: int, name: str) -> None:
    found = diagnosed(seed, name)
    assert found.scored.score in ("exact", "in_set")
    if found.scored.score == "exact":
        assert all(abs(e.errors or 0.0) <= 4.0 for e in found.scored.estimates)


def test_what_is_in_no_table_gets_no_wrong_name() -> None:
    assert diagnosed(23, "iron_in_the_floor").scored.score == "exact"


def test_a_cause_that_was_taken_out_of_the_table_is_not_found() -> None:
    # it shows that the tests above can fail
    found = diagnosed(22, "camera_delay", known=False)
    assert found.scored.verdict == "unexplained"
    # a late pose looks like an error that follows the speed: described by such terms, or left
    described = [cause.name for cause in found.diagnosis.report.causes] == ["unknown_force"]
    assert described or found.diagnosis.report.remaining_structure.found
