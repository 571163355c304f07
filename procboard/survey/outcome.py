"""The field that a survey found, with its errors; cells that nobody reached included.

A sampled cell has the standard deviation of its own readings, a recovered one what the survey's
algorithm states for it. A cell that was given up must have a value, or no row and column through it
could be used: the mean of the nearest samples stands in for it, and their spread is taken as the
deviation of its error. What was recovered with it is off, too: by how much is tried, one stand-in
at a time, by surveying anew in thought with that value changed by its deviation. Where the changed
survey would have wanted other cells nothing is stated (NaN).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from procboard.survey.algebra import FloatArray
from procboard.survey.completion import BoolArray
from procboard.survey.expansion import Expansion
from procboard.survey.knowledge import Knowledge, Reading
from procboard.survey.rank import Cell


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What is known of a field; arrays of (rows, columns), NaN where nothing is.

    ``deviation``: standard deviation of the error in the field's unit, to first order.
    """

    matrix: FloatArray
    deviation: FloatArray
    sampled: BoolArray
    given_up: tuple[Cell, ...]
    complete: bool


def stand_in(cell: Cell, samples: Mapping[Cell, Reading]) -> Reading:
    """Mean and spread of the samples in the smallest square about a cell that has two or more.

    Of a single sample the spread is unknown, NaN; without any the value is 0.
    """
    by_distance: dict[int, list[Cell]] = {}
    for other in sorted(samples):
        away = max(abs(other[0] - cell[0]), abs(other[1] - cell[1]))
        by_distance.setdefault(away, []).append(other)
    near: list[float] = []
    for away in sorted(by_distance):
        near += [samples[other].value for other in by_distance[away]]
        if len(near) > 1:
            break
    if not near:
        return Reading(0.0, math.nan)
    mean = math.fsum(near) / len(near)
    if len(near) == 1:
        return Reading(mean, math.nan)
    return Reading(mean, math.sqrt(math.fsum((v - mean) ** 2 for v in near) / (len(near) - 1)))


def readings(knowledge: Knowledge) -> dict[Cell, Reading]:
    """All cells that were sampled, each once."""
    known = {cell: knowledge.reading(cell) for cell in sorted(knowledge.samples)}
    return {cell: reading for cell, reading in known.items() if reading is not None}


def outcome(knowledge: Knowledge, survey: Expansion, fresh: Callable[[], Expansion]) -> Outcome:
    """Return the field from a survey that has been told all of a board's knowledge.

    ``fresh`` makes the same survey in its first state.
    """
    samples = readings(knowledge)
    missing = {cell: stand_in(cell, samples) for cell in knowledge.given_up()}
    estimate = survey.estimate()
    matrix, deviation = estimate.matrix, estimate.deviation
    for cell, reading in samples.items():
        deviation[cell] = reading.deviation
    for cell, reading in missing.items():
        other = fresh()
        for known, value in (samples | missing).items():
            off = reading.deviation if known == cell else 0.0
            if not math.isnan(off):
                other.correct(known, value.value + off)
        changed = np.abs(other.estimate().matrix - matrix)
        deviation = np.hypot(deviation, changed)
    for cell, reading in missing.items():
        deviation[cell] = reading.deviation
    sampled = np.zeros(survey.shape, dtype=np.bool_)
    for cell in samples:
        sampled[cell] = True
    return Outcome(matrix, deviation, sampled, tuple(missing), survey.done)
