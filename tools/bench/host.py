"""The host at the tank's edge: an overhead camera, and a base station that commands by radio.

Where the scenario says so, the host sends the latest known pose to the robot at its own period;
commands go out at their times. It learns of the robot only what the camera sees and telemetry says.
Of several robots each has its poses, evenly apart within the period, and its commands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from firmware_model.power import Rail
from firmware_model.scheduler import Priority
from firmware_model.signals import Quantity, constant
from firmware_model.time import FS_PER_MS, FS_PER_S, from_seconds
from procboard.applications.base_station import Command, PendingCommand
from procboard.board import BaseStation
from radio_802154.medium import Antenna, Medium
from radio_802154.messages import Pose, TailBeatCommand, TargetCommand, Telemetry
from tools.bench import mission
from tools.bench.overhead import InView, Overhead
from tools.bench.power import PROC_V
from tools.bench.robot import network_config
from tools.bench.wrong import arrives, prefix
from tools.records.data import Command as CommandRow
from tools.records.data import Event
from tools.survey_section import surveys

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from tools.bench.live import Live
    from tools.bench.tracker import Seen, Tracker
    from tools.configuration import Scenario

UNTIL_THE_NEXT_S = 0.0
"""Validity of a command that holds until the next one."""


AWAY_M = 1e6
"""Of a base station that is out of range: no frame of a CC2420 is heard so far."""


class Host:
    """Camera, base station and the schedule of commands."""

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        trace: Trace,
        medium: Medium,
        robots: Sequence[InView],
        live: Live | None = None,
    ) -> None:
        """Begin; with `live` there is one robot, and perhaps somebody else in a part's place."""
        self.telemetry: Counter[int] = Counter()
        """Messages received, by the address of the robot that sent them."""
        self._sent: list[tuple[float, PendingCommand]] = []
        self._answered_s: dict[int, float] = {}
        self.events: list[Event] = []
        self._scheduler = scheduler
        self._config = config
        self._robots = tuple(robots)
        self._names = {robot.address: robot.name for robot in robots}
        poses = [trace.channel(f"{prefix(robot.name)}camera") for robot in robots]
        base = config.base_station
        medium.place(
            "base",
            Antenna(x_m=_away(config), y_m=constant(base.y_m), height_m=base.height_m),
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
        self._tracker = live.tracker if live is not None else None
        self._sent_pose: Seen | None = None
        self._sends_pose = base.send_pose and self.base is not None
        # Who looks at a real fish is real.
        emulated = config.camera.fitted and config.hil.emulates_water
        if self._tracker is not None and live is not None:
            self._tracker.start(live.scheduler, poses[0])
        elif emulated:
            self._camera = Overhead(config, scheduler, trace, robots, keep=self._sends_pose)
        if self._sends_pose and (emulated or self._tracker is not None):
            self._send_period_fs = period_fs = from_seconds(base.pose_period_s)
            if surveys(config):
                scheduler.at(period_fs, self._send_poses, Priority.OBSERVER)
                return
            for place, robot in enumerate(robots):
                first_fs = period_fs + place * period_fs // len(robots)
                scheduler.at(first_fs, self._pose_sender(robot.address), Priority.OBSERVER)

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
            routing=mission.routing_config(config, base=True) if surveys(config) else None,
        )
        self._app = self.base.app
        self._app.on_telemetry = self._on_telemetry
        self._app.on_reply = self._on_reply
        arrived = {robot.address: arrives(config, robot.name) for robot in self._robots}
        for beat in base.tail_beats:
            command = TailBeatCommand(
                0, beat.bias_rad, beat.amplitude_rad, beat.frequency_hz, UNTIL_THE_NEXT_S
            )
            for address in self._meant(beat.robots):
                if config.plant.servo.ideal or arrived[address]():
                    self._command_at(beat.at_s, address, command)
        for target in base.targets:
            for address in self._meant(target.robots):
                self._command_at(target.at_s, address, TargetCommand(0, target.x_m, target.y_m))

    def _meant(self, robots: Sequence[int]) -> Sequence[int]:
        """Addresses that a command goes to: all where it names none."""
        return robots or tuple(robot.address for robot in self._robots)

    def _command_at(self, at_s: float, address: int, command: Command) -> None:
        def send() -> None:
            pending = self._app.send_command(address, command)
            self._sent.append((self._scheduler.now / FS_PER_S, pending))

        self._scheduler.at(from_seconds(at_s), send, Priority.OBSERVER)

    def _pose_sender(self, address: int) -> Callable[[], None]:
        def send() -> None:
            tracker = self._tracker
            pose = self._known_pose(address) if tracker is None else self._tracked_pose(tracker)
            if pose is not None:
                self._app.send_pose(address, pose)
            self._scheduler.after(self._send_period_fs, send, Priority.OBSERVER)

        return send

    def _send_poses(self) -> None:
        """Have everybody hear where all are; of one exposure, since one camera sees them."""
        found = [(robot.address, self._known_pose(robot.address)) for robot in self._robots]
        poses = [(address, pose) for address, pose in found if pose is not None]
        if poses:
            self._app.send_poses(poses)
        self._scheduler.after(self._send_period_fs, self._send_poses, Priority.OBSERVER)

    def _known_pose(self, address: int) -> Pose | None:
        """Return the emulated camera's latest pose of a robot that is known by now."""
        frame = self._camera.known(address)
        if frame is None:
            return None
        return Pose(frame.x_m, frame.y_m, frame.heading_rad, frame.exposure_fs // FS_PER_MS)

    def _tracked_pose(self, tracker: Tracker) -> Pose | None:
        """Return the tracker's latest pose, unless it went already or is of long ago."""
        seen = tracker.fresh(self._sent_pose)
        if seen is None:
            return None
        self._sent_pose, pose = seen, seen.pose
        return Pose(pose.x_m, pose.y_m, pose.heading_rad, max(0, round(seen.exposed_s * 1e3)))

    def _on_telemetry(self, robot: int, message: Telemetry) -> None:
        self.telemetry[robot] += 1
        self.heard(self._scheduler.now, robot, message)

    def _on_reply(self, pending: PendingCommand) -> None:
        now_s = self._scheduler.now / FS_PER_S
        number = pending.command.command_id
        words = f"command {number}, {self._said(pending)}"
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
                self._said(pending),
                pending.attempts,
                _outcome(pending),
                self._answered_s.get(pending.command.command_id),
            )
            for sent_s, pending in self._sent
        )

    def _said(self, pending: PendingCommand) -> str:
        """A command in words, with the name of the robot where there are several."""
        name = self._names[pending.robot]
        return _words(pending.command) + (f" to {name}" if name else "")


def _away(config: Scenario) -> Quantity:
    """Where the base station is along x: out of everybody's range at times, if so wanted."""
    x_m, outages = config.base_station.x_m, config.faults.base_outages
    if not outages:
        return constant(x_m)
    spans = [(from_seconds(cut.at_s), from_seconds(cut.at_s + cut.duration_s)) for cut in outages]
    return lambda now: x_m + AWAY_M * any(begin <= now < end for begin, end in spans)


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
