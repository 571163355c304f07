"""Between helm and module: a command ten times a second, and a fish that is stopped at the end.

Only the newest setpoint is ever sent. Each command is valid for a second (`valid_for_s`) on the
fish's own clock: whatever happens to this program, its machine, the module or the air, the fish
comes to rest within that time. At an orderly end, or when the operator's input ends, the neutral
setpoint goes out until the fish has answered it, for three seconds at most.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from radio_802154.messages import CommandStatus, TailBeatCommand, Telemetry
from tools.teleop.module import (
    Event,
    Failed,
    Heard,
    ModuleSession,
    Ready,
    Replied,
    Restarted,
    Sent,
    Told,
)
from tools.teleop.setpoint import NEUTRAL, Helm, Setpoint

RATE_HZ: Final = 10.0
VALID_S: Final = 1.0
STOP_LEAST: Final = 3
"""Neutral commands that go out in any case."""
STOP_MOST_S: Final = 3.0
"""How long a fish that does not answer is told to stop."""
QUALITY_OF: Final = 20
"""Packets that the link quality is taken over."""
_DONE: Final = (CommandStatus.APPLIED, CommandStatus.ACCEPTED, CommandStatus.DUPLICATE)


class Course(Enum):
    """Where the session is."""

    WAITING = "waiting for the module"
    DRIVING = "driving"
    STOPPING = "stopping"
    OVER = "over"


@dataclass(frozen=True, slots=True)
class Plan:
    """How the fish is commanded."""

    address: int = 1
    rate_hz: float = RATE_HZ
    valid_for_s: float = VALID_S


class Pilot:
    """Sends what the helm says through a module, at a fixed rate.

    `first_id` is the first command's, so that two sessions in a row differ.
    """

    def __init__(self, helm: Helm, module: ModuleSession, plan: Plan, first_id: int) -> None:
        self.helm = helm
        self.module = module
        self.plan = plan
        self.course = Course.WAITING
        self.told = NEUTRAL
        """The setpoint that went out last."""
        self.commands = 0
        """Commands handed to the module."""
        self.late = 0
        """Times at which the module or its line took none."""
        self.failure = ""
        """Why there is no module; empty while there is one."""
        self.telemetry: Telemetry | None = None
        self.telemetry_s: float | None = None
        """When it came."""
        self.stop_confirmed = False
        """Whether the fish has answered a neutral command at the end."""
        self.stops_sent = 0
        self._next_id = first_id & 0xFFFF
        self._due_s: float | None = None
        self._stopping_s: float | None = None
        self._stop_ids: set[int] = set()
        self._recent: list[bool] = []
        self.events: list[tuple[float, str]] = []
        """What was told to the operator, with its time."""

    @property
    def next_deadline_s(self) -> float | None:
        """When `tick` has something to do."""
        dues = [due for due in (self._due_s, self.module.next_deadline_s) if due is not None]
        return min(dues, default=None)

    @property
    def quality(self) -> float | None:
        """Share of the last packets that were acknowledged; None before the first."""
        return sum(self._recent) / len(self._recent) if self._recent else None

    def hear(self, octets: bytes, now_s: float) -> None:
        """Take octets from the module."""
        self._take(self.module.receive(octets, now_s), now_s)

    def tick(self, now_s: float) -> None:
        """Do what is due: the module's timers, the helm's end, the next command."""
        self._take(self.module.handle_timer(now_s), now_s)
        if self.helm.ended is not None and self._stopping_s is None:
            self._stopping_s = now_s
            self._tell(self.helm.ended.reason, now_s)
            if self.course is Course.DRIVING:
                self.course, self._due_s = Course.STOPPING, now_s
            elif not self.commands:
                self.course = Course.OVER  # nothing was ever sent: nothing to stop
        if self._due_s is not None and now_s >= self._due_s:
            period_s = 1.0 / self.plan.rate_hz
            self._due_s = max(self._due_s + period_s, now_s)  # what was missed is not made up for
            self._command(now_s)
        if self._stopping_s is not None:
            enough = self.stop_confirmed and self.stops_sent >= STOP_LEAST
            if enough:
                self._due_s = None  # the last one's status is still to come
                enough = not self.module.in_flight
            if enough or now_s - self._stopping_s >= STOP_MOST_S:
                self.course, self._due_s = Course.OVER, None

    def _command(self, now_s: float) -> None:
        stopping = self.course is Course.STOPPING
        setpoint: Setpoint = NEUTRAL if stopping else self.helm.setpoint(now_s)
        number = self._next_id
        command = TailBeatCommand(
            number, setpoint.bias_rad, setpoint.amplitude_rad, setpoint.frequency_hz,
            self.plan.valid_for_s,
        )  # fmt: skip
        if not self.module.send(self.plan.address, command, number, now_s):
            self.late += 1
            return
        self._next_id = (number + 1) & 0xFFFF
        self.commands += 1
        self.told = setpoint
        if stopping:
            self.stops_sent += 1
            self._stop_ids.add(number)

    def _take(self, events: list[Event], now_s: float) -> None:
        for event in events:
            match event:
                case Ready(info):
                    self.failure = ""
                    self._tell(str(info), now_s)
                    stopping = self._stopping_s is not None
                    self.course = Course.STOPPING if stopping else Course.DRIVING
                    self._due_s = now_s
                case Failed(reason):
                    self.failure = reason
                    self._tell(reason, now_s)
                    self.course, self._due_s = Course.WAITING, None
                case Restarted():
                    self._tell("the module was reset; it is set up again", now_s)
                    self._pause()
                case Told(text):
                    self._tell(text, now_s)
                case Sent(_, result, _):
                    self._recent = [*self._recent[1 - QUALITY_OF :], result == 0]
                case Replied(reply, _):
                    if reply.command_id in self._stop_ids and reply.status in _DONE:
                        self.stop_confirmed = True
                case Heard(source, telemetry):
                    if self.plan.address in (source, 0xFFFF) or self.plan.address > 0xFFFF:
                        self.telemetry, self.telemetry_s = telemetry, now_s

    def reopened(self, now_s: float) -> None:
        """The serial line was lost and is back."""
        self._tell("the line is back; the module is set up again", now_s)
        self.module.reopened(now_s)
        self._pause()

    def _pause(self) -> None:
        if self.course is not Course.OVER:
            self.course, self._due_s = Course.WAITING, None

    def _tell(self, text: str, now_s: float) -> None:
        self.events.append((now_s, text))

    def summary(self) -> dict[str, Any]:
        """Everything for `--json`."""
        module, info = self.module, self.module.info
        return {
            "module": None if info is None else str(info),
            "failure": self.failure,
            "address": self.plan.address,
            "commands": self.commands,
            "late": self.late,
            "skipped": module.skipped,
            "on_the_air": dict(module.results),
            "replies": dict(module.replies),
            "repeated_replies": module.repeated,
            "foreign_packets": module.foreign,
            "damaged_frames": module.errors,
            "restarts": module.restarts,
            "status_after": module.status_s.summary(),
            "reply_after": module.reply_s.summary(),
            "rssi_dbm": module.rssi_dbm,
            "stops_sent": self.stops_sent,
            "stop_confirmed": self.stop_confirmed,
            "ended": None if self.helm.ended is None else self.helm.ended.reason,
        }
