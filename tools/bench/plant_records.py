"""What a plant in the loop keeps of a run: pulses, targets and the overhead camera, as channels."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from firmware_model.scheduler import Priority
from firmware_model.time import FS_PER_S
from plant.camera import Camera
from tools.bench import model
from tools.records.data import FloatArray, Series

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from plant.underwater import UnderwaterVehicle
    from tools.configuration import Scenario

BEATS_LOOKED_AT_S: Final = 20.0
"""The tail's frequency is that of its last so many seconds."""
LEAST_SWING_RAD: Final = math.radians(1.0)
"""A commanded swing of less is none."""


class PlantRecords:
    """Commands as the servo had them, and poses as the overhead camera saw them."""

    def __init__(
        self, config: Scenario, scheduler: Scheduler, vehicle: UnderwaterVehicle, trace: Trace
    ) -> None:
        self.commands: list[tuple[float, float]] = []
        """(time in s, angle that a pulse asked for in rad)"""
        self.targets: list[tuple[float, float | None]] = []
        """(time in s, angle that the servo took for its target in rad; None: it let go)"""
        self._seen: list[tuple[float, float, float, float]] = []
        self._scheduler = scheduler
        self._vehicle = vehicle
        if config.camera.fitted:
            seeds = np.random.SeedSequence([config.scenario.seed, 0xCA3E7A])
            self._camera = Camera(np.random.default_rng(seeds), model.camera(config))
            self._poses = trace.channel("camera")
            self._frame = 0
            scheduler.at(0, self._expose, Priority.OBSERVER)

    def channels(self) -> dict[str, Series]:
        """Return what was kept, by the names of channels.csv."""
        found = {}
        if self.commands:
            commands = np.array(self.commands)
            found["tail_command_rad"] = Series(commands[:, 0].copy(), commands[:, 1].copy())
        if self._seen:
            poses = np.array(self._seen)
            for column, name in enumerate(("x_m", "y_m", "heading_rad"), start=1):
                found[name] = Series(poses[:, 0].copy(), poses[:, column].copy())
        return found

    def tail_command(self, times_s: FloatArray) -> FloatArray:
        """Return what the servo was told at each time: NaN where nothing, or before anything."""
        told_s = np.array([at_s for at_s, _ in self.targets])
        angles = np.array(
            [np.nan] + [np.nan if angle is None else angle for _, angle in self.targets]
        )
        held: FloatArray = angles[np.searchsorted(told_s, times_s, side="right")]
        return held

    def _expose(self) -> None:
        now, vehicle, camera = self._scheduler.now, self._vehicle, self._camera
        x_m, y_m = vehicle.position(now)
        frame = camera.capture(self._frame, x_m, y_m, vehicle.heading(now))
        self._poses.record(now, (frame.x_m, frame.y_m, frame.heading_rad))
        self._seen.append((now / FS_PER_S, frame.x_m, frame.y_m, frame.heading_rad))
        self._frame += 1
        self._scheduler.at(camera.exposure_fs(self._frame), self._expose, Priority.OBSERVER)


def beat_frequency_hz(commands: list[tuple[float, float]]) -> float:
    """Return how often commanded angles rise through their middle a second; 0: at rest.

    The middle is between the least and the largest angle of the last `BEATS_LOOKED_AT_S`.
    """
    if not commands:
        return 0.0
    recent = [pair for pair in commands if pair[0] >= commands[-1][0] - BEATS_LOOKED_AT_S]
    angles = [angle for _, angle in recent]
    low, high = min(angles), max(angles)
    if high - low < LEAST_SWING_RAD:
        return 0.0
    middle = 0.5 * (low + high)
    rises = [
        t0 + (middle - a0) / (a1 - a0) * (t1 - t0)
        for (t0, a0), (t1, a1) in itertools.pairwise(recent)
        if a0 < middle <= a1
    ]
    return (len(rises) - 1) / (rises[-1] - rises[0]) if len(rises) > 1 else 0.0
