"""A fixed sample of the benchmark: effects are hidden in data, and the diagnosis has to find them.

Sets are made, diagnosed as folders and scored as the benchmark does it, at the benchmark's λ: 100
for one cause, 150 for each of two, 400 for what is in no table (nothing looks for its shape).
λ is what counts, so six runs of 20 s do (four of 15 s for the emulated robot, whose servo asks for
small steps); they and fewer draws for the calibration save time.
Seeds are the first numbers there are, and what a seed hides is the first draw: none was chosen by
what the diagnosis makes of it. `python -m tools.practice.benchmark` is the whole of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from tools.diagnosis.options import Options
from tools.practice.cases import EXACT, UNKNOWN, Case, perform
from tools.practice.draw import TWO_LEAST
from tools.practice.emulated import EMULATED
from tools.practice.experiment import stream
from tools.practice.hidden import LISTED, UNLISTED
from tools.practice.tally import as_good, crashed, estimates, honest, strong, telling, within

SIX, FOUR = (6, 20.0), (4, 15.0)
"""Runs, and how long each lasts in seconds."""
DRAWS = 48

pytestmark = pytest.mark.slow


def drawn(seed: int, names: Sequence[str], count: int = 1) -> tuple[str, ...]:
    found = stream(seed, 12).choice(sorted(names), count, replace=False)
    return tuple(str(name) for name in found)


def performed(
    part: str,
    seed: int,
    names: tuple[str, ...],
    strength: float,
    length: tuple[int, float] = SIX,
) -> dict[str, Any]:
    case = Case(part, seed, names, strength, *length)
    row = perform(case, Options(draws=DRAWS))
    assert not crashed(row), row["where"]
    assert strong(row), f"{row['hidden']}: λ is {row['reached']}"
    return row


def test_nothing_is_found_where_nothing_is() -> None:
    assert performed("healthy", 1, (), 0.0)["verdict"] == "nothing_wrong"


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_the_hidden_cause_is_named_or_is_among_look_alikes(seed: int) -> None:
    row = performed("exact", seed, drawn(seed, LISTED), EXACT)
    assert row["score"] in ("exact", "in_set"), (row["hidden"], row["reported"])
    assert all(within(each) for each in estimates([row])), row["estimates"]
    assert not telling(row) or as_good(row), row["held_out"]


def test_two_hidden_causes_are_named_or_are_among_look_alikes() -> None:
    row = performed("two", 1, drawn(1, LISTED, 2), TWO_LEAST)
    assert row["score"] in ("exact", "in_set"), (row["hidden"], row["reported"])


def test_what_hinders_the_emulated_robot_is_named_or_is_among_look_alikes() -> None:
    row = performed("emulated", 1, drawn(1, EMULATED), EXACT, FOUR)
    assert row["score"] in ("exact", "in_set"), (row["hidden"], row["reported"])


def test_what_is_in_no_table_gets_no_wrong_name() -> None:
    row = performed("unlisted", 1, drawn(1, UNLISTED), max(UNKNOWN))
    assert row["score"] == "exact", (row["hidden"], row["named"])


def test_a_cause_that_was_taken_out_of_the_table_is_not_found() -> None:
    # it shows that the tests above can fail
    row = performed("taken-out", 1, drawn(1, LISTED), EXACT)
    assert not set(row["named"]) & set(row["hidden"])
    assert honest(row), (row["verdict"], row["named"], row.get("likeness"))
