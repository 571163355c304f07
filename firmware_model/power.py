"""Energy by consumer and power state: time is counted, energy is booked when it is looked at.

A consumer draws a constant current in each of its states. The account is exact for that model:
times are integers, and they become joules when a current or the voltage changes. Supplies are
signals, so cutting one reaches every chip that watches it, in wiring order.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_S

OFF = "off"
"""The state that every consumer has: no current."""


class _Line:
    """The account of one state: a current, and the time not yet booked as energy at it."""

    __slots__ = ("amps", "booked_fs", "fs", "joules")

    def __init__(self, amps: float) -> None:
        self.amps = amps
        self.fs = 0
        self.booked_fs = 0
        self.joules = 0.0

    def book(self, volts: float) -> None:
        """Turn the time into energy: current or voltage are about to change, or somebody looks."""
        self.joules += self.fs / FS_PER_S * self.amps * volts
        self.booked_fs += self.fs
        self.fs = 0


class Consumer:
    """One load on a rail: states with currents in amperes, seconds and joules spent in each.

    Changing state only adds an integer time to the account of the state that is left: that is all
    that happens thousands of times a second.
    """

    __slots__ = (
        "_charge",
        "_line",
        "_lines",
        "_rail",
        "_scheduler",
        "_since_fs",
        "amps",
        "name",
        "state",
    )

    def __init__(self, name: str, rail: Rail, currents: Mapping[str, float]) -> None:
        self.name = name
        self.state = OFF
        self.amps = 0.0
        self._rail = rail
        self._scheduler = rail.scheduler
        self._since_fs = rail.scheduler.now
        self._lines = {state: _Line(amps) for state, amps in {OFF: 0.0, **currents}.items()}
        self._line = self._lines[OFF]
        self._charge = 0.0  # drawn before `_since_fs`, A·fs

    def enter(self, state: str) -> None:
        """Change to a state of the table."""
        if state != self.state:
            following = self._lines[state]
            now = self._scheduler.now
            span = now - self._since_fs
            self._line.fs += span
            self._charge += span * self.amps
            self._since_fs = now
            self._line = following
            self.state = state
            self.amps = following.amps

    def draw(self, state: str, amps: float) -> None:
        """Change to a state with a current of its own, such as a transmitter's power level."""
        if state not in self._lines:
            self._lines[state] = _Line(amps)
        self.set_current(state, amps)
        self.enter(state)

    def set_current(self, state: str, amps: float) -> None:
        """Change the current of a state, from now on."""
        line = self._lines[state]
        if amps != line.amps:
            self.settle()
            line.amps = amps
            if line is self._line:
                self.amps = amps

    def settle(self) -> None:
        """Book what was drawn up to now at the present voltage."""
        now = self._scheduler.now
        span = now - self._since_fs
        self._line.fs += span
        self._charge += span * self.amps
        self._since_fs = now
        volts = self._rail.volts.value
        for line in self._lines.values():
            if line.fs:
                line.book(volts)

    def table(self) -> dict[str, tuple[float, float]]:
        """Return seconds and joules of each state that has been used, in the order of the table."""
        self.settle()
        return {
            state: (line.booked_fs / FS_PER_S, line.joules)
            for state, line in self._lines.items()
            if line.booked_fs
        }

    @property
    def coulombs(self) -> float:
        """Charge up to now."""
        return (self._charge + (self._scheduler.now - self._since_fs) * self.amps) / FS_PER_S

    @property
    def joules(self) -> float:
        """Energy up to now."""
        self.settle()
        return sum(line.joules for line in self._lines.values())


class Rail:
    """A supply rail: a voltage and its consumers."""

    __slots__ = ("consumers", "scheduler", "volts")

    def __init__(self, scheduler: Scheduler, name: str, volts: float) -> None:
        self.scheduler = scheduler
        self.volts: Signal[float] = Signal(name, volts)
        self.consumers: list[Consumer] = []

    def consumer(self, name: str, currents: Mapping[str, float]) -> Consumer:
        """Connect a load; it starts in the state "off"."""
        consumer = Consumer(name, self, currents)
        self.consumers.append(consumer)
        return consumer

    def set_volts(self, volts: float) -> None:
        """Change the voltage: book the past at the old one, then tell every listener."""
        for consumer in self.consumers:
            consumer.settle()
        self.volts.set(volts)

    @property
    def amps(self) -> float:
        """Present current of all consumers."""
        return sum(consumer.amps for consumer in self.consumers)

    @property
    def coulombs(self) -> float:
        """Charge that all consumers drew up to now; nothing is booked for it."""
        return sum(consumer.coulombs for consumer in self.consumers)

    @property
    def joules(self) -> float:
        """Energy of all consumers up to now."""
        return sum(consumer.joules for consumer in self.consumers)
