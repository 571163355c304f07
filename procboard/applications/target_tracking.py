"""Swimming to one target after the other: the source's section 5.7, on the robot.

The overhead camera's pose comes by radio once a tail beat, as in the source; at each the law
(`tracking_law`) sets the bias of the next beat, amplitude and frequency are fixed. Velocities are
made of poses and of the navigation board's heading (`tracking_estimate`). The source counts a
target as reached where a pose lies within 0.02 m of it; the robot swims more than that in a beat,
so the straight line from the last pose to this one counts here.

What happens where something is missing:

- *No pose yet*: it rests. A robot that does not know where it is does not set out.
- *A pose is lost*: after a beat and a quarter the place is carried on by heading and last speed,
  and the law goes on with it. After `coast_s` the robot stops, until the next pose.
- *A pose comes again* (same or earlier exposure): it is no news, and counts as lost.
- *The navigation board is silent or was reset*: poses alone must do; it is told the beat again.
- *This board restarts*: what was reached is forgotten, and the list begins anew with the first
  target, as after power-on; targets that had come by radio are forgotten.
- *No target is left*: it rests.

A target command adds a target to the end of the list; a tail-beat command ends the tracking.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from firmware_model.cpu import Flag
from procboard.applications.commands import CommandDesk, Reply, listen
from procboard.applications.open_loop import tail_beat_handler
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer, TailBeatSetting
from procboard.applications.telemetry import TelemetryConfig, TelemetryTask
from procboard.applications.tracking_estimate import PoseTrack
from procboard.applications.tracking_law import Mode, TrackingGains, TrackingLaw
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from radio_802154 import messages
from radio_802154.messages import CommandStatus, Pose, TailBeatCommand, TargetCommand
from spi_bus.messages import SensorReport

LAW_CYCLES: Final = 40_000
"""The law in software floating point. An estimate: about a hundred operations of the C library, a
dozen of them transcendental, at some hundred cycles each; 10 ms of a beat."""
POSE_CYCLES: Final = 8_000
"""A pose: differences, a rotation, the mean of ten headings (estimate, as above)."""
TARGETS_KEPT: Final = 16
"""Room for targets: four bytes each, as they come by radio."""
LATE_BEATS: Final = 1.25
"""A pose that is not there after so long is lost."""
EARLY_BEATS: Final = 0.75
"""Poses that come more often than once a beat are noted, but the law waits."""


@dataclass(frozen=True, slots=True)
class TrackingConfig:
    """Targets in their order, the beat, and the law's constants."""

    targets_m: tuple[tuple[float, float], ...] = ()
    amplitude_rad: float = 0.2617993877991494  # 15°, as in the source's figures of chapter 5
    frequency_hz: float = 1.0
    coast_s: float = 5.0
    """How long the robot goes on without a pose."""
    gains: TrackingGains = field(default_factory=TrackingGains)

    def __post_init__(self) -> None:
        if len(self.targets_m) > TARGETS_KEPT:
            raise ProcConfigError(
                f"target tracking: {len(self.targets_m)} targets, there is room for {TARGETS_KEPT}"
            )
        if self.coast_s < 0:
            raise ProcConfigError("target tracking: coast_s is not negative")
        if not (self.amplitude_rad > 0 and self.frequency_hz > 0):
            raise ProcConfigError(
                "target tracking: the tail's amplitude and frequency are positive"
            )


