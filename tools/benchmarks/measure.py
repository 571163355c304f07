"""What all measurements share: how much effort, the best of several times, a row of the table.

A busy machine can only slow things down, so the shortest of several times is the nearest to what
the code costs. Two things that are compared take turns, so that both see the same machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Figures = dict[str, float]
"""What a case measures, by name; it crosses over from a process of its own as JSON."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How long things run that are timed. ``repeats``: of each, the best one counts."""

    repeats: int = 5
    robot_s: float = 20.0  # simulated, of the whole robot
    swim_s: float = 30.0  # simulated, of the plant alone: over this the accuracy is asked
    shoals: tuple[int, ...] = (1, 2, 20, 100)  # robots; the first one is alone
    members: int = 1000  # of an ensemble
    line_s: float = 3.0  # simulated, of a line that is full
    search_frequencies: int = 5  # of the five of Table 5.1; each has 25 beats


QUICK = Effort(
    repeats=1,
    robot_s=1.0,
    shoals=(1, 2),
    swim_s=2.0,
    members=12,
    line_s=0.7,
    search_frequencies=1,
)
"""Enough to see that everything works; the figures mean little."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    what: str
    measured: str
    wanted: str = ""
    accuracy: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One measurement, in a process of its own: a part of the project, and its rows."""

    part: str
    measure: Callable[[Effort], Figures]
    rows: Callable[[Figures], Sequence[Row]]


def best_s(
    repeats: int,
    *functions: Callable[[], object],
    clock: Callable[[], float] = time.perf_counter,
) -> list[float]:
    """Shortest time of each function, s. They take turns.

    ``clock``: wall time, or for what runs in one thread ``time.thread_time``, which leaves out the
    time that others had the core.
    """
    best = [float("inf")] * len(functions)
    for _ in range(repeats):
        for index, function in enumerate(functions):
            begin = clock()
            function()
            best[index] = min(best[index], clock() - begin)
    return best
