"""Reset causes, watchdog and oscillator: RCON, OSCCON.

The watchdog runs from the low-power RC oscillator: nominally 2 ms × prescaler A × prescaler B
(DS70046, section 10.5). It is a deadline and one event, which moves on if CLRWDT came in time. A
time-out while the CPU executes resets it; PWRSAV clears the count, and a time-out in Idle only
wakes the CPU and leaves WDTO for firmware to find.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntFlag

from firmware_model.cpu import Cpu
from firmware_model.dspic30f.errors import LimitError
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_MS


class ResetCause(IntFlag):
    """Bits of RCON that say why firmware starts (DS70046, register 8-1)."""

    TRAP = 1 << 15
    ILLEGAL = 1 << 14
    EXTERNAL = 1 << 7
    SOFTWARE = 1 << 6
    WATCHDOG = 1 << 4
    BROWN_OUT = 1 << 1
    POWER_ON = 1 << 0


SWDTEN = 1 << 5
IDLE = 1 << 2
WDT_BASE_FS = 2 * FS_PER_MS
PRESCALERS_A = (1, 8, 64, 512)

# DS70143, table 20-7 (system integration register map). OSCCON after a reset with the primary
# oscillator and PLL selected by FOSC: COSC = NOSC = 11, LOCK (bit 5).
SYSTEM_REGISTERS = (
    RegisterSpec("RCON", 0x0740, writable=0xDFFF),
    RegisterSpec("OSCCON", 0x0742, reset=0x3320, writable=0x33CB),
)


def watchdog_period_fs(prescaler_a: int, prescaler_b: int) -> int:
    """Return the nominal time-out of a setting of FWDT (WDTPSA × WDTPSB × 2 ms)."""
    if prescaler_a not in PRESCALERS_A or not 1 <= prescaler_b <= 16:
        raise LimitError(f"watchdog prescalers {prescaler_a} and {prescaler_b} do not exist")
    return WDT_BASE_FS * prescaler_a * prescaler_b


class Watchdog:
    """The watchdog timer behind SWDTEN (FWDTEN = 0 in the configuration)."""

    def __init__(
        self,
        scheduler: Scheduler,
        cpu: Cpu,
        period_fs: int,
        request_reset: Callable[[ResetCause], None],
    ) -> None:
        self.period_fs = period_fs
        self.bank = RegisterBank(SYSTEM_REGISTERS, on_write={"RCON": self._write_rcon})
        self._rcon = self.bank["RCON"]
        self._scheduler = scheduler
        self._cpu = cpu
        self._request_reset = request_reset
        self._cleared_fs = 0
        self._event: Event | None = None

    def clear(self) -> None:
        """CLRWDT: start counting anew."""
        self._cleared_fs = self._scheduler.now

    def stop(self) -> None:
        """Stop counting."""
        self._scheduler.cancel(self._event)
        self._event = None

    def reset(self, cause: ResetCause) -> None:
        """Stop, and note why: a power-on clears the other bits, the rest only adds its own."""
        self.stop()
        rcon = 0 if cause & ResetCause.POWER_ON else self._rcon.value & ~SWDTEN
        self.bank.reset()
        self._rcon.value = rcon | int(cause)

    def _write_rcon(self, value: int) -> None:
        self._rcon.value = value
        if value & SWDTEN and self._event is None:
            self.clear()
            self._event = self._scheduler.after(self.period_fs, self._expire)
        elif not value & SWDTEN:
            self._scheduler.cancel(self._event)
            self._event = None

    def _expire(self) -> None:
        now = self._scheduler.now
        cleared = max(self._cleared_fs, self._cpu.last_sleep_fs)
        if self._cpu.asleep:
            if cleared + self.period_fs <= now:
                self._rcon.value |= int(ResetCause.WATCHDOG) | IDLE
                self.clear()
                cleared = now
        elif cleared + self.period_fs <= now:
            self._event = None
            self._request_reset(ResetCause.WATCHDOG)
            return
        self._event = self._scheduler.at(cleared + self.period_fs, self._expire)