class TargetTracking:
    """Application of the processing board."""

    def __init__(
        self, config: TrackingConfig | None = None, telemetry: TelemetryConfig | None = None
    ) -> None:
        self.config = config or TrackingConfig()
        self.telemetry = telemetry or TelemetryConfig()
        self._law = TrackingLaw(
            self.config.amplitude_rad, self.config.frequency_hz, self.config.gains
        )

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
        self._alarms = services.alarms
        self._config = config
        self._law = law
        self._mode: Mode | None = None
        self._targets = deque(config.targets_m)
        self._number = 0
        """Targets since the boot, the present one included."""
        self._beat_us = round(1e6 / config.frequency_hz)
        self._track = PoseTrack(1.0 / config.frequency_hz, config.coast_s)
        self._news = Flag("target tracking: a pose or a target")
        self._posed = False
        self._swims = False
        self._stopped = False
        self._decided_us = -self._beat_us
        self._nav_time_us = 0
        self._swimmer = Swimmer(services)
        desk = CommandDesk(services)
        self._telemetry = TelemetryTask(services, telemetry, self._swimmer, desk)
        self._telemetry.on_report = self._on_report
        self._obey_tail_beat = tail_beat_handler(self._swimmer)
        desk.on(TailBeatCommand, self._on_tail_beat)
        desk.on(TargetCommand, self._on_target)
        listen(services, Pose, self._on_pose, messages.BASE)
        services.cpu.spawn("target tracking", self._run())

    def _now_s(self) -> float:
        return self._alarms.now_us() / 1e6

    # --- what comes in ------------------------------------------------------------------

    def _on_report(self, report: SensorReport) -> None:
        if report.time_us < self._nav_time_us:
            self._track.forget_headings()
        self._nav_time_us = report.time_us
        if report.heading_rad is not None:
            self._track.take_heading(self._now_s(), report.heading_rad)

    def _on_pose(self, _source: int, pose: Pose) -> Firmware[None]:
        yield POSE_CYCLES
        now_s = self._now_s()
        if self._track.take_pose(now_s, pose.x_m, pose.y_m, pose.heading_rad, pose.camera_time_ms):
            self._posed = True
            self._news.set()

    def _on_tail_beat(self, command: TailBeatCommand, reply: Reply) -> Firmware[None]:
        self._targets.clear()
        self._swims = False
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
        self._news.set()

    # --- what is done -------------------------------------------------------------------

    def _pursue(self) -> None:
        """Say which target is the next; the law begins as after power-on."""
        self._mode = None
        self._telemetry.target_reached = False
        self._number += 1
        self._services.hooks.tracking("target", self._number, *self._targets[0])

    def _run(self) -> Firmware[None]:
        alarms = self._alarms
        if self._targets:
            self._pursue()
        while True:
            self._telemetry.heading_control = bool(self._targets) and not self._stopped
            if self._swims and self._targets:
                due_us = self._decided_us + round(LATE_BEATS * self._beat_us)
                alarm = alarms.after_us(max(0, due_us - alarms.now_us()), self._news)
                yield self._news
                alarms.cancel(alarm)
            else:
                yield self._news
            posed, self._posed = self._posed, False
            if posed:
                if self._stopped:
                    self._stopped = False
                    self._services.hooks.tracking("pose found")
                self._look_for_arrival()
            if self._targets and self._track.pose_s is not None:
                yield from self._decide(posed)

    def _look_for_arrival(self) -> None:
        """Strike off the targets that the robot has just come by."""
        targets, passed = self._targets, False
        while targets and self._track.passed_m(targets[0]) <= self._config.gains.arrival_m:
            self._services.hooks.tracking("reached", self._number, *targets.popleft())
            self._telemetry.target_reached = passed = True
            if targets:
                self._pursue()
        if passed and not targets:
            self._rest()

    def _rest(self) -> None:
        self._swims = False
        self._swimmer.rest()

    def _decide(self, posed: bool) -> Firmware[None]:
        """Set the next beat's bias, if it is time."""
        now_us, pose_s = self._alarms.now_us(), self._track.pose_s
        since_us = now_us - self._decided_us
        if self._swims and since_us < (EARLY_BEATS if posed else LATE_BEATS) * self._beat_us - 1e3:
            return
        assert pose_s is not None  # there was one, or there is nothing to decide
        if now_us / 1e6 - pose_s > self._config.coast_s:
            if self._swims:
                self._stopped = True
                self._services.hooks.tracking("pose lost")
                self._rest()
            return
        self._decided_us = now_us
        yield LAW_CYCLES
        if not self._targets:  # a command came meanwhile
            return
        if not posed:
            self._track.carry_on(now_us / 1e6)
        motion = self._track.motion(self._targets[0])
        assert motion is not None
        before = self._mode
        mode, bias = self._law.step(Mode.TURNING if before is None else before, motion)
        if mode is not before:
            self._mode = mode
            self._services.hooks.tracking("mode", mode.name.lower())
        self._services.hooks.control(-motion.error_rad, bias)
        config = self._config
        self._swims = True
        yield from self._swimmer.command(
            TailBeatSetting(bias, config.amplitude_rad, config.frequency_hz)
        )
