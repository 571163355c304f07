"""Swimming towards a place, beat by beat: what target tracking and surveys have in common.

A pose comes by radio once a tail beat; at each the law (`tracking_law`) sets the bias of the next
beat, amplitude and frequency are fixed. A pose that is not there after a beat and a quarter is
lost: the place is carried on by heading and last speed (`tracking_estimate`), and the law goes on
with it. After `coast_s` without a pose the robot stops, until the next one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from firmware_model.cpu import Flag
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer, TailBeatSetting
from procboard.applications.tracking_estimate import PoseTrack
from procboard.applications.tracking_law import Mode, TrackingGains, TrackingLaw
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from radio_802154.messages import Pose
from spi_bus.messages import SensorReport

LAW_CYCLES: Final = 40_000
"""The law in software floating point. An estimate: about a hundred operations of the C library, a
dozen of them transcendental, at some hundred cycles each; 10 ms of a beat."""
POSE_CYCLES: Final = 8_000
"""A pose: differences, a rotation, the mean of ten headings (estimate, as above)."""
LATE_BEATS: Final = 1.25
"""A pose that is not there after so long is lost."""
EARLY_BEATS: Final = 0.75
"""Poses that come more often than once a beat are noted, but the law waits."""

Place: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True)
class PursuitConfig:
    """The beat and the law's constants."""

    amplitude_rad: float = 0.2617993877991494  # 15°, as in the source's figures of chapter 5
    frequency_hz: float = 1.0
    coast_s: float = 5.0
    """How long the robot goes on without a pose."""
    gains: TrackingGains = field(default_factory=TrackingGains)

    def __post_init__(self) -> None:
        if self.coast_s < 0:
            raise ProcConfigError("target tracking: coast_s is not negative")
        if not (self.amplitude_rad > 0 and self.frequency_hz > 0):
            raise ProcConfigError(
                "target tracking: the tail's amplitude and frequency are positive"
            )

    def law(self) -> TrackingLaw:
        """Return the law; it takes a while to make, and remembers nothing."""
        return TrackingLaw(self.amplitude_rad, self.frequency_hz, self.gains)


class Pursuit:
    """One boot's swimming."""

    def __init__(
        self, services: Services, config: PursuitConfig, law: TrackingLaw, swimmer: Swimmer
    ) -> None:
        self.beat_us = round(1e6 / config.frequency_hz)
        self.track = PoseTrack(1.0 / config.frequency_hz, config.coast_s)
        self.news = Flag("pursuit: a pose, or another target")
        self.swims = False
        self.stopped = False
        """For want of poses."""
        self._services = services
        self._alarms = services.alarms
        self._config = config
        self._law = law
        self._swimmer = swimmer
        self._mode: Mode | None = None
        self._posed = False
        self._decided_us = -self.beat_us
        self._nav_time_us = 0

    def _now_s(self) -> float:
        return self._alarms.now_us() / 1e6

    # --- what comes in ------------------------------------------------------------------

    def take_report(self, report: SensorReport) -> None:
        """Note the heading of a report."""
        if report.time_us < self._nav_time_us:
            self.track.forget_headings()
        self._nav_time_us = report.time_us
        if report.heading_rad is not None:
            self.track.take_heading(self._now_s(), report.heading_rad)

    def take_pose(self, pose: Pose) -> Firmware[None]:
        """Note a pose; one that is no news is left alone."""
        yield POSE_CYCLES
        now_s = self._now_s()
        if self.track.take_pose(now_s, pose.x_m, pose.y_m, pose.heading_rad, pose.camera_time_ms):
            self._posed = True
            self.news.set()

    # --- what is done -------------------------------------------------------------------

    def begin_anew(self) -> None:
        """There is another target: the law begins as after power-on."""
        self._mode = None

    def wait(self, pursues: bool) -> Firmware[bool]:
        """Wait for news, or for a pose to be late; return whether there is a new pose."""
        alarms = self._alarms
        if self.swims and pursues:
            due_us = self._decided_us + round(LATE_BEATS * self.beat_us)
            alarm = alarms.after_us(max(0, due_us - alarms.now_us()), self.news)
            yield self.news
            alarms.cancel(alarm)
        else:
            yield self.news
        posed, self._posed = self._posed, False
        if posed and self.stopped:
            self.stopped = False
            self._services.hooks.tracking("pose found")
        return posed

    def rest(self) -> None:
        """Swim no more."""
        self.swims = False
        self._swimmer.rest()

    def due(self, posed: bool) -> bool:
        """Whether it is time to decide on the next beat; stops where poses stay away."""
        now_us, pose_s = self._alarms.now_us(), self.track.pose_s
        if pose_s is None:
            return False
        since_us = now_us - self._decided_us
        if self.swims and since_us < (EARLY_BEATS if posed else LATE_BEATS) * self.beat_us - 1e3:
            return False
        if now_us / 1e6 - pose_s > self._config.coast_s:
            if self.swims:
                self.stopped = True
                self._services.hooks.tracking("pose lost")
                self.rest()
            return False
        return True

    def steer(self, posed: bool, target: Callable[[], Place | None]) -> Firmware[None]:
        """Set the next beat's bias; None as the target: nothing is to be done any more."""
        now_us = self._alarms.now_us()
        self._decided_us = now_us
        yield LAW_CYCLES
        place = target()
        if place is None:  # a command came meanwhile
            return
        if not posed:
            self.track.carry_on(now_us / 1e6)
        motion = self.track.motion(place)
        assert motion is not None  # there was a pose, or it would not be due
        before = self._mode
        mode, bias = self._law.step(Mode.TURNING if before is None else before, motion)
        if mode is not before:
            self._mode = mode
            self._services.hooks.tracking("mode", mode.name.lower())
        self._services.hooks.control(-motion.error_rad, bias)
        config = self._config
        self.swims = True
        yield from self._swimmer.command(
            TailBeatSetting(bias, config.amplitude_rad, config.frequency_hz)
        )
