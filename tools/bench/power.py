"""The robot's power: a pack, a linear regulator for each rail, the servo straight from the pack.

A linear regulator passes its load's current on, so the pack's current is the sum over all rails
plus the servo's; what the regulators turn into heat is the rest of the energy account. Battery
and servo are looked at ten times a second, which follows a tail beat of a few hertz; rails hold
their voltage in between. What a rail drew since the last look is what its consumers' own accounts
say, because a radio sends for a few milliseconds, which no look would see. A pack that is empty, or
sags below its protection, is off for good. Cutting the supply is one call, and every chip hears of
it from its rail.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.power import Rail
from firmware_model.scheduler import Priority, Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S
from plant.battery import Battery
from tools.records.data import EnergyState, Event

if TYPE_CHECKING:
    from plant.underwater import UnderwaterVehicle

NAV_V = 3.3
"""Supply of the navigation board (assumed; the dsPIC's ADC measures against it)."""
GPS_V = 5.0
"""The GPS 18x LVC wants 4.0 to 5.5 V."""
PROC_V = 3.0
"""Supply of the TelosB: two AA cells' worth, for which its data sheet gives currents."""

LOOK_FS = 100 * FS_PER_MS
SERVO_UPDATE_V = 0.01
"""Change of the pack's voltage that the servo is told of."""


class Power:
    """Battery and rails of one robot."""

    def __init__(
        self,
        scheduler: Scheduler,
        battery: Battery,
        *,
        nav: bool = True,
        proc: bool = True,
        on: bool = True,
    ) -> None:
        """Connect the boards that are emulated; a real one has its own supply."""
        nav_v, gps_v, proc_v = nav * NAV_V, nav * GPS_V, proc * PROC_V
        self.nav = Rail(scheduler, "nav 3.3 V", on * nav_v)
        self.gps = Rail(scheduler, "GPS 5 V", on * gps_v)
        self.proc = Rail(scheduler, "proc 3 V", on * proc_v)
        self.on = on
        self.events: list[Event] = []
        self.watchers: list[Callable[[bool], None]] = []
        """Called after the supply has come (True) or gone (False)."""
        self.volts = battery.terminal_v(0.0)
        self.history: list[tuple[int, float]] = [(0, self.battery_v(0))]
        """Pack voltage as (time in fs, volts) at every look."""
        self.keep_history = True
        self._scheduler = scheduler
        self._battery = battery
        self._rails = ((self.nav, nav_v), (self.gps, gps_v), (self.proc, proc_v))
        self._boards = ("navigation board", "navigation board", "processing board")
        self._off: list[tuple[int, int | None]] = [] if on else [(0, None)]
        self._vehicle: UnderwaterVehicle | None = None
        self._servo_a = 0.0
        self._servo_j = 0.0
        self._servo_fs = 0
        self._told_v = self.volts
        self._drawn_c = 0.0  # by the rails, up to the latest look

    def start(self, vehicle: UnderwaterVehicle) -> None:
        """Begin to look at the pack and the servo."""
        self._vehicle = vehicle
        self._scheduler.at(self._scheduler.now, self._look, Priority.OBSERVER)

    def battery_v(self, _time_fs: int) -> float:
        """Pack voltage as of the latest look, which is what the board's divider measures."""
        return self.volts if self.on else 0.0

    def cut(self) -> None:
        """Take the pack away."""
        self._switch(False)

    def restore(self) -> None:
        """Put the pack back."""
        self._switch(True)

    def _switch(self, on: bool) -> None:
        on = on and self.volts > 0.0
        if on == self.on:
            return
        self.on = on
        now = self._scheduler.now
        if on:
            self._off[-1] = (self._off[-1][0], now)
        else:
            self._off.append((now, None))
        for rail, volts in self._rails:
            rail.set_volts(volts if on else 0.0)
        if self._vehicle is not None and not self._vehicle.servo.ideal:
            self._vehicle.set_supply(now, self.volts if on else 0.0)
        for watcher in self.watchers:
            watcher(on)

    def _look(self) -> None:
        now = self._scheduler.now
        vehicle = self._vehicle
        assert vehicle is not None
        seconds = LOOK_FS / FS_PER_S if now else 0.0
        servo_a = 0.0
        if self.on and not vehicle.servo.ideal:
            servo_a = vehicle.servo_current(now)
            self._servo_fs += LOOK_FS if now else 0
        mean_a = 0.5 * (servo_a + self._servo_a)
        self._servo_a = servo_a
        self._servo_j += mean_a * self.volts * seconds
        current_a = mean_a + self._rails_a(seconds)
        self._battery.draw(current_a, seconds)
        self.volts = self._battery.terminal_v(current_a)
        if self.on and self.volts <= 0.0:
            self._switch(False)
            self.events.append(
                Event(now / FS_PER_S, "supply", "the pack's protection has cut it off", "fault")
            )
        if self.keep_history:
            self.history.append((now, self.volts if self.on else 0.0))
        if self.on and abs(self.volts - self._told_v) > SERVO_UPDATE_V:
            self._told_v = self.volts
            if not vehicle.servo.ideal:
                vehicle.set_supply(now, self.volts)
        self._scheduler.after(LOOK_FS, self._look, Priority.OBSERVER)

    def _rails_a(self, seconds: float) -> float:
        """Return the mean current of all rails since the last look; at the first the present."""
        drawn_c = sum(rail.coulombs for rail, _ in self._rails)
        since_c, self._drawn_c = drawn_c - self._drawn_c, drawn_c
        return since_c / seconds if seconds else sum(rail.amps for rail, _ in self._rails)

    @property
    def joules(self) -> float:
        """Energy that the pack gave so far."""
        return self._battery.energy_j

    @property
    def outages(self) -> tuple[tuple[float, float], ...]:
        """Times without supply, in seconds; one that lasts ends now."""
        now = self._scheduler.now
        return tuple(
            (begin / FS_PER_S, (now if end is None else end) / FS_PER_S) for begin, end in self._off
        )

    def table(self) -> tuple[EnergyState, ...]:
        """Return every consumer's states, and what the regulators lost."""
        rows = [
            EnergyState(consumer.name, state, seconds, joules, board)
            for board, (rail, _) in zip(self._boards, self._rails, strict=True)
            for consumer in rail.consumers
            for state, (seconds, joules) in consumer.table().items()
            if state != "off"
        ]
        if self._servo_j:
            seconds = self._servo_fs / FS_PER_S
            rows.append(EnergyState("HS-5646WP", "on", seconds, self._servo_j, "tail"))
        rest = self._battery.energy_j - sum(row.joules for row in rows)
        rows.append(
            EnergyState("regulators", "loss", self._scheduler.now / FS_PER_S, rest, "power supply")
        )
        return tuple(rows)
