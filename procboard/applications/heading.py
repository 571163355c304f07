"""Proportional heading control towards a target: the source's Fig. 5.10, on the robot.

Every five seconds the tail-beat bias is set in proportion to the heading error, the difference
between the direction of the target and the heading. The place comes from Pose messages (overhead
camera, base station); the heading between two of them from the navigation board, whose difference
to the camera's heading at the last pose is carried along, so that a compass offset does no harm.

The source gives neither gain nor limit; the defaults are assumed, within the ±1 rad of Fig. 5.10c.
A tail that is deflected to α > 0 points to starboard and turns the robot clockwise (3.18: the
thrust's moment about C is −c sin α F), so the bias has the sign opposite to the error's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from procboard.applications.commands import CommandDesk, Reply, listen
from procboard.applications.open_loop import tail_beat_handler
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer, TailBeatSetting
from procboard.applications.telemetry import TelemetryConfig, TelemetryTask
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from radio_802154 import messages
from radio_802154.messages import CommandStatus, Pose, TailBeatCommand, TargetCommand

CONTROL_CYCLES: Final = 12_000
"""A control step: atan2, sqrt and multiplications in software floating point. An estimate: some
twenty operations of the C library at a few hundred cycles each."""

TURN_SIGN: Final = -1
"""Sign of the bias that turns the robot to port (heading rising)."""


@dataclass(frozen=True, slots=True)
class HeadingConfig:
    """The controller. Amplitude, frequency and period as in Fig. 5.10; gain and limit assumed."""

    target_m: tuple[float, float] | None = None
    """Where to swim from the start; None waits for a `TargetCommand`."""
    gain: float = 0.5
    """K_p: rad of bias a rad of error."""
    bias_limit_rad: float = math.radians(50.0)
    amplitude_rad: float = math.radians(15.0)
    frequency_hz: float = 1.0
    period_s: float = 5.0
    arrival_m: float = 0.02
    """Distance at which the target counts as reached (section 5.7.3)."""
    rest_at_target: bool = False
    """Whether to stop there; else the robot goes on circling the target."""
    pose_age_s: float = 10.0
    """Age of a pose beyond which nothing is steered by it: the robot swims straight."""

    def __post_init__(self) -> None:
        if not self.period_s > 0 or not self.frequency_hz > 0:
            raise ProcConfigError("heading control: period_s and frequency_hz are positive")
        if not 0 <= self.bias_limit_rad <= math.pi / 2 or self.gain < 0 or self.arrival_m < 0:
            raise ProcConfigError(
                "heading control: bias_limit_rad lies between 0 and π/2, gain and arrival_m are "
                "not negative"
            )


def wrap(angle_rad: float) -> float:
    """Return the same direction within [-π, π)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def heading_error(
    x_m: float, y_m: float, heading_rad: float, target_m: tuple[float, float]
) -> float:
    """Return the direction of the target against the heading, counter-clockwise, [-π, π)."""
    return wrap(math.atan2(target_m[1] - y_m, target_m[0] - x_m) - heading_rad)


def bias_for(error_rad: float, gain: float, limit_rad: float) -> float:
    """Return the proportional law's bias, limited."""
    return min(limit_rad, max(-limit_rad, TURN_SIGN * gain * error_rad))


class HeadingEstimate:
    """Camera poses, and between them the change of the navigation board's heading."""

    __slots__ = ("_offset_rad", "pose", "pose_us")

    def __init__(self) -> None:
        self.pose: Pose | None = None
        self.pose_us = 0
        self._offset_rad: float | None = None

    def take(self, pose: Pose, now_us: int, board_heading_rad: float | None) -> None:
        """Note a pose and what the navigation board's heading is at that time."""
        self.pose = pose
        self.pose_us = now_us
        self._offset_rad = (
            None if board_heading_rad is None else wrap(pose.heading_rad - board_heading_rad)
        )

    def heading_rad(self, board_heading_rad: float | None) -> float:
        """Return the heading now. Needs a pose."""
        assert self.pose is not None
        if board_heading_rad is None or self._offset_rad is None:
            return self.pose.heading_rad
        return wrap(board_heading_rad + self._offset_rad)


class HeadingControl:
    """Swims to targets; a tail-beat command ends it, a target command begins it again."""

    def __init__(
        self, config: HeadingConfig | None = None, telemetry: TelemetryConfig | None = None
    ) -> None:
        self.config = config or HeadingConfig()
        self.telemetry = telemetry or TelemetryConfig()

    def start(self, services: Services) -> None:
        """Begin."""
        _Helmsman(services, self.config, self.telemetry)


class _Helmsman:
    """One boot's life of the application."""

    def __init__(
        self, services: Services, config: HeadingConfig, telemetry: TelemetryConfig
    ) -> None:
        self._services = services
        self._config = config
        self._target = config.target_m
        self._estimate = HeadingEstimate()
        self._swimmer = Swimmer(services)
        desk = CommandDesk(services)
        self._telemetry = TelemetryTask(services, telemetry, self._swimmer, desk)
        self._obey_tail_beat = tail_beat_handler(self._swimmer)
        desk.on(TailBeatCommand, self._on_tail_beat)
        desk.on(TargetCommand, self._on_target)
        listen(services, Pose, self._on_pose, messages.BASE)
        services.cpu.spawn("heading control", self._run())

    def _board_heading(self) -> float | None:
        report = self._telemetry.report
        return None if report is None else report.heading_rad

    def _on_tail_beat(self, command: TailBeatCommand, reply: Reply) -> Firmware[None]:
        self._target = None
        self._telemetry.heading_control = False
        yield from self._obey_tail_beat(command, reply)

    def _on_target(self, command: TargetCommand, reply: Reply) -> Firmware[None]:
        self._target = (command.x_m, command.y_m)
        self._telemetry.target_reached = False
        reply(CommandStatus.ACCEPTED)
        yield from self._steer()

    def _on_pose(self, _source: int, pose: Pose) -> Firmware[None]:
        first = self._estimate.pose is None
        self._estimate.take(pose, self._services.alarms.now_us(), self._board_heading())
        target = self._target
        if target is not None:
            distance_m = math.hypot(target[0] - pose.x_m, target[1] - pose.y_m)
            if distance_m <= self._config.arrival_m:
                self._telemetry.target_reached = True
                if self._config.rest_at_target:
                    self._target = None
                    self._swimmer.rest()
        yield 100
        if first:  # until now it swam blindly straight
            yield from self._steer()

    def _steer(self) -> Firmware[None]:
        """One step of the control law."""
        config, estimate, target = self._config, self._estimate, self._target
        self._telemetry.heading_control = target is not None
        if target is None:
            return
        yield CONTROL_CYCLES
        error = bias = 0.0
        pose = estimate.pose
        age_us = self._services.alarms.now_us() - estimate.pose_us
        if pose is not None and age_us <= config.pose_age_s * 1e6:
            heading = estimate.heading_rad(self._board_heading())
            error = heading_error(pose.x_m, pose.y_m, heading, target)
            bias = bias_for(error, config.gain, config.bias_limit_rad)
        self._services.hooks.control(error, bias)
        setting = TailBeatSetting(bias, config.amplitude_rad, config.frequency_hz)
        yield from self._swimmer.command(setting)

    def _run(self) -> Firmware[None]:
        alarms = self._services.alarms
        period = round(self._config.period_s * 32_768)
        due = alarms.now()
        while True:
            yield from self._steer()
            due += period
            yield from alarms.sleep_until(due)
