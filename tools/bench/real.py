"""The real board of a run: the line to it, and what can be known of it from this side.

Everything is measured where the bridge meets the transport, on the host's clock, from frames that
pass: the round trip of a question (Ping to a navigation board, ClockRequest to a processing board),
the time until a message is acknowledged, the stamps of its reports or answers.
The link's own counters are those of the emulated board at this end.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from firmware_model.histogram import DurationHistogram
from firmware_model.scheduler import Priority
from firmware_model.time import from_seconds
from spi_bus.errors import LinkFull, SpiBusError
from spi_bus.frame import VERSION, Decoder, ErrorKind, Frame, FrameType
from spi_bus.messages import (
    LINK_MESSAGES,
    ClockReport,
    ClockRequest,
    Ping,
    Pong,
    SensorReport,
)
from spi_bus.transports.bridge import FrameLine
from tools.bench.board_clock import BoardClock, ClockFit
from tools.bench.lateness import above
from tools.bench.outages import LineOutages, open_line
from tools.bench.robot import gps_config
from tools.bench.told import Told

if TYPE_CHECKING:
    from firmware_model.trace import Trace
    from spi_bus.link import Link
    from tools.bench.pace import LineScheduler
    from tools.bench.robot import Robot
    from tools.configuration import Scenario
    from tools.records.data import Event, Series

NAMES = {"nav": "navigation board", "proc": "processing board"}
_HALF = 128  # of the sequence numbers
_MOST_PINGS = 64
LEAST_REPEATED = 10
"""Repetitions without anything new that are no accident any more."""
_UNANSWERED = 20
"""Questions after which a board that has answered none is asked no more: its firmware may not know
them. More than a link's queue holds, so that an outage alone cannot bring it about."""


