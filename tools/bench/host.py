"""The host at the tank's edge: an overhead camera, and a base station that commands by radio.

The camera exposes a frame every 1/30 s, and the pose is known some time later. Where the scenario
says so, the host sends the latest known pose to the robot at its own period; commands go out at
their times. It learns of the robot only what the camera sees and telemetry says.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from firmware_model.power import Rail
from firmware_model.scheduler import Priority
from firmware_model.signals import constant
from firmware_model.time import FS_PER_MS, FS_PER_S, from_seconds
from plant.camera import Camera, CameraFrame
from procboard.applications.base_station import Command, PendingCommand
from procboard.board import BaseStation
from radio_802154.medium import Antenna, Medium
from radio_802154.messages import Pose, TailBeatCommand, TargetCommand, Telemetry
from tools.bench import model
from tools.bench.power import PROC_V
from tools.bench.robot import network_config
from tools.records.data import Command as CommandRow
from tools.records.data import Event

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from plant.underwater import UnderwaterVehicle
    from tools.configuration import Scenario

UNTIL_THE_NEXT_S = 0.0
"""Validity of a command that holds until the next one."""


class Host:
    """Camera, base station and the schedule of commands."""

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        trace: Trace,
        medium: Medium,
        vehicle: UnderwaterVehicle,
    ) -> None:
        self.telemetry_received = 0
        self._sent: list[tuple[float, PendingCommand]] = []
        self._answered_s: dict[int, float] = {}
        self.events: list[Event] = []
        self._scheduler = scheduler
        self._config = config
        self._vehicle = vehicle
        self._robot = config.procboard.address
        self._poses = trace.channel("camera")
        base = config.base_station
        medium.place(
            "base",
            Antenna(x_m=constant(base.x_m), y_m=constant(base.y_m), height_m=base.height_m),
        )
        self.base = BaseStation(
            scheduler,
            trace,
            Rail(scheduler, "base 3 V", PROC_V),
            medium,
            network_config(config, base.address),
            "base",
            config.scenario.seed,
        )
        self.base.app.on_telemetry = self._on_telemetry
        self.base.app.on_reply = self._on_reply
        for command in base.tail_beats:
            self._command_at(
                command.at_s,
                TailBeatCommand(
                    0,
                    command.bias_rad,
                    command.amplitude_rad,
                    command.frequency_hz,
                    UNTIL_THE_NEXT_S,
                ),
            )
        for target in base.targets:
            self._command_at(target.at_s, TargetCommand(0, target.x_m, target.y_m))
        self._frames: deque[CameraFrame] = deque()
        """The latest frame whose pose is known, and those whose pose is not known yet."""
        self._frame = 0
        if (
            config.camera.fitted and not config.hil.water_elsewhere
        ):  # who looks at the real fish is real
            self._camera = Camera(
                np.random.default_rng(np.random.SeedSequence([config.scenario.seed, 0xCA3E7A])),
                model.camera(config),
            )
            scheduler.at(0, self._expose, Priority.OBSERVER)
            self._sends_pose = base.send_pose
            if base.send_pose:
                self._send_period_fs = from_seconds(base.pose_period_s)
                scheduler.at(self._send_period_fs, self._send_pose, Priority.OBSERVER)

    def _command_at(self, at_s: float, command: Command) -> None:
        def send() -> None:
            pending = self.base.app.send_command(self._robot, command)
            self._sent.append((self._scheduler.now / FS_PER_S, pending))

        self._scheduler.at(from_seconds(at_s), send, Priority.OBSERVER)

    def _expose(self) -> None:
        now, vehicle, camera = self._scheduler.now, self._vehicle, self._camera
        index = self._frame
        x_m, y_m = vehicle.position(now)
        frame = camera.capture(index, x_m, y_m, vehicle.heading(now))
        self._poses.record(now, (frame.x_m, frame.y_m, frame.heading_rad))
        if self._sends_pose:
            self._frames.append(frame)
        self._frame = index = index + 1
        self._scheduler.at(camera.exposure_fs(index), self._expose, Priority.OBSERVER)

    def _send_pose(self) -> None:
        now, frames = self._scheduler.now, self._frames
        while len(frames) > 1 and frames[1].available_fs <= now:
            frames.popleft()
        if frames and frames[0].available_fs <= now:
            frame = frames[0]
            self.base.app.send_pose(
                self._robot,
                Pose(frame.x_m, frame.y_m, frame.heading_rad, frame.exposure_fs // FS_PER_MS),
            )
        self._scheduler.after(self._send_period_fs, self._send_pose, Priority.OBSERVER)

    def _on_telemetry(self, _robot: int, _message: Telemetry) -> None:
        self.telemetry_received += 1

    def _on_reply(self, pending: PendingCommand) -> None:
        now_s = self._scheduler.now / FS_PER_S
        number = pending.command.command_id
        words = f"command {number}, {_words(pending.command)}"
        tries = f"{pending.attempts} attempt{'s' if pending.attempts != 1 else ''}"
        if pending.status is None:
            event = Event(now_s, "base station", f"{words}: no answer after {tries}", "fault")
        else:
            self._answered_s[number] = now_s
            outcome = _outcome(pending)
            event = Event(
                now_s, "base station", f"{words}: {outcome}, {tries}", label=f"command {number}"
            )
        self.events.append(event)

    def commands(self) -> tuple[CommandRow, ...]:
        """Return every command that was sent, with its outcome so far."""
        return tuple(
            CommandRow(
                sent_s,
                _words(pending.command),
                pending.attempts,
                _outcome(pending),
                self._answered_s.get(pending.command.command_id),
            )
            for sent_s, pending in self._sent
        )


def _outcome(pending: PendingCommand) -> str:
    if pending.status is not None:
        return pending.status.name.lower().replace("_", " ")
    return "no answer" if pending.abandoned else "no answer yet"


def _words(command: Command) -> str:
    if isinstance(command, TailBeatCommand):
        bias = f"{np.degrees(command.bias_rad) + 0.0:.1f}".replace("-", "−")
        amplitude = f"{np.degrees(command.amplitude_rad):.1f}"
        return f"tail beat {bias}° ± {amplitude}° at {command.frequency_hz:g} Hz"
    return f"target ({command.x_m:g}, {command.y_m:g}) m"
