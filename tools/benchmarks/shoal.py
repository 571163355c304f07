"""Shoals of one to a hundred robots: how fast each is, and what a robot costs in it.

All swim in one process and take turns, after all robots have been switched on; the shortest time
of each counts. The ratio of the costs of a robot is what is asked: it grows by what every radio
hears of all others, and by what no cache holds any more.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence

from tools.benchmarks.measure import Effort, Figures, Row

WANTED = {2: "≥ 25 × real time", 20: "≥ 2 × real time", 100: "≥ 0.5 × real time"}
SWITCHED_ON_S = 3.0
"""All robots of the bundled scenario swim by then."""
LARGE = 5
"""A turn of more robots than this is shorter: so many robots' seconds."""


def shoal(effort: Effort) -> Figures:
    """Processor and wall seconds of a simulated second of each size, and memory of all in bytes."""
    from firmware_model.time import from_seconds
    from tools import scenario
    from tools.shoal import ShoalBench

    benches = {}
    for robots in effort.shoals:
        sets = (f"shoal.robots={robots}",)
        bench = ShoalBench.from_scenario(scenario.load("shoal", sets))
        bench.scheduler.run(from_seconds(SWITCHED_ON_S))
        benches[robots] = bench

    def swim(robots: int) -> None:
        scheduler = benches[robots].scheduler
        scheduler.run(scheduler.now + from_seconds(_turn_s(effort, robots)))

    figures: Figures = {}
    best = {robots: (float("inf"), float("inf")) for robots in effort.shoals}
    for _ in range(effort.repeats):
        for robots in effort.shoals:
            wall_s, cpu_s = time.perf_counter(), time.process_time()
            swim(robots)
            wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
            best[robots] = min(best[robots][0], cpu_s), min(best[robots][1], wall_s)
    for robots in effort.shoals:
        span_s = _turn_s(effort, robots)
        figures[f"cpu_{robots}"] = best[robots][0] / span_s
        figures[f"wall_{robots}"] = best[robots][1] / span_s
    unit = 1 if sys.platform == "darwin" else 1024  # Linux counts in KiB, macOS in bytes
    figures["bytes"] = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit)
    return figures


def _turn_s(effort: Effort, robots: int) -> float:
    """Simulated seconds of a turn: fewer of many robots, so that no size takes all the time."""
    return effort.robot_s * min(1.0, LARGE / robots)


def shoal_rows(figures: Figures) -> Sequence[Row]:
    """How fast each size is, what a robot costs in it, and the ratios."""
    rows = []
    alone = figures["cpu_1"]
    for robots in sorted(int(name[4:]) for name in figures if name.startswith("cpu_")):
        each = figures[f"cpu_{robots}"] / robots
        said = f"{1e3 * each:.1f} ms of processor a robot and second"
        if robots > 1:
            said += f", {each / alone:.2f} × that of one"
        rows.append(
            Row(
                f"shoal of {robots}" if robots > 1 else "shoal of one",
                f"{1 / figures[f'wall_{robots}']:,.2f} × real time",
                WANTED.get(robots, ""),
                said,
            )
        )
    return [*rows, Row("memory of all of these", f"{figures['bytes'] / 1e6:.0f} MB", "< 2000 MB")]