class RealBoard:
    """One real board, on its line.

    Args:
        config: names the line.
        clock: monotonic, in seconds.
        keep: whether to keep what the board reports; without it memory is bounded.

    Raises:
        ScenarioError: the line cannot be opened; the text is one line with the remedy.

    """

    def __init__(
        self, config: Scenario, clock: Callable[[], float] = time.monotonic, *, keep: bool = True
    ) -> None:
        hil = config.hil
        self.side = "nav" if hil.nav else "proc"
        self.url = hil.url
        self.outages = LineOutages()
        self.scheduler: LineScheduler | None = None
        self._hil = hil
        self._clock = clock
        transport = open_line(self.side, self.url, clock, self.outages)
        self.line = FrameLine(transport, clock)
        self.line.watch_incoming = self._incoming
        self.line.watch_outgoing = self._outgoing
        self.where = transport.description
        self.board_clock = BoardClock()
        self.round_trip = DurationHistogram()
        self.acknowledged = DurationHistogram()
        self._pings: dict[int, float] = {}
        self._watched = Decoder()
        """Of what comes, for what it says of frames that are not ours."""
        self._token = 0
        self._pings_sent = 0
        self._session = -1
        self._unacknowledged: deque[tuple[int, float]] = deque()
        self._robot: Robot | None = None
        self._told = Told(gps_config(config), keep=keep)
        self._up_s = math.inf
        """When the link first was up: what the board made before lay in its queue, or is lost."""

    def watch(self, robot: Robot, trace: Trace) -> None:
        """Begin to measure, with the robot that the bench has wired to the line."""
        self._robot = robot
        scheduler = self.scheduler
        assert scheduler is not None
        scheduler.after(from_seconds(self._hil.ping_period_s), self._ping, Priority.OBSERVER)
        if robot.bridge is not None:
            scheduler.served = robot.bridge.resume
            return
        trace.channel("proc.samples").sink(self._told.take_messages)
        trace.channel("proc.tail_beat").sink(self._told.take_beats)

    def _ping(self) -> None:
        """Have the emulated board ask, as its firmware would."""
        assert self.scheduler is not None
        ask = self._asker()
        if ask is not None:
            self._token = (self._token + 1) & 0xFFFF
            with suppress(LinkFull):  # it would measure the queue
                ask(self._token)
                self._pings_sent += 1
        if self._pings_sent >= _UNANSWERED and not self.round_trip:
            return
        period_fs = from_seconds(self._hil.ping_period_s)
        self.scheduler.after(period_fs, self._ping, Priority.OBSERVER)

    def _asker(self) -> Callable[[int], None] | None:
        """What puts a question with a token into the emulated board's queue; None: no link."""
        assert self._robot is not None
        if self.side == "nav":
            services = self._robot.proc.services
            if services is None or services.link is None or not services.link.link.connected:
                return None
            controller = services.link
            return lambda token: controller.send(Ping(token))
        firmware = self._robot.nav.firmware
        if firmware is None or firmware.link is None or not firmware.link.link.connected:
            return None
        return firmware.link.ask_clock

    # --- what passes -----------------------------------------------------------------------

    def _outgoing(self, encoded: bytes) -> None:
        frame = _parse(encoded)
        if frame is None or frame.frame_type == FrameType.HELLO:
            return
        now_s = self._clock()
        if self._up_s == math.inf and self.scheduler is not None:
            self._up_s = self.scheduler.emulated_s(now_s)
        if frame.frame_type != FrameType.DATA:
            return
        if frame.session != self._session:
            self._session = frame.session
            self._unacknowledged.clear()
        waiting = self._unacknowledged
        if not waiting or 0 < (frame.sequence - waiting[-1][0]) % 256 < _HALF:
            waiting.append((frame.sequence, now_s))
        message = _message(frame)
        if isinstance(message, Ping | ClockRequest):
            self._pings.setdefault(message.token, now_s)
            if len(self._pings) > _MOST_PINGS:
                del self._pings[next(iter(self._pings))]

    def _incoming(self, encoded: bytes) -> None:
        frame = _parse(encoded, self._watched)
        if frame is None:
            return
        now_s = self._clock()
        waiting = self._unacknowledged
        if frame.frame_type != FrameType.HELLO:
            while waiting and 0 < (frame.acknowledge - waiting[0][0]) % 256 < _HALF:
                self.acknowledged.record(now_s - waiting.popleft()[1])
        if frame.frame_type != FrameType.DATA:
            return
        message = _message(frame)
        if isinstance(message, Pong | ClockReport) and message.token in self._pings:
            self.round_trip.record(now_s - self._pings.pop(message.token))
        if isinstance(message, SensorReport | ClockReport) and self.scheduler is not None:
            self.board_clock.note(message.time_us / 1e6, self.scheduler.emulated_s(now_s))

    # --- what is known at the end ----------------------------------------------------------

    @property
    def connected(self) -> bool:
        """Whether the emulated board's link has ever been up with the real one."""
        return any(link.connected or link.statistics.messages_received for link in self._links())

    def diagnosis(self) -> str:
        """Why the link did not come up, or carries nothing, in a line; empty where it does."""
        if self.connected:
            return self._repeats()
        line = self.line
        if not line.bytes_in:
            return f"{self.where}: nothing came: is the other side running, and the cable in?"
        if self._watched.foreign_version is not None:
            return (
                f"{self.where}: the other side speaks version {self._watched.foreign_version} of "
                f"the link, this is {VERSION}: install the same version on both sides"
            )
        if any(link.error_counts[ErrorKind.ECHO] for link in self._links()):
            return f"{self.where}: our own frames come back: is TX wired to RX of the same side?"
        if not line.frames_in or not self._heard():
            return (
                f"{self.where}: {line.bytes_in} bytes came and no frame was intact: is the baud "
                "rate the same on both sides, and is this the link's port?"
            )
        return f"{self.where}: frames came and no greeting was answered: does the other side hear?"

    def _repeats(self) -> str:
        """Say so where all that comes is taken for repetitions of an earlier start."""
        counts = [link.statistics for link in self._links()]
        repeated = sum(c.duplicates for c in counts)
        if any(c.messages_received for c in counts) or repeated < LEAST_REPEATED:
            return ""
        return (
            f"{self.where}: {repeated} messages came and all count as repetitions: was the other "
            "board started again with the same boot number? It has to change at every start"
        )

    def _heard(self) -> bool:
        return any(link.statistics.frames_received for link in self._links())

    def events(self) -> list[Event]:
        """Begin and end of each outage of the line."""
        assert self.scheduler is not None
        return self.outages.events(self.scheduler, "line")

    def channels(self) -> dict[str, Series]:
        """What the real navigation board reported, and what it was told, as channels."""
        return self._told.channels(self._trusted(self.board_clock.fit()))

    def summary(self) -> dict[str, Any]:
        """What is known of it, for `hil` of a `summary.json`."""
        line = self.line
        fit = self.board_clock.fit(self._up_s)
        return {
            "real": NAMES[self.side],
            "url": self.url,
            "line": self.where,
            "connected": self.connected,
            "diagnosis": self.diagnosis(),
            "round_trip": {
                **self.round_trip.summary(),
                "pings_sent": self._pings_sent,
                "above": above(self.round_trip),
            },
            "acknowledged": {**self.acknowledged.summary(), "above": above(self.acknowledged)},
            "clock": _clock_summary(fit, self.board_clock.resets),
            "reports": self._told.reports(self._trusted(fit), self._up_s),
            "commands": self._told.commands(),
            "link": self._link_summary(),
            "frames": {
                "received": line.frames_in,
                "sent": line.frames_out,
                "dropped": line.frames_dropped,
                "noise_bytes": line.noise_bytes,
            },
            "outages": {**self.outages.summary(), "resumptions": line.resumptions},
        }

    def _trusted(self, fit: ClockFit | None) -> ClockFit | None:
        """None where the board was reset: what came before has another clock."""
        return None if self.board_clock.resets else fit

    def _links(self) -> list[Link]:
        """The emulated board's link of every boot."""
        assert self._robot is not None
        return self._robot.proc.links if self.side == "nav" else self._robot.nav.links

    def _link_summary(self) -> dict[str, int]:
        """Messages of the emulated board's link, over all boots."""
        counts = [link.statistics for link in self._links()]
        return {
            "sent": sum(c.messages_sent for c in counts),
            "acknowledged": sum(c.messages_acknowledged for c in counts),
            "received": sum(c.messages_received for c in counts),
            "lost": sum(c.lost for c in counts),
            "retransmissions": sum(c.retransmissions for c in counts),
            "duplicates": sum(c.duplicates for c in counts),
            "damaged": sum(c.crc_errors + c.framing_errors for c in counts),
            "peer_resets": sum(c.peer_resets for c in counts),
        }

    def close(self) -> None:
        """Give the line back."""
        self.line.close()


def _parse(encoded: bytes, decoder: Decoder | None = None) -> Frame | None:
    bodies = (decoder or Decoder()).receive(encoded)
    with suppress(SpiBusError):
        return Frame.parse(bodies[0]) if bodies else None
    return None


def _message(frame: Frame) -> object | None:
    with suppress(SpiBusError):
        return LINK_MESSAGES.decode(frame.payload)
    return None


def _clock_summary(fit: ClockFit | None, resets: int) -> dict[str, Any] | None:
    return None if fit is None else {**asdict(fit), "resets": resets}
