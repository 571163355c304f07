"""Swimming to one target after the other: the source's section 5.7, on the robot.

The overhead camera's pose comes by radio once a tail beat, as in the source; how the robot swims
to a place with it is `pursuit`'s. The source counts a target as reached where a pose lies within
0.02 m of it; the robot swims more than that in a beat, so the straight line from the last pose to
this one counts here.

What happens where something is missing:

- *No pose yet*: it rests. A robot that does not know where it is does not set out.
- *A pose is lost*: the robot goes on without, and stops after `coast_s`, until the next pose.
- *A pose comes again* (same or earlier exposure): it is no news, and counts as lost.
- *The navigation board is silent or was reset*: poses alone must do; it is told the beat again.
- *This board restarts*: what was reached is forgotten, and the list begins anew with the first
  target, as after power-on; targets that had come by radio are forgotten.
- *No target is left*: it rests.

A target command adds a target to the end of the list; a tail-beat command ends the tracking.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from procboard.applications.commands import CommandDesk, Reply, listen
from procboard.applications.open_loop import tail_beat_handler
from procboard.applications.pursuit import Place, Pursuit, PursuitConfig
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer
from procboard.applications.telemetry import TelemetryConfig, TelemetryTask
from procboard.applications.tracking_law import TrackingLaw
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from radio_802154 import messages
from radio_802154.messages import CommandStatus, Pose, TailBeatCommand, TargetCommand

TARGETS_KEPT: Final = 16
"""Room for targets: four bytes each, as they come by radio."""


@dataclass(frozen=True, slots=True)
class TrackingConfig(PursuitConfig):
    """Targets in their order, the beat, and the law's constants."""

    targets_m: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        PursuitConfig.__post_init__(self)
        if len(self.targets_m) > TARGETS_KEPT:
            raise ProcConfigError(
                f"target tracking: {len(self.targets_m)} targets, there is room for {TARGETS_KEPT}"
            )


class TargetTracking:
    """Application of the processing board."""

    def __init__(
        self, config: TrackingConfig | None = None, telemetry: TelemetryConfig | None = None
    ) -> None:
        self.config = config or TrackingConfig()
        self.telemetry = telemetry or TelemetryConfig()
        self._law = self.config.law()

    def start(self, services: Services) -> None:
        """Begin, with the first target."""
        _Tracker(services, self.config, self.telemetry, self._law)


class _Tracker:
    """One boot's life of the application."""

    def __init__(
        self,
        services: Services,
        config: TrackingConfig,
        telemetry: TelemetryConfig,
        law: TrackingLaw,
    ) -> None:
        self._services = services
        self._config = config
        self._targets = deque(config.targets_m)
        self._number = 0
        """Targets since the boot, the present one included."""
        self._swimmer = Swimmer(services)
        self._pursuit = Pursuit(services, config, law, self._swimmer)
        desk = CommandDesk(services)
        self._telemetry = TelemetryTask(services, telemetry, self._swimmer, desk)
        self._telemetry.on_report = self._pursuit.take_report
        self._obey_tail_beat = tail_beat_handler(self._swimmer)
        desk.on(TailBeatCommand, self._on_tail_beat)
        desk.on(TargetCommand, self._on_target)
        listen(services, Pose, self._on_pose, messages.BASE)
        services.cpu.spawn("target tracking", self._run())

    # --- what comes in ------------------------------------------------------------------

    def _on_pose(self, _source: int, pose: Pose) -> Firmware[None]:
        yield from self._pursuit.take_pose(pose)

    def _on_tail_beat(self, command: TailBeatCommand, reply: Reply) -> Firmware[None]:
        self._targets.clear()
        self._pursuit.swims = False
        self._telemetry.heading_control = False
        yield from self._obey_tail_beat(command, reply)

    def _on_target(self, command: TargetCommand, reply: Reply) -> Firmware[None]:
        if len(self._targets) >= TARGETS_KEPT:
            reply(CommandStatus.REFUSED)
            return
        self._targets.append((command.x_m, command.y_m))
        if len(self._targets) == 1:
            self._pursue()
        reply(CommandStatus.ACCEPTED)
        yield 20
        self._pursuit.news.set()

    # --- what is done -------------------------------------------------------------------

    def _pursue(self) -> None:
        """Say which target is the next; the law begins as after power-on."""
        self._pursuit.begin_anew()
        self._telemetry.target_reached = False
        self._number += 1
        self._services.hooks.tracking("target", self._number, *self._targets[0])

    def _target(self) -> Place | None:
        return self._targets[0] if self._targets else None

    def _run(self) -> Firmware[None]:
        pursuit = self._pursuit
        if self._targets:
            self._pursue()
        while True:
            self._telemetry.heading_control = bool(self._targets) and not pursuit.stopped
            posed = yield from pursuit.wait(bool(self._targets))
            if posed:
                self._look_for_arrival()
            if self._targets and pursuit.due(posed):
                yield from pursuit.steer(posed, self._target)

    def _look_for_arrival(self) -> None:
        """Strike off the targets that the robot has just come by."""
        targets, passed, track = self._targets, False, self._pursuit.track
        while targets and track.passed_m(targets[0]) <= self._config.gains.arrival_m:
            self._services.hooks.tracking("reached", self._number, *targets.popleft())
            self._telemetry.target_reached = passed = True
            if targets:
                self._pursue()
        if passed and not targets:
            self._pursuit.rest()
