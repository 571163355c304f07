"""Energy by consumer and power state: charge is booked when a state or the voltage changes.

A consumer draws a constant current in each of its states. The account is exact for that model and
costs nothing while nothing changes. Supplies are signals, so cutting one reaches every chip that
watches it, in wiring order.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_S

OFF = "off"
"""The state that every consumer has: no current."""


class Consumer:
    """One load on a rail: states with currents in amperes, seconds and joules spent in each."""

    __slots__ = (
        "_joules",
        "_rail",
        "_seconds_fs",
        "_since_fs",
        "amps",
        "currents",
        "name",
        "state",
    )

    def __init__(self, name: str, rail: Rail, currents: Mapping[str, float]) -> None:
        self.name = name
        self.currents = {OFF: 0.0, **currents}
        self.state = OFF
        self.amps = 0.0
        self._rail = rail
        self._since_fs = rail.scheduler.now
        self._seconds_fs: dict[str, int] = {}
        self._joules: dict[str, float] = {}

    def enter(self, state: str) -> None:
        """Change to a state of the table."""
        old = self.state
        if state == old:
            return
        # `settle` and `draw` in one: a CPU comes here twice an interrupt.
        rail = self._rail
        now = rail.scheduler.now
        elapsed = now - self._since_fs
        amps = self.amps
        if elapsed:
            self._seconds_fs[old] = self._seconds_fs.get(old, 0) + elapsed
            joules = elapsed / FS_PER_S * amps * rail.volts.value
            self._joules[old] = self._joules.get(old, 0.0) + joules
            self._since_fs = now
        self.state = state
        self.amps = new_amps = self.currents[state]
        rail.amps += new_amps - amps

    def draw(self, state: str, amps: float) -> None:
        """Change to a state with a current of its own, such as a transmitter's power level."""
        rail = self._rail
        self.settle()
        rail.amps += amps - self.amps
        self.state = state
        self.amps = amps

    def settle(self) -> None:
        """Book what was drawn since the last change."""
        now = self._rail.scheduler.now
        elapsed = now - self._since_fs
        if elapsed:
            state = self.state
            self._seconds_fs[state] = self._seconds_fs.get(state, 0) + elapsed
            joules = elapsed / FS_PER_S * self.amps * self._rail.volts.value
            self._joules[state] = self._joules.get(state, 0.0) + joules
            self._since_fs = now

    def table(self) -> dict[str, tuple[float, float]]:
        """Return seconds and joules by state, up to now, in order of first use."""
        self.settle()
        return {
            state: (fs / FS_PER_S, self._joules[state]) for state, fs in self._seconds_fs.items()
        }

    @property
    def joules(self) -> float:
        """Energy up to now."""
        self.settle()
        return sum(self._joules.values())


class Rail:
    """A supply rail: a voltage and its consumers."""

    __slots__ = ("amps", "consumers", "scheduler", "volts")

    def __init__(self, scheduler: Scheduler, name: str, volts: float) -> None:
        self.scheduler = scheduler
        self.volts: Signal[float] = Signal(name, volts)
        self.consumers: list[Consumer] = []
        self.amps = 0.0

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
    def joules(self) -> float:
        """Energy of all consumers up to now."""
        return sum(consumer.joules for consumer in self.consumers)
