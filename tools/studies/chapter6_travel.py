"""How far two robots go for the samples of chapter 6 (Figs. 6.7 and 6.8).

The field is 24 × 24 cells of an inch and of rank 6. For Algorithm 1 half of the cells, drawn at
random, are shared between two salesmen; Algorithm 2 begins with 6 × 6 cells and then wants six
cells of every further row and column, which two robots walk as they come. Travel depends on where
the cells lie and not on what is measured there.

The source prints neither which cells were drawn nor where the robots start. The first block that
Algorithm 2 is given has the field's rank, so its basis is the first six columns and rows. Starts
are tried in mirrored pairs, as row and column are.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from procboard.survey.energy import EMULATED, Effort, EnergyModel, effort
from procboard.survey.genetic import Evolution, evolved
from procboard.survey.rank import Cell
from procboard.survey.successive import algorithm_2
from procboard.survey.sweeps import Pose, Walk, walk
from procboard.survey.tours import LONGEST, tours_anywhere
from tools.studies.study import Check, Curve, Figure, FloatArray, Panel, Progress, Result

SIZE, RANK = 24, 6
INCH_M = 0.0254
DRAWN = SIZE * SIZE // 2
"""Cells that Algorithm 1 is given: 50 %."""
SALESMEN_IN, EXPANSION_IN = 382.0066, 290.0
"""Printed: the title of Fig. 6.7, and the text."""
SEED = 6
KICKS = 300
"""Of iterated local search: more shorten by less than one per cent."""
WAY = EnergyModel(1.0)
"""The source counts distance: (6.4) with κ₂ = 0."""


def drawn_cells(rng: np.random.Generator) -> FloatArray:
    """Half of the cells at random, as x and y in inches, in the order of rows."""
    cells = np.sort(rng.choice(SIZE * SIZE, DRAWN, replace=False))
    return np.column_stack((cells % SIZE, cells // SIZE)).astype(np.float64)


def expansions(size: int, rank: int) -> Iterator[tuple[Cell, ...]]:
    """Cells that Algorithm 2 wants, one expansion after the other.

    The field is one of that rank whose first block is the unit matrix: what it is does not matter.
    """
    unit = np.eye(rank)[np.arange(size) % rank]
    survey = algorithm_2((size, size), rank)
    while not survey.done:
        wanted = survey.wanted()
        yield wanted
        for cell in wanted:
            survey.tell(cell, float(unit[cell[0]] @ unit[cell[1]]))


@cache
def expanding_walk() -> tuple[Walk, tuple[float, ...]]:
    """The shortest walk of two robots through all expansions, and the lengths of all tried, in."""
    tried = []
    for row in range(RANK):
        for column in range(RANK):
            starts = {1: Pose(column, row), 2: Pose(row, column)}
            tried.append(walk(expansions(SIZE, RANK), starts, 1.0, WAY, LONGEST))
    lengths = tuple(found.effort.metres for found in tried)
    return tried[int(np.argmin(lengths))], lengths


def _closed(points: FloatArray, tours: tuple[tuple[int, ...], ...]) -> list[FloatArray]:
    return [points[[*tour, tour[0]]] for tour in tours]


def _joules(paths_in: list[FloatArray], samples: int) -> float:
    """Energy of the emulated robot by (6.5)."""
    swum = sum((effort(path * INCH_M, 0) for path in paths_in), Effort(samples=samples))
    return EMULATED.joules(swum)


def _panel(title: str, paths: list[FloatArray]) -> Panel:
    return Panel(
        title,
        "x (in)",
        "y (in)",
        tuple(
            Curve(f"robot {number}", path[:, 0], path[:, 1]) for number, path in enumerate(paths, 1)
        ),
        equal=True,
    )


def salesmen(progress: Progress) -> Result:
    """Fig. 6.7: the genetic algorithm of the source, and what a better heuristic finds."""
    rng = np.random.default_rng(SEED)
    points = drawn_cells(rng)
    found = evolved(points, 2, rng, Evolution())
    progress(0.8)
    better = tours_anywhere(2, points, objective=LONGEST, kicks=KICKS)
    progress(0.9)
    expanding, _ = expanding_walk()
    swept = list(expanding.paths_m.values())
    genetic_paths, better_paths = _closed(points, found.tours), _closed(points, better.orders)
    less = [100.0 * (1.0 - expanding.effort.metres / way) for way in (found.length, better.length)]
    joules = (
        _joules(genetic_paths, DRAWN),
        _joules(better_paths, DRAWN),
        _joules(swept, int(expanding.effort.samples)),
    )
    return Result(
        (Check("distance of two salesmen", SALESMEN_IN, found.length, "in", 0.15),),
        (
            Figure(
                "Fig. 6.7",
                "Two salesmen visit the cells drawn for Algorithm 1: by the genetic algorithm, as "
                "in the source, and by insertion and exchanges.",
                (
                    _panel(f"(a) genetic algorithm, {found.length:.1f} in", genetic_paths),
                    _panel(f"(b) insertion and exchanges, {better.length:.1f} in", better_paths),
                ),
            ),
        ),
        (
            (
                "Which cells were drawn is not printed; here others are. Cells and generations are "
                "drawn anew with every seed: seeds 0 to 5 gave 400 to 452 in after 50,000 "
                "generations, so the tolerance is 15 %. Here the last gain was in generation "
                f"{found.generation}, in the source in 48,827."
            ),
            (
                f"Insertion and exchanges find {better.length:.1f} in for the same cells, "
                f"{better.lengths[0]:.1f} and {better.lengths[1]:.1f} in for the two. The way of "
                f"Fig. 6.8 is {less[0]:.0f} % shorter than the genetic algorithm's and "
                f"{less[1]:.0f} % shorter than this: part of what the source gains is gained on a "
                "tour that was not short."
            ),
            (
                "By (6.5) with the coefficients of the emulated robot the genetic algorithm's "
                f"tours cost {joules[0]:.0f} J, these {joules[1]:.0f} J and the way of Fig. 6.8 "
                f"{joules[2]:.0f} J. At an inch from cell to cell turns cost more than the way."
            ),
        ),
    )


def expansion(progress: Progress) -> Result:
    """Fig. 6.8: two robots walk the cells that Algorithm 2 wants, and return in a straight line."""
    found, lengths = expanding_walk()
    progress(1.0)
    length = found.effort.metres
    share = 100.0 * found.effort.samples / SIZE**2
    starts = " and ".join(
        f"({path[0, 0]:.0f}, {path[0, 1]:.0f})" for path in found.paths_m.values()
    )
    return Result(
        (
            Check("distance of two robots", EXPANSION_IN, length, "in", 0.02),
            Check(
                "less than the salesmen's as printed",
                24.0,
                100.0 * (1.0 - length / SALESMEN_IN),
                "%",
                1.0,
                absolute=True,
            ),
            Check("cells sampled", 43.75, share, "%", 0.005, absolute=True),
        ),
        (
            Figure(
                "Fig. 6.8",
                "Two robots walk the cells of Algorithm 2 as the sampled area expands.",
                (_panel("", list(found.paths_m.values())),),
            ),
        ),
        (
            (
                "Where the robots start is not printed. Of 36 mirrored pairs in the first block "
                f"{starts} is the shortest; their median is {np.median(lengths):.1f} in, the "
                f"longest {max(lengths):.1f} in. Steps from cell to cell alone are 250 in, if none "
                "is longer than an inch; the rest is the way back."
            ),
        ),
    )
