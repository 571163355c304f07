"""How often target tracking arrives: `python -m tools.studies.tracking_rates` prints the table.

The table of docs/tracking.md: grids of 7 × 7 places and 8 headings around the target, every pose
from rest, with one thing changed in each row. The robot is the bundled one with its servo, since a
tail that is where it is told to be hides what a change of bias does to the body.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace

import numpy as np

from plant.parameters import PlantParameters, Water
from procboard.applications.tracking_law import TrackingGains, TrackingLaw
from tools.studies.chapter5_control import BEAT, chapter_5
from tools.studies.closed_loop import Instruments, success_grid

REACHES_M = (0.6, 0.25)
LIMIT_S = 400.0


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table: what differs from the robot as it is."""

    what: str
    gains: TrackingGains = field(default_factory=TrackingGains)
    instruments: Instruments = field(default_factory=Instruments)
    ideal: bool = False
    """The robot of chapter 5 with an ideal tail in place of the bundled one."""
    current_m_s: float = 0.0
    """Of the water, along x."""


ROWS = (
    Row("the robot as it is"),
    Row("the robot of chapter 5, ideal tail", ideal=True),
    Row("camera noise of 3 mm in place of 1 mm", instruments=Instruments(led_noise_m=0.003)),
    Row("three poses in ten lost", instruments=Instruments(lost_poses=0.3)),
    Row("a current of 1 cm/s, a third of its speed", current_m_s=0.01),
    Row("never leaving", TrackingGains(leave_radii=0.0)),
    Row("gains 0.2 and 0.3 per second", TrackingGains(approach_per_s=0.2, speed_per_s=0.3)),
    Row("gains 1 per second", TrackingGains(approach_per_s=1.0, speed_per_s=1.0)),
    Row("without lead", TrackingGains(lead_s=0.0)),
    Row("lead of 1.5 s", TrackingGains(lead_s=1.5)),
)


def measure(row: Row, reach_m: float) -> tuple[int, int, float, float]:
    """Poses that arrived, poses in all, median and longest time (s) of those that arrived."""
    grid = success_grid(
        replace(
            chapter_5() if row.ideal else PlantParameters(),
            water=Water(current_x_m_s=row.current_m_s),
        ),
        TrackingLaw(BEAT.amplitude_rad, BEAT.frequency_hz, row.gains),
        BEAT,
        reach_m,
        limit_s=LIMIT_S,
        instruments=row.instruments,
    )
    times = [run.reached_s for run in grid if run.reached_s is not None]
    return len(times), len(grid), float(np.median(times)), max(times)


def main() -> int:
    """Print the table, a row as soon as it is known."""
    head = "".join(f" within {reach_m:g} m: arrived, median, longest |" for reach_m in REACHES_M)
    print(f"| |{head}\n|---|{'---|' * len(REACHES_M)}")
    for row in ROWS:
        cells = []
        for reach_m in REACHES_M:
            arrived, of, median, longest = measure(row, reach_m)
            cells.append(f" {arrived} of {of}, {median:.0f} s, {longest:.0f} s |")
        print(f"| {row.what} |{''.join(cells)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
