"""A plant in the loop: the water, the body and the chips here, the navigation board real.

At a fixed rate the chips are looked at and the raw sample goes out; the pulses that come back move
the servo. Everything runs on the one scheduler in real time, so a sample is of the moment that its
stamp says, however late it was taken; one that is late by a whole period is left out, because the
next one is due. There is no processing board: that is whatever the real one is wired to.

The board speaks first (`BoardGreeting`). It is told the rate, and samples begin. What its driver
writes into the LSM303DLH is written into ours.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from firmware_model.signals import Signal
from firmware_model.time import FS_PER_S, FS_PER_US, from_seconds
from firmware_model.trace import Trace
from navboard.chips.hs5646wp import Hs5646wp
from plant.errors import DivergedError
from spi_bus.errors import TransportLost
from spi_bus.frame import ErrorKind
from spi_bus.link import LinkError, LinkUp, MessageReceived, PeerReset, Role, StreamReceived
from spi_bus.plant_messages import (
    PLANT_VERSION,
    BoardGreeting,
    BoardStatus,
    HostGreeting,
    NmeaCharacters,
    RegisterWrite,
    ServoPulse,
)
from tools.bench import model
from tools.bench.bench import PIECE, Bench
from tools.bench.outages import LineOutages, named_by, open_line
from tools.bench.pace import LineScheduler
from tools.bench.plant_figures import PlantFigures
from tools.bench.plant_line import PlantLine
from tools.bench.plant_rate import check_line, stale_after_s
from tools.bench.plant_records import PlantRecords, beat_frequency_hz
from tools.bench.plant_signals import RawSignals
from tools.bench.starts import start_number
from tools.bench.stepping import SLICE_FS
from tools.bench.swimmer import Swimmer
from tools.errors import ScenarioError
from tools.records.data import METRICS, Event, Metric, RunData
from tools.records.metrics import path_metrics
from tools.records.read import tank_view
from tools.version import version

if TYPE_CHECKING:
    from tools.configuration import Scenario


class PlantRig:
    """The host's side, ready to run.

    Args:
        config: the scenario; its `hil.plant_for` names the line.
        line: to the board.
        scheduler: real time, on that line.
        clock: monotonic, in seconds; theirs.
        outages: what happened to the line; where it was opened hears of it first.

    """

    def __init__(
        self,
        config: Scenario,
        line: PlantLine,
        scheduler: LineScheduler,
        *,
        clock: Callable[[], float] = time.monotonic,
        outages: LineOutages | None = None,
    ) -> None:
        self.config = config
        self.line = line
        self.scheduler = scheduler
        self.where = line.transport.description
        self.trace = trace = Trace()
        self.figures = PlantFigures()
        self.outages = outages or LineOutages()
        self.interrupted = False
        self.refusal = ""
        """Why this board and this run do not go together; empty where they do."""
        self.greeting: BoardGreeting | None = None
        self.swimmer = swimmer = Swimmer(config, scheduler, nav=False, proc=False)
        self.signals = RawSignals(config, scheduler, swimmer)
        self.signals.on_message = self._send
        self.servo = Hs5646wp(scheduler, Signal("servo", False), self._target)
        self.servo.listeners = (self._pulsed,)
        self._clock = clock
        self._events: list[Event] = []
        self._samples = trace.channel("rig.sample")
        self._targets = trace.channel("rig.servo")
        self._widths = trace.channel("rig.pulse")
        self._foreign = 0
        self._number = 0
        self._handed = 0  # number of the latest sample that the line was given
        self._rate = Fraction(config.hil.plant_rate_hz).limit_denominator(1000)
        self._period_s = float(1 / self._rate)
        line.on_incoming = self._incoming
        line.on_streamed = lambda clock_s: self.figures.streamed(self._handed, clock_s)
        scheduler.spare = lambda: trace.flush_some(PIECE)
        self.records = PlantRecords(config, scheduler, swimmer.vehicle, trace)
        swimmer.power.watchers.append(self._supply)
        swimmer.power.start(swimmer.vehicle)
        scheduler.at(self._due_fs(0), self._tick)

    @classmethod
    def from_scenario(
        cls,
        config: Scenario,
        *,
        speed: float | None = None,
        announce: Callable[[str], None] = lambda where: None,
    ) -> PlantRig:
        """Open the line and put the rig together; `announce` is told where the board is expected.

        Raises `ScenarioError` where the line cannot be opened or cannot carry the rate, or where
        the scenario's servo takes no pulses.
        """
        hil = config.hil
        if speed not in (None, 1.0):
            raise ScenarioError(f"hil: a real board cannot run {speed:g} times as fast")
        if config.plant.servo.ideal:
            raise ScenarioError(
                "plant.servo.ideal: a board sends pulses, and an ideal tail follows a formula: "
                "add --set plant.servo.ideal=false"
            )
        clock = time.monotonic
        outages = LineOutages()
        with named_by("plant_for"):
            check_line(hil.plant_for, hil.plant_rate_hz, gps=config.navboard.gps.fitted)
        transport = open_line("plant_for", hil.plant_for, clock, outages)
        try:
            announce(f"the other board is expected at {transport.description}")
            Bench.warm_up(config)
            line = PlantLine(transport, Role.MASTER, start_number(), clock)
            bound_s = hil.late_bound_s if hil.late == "stop" else None
            scheduler = LineScheduler(line, bound_s=bound_s, clock=clock)
            return cls(config, line, scheduler, clock=clock, outages=outages)
        except BaseException:
            transport.close()
            raise

    def close(self) -> None:
        """Give the line back."""
        self.line.close()

    # --- running -----------------------------------------------------------------------

    @property
    def stops(self) -> bool:
        """Whether the run ends before its time."""
        return self.scheduler.too_late or bool(self.refusal)

    def run(self, progress: Callable[[float], None], interrupted: Callable[[], bool]) -> None:
        """Run the scenario's duration, telling `progress` the seconds done and asking to go on.

        Raises `ScenarioError` where the motion diverges, or a line that cannot be opened again
        ends.
        """
        scheduler = self.scheduler
        end_fs = from_seconds(self.config.scenario.duration_s)
        try:
            while scheduler.now < end_fs:
                if interrupted() or self.stops:
                    self.interrupted = True
                    break
                scheduler.run(min(end_fs, scheduler.now + SLICE_FS))
                progress(scheduler.now / FS_PER_S)
            self.swimmer.vehicle.advance(scheduler.now)
        except DivergedError as error:
            raise ScenarioError(f"{self.config.scenario.name}: {error}") from error
        except TransportLost as error:
            raise ScenarioError(f"hil.plant_for: {error}") from error

    def _due_fs(self, number: int) -> int:
        """Return when a sample is due: origin + n · period, so that lateness does not add up."""
        return int(number * FS_PER_S / self._rate)

    def _tick(self) -> None:
        now = self.scheduler.now
        self._number += 1
        self.scheduler.at(self._due_fs(self._number), self._tick)
        if self.greeting is None or self.refusal:
            return
        late_s = self.scheduler.emulated_s(self._clock()) - now / FS_PER_S
        if late_s >= self._period_s:
            self.figures.skipped += 1
            return
        late = late_s > 0.5 * self._period_s
        sample = self.signals.sample(self._number & 0xFFFFFFFF, now, late=late)
        known = tuple(count for count in sample.counts if count is not None)
        self._samples.record(now, (sample.number, known, sample.accelerometer))
        self._handed = sample.number
        self.line.send_newest(sample)

    def _supply(self, on: bool) -> None:
        self.signals.power(on)
        self.servo.power(on)

    def _send(self, message: object) -> None:
        """Send what belongs to the GPS, where the board listens to one."""
        if self.greeting is None or not self.greeting.gps_fitted:
            return
        if isinstance(message, NmeaCharacters):
            self.figures.characters += message.count
        self.line.send(message)

    # --- what the board says -----------------------------------------------------------

    def _incoming(self) -> None:
        events = self.line.events
        while events:
            clock_s, event = events.popleft()
            match event:
                case StreamReceived(ServoPulse() as pulse):
                    self._pulse(pulse, clock_s)
                case MessageReceived(message):
                    self._message(message)
                case LinkUp() | PeerReset():
                    if isinstance(event, PeerReset):
                        self.figures.board_resets += 1
                    self.greeting = None
                    self.figures.restarted()
                case LinkError(ErrorKind.PAYLOAD):
                    self._foreign += 1

    def _message(self, message: object) -> None:
        if isinstance(message, BoardGreeting):
            self._greeted(message)
        elif isinstance(message, RegisterWrite):
            self.figures.registers_written += 1
            self.signals.write(message.address, message.sub_address, message.value)
        elif isinstance(message, BoardStatus):
            self.figures.status = message

    def _greeted(self, greeting: BoardGreeting) -> None:
        rate_hz = float(self._rate)
        if greeting.version != PLANT_VERSION:
            self.refusal = (
                f"{self.where}: the board speaks version {greeting.version} of the messages of a "
                f"plant in the loop, we {PLANT_VERSION}: build its firmware against our table"
            )
        elif greeting.most_rate_hz < rate_hz:
            self.refusal = (
                f"{self.where}: the board takes at most {greeting.most_rate_hz} samples a second, "
                f"not {rate_hz:g}: give --rate {greeting.most_rate_hz}"
            )
        if self.refusal:
            return
        self.greeting = greeting
        inputs = [f"AN{place}" for place in range(16) if greeting.analog_inputs >> place & 1]
        self._event(
            "navigation board",
            f"greets: converts {', '.join(inputs) or 'nothing'}, takes up to "
            f"{greeting.most_rate_hz} samples a second",
        )
        stale_us = round(1e6 * stale_after_s(rate_hz))
        self.line.send(HostGreeting(PLANT_VERSION, round(1e6 * self._period_s), stale_us))

    def _pulse(self, pulse: ServoPulse, clock_s: float) -> None:
        if self.figures.pulse(pulse, clock_s, self.scheduler.emulated_s(clock_s)):
            self.servo.pulse(from_seconds(pulse.width_s))

    def _pulsed(self, _rise_fs: int, width_fs: int) -> None:
        now = self.scheduler.now
        angle = (width_fs / FS_PER_S - 0.0015) * self.servo.specs.rad_per_s
        self._widths.record(now, width_fs // FS_PER_US)
        self.records.commands.append((now / FS_PER_S, angle))

    def _target(self, time_fs: int, angle_rad: float | None) -> None:
        self._targets.record(time_fs, angle_rad)
        self.records.targets.append((time_fs / FS_PER_S, angle_rad))
        self.swimmer.vehicle.set_servo_target(time_fs, angle_rad)
        if angle_rad is None:
            self._event("servo", "lets go: no pulse came any more", "warning")

    def _event(self, where: str, what: str, severity: str = "info") -> None:
        self._events.append(Event(self.scheduler.now / FS_PER_S, where, what, severity))

    # --- what is known at the end ------------------------------------------------------

    def diagnosis(self) -> str:
        """Why no samples went, in a line; empty where they did."""
        if self.refusal or self.greeting is not None or self.figures.sent:
            return self.refusal
        words = self.line.runner.diagnosis()
        if words is None:
            words = (
                f"{self.where}: the link is up and no BoardGreeting came: does that firmware know "
                "the messages of a plant in the loop, and is this the right port?"
            )
        return words

    def run_data(self) -> RunData:
        """Return all that the run knows about itself."""
        self.trace.flush()
        config, swimmer = self.config, self.swimmer
        now_s = self.scheduler.now / FS_PER_S
        truth = swimmer.truth(self.scheduler.now, self.records.tail_command)
        channels = {**self.signals.readings(now_s), **self.records.channels()}
        beat_hz = beat_frequency_hz(self.records.commands)
        metrics: dict[str, Metric] = dict.fromkeys(METRICS)
        metrics.update(path_metrics(truth, beat_hz))
        metrics["energy_j"] = swimmer.power.joules
        events = [
            *self._events,
            *self.outages.events(self.scheduler, "line"),
            *swimmer.power.events,
        ]
        late = self.scheduler.lateness_s
        return RunData(
            scenario=config.scenario.name,
            description=config.scenario.description,
            seed=config.scenario.seed,
            duration_s=now_s,
            wall_s=0.0,
            version=version(),
            trace_sha256=self.trace.sha256(),
            tank=tank_view(config),
            metrics=metrics,
            truth=truth,
            truth_every=model.truth_steps(config)[1],
            channels=channels,
            beat_frequency_hz=beat_hz,
            interrupted=self.interrupted,
            energy=swimmer.power.table(),
            comparison_note="a real board took part",
            events=tuple(sorted(events, key=lambda event: event.time_s)),
            outages=swimmer.power.outages,
            lateness={
                "maximum_s": late.maximum_s,
                "p99_s": late.quantile_s(0.99),
                "missed": float(self.scheduler.missed),
            },
            hil=self.summary(),
        )

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil`."""
        scheduler, link, hil = self.scheduler, self.line.link, self.config.hil
        counts = link.statistics
        return {
            "real": "navigation board, around it a plant",
            "url": hil.plant_for,
            "line": self.where,
            "connected": link.connected,
            "diagnosis": self.diagnosis(),
            "rate_hz": float(self._rate),
            "lateness": scheduler.lateness(hil.late, hil.late_bound_s),
            **self.figures.summary(counts.replaced, self.servo.ignored),
            "frames": {
                "received": counts.frames_received,
                "sent": counts.frames_sent,
                "damaged": counts.crc_errors + counts.framing_errors,
                "foreign": self._foreign,
                "retransmissions": counts.retransmissions,
                "dropped": self.line.dropped,
            },
            "outages": {
                **self.outages.summary(),
                "resumptions": self.line.runner.statistics.resumptions,
            },
        }
