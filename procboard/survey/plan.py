"""Who swims to which cells: shares of a request, without those who did not reach them.

A request of the survey is shared out once, whole, from where its robots were when it began; as they
go on the plan stays, and each passes over what has been sampled. It changes only where a robot
comes or goes, or says that it did not reach a cell. All of it follows from what boards know alike.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from procboard.survey.energy import EMULATED, EnergyModel
from procboard.survey.knowledge import Grid
from procboard.survey.rank import Cell
from procboard.survey.sweeps import Pose, shares

Shares = dict[int, tuple[Cell, ...]]


def planned(
    cells: Collection[Cell],
    robots: Mapping[int, Pose],
    skips: Mapping[Cell, set[int]],
    grid: Grid,
    model: EnergyModel = EMULATED,
) -> Shares:
    """For each robot, cells in the order in which it samples them.

    A cell that a robot did not reach goes to another one, whose way ends nearest to it; nobody has
    it where nobody is left to try.
    """
    if not robots:
        return {}
    about = {
        robot: Pose(pose.x_m - grid.x_m, pose.y_m - grid.y_m, pose.heading_rad)
        for robot, pose in robots.items()
    }
    found = shares(cells, about, grid.spacing_m, model)
    moved = []
    for robot, order in found.items():
        moved += [cell for cell in order if robot in skips.get(cell, ())]
        found[robot] = tuple(cell for cell in order if robot not in skips.get(cell, ()))
    for cell in sorted(moved):
        others = [robot for robot in sorted(robots) if robot not in skips[cell]]
        if others:
            nearest = min(others, key=lambda robot: _away(grid, robots[robot], found[robot], cell))
            found[nearest] += (cell,)
    return found


def _away(grid: Grid, pose: Pose, order: tuple[Cell, ...], cell: Cell) -> float:
    """How far a robot's way ends from a cell, m."""
    end = grid.centre(order[-1]) if order else pose.place
    return math.dist(end, grid.centre(cell))
