"""The host at the tank's edge: an overhead camera, and a base station that commands by radio.

The camera exposes a frame every 1/30 s, and the pose is known some time later. Where the scenario
says so, the host sends the latest known pose to the robot at its own period; commands go out at
their times. It learns of the robot only what the camera sees and telemetry says.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
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
from tools.bench.wrong import Lens, arrives
from tools.records.data import Command as CommandRow
from tools.records.data import Event

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from plant.underwater import UnderwaterVehicle
    from tools.bench.live import Live
    from tools.bench.tracker import Seen, Tracker
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
        live: Live | None = None,
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
        self.base: BaseStation | None = None
        """The base station; None where an operator's XBee module stands in its place."""
        self.heard: Callable[[int, int, Telemetry], None] = lambda now_fs, robot, message: None
        """Called with every telemetry message that the base station's host gets, and its time."""
        if live is not None and live.module is not None:
            live.module.place(scheduler, medium, "base")
        elif live is not None and live.port is not None:
            network = network_config(config, base.address)
            network = replace(network, promiscuous=config.hil.base_promiscuous)
            live.port.start(live.scheduler, trace, medium, network)
        elif config.hil.emulates_base:
            self._start_base_station(trace, medium)
        self._frames: deque[CameraFrame] = deque()
        """The latest frame whose pose is known, and those whose pose is not known yet."""
        self._frame = 0
        self._tracker = live.tracker if live is not None else None
        self._sent_pose: Seen | None = None
        self._sends_pose = base.send_pose and self.base is not None
        # Who looks at a real fish is real.
        emulated = config.camera.fitted and config.hil.emulates_water
        if self._tracker is not None and live is not None:
            self._tracker.start(live.scheduler, self._poses)
        elif emulated:
            self._camera = Camera(
                np.random.default_rng(np.random.SeedSequence([config.scenario.seed, 0xCA3E7A])),
                model.camera(config),
            )
            self._lens = Lens(config)
            self._looks: deque[tuple[float, float, float]] = deque()
            self._shown: CameraFrame | None = None
            self._looked = 0
            if self._lens.delay_fs:
                scheduler.at(0, self._look, Priority.OBSERVER)
            scheduler.at(0, self._expose, Priority.OBSERVER)
        if self._sends_pose and (emulated or self._tracker is not None):
            self._send_period_fs = from_seconds(base.pose_period_s)
            scheduler.at(self._send_period_fs, self._send_pose, Priority.OBSERVER)

    def _start_base_station(self, trace: Trace, medium: Medium) -> None:
        config = self._config
        base = config.base_station
        self.base = BaseStation(
            self._scheduler,
            trace,
            Rail(self._scheduler, "base 3 V", PROC_V),
            medium,
            network_config(config, base.address),
            "base",
            config.scenario.seed,
        )
        self._app = self.base.app
        self._app.on_telemetry = self._on_telemetry
        self._app.on_reply = self._on_reply
        arrived = arrives(config)
        for command in base.tail_beats:
            if not config.plant.servo.ideal and not arrived():
                continue
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

    def _command_at(self, at_s: float, command: Command) -> None:
        def send() -> None:
            pending = self._app.send_command(self._robot, command)
            self._sent.append((self._scheduler.now / FS_PER_S, pending))

        self._scheduler.at(from_seconds(at_s), send, Priority.OBSERVER)

    def _expose(self) -> None:
        now, camera, lens = self._scheduler.now, self._camera, self._lens
        index = self._frame
        seen = self._looks.popleft() if lens.delay_fs else lens.look(self._vehicle, now)
        frame = camera.capture(index, *seen)
        if self._shown is not None and lens.stalls(now):
            frame = self._shown._replace(
                number=index, exposure_fs=frame.exposure_fs, available_fs=frame.available_fs
            )
        self._shown = frame
        self._poses.record(now, (frame.x_m, frame.y_m, frame.heading_rad))
        if self._sends_pose:
            self._frames.append(frame)
        self._frame = index = index + 1
        self._scheduler.at(camera.exposure_fs(index), self._expose, Priority.OBSERVER)

    def _look(self) -> None:
        """See what a late camera will show: what is before the beginning stands still."""
        camera, late = self._camera, self._lens.delay_fs
        while (due := camera.exposure_fs(self._looked) - late) <= self._scheduler.now:
            self._looks.append(self._lens.look(self._vehicle, self._scheduler.now))
            self._looked += 1
        self._scheduler.at(due, self._look, Priority.OBSERVER)

    def _send_pose(self) -> None:
        pose = self._known_pose() if self._tracker is None else self._tracked_pose(self._tracker)
        if pose is not None:
            self._app.send_pose(self._robot, pose)
        self._scheduler.after(self._send_period_fs, self._send_pose, Priority.OBSERVER)

    def _known_pose(self) -> Pose | None:
        """Return the emulated camera's latest pose that is known by now."""
        now, frames = self._scheduler.now, self._frames
        while len(frames) > 1 and frames[1].available_fs <= now:
            frames.popleft()
        if not frames or frames[0].available_fs > now:
            return None
        frame = frames[0]
        return Pose(frame.x_m, frame.y_m, frame.heading_rad, frame.exposure_fs // FS_PER_MS)

    def _tracked_pose(self, tracker: Tracker) -> Pose | None:
        """Return the tracker's latest pose, unless it went already or is of long ago."""
        seen = tracker.fresh(self._sent_pose)
        if seen is None:
            return None
        self._sent_pose, pose = seen, seen.pose
        return Pose(pose.x_m, pose.y_m, pose.heading_rad, max(0, round(seen.exposed_s * 1e3)))

    def _on_telemetry(self, robot: int, message: Telemetry) -> None:
        self.telemetry_received += 1
        self.heard(self._scheduler.now, robot, message)

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
