"""Watchdog timer WDT of the MSP430x1xx (SLAU049, chapter 10): after reset it is armed.

WDTCTL takes words with the password 0x5A in the high byte and reads 0x69 there; a wrong password
is a PUC. Expiry is a PUC in watchdog mode and WDTIFG in interval mode. The counter is computed, not
counted: clearing it in time moves the deadline, and the one event looks whether it really is due.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.msp430.clocks import FOREVER_FS, GatedClock
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event

if TYPE_CHECKING:
    from firmware_model.msp430.sfr import SfrFlag
    from firmware_model.scheduler import Scheduler

WDTPW = 0x5A00
WDTHOLD, WDTNMIES, WDTNMI, WDTTMSEL = 0x80, 0x40, 0x20, 0x10
WDTCNTCL, WDTSSEL = 0x08, 0x04
_READ_PASSWORD = 0x6900
_INTERVALS = (32_768, 8_192, 512, 64)  # WDTISx, in ticks of the clock

REGISTERS = (RegisterSpec("WDTCTL", 0x0120),)


class Watchdog:
    """WDTCTL and its counter. `on_reset(cause)` asks the MCU for a PUC."""

    def __init__(
        self,
        scheduler: Scheduler,
        aclk: GatedClock,
        smclk: GatedClock,
        flag: SfrFlag,
        on_reset: Callable[[str], None],
    ) -> None:
        self._scheduler = scheduler
        self._aclk, self._smclk = aclk, smclk
        self._clock = smclk
        self._flag = flag
        self._on_reset = on_reset
        flag.line.on_accept = flag.clear
        self.bank = RegisterBank(
            REGISTERS, on_read={"WDTCTL": self._read}, on_write={"WDTCTL": self._write}
        )
        self._ctl = self.bank["WDTCTL"]
        self._running = False
        self._start_tick = 0
        self._counted = 0  # while held
        self._event: Event | None = None
        for clock in (aclk, smclk):
            clock.watch(self._arm)

    def reset(self, por: bool) -> None:
        """After a PUC the watchdog runs: SMCLK / 32768, about 44 ms at 750 kHz."""
        self._ctl.value = 0
        self._restart(self._smclk, running=True)

    def power_off(self) -> None:
        """Stop without a trace."""
        self._restart(self._smclk, running=False)

    def _read(self) -> int:
        return _READ_PASSWORD | self._ctl.value & 0xFF & ~WDTCNTCL

    def _write(self, value: int) -> None:
        if value & 0xFF00 != WDTPW:
            self._flag.set()
            self._on_reset("watchdog password")
            return
        before = self._ctl.value
        self._ctl.value = value & 0xFF
        clock = self._aclk if value & WDTSSEL else self._smclk
        running = not value & WDTHOLD
        if value & WDTCNTCL or clock is not self._clock:
            self._restart(clock, running)
        elif running != self._running or (before ^ value) & 3:
            counted = self._count()
            self._restart(clock, running)
            self._counted = counted
            self._start_tick -= counted
            self._arm()

    def _count(self) -> int:
        if not self._running:
            return self._counted
        return self._clock.ticks(self._scheduler.now) - self._start_tick

    def _restart(self, clock: GatedClock, running: bool) -> None:
        """Count from zero."""
        if self._running:
            self._clock.users -= 1
        if running:
            clock.users += 1
        self._clock, self._running = clock, running
        self._counted = 0
        self._start_tick = clock.ticks(self._scheduler.now)
        if self._event is None or not running or self._due() < self._event[0]:
            self._arm()

    def _due(self) -> int:
        return self._clock.edge(self._start_tick + _INTERVALS[self._ctl.value & 3])

    def _arm(self) -> None:
        self._scheduler.cancel(self._event)
        self._event = None
        if self._running:
            due = max(self._due(), self._scheduler.now)
            if due < FOREVER_FS:
                self._event = self._scheduler.at(due, self._expired)

    def _expired(self) -> None:
        self._event = None
        due = self._due()
        if due > self._scheduler.now:  # cleared meanwhile
            self._arm()
            return
        self._start_tick += _INTERVALS[self._ctl.value & 3]
        self._flag.set()
        if self._ctl.value & WDTTMSEL:
            self._arm()
        else:
            self._on_reset("watchdog")
