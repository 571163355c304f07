"""A run from its begin to its end, in slices, so that somebody may watch or interrupt.

Slicing changes nothing in what happens.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from firmware_model.scheduler import RealTimeScheduler, Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S, from_seconds
from plant.errors import DivergedError
from spi_bus.errors import TransportLost
from tools.errors import ScenarioError

if TYPE_CHECKING:
    from tools.bench.robot import Robot
    from tools.configuration import Scenario

SLICE_FS = 50 * FS_PER_MS


def run_to_the_end(
    config: Scenario,
    scheduler: Scheduler,
    robots: Iterable[Robot],
    progress: Callable[[float], None],
    stops: Callable[[], bool],
) -> bool:
    """Run the scenario's duration, telling `progress` the seconds done and asking for a stop.

    Return whether it was stopped before its end. Raises `ScenarioError` where the scenario's
    parameters let the motion diverge.
    """
    end_fs = from_seconds(config.scenario.duration_s)
    stopped = False
    try:
        while scheduler.now < end_fs:
            if stops():
                stopped = True
                break
            scheduler.run(min(end_fs, scheduler.now + SLICE_FS))
            progress(scheduler.now / FS_PER_S)
        for robot in robots:
            robot.vehicle.advance(scheduler.now)  # nobody may have looked at its very end
    except DivergedError as error:  # parameters in their ranges, and no motion with them
        raise ScenarioError(f"{config.scenario.name}: {error}") from error
    except TransportLost as error:  # of a line that nobody can open again: a recording
        raise ScenarioError(f"hil: {error}") from error
    for robot in robots:
        robot.wires.settle()  # before whoever writes the trace to files closes them
    return stopped


def lateness(scheduler: Scheduler) -> dict[str, float]:
    """Return how late a run in real time was; nothing of another."""
    if not isinstance(scheduler, RealTimeScheduler) or not scheduler.lateness_s:
        return {}
    late = scheduler.lateness_s
    return {
        "maximum_s": late.maximum_s,
        "p99_s": late.quantile_s(0.99),
        "missed": float(scheduler.missed),
    }
