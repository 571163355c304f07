"""The board's end of a plant in the loop, for an emulated navigation board without its chips.

On a real board this is firmware: drivers read the newest sample instead of converters and buses,
and tell of what they would have written. Here the firmware stays as it is and the chips around it
are replaced (`navboard.chips.remote`), filled by what arrives; so it shows what a real board has to
do, and runs where there is none.

Characters and pulses of the GPS come ahead of their time, in the host's clock. A sample's stamp
against its arrival gives that clock: of the last samples the one that was quickest under way.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from math import floor
from typing import TYPE_CHECKING, Any, Final

from firmware_model.time import FS_PER_S, FS_PER_US
from navboard.chips.remote import RemoteChips
from spi_bus.link import LinkUp, MessageReceived, PeerReset, Role, StreamReceived
from spi_bus.plant_messages import (
    PLANT_VERSION,
    BoardGreeting,
    BoardStatus,
    GpsPulse,
    HostGreeting,
    NmeaCharacters,
    RegisterWrite,
    SampleStatus,
    SensorSample,
    ServoPulse,
)
from spi_bus.transports.capacity import line_speed
from tools.bench.outages import LineOutages, named_by, open_line
from tools.bench.pace import LineScheduler
from tools.bench.plant_line import PlantLine
from tools.bench.plant_rate import check_line, most_rate_hz
from tools.bench.starts import start_number
from tools.records.data import Event as Happening

if TYPE_CHECKING:
    from firmware_model.scheduler import Event, Scheduler
    from navboard.board import NavBoard
    from tools.configuration import Scenario

LEAST_RATE_HZ: Final = 10
MOST_RATE_HZ: Final = 1000
"""What `hil.plant_rate_hz` may be."""
QUICKEST_OF: Final = 128
"""Samples from which the host's clock is taken: 1.3 s at 100 Hz, in which clocks that differ by
50 ppm part by 65 µs."""
STATUS_FS: Final = FS_PER_S
TOO_LATE_FS: Final = FS_PER_S
"""Characters that are later than this are dropped: the next second's are there."""
LONGEST_PULSE_FS: Final = 6500 * FS_PER_US
"""Longer ones do not fit the message, and are none of a servo's."""


