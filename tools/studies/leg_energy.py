"""κ₁ and κ₃ of (6.5) from a run: `python -m tools.studies.leg_energy RUN` prints them.

The run is one of target tracking (docs/tours.md). Its targets are the corners of straight legs; how
long the robot took from one to the next, by the true path, times the run's mean power is what the
leg cost, turn included. The first leg, from rest, is left out. Samples cost too little to show.
"""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from procboard.survey.energy import Effort, Fitted, effort, fitted

NEAR_M = 0.03
"""A target counts as reached where the robot first is nearest to it within this: the bundled
scenario's 0.02 m and what the camera and the estimate may be off."""
_PASSING_S = 2.0
"""Within which the robot has passed the place where it is nearest: 5 cm."""


def legs(
    time_s: npt.NDArray[np.float64],
    path_m: npt.NDArray[np.float64],
    targets_m: npt.NDArray[np.float64],
    watts: float,
) -> tuple[tuple[Effort, ...], tuple[float, ...]]:
    """Efforts and energies (J) from the first target to the second, and so on, as far as reached.

    ``path_m`` and ``targets_m``: shape (n, 2); the path begins where the robot starts.
    """
    corners, at, reached = [path_m[0]], 0, [0]
    for target in targets_m:
        away = np.hypot(*(path_m[at:] - target).T)
        if not (away < NEAR_M).any():
            break
        first = int((away < NEAR_M).argmax())
        passing = time_s[at:] <= time_s[at + first] + _PASSING_S
        at += first + int(away[first : int(passing.sum())].argmin())
        corners.append(target)
        reached.append(at)
    efforts, joules = [], []
    for i in range(1, len(corners) - 1):
        before = corners[i] - corners[i - 1]
        heading = float(np.arctan2(before[1], before[0]))
        efforts.append(effort(np.array(corners[i : i + 2]), 0, heading))
        joules.append(watts * float(time_s[reached[i + 1]] - time_s[reached[i]]))
    return tuple(efforts), tuple(joules)


def of_run(folder: Path) -> tuple[Fitted, int]:
    """The coefficients that a run folder gives, and how many legs it has."""
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        columns = [names.index(name) for name in ("time_s", "x_m", "y_m")]
        truth = np.loadtxt(file, delimiter=",", usecols=columns)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    scenario = tomllib.loads((folder / "scenario.toml").read_text(encoding="utf-8"))
    targets = np.array(scenario["procboard"]["tracking"]["targets_m"], dtype=np.float64)
    watts = summary["metrics"]["energy_j"] / summary["duration_s"]
    efforts, joules = legs(truth[:, 0], truth[:, 1:], targets, watts)
    return fitted(efforts, joules), len(efforts)


def main(folder: Path) -> None:
    """Print the coefficients of a run with their standard errors."""
    found, count = of_run(folder)
    (per_metre, _, per_turn), (error, _, turn_error) = found.coefficients, found.errors
    print(f"{count} legs, {found.residual_j:.1f} J off each, root mean square")
    print(f"κ₁ {per_metre:.1f} ± {error:.1f} J/m, κ₃ {per_turn:.2f} ± {turn_error:.2f} J/rad²")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
