"""What follows from a survey's samples and paths and need not be recorded.

How the field became known: the samples are told to the same survey again, in the order in which
they were taken. A board may have known less, where a sample was late; none knew more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from procboard.survey.expansion import Expansion
from procboard.survey.knowledge import Reading, together
from procboard.survey.outcome import stand_in
from tools.records.data import FloatArray
from tools.records.survey_data import Cell
from tools.report.survey_view import Doing, Known, SampleRow, Span

WINDOW_S = 6.0
"""Over which a robot's way is measured: several tail beats, so that swaying is no way (ours)."""
REST_M_S = 0.005
"""Slower than this is at rest: a fifth of the slowest cruise, more than swaying makes (ours)."""


def known_over_time(
    samples: Iterable[SampleRow],
    fresh: Callable[[], Expansion],
    given_up: Mapping[Cell, float] | None = None,
) -> tuple[Known, ...]:
    """Return the field as it was known whenever the survey got an answer.

    Args:
        samples: in the order of their times.
        fresh: makes the survey in its first state.
        given_up: when cells were given up; they get their stand-ins as on the boards.

    """
    survey = fresh()
    told: dict[Cell, list[Reading]] = {}
    news: list[tuple[float, Cell, SampleRow | None]] = [
        (sample.time_s, sample.cell, sample) for sample in samples
    ]
    news += [(time_s, cell, None) for cell, time_s in (given_up or {}).items()]
    news.sort(key=lambda row: row[0])
    found = [Known(0.0, len(survey.request), survey.reconstruction())]
    for time_s, cell, sample in news:
        answered = survey.answered
        if sample is not None:
            told.setdefault(cell, []).append(Reading(sample.value, sample.deviation))
            survey.correct(cell, together(told[cell]).value)
        elif cell not in told:
            near = {other: together(readings) for other, readings in told.items()}
            survey.correct(cell, stand_in(cell, near).value)
        if survey.answered != answered:
            wanted = len(set(survey.used) | set(survey.request))
            found.append(Known(time_s, wanted, survey.reconstruction()))
    return tuple(found)


def doings(
    time_s: FloatArray, x_m: FloatArray, y_m: FloatArray, dead: Sequence[Span] = ()
) -> tuple[tuple[Span, Doing], ...]:
    """What a robot did all along its path: it swims where it comes on, else it rests.

    Args:
        time_s: growing, shape (n,).
        x_m: its places, shape (n,).
        y_m: likewise.
        dead: times when it was dead, in order.

    """
    if time_s.size < 2:
        return ()
    before, after = time_s - WINDOW_S / 2, time_s + WINDOW_S / 2
    dx, dy = (np.interp(after, time_s, way) - np.interp(before, time_s, way) for way in (x_m, y_m))
    lasted = np.minimum(after, time_s[-1]) - np.maximum(before, time_s[0])
    swims = np.hypot(dx, dy) > REST_M_S * lasted
    edges = np.flatnonzero(np.diff(swims.astype(np.int8))) + 1
    starts, ends = [0, *edges.tolist()], [*edges.tolist(), time_s.size - 1]
    rows: list[tuple[Span, Doing]] = []
    for first, last in zip(starts, ends, strict=True):
        doing = Doing.SWIMS if swims[first] else Doing.RESTS
        whole = float(time_s[first]), float(time_s[last])
        rows += [(span, doing) for span in _without(whole, dead)]
    rows += [(span, Doing.DEAD) for span in dead]
    return tuple(sorted(rows, key=lambda row: row[0]))


def _without(span: Span, taken: Sequence[Span]) -> list[Span]:
    """What is left of a span; parts of no length are left out."""
    parts, start = [], span[0]
    for low, high in taken:
        parts.append((start, min(low, span[1])))
        start = max(start, high)
    parts.append((start, span[1]))
    return [(low, high) for low, high in parts if high > low]
