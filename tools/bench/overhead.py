"""The overhead camera: every robot's pose at every frame, and which of them is known by now.

One event a frame whatever the number of robots. A pose is known some time after its exposure; what
an effect of the scenario does to the picture (another frame, late, stalled) is `wrong.Lens`. Each
robot has noise of its own, so what is seen of one does not depend on how many others there are.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from firmware_model.scheduler import Priority
from plant.camera import Camera, CameraFrame
from tools.bench import model
from tools.bench.wrong import Lens, prefix

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from plant.underwater import UnderwaterVehicle
    from tools.configuration import Scenario

STREAM = 0xCA3E7A
"""Of the camera's random numbers, beside the run's seed."""


@dataclass(frozen=True, slots=True)
class InView:
    """A robot as the host knows it: by its radio address, and by its body under the camera."""

    address: int
    vehicle: UnderwaterVehicle
    name: str = ""
    """Of one of several."""


class Overhead:
    """The camera over all robots; its frames go to the trace channels `camera`.

    Args:
        config: the scenario.
        scheduler, trace: the run's.
        robots: who is in the tank.
        keep: whether somebody will ask for `known` poses.

    """

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        trace: Trace,
        robots: Sequence[InView],
        *,
        keep: bool,
    ) -> None:
        self._scheduler = scheduler
        self._eyes = {robot.address: _Eye(config, trace, robot, keep=keep) for robot in robots}
        self._every = tuple(self._eyes.values())
        self._frame = 0
        self._looked = 0
        self._late_fs = self._every[0].lens.delay_fs
        self._exposure_fs = self._every[0].camera.exposure_fs
        if self._late_fs:
            scheduler.at(0, self._look, Priority.OBSERVER)
        scheduler.at(0, self._expose, Priority.OBSERVER)

    def known(self, address: int) -> CameraFrame | None:
        """Return the latest pose of a robot that is known by now."""
        return self._eyes[address].known(self._scheduler.now)

    def _expose(self) -> None:
        now, index = self._scheduler.now, self._frame
        for eye in self._every:
            eye.expose(now, index)
        self._frame = index = index + 1
        self._scheduler.at(self._exposure_fs(index), self._expose, Priority.OBSERVER)

    def _look(self) -> None:
        """See what a late camera will show: what is before the beginning stands still."""
        now = self._scheduler.now
        while (due := self._exposure_fs(self._looked) - self._late_fs) <= now:
            for eye in self._every:
                eye.look(now)
            self._looked += 1
        self._scheduler.at(due, self._look, Priority.OBSERVER)


class _Eye:
    """What the camera sees of one robot."""

    def __init__(self, config: Scenario, trace: Trace, robot: InView, *, keep: bool) -> None:
        words = [config.scenario.seed, STREAM]
        if robot.name:
            words.append(zlib.crc32(robot.name.encode()))
        self.camera = Camera(
            np.random.default_rng(np.random.SeedSequence(words)), model.camera(config)
        )
        self.lens = Lens(config, robot.name)
        self._vehicle = robot.vehicle
        self._poses = trace.channel(f"{prefix(robot.name)}camera")
        self._looks: deque[tuple[float, float, float]] = deque()
        self._shown: CameraFrame | None = None
        self._keep = keep
        self._frames: deque[CameraFrame] = deque()
        """The latest frame whose pose is known, and those whose pose is not known yet."""

    def look(self, now: int) -> None:
        self._looks.append(self.lens.look(self._vehicle, now))

    def expose(self, now: int, index: int) -> None:
        lens = self.lens
        seen = self._looks.popleft() if lens.delay_fs else lens.look(self._vehicle, now)
        frame = self.camera.capture(index, *seen)
        if self._shown is not None and lens.stalls(now):
            frame = self._shown._replace(
                number=index, exposure_fs=frame.exposure_fs, available_fs=frame.available_fs
            )
        self._shown = frame
        self._poses.record(now, (frame.x_m, frame.y_m, frame.heading_rad))
        if self._keep:
            self._frames.append(frame)

    def known(self, now: int) -> CameraFrame | None:
        frames = self._frames
        while len(frames) > 1 and frames[1].available_fs <= now:
            frames.popleft()
        return frames[0] if frames and frames[0].available_fs <= now else None
