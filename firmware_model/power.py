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


class _Account:
    """Time and energy in one state."""

    __slots__ = ("fs", "joules")

    def __init__(self) -> None:
        self.fs = 0
        self.joules = 0.0


class Consumer:
    """One load on a rail: states with currents in amperes, seconds and joules spent in each."""

    __slots__ = (
        "_account",
        "_accounts",
        "_rail",
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
        self._accounts: dict[str, _Account] = {}
        self._account = self._open(OFF)

    def _open(self, state: str) -> _Account:
        account = self._accounts.get(state)
        if account is None:
            account = self._accounts[state] = _Account()
        return account

    def enter(self, state: str) -> None:
        """Change to a state of the table."""
        if state != self.state:
            self.draw(state, self.currents[state])

    def draw(self, state: str, amps: float) -> None:
        """Change to a state with a current of its own, such as a transmitter's power level."""
        # `settle` is written out: a CPU comes here twice an interrupt.
        rail = self._rail
        now = rail.scheduler.now
        elapsed = now - self._since_fs
        if elapsed:
            account = self._account
            account.fs += elapsed
            account.joules += elapsed / FS_PER_S * self.amps * rail.volts.value
            self._since_fs = now
        rail.amps += amps - self.amps
        self.amps = amps
        self.state = state
        self._account = self._accounts.get(state) or self._open(state)

    def settle(self) -> None:
        """Book what was drawn since the last change."""
        now = self._rail.scheduler.now
        elapsed = now - self._since_fs
        if elapsed:
            account = self._account
            account.fs += elapsed
            account.joules += elapsed / FS_PER_S * self.amps * self._rail.volts.value
            self._since_fs = now

    def table(self) -> dict[str, tuple[float, float]]:
        """Return seconds and joules by state, up to now, in order of first use."""
        self.settle()
        return {
            state: (account.fs / FS_PER_S, account.joules)
            for state, account in self._accounts.items()
            if account.fs
        }

    @property
    def joules(self) -> float:
        """Energy up to now."""
        self.settle()
        return sum(account.joules for account in self._accounts.values())


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