class PlantPort:
    """The line, and the chips that it fills.

    Args:
        config: the scenario; its `hil.plant` names the line.
        line: open, to the plant.
        outages: what happened to it; where it was opened hears of it first.

    """

    def __init__(
        self, config: Scenario, line: PlantLine, outages: LineOutages | None = None
    ) -> None:
        speed = line_speed(config.hil.plant)
        self._gps = config.navboard.gps.fitted
        self._most_rate_hz = MOST_RATE_HZ
        if speed is not None:
            self._most_rate_hz = min(MOST_RATE_HZ, floor(most_rate_hz(speed, gps=self._gps)))
        self.line = line
        self.line.on_incoming = self._incoming
        self.outages = outages or LineOutages()
        self.where = line.transport.description
        self.samples = 0
        self.missing = 0
        self.repeated = 0
        self.stalls = 0
        self.pulses = 0
        self.characters = 0
        self.characters_late = 0
        self.host: HostGreeting | None = None
        self._rate = 1.0 + 1e-6 * config.navboard.clock_drift_ppm
        self._analog_inputs = 0
        self._registers: dict[tuple[int, int], int] = {}
        self._number = 0
        self._arrived_s = 0.0  # by this machine's clock
        self._arrived_fs = 0
        self._stale_event: Event | None = None
        self._quickest: deque[int] = deque(maxlen=QUICKEST_OF)
        self._uart_free_fs = 0
        self._scheduler: Scheduler
        self.chips: RemoteChips

    @classmethod
    def from_scenario(
        cls, config: Scenario, clock: Callable[[], float] = time.monotonic
    ) -> PlantPort:
        """Open the line that a scenario names.

        Raises `ScenarioError` where that cannot be; its text is one line with the remedy.
        """
        outages = LineOutages()
        with named_by("plant"):
            check_line(config.hil.plant, LEAST_RATE_HZ, gps=config.navboard.gps.fitted)
        transport = open_line("plant", config.hil.plant, clock, outages)
        line = PlantLine(transport, Role.SLAVE, start_number(), clock)
        return cls(config, line, outages)

    def start(self, scheduler: Scheduler) -> RemoteChips:
        """Return the chips for a board that runs on `scheduler`."""
        self._scheduler = scheduler
        self.chips = chips = RemoteChips(scheduler)
        chips.on_write = self._written
        chips.on_pulse = self._pulse
        scheduler.after(STATUS_FS, self._tell_status)
        return chips

    def fit(self, board: NavBoard) -> None:
        """Take notice of what the board converts, for the greeting."""
        self._analog_inputs = board.analog_inputs

    def close(self) -> None:
        """Give the line back."""
        self.line.close()

    # --- what comes --------------------------------------------------------------------

    def _incoming(self) -> None:
        events = self.line.events
        while events:
            clock_s, event = events.popleft()
            match event:
                case StreamReceived(SensorSample() as sample):
                    self._sample(sample, clock_s)
                case MessageReceived(message):
                    self._message(message)
                case LinkUp() | PeerReset():
                    self._greet()

    def _greet(self) -> None:
        self.host = None
        self._number = 0
        self._quickest.clear()
        self.line.send(
            BoardGreeting(PLANT_VERSION, self._most_rate_hz, self._analog_inputs, self._gps)
        )
        for (address, register), value in self._registers.items():
            self.line.send(RegisterWrite(address, register, value))

    def _sample(self, sample: SensorSample, clock_s: float) -> None:
        ahead = (sample.number - self._number) & 0xFFFFFFFF
        if self._number and not 0 < ahead < 0x80000000:
            self.repeated += 1
            return
        if self._number:
            self.missing += ahead - 1
        self._number = sample.number
        self.samples += 1
        self._arrived_s = clock_s
        self._arrived_fs = now = self._scheduler.now
        self._quickest.append(now - sample.host_time_us * FS_PER_US)
        self._watch_for_stalls()
        chips = self.chips
        for channel, count in enumerate(sample.counts):
            if count is not None:
                chips.counts[channel] = count
        chips.accelerometer.fill(sample.accelerometer)
        chips.magnetometer.fill(sample.magnetometer)
        self._answer(bool(sample.status & SampleStatus.SUPPLY_ON))

    def _answer(self, on: bool) -> None:
        """Have the chips on the I²C bus answer or not; their registers stay."""
        self.chips.accelerometer.powered = self.chips.magnetometer.powered = on

    def _watch_for_stalls(self) -> None:
        if self._stale_event is None and self.host is not None:
            due = self._arrived_fs + self.host.stale_after_us * FS_PER_US
            self._stale_event = self._scheduler.at(due, self._look_for_stall)

    def _look_for_stall(self) -> None:
        """Look whether samples still come: one event for many samples."""
        self._stale_event = None
        if self.host is None:
            return
        if self._scheduler.now - self._arrived_fs < self.host.stale_after_us * FS_PER_US:
            self._watch_for_stalls()
        else:
            self.stalls += 1
            self._answer(False)

    def _message(self, message: object) -> None:
        if isinstance(message, HostGreeting):
            self.host = message
        elif isinstance(message, NmeaCharacters):
            self._characters(message)
        elif isinstance(message, GpsPulse):
            self._gps_pulse(message)

    def _at(self, host_us: int) -> int | None:
        """Return when a time of the host's clock is; None before the first sample."""
        return host_us * FS_PER_US + min(self._quickest) if self._quickest else None

    def _characters(self, message: NmeaCharacters) -> None:
        scheduler, due_fs = self._scheduler, self._at(message.due_us)
        character_fs = 10 * FS_PER_S // message.baud
        for place, character in enumerate(message.text):
            if due_fs is None or scheduler.now - due_fs > TOO_LATE_FS:
                self.characters_late += 1
                continue
            wanted_fs = due_fs + place * character_fs
            at_fs = max(wanted_fs, self._uart_free_fs, scheduler.now)
            self.characters += 1
            self.characters_late += at_fs > wanted_fs + character_fs
            self._uart_free_fs = at_fs + character_fs
            scheduler.at(at_fs, partial(self.chips.gps.character, character))

    def _gps_pulse(self, message: GpsPulse) -> None:
        rise_fs, gps = self._at(message.rise_us), self.chips.gps
        if rise_fs is None or rise_fs < self._scheduler.now:
            return
        self._scheduler.at(rise_fs, lambda: gps.pulse(True))
        self._scheduler.at(rise_fs + message.width_us * FS_PER_US, lambda: gps.pulse(False))

    # --- what goes ---------------------------------------------------------------------

    def _board_us(self) -> int:
        return int(self._scheduler.now * self._rate) // FS_PER_US

    def _pulse(self, _rise_fs: int, width_fs: int) -> None:
        if width_fs > LONGEST_PULSE_FS:
            return
        self.pulses += 1
        # by this machine's clock: while a late board catches up, its own time runs faster
        age_us = int(1e6 * (self.line.clock() - self._arrived_s)) if self._number else 0
        self.line.send_newest(
            ServoPulse(
                self.pulses & 0xFFFFFFFF,
                self._board_us(),
                width_fs / FS_PER_S,
                self._number,
                min(age_us, 0xFFFFFFFF),
            )
        )

    def _written(self, address: int, register: int, value: int) -> None:
        self._registers[address, register] = value
        if self.line.link.connected:
            self.line.send(RegisterWrite(address, register, value))

    def _tell_status(self) -> None:
        self._scheduler.after(STATUS_FS, self._tell_status)
        if self.line.link.connected:
            self.line.send(self.status())

    def status(self) -> BoardStatus:
        """Return the counts so far."""
        return BoardStatus(
            self._board_us(),
            self.samples,
            self.missing,
            self.repeated,
            min(self.stalls, 0xFFFF),
            self.pulses,
            self.characters,
            self.characters_late,
        )

    # --- what is known at the end ------------------------------------------------------

    def diagnosis(self) -> str:
        """Why no samples came, in a line; empty where they did."""
        if self.samples:
            return ""
        words = self.line.runner.diagnosis()
        if words is None:
            words = f"{self.where}: the link is up and no sample came: is that a plant's line?"
            if self.host is not None and self.host.version != PLANT_VERSION:
                words = (
                    f"{self.where}: the plant speaks version {self.host.version} of its messages, "
                    f"we {PLANT_VERSION}: install the same version on both sides"
                )
        return words

    def events(self) -> list[Happening]:
        """Begin and end of each outage of the plant's line."""
        assert isinstance(self._scheduler, LineScheduler)  # real time, or there is no outage
        return self.outages.events(self._scheduler, "plant's line")

    def summary(self) -> dict[str, Any]:
        """Everything, for a document."""
        return {
            "line": self.where,
            "connected": self.line.link.connected,
            "diagnosis": self.diagnosis(),
            "samples": {
                "received": self.samples,
                "missing": self.missing,
                "repeated": self.repeated,
                "stalls": self.stalls,
            },
            "pulses": {"sent": self.pulses, "replaced": self.line.link.statistics.replaced},
            "nmea": {"characters": self.characters, "late": self.characters_late},
            "registers": len(self._registers),
            "outages": {
                **self.outages.summary(),
                "resumptions": self.line.runner.statistics.resumptions,
            },
        }
