"""Timer1–5: counters that are computed when read, and one event a period.

A count is (cycles since a base) // prescaler, so nothing happens between period matches. An even
timer with T32 set counts in 32 bits with its odd partner: reading the low word latches the high one
in TMRxHLD, which is how firmware gets a consistent time stamp (DS70046, section 12).
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.dspic30f.errors import UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import Clock

TON = 1 << 15
T32 = 1 << 3
TCS = 1 << 1
TGATE = 1 << 6
PRESCALERS = (1, 8, 64, 256)  # TCKPS<1:0>, TxCON<5:4>

# DS70143, tables 9-1 to 11-1 (timer register maps).
TIMER_REGISTERS = {
    1: (
        RegisterSpec("TMR1", 0x0100),
        RegisterSpec("PR1", 0x0102, reset=0xFFFF),
        RegisterSpec("T1CON", 0x0104, writable=0xA076),
    ),
    2: (
        RegisterSpec("TMR2", 0x0106),
        RegisterSpec("PR2", 0x010C, reset=0xFFFF),
        RegisterSpec("T2CON", 0x0110, writable=0xA07A),
    ),
    3: (
        RegisterSpec("TMR3HLD", 0x0108),
        RegisterSpec("TMR3", 0x010A),
        RegisterSpec("PR3", 0x010E, reset=0xFFFF),
        RegisterSpec("T3CON", 0x0112, writable=0xA072),
    ),
    4: (
        RegisterSpec("TMR4", 0x0114),
        RegisterSpec("PR4", 0x011A, reset=0xFFFF),
        RegisterSpec("T4CON", 0x011E, writable=0xA07A),
    ),
    5: (
        RegisterSpec("TMR5HLD", 0x0116),
        RegisterSpec("TMR5", 0x0118),
        RegisterSpec("PR5", 0x011C, reset=0xFFFF),
        RegisterSpec("T5CON", 0x0120, writable=0xA072),
    ),
}


class Timer:
    """One timer on the instruction clock. `odd` is the partner that T32 joins to an even timer."""

    def __init__(
        self,
        number: int,
        scheduler: Scheduler,
        clock: Clock,
        line: InterruptLine,
        odd: Timer | None = None,
    ) -> None:
        self.number = number
        self.bank = RegisterBank(
            TIMER_REGISTERS[number],
            on_read={f"TMR{number}": self._read_count},
            on_write={
                f"TMR{number}": self._write_count,
                f"PR{number}": self._write_period,
                f"T{number}CON": self._write_control,
            },
        )
        self._scheduler = scheduler
        self._clock = clock
        self._line = line
        self._odd = odd
        self._count = self.bank[f"TMR{number}"]
        self._period = self.bank[f"PR{number}"]
        self._control = self.bank[f"T{number}CON"]
        self._hold = self.bank[f"TMR{number}HLD"] if number in (3, 5) else None
        self._slave = False  # the odd half of a 32-bit pair
        self._running = False
        self._prescaler = 1
        self._base = 0  # cycle at which the count is or was zero
        self._match_cycle = 0
        self._event: Event | None = None
        self._listeners: tuple[Callable[[], None], ...] = ()

    def on_match(self, listener: Callable[[], None]) -> None:
        """Call `listener` whenever the count returns to zero after equalling PRx."""
        self._listeners = (*self._listeners, listener)

    @property
    def running(self) -> bool:
        """Whether the timer counts."""
        return self._running

    @property
    def prescaler(self) -> int:
        """Instruction cycles a count."""
        return self._prescaler

    @property
    def base_cycle(self) -> int:
        """Instruction cycle at which the present period began (count 0)."""
        return self._base

    @property
    def period(self) -> int:
        """Counts a period: PRx + 1, 32 bits wide in a pair."""
        odd = self._odd
        if odd is not None and self._control.value & T32:
            return (odd._period.value << 16 | self._period.value) + 1
        return self._period.value + 1

    @property
    def _wide(self) -> bool:
        return self._odd is not None and bool(self._control.value & T32)

    def reset(self) -> None:
        """Stop and clear, as every reset does."""
        self._scheduler.cancel(self._event)
        self._event = None
        self._running = self._slave = False
        self._prescaler = 1
        self.bank.reset()

    def count(self) -> int:
        """Return the present count without side effects."""
        if not self._running:
            low = self._count.value
            if self._wide and self._odd is not None:
                return self._odd._count.value << 16 | low
            return low
        return (self._clock.ticks(self._scheduler.now) - self._base) // self._prescaler

    def _read_count(self) -> int:
        if self._slave:  # the high half is read through TMRxHLD
            return self._count.value
        count = self.count()
        odd = self._odd
        if odd is not None and self._control.value & T32 and odd._hold is not None:
            odd._hold.value = count >> 16
        return count & 0xFFFF

    def _write_count(self, value: int) -> None:
        self._count.value = value
        if self._running:
            if self._wide and self._odd is not None and self._odd._hold is not None:
                value |= self._odd._hold.value << 16  # written first, DS70046 12.11
            self._start(value)

    def _write_period(self, value: int) -> None:
        self._period.value = value
        if self._running:
            self._schedule()

    def _write_control(self, value: int) -> None:
        if value & (TCS | TGATE):
            raise UnsupportedModeError(f"Timer{self.number}: external clock and gate are left out")
        count = self.count()
        self._control.value = value
        self._prescaler = PRESCALERS[value >> 4 & 3]
        if self._odd is not None:
            self._odd._slave = bool(value & T32)
        self._scheduler.cancel(self._event)
        self._event = None
        if value & TON and not self._slave:
            self._start(count)
        elif self._running:
            self._running = False
            self._count.value = count & 0xFFFF
            if self._wide and self._odd is not None:
                self._odd._count.value = count >> 16

    def _start(self, count: int) -> None:
        self._running = True
        # A write to TMRx or TxCON clears the prescaler (DS70046, 12.3.1).
        self._base = self._clock.ticks(self._scheduler.now) - count * self._prescaler
        self._schedule()

    def _schedule(self) -> None:
        self._scheduler.cancel(self._event)
        period = self.period
        if self.count() >= period:  # PRx was passed: the count wraps at its full width first
            period += 1 << 32 if self._wide else 1 << 16
        self._match_cycle = self._base + period * self._prescaler
        self._event = self._scheduler.at(self._clock.edge(self._match_cycle), self._match)

    def _match(self) -> None:
        odd = self._odd
        line, counts = self._line, self._period.value + 1
        if odd is not None and self._control.value & T32:
            line, counts = odd._line, self.period
        self._base = base = self._match_cycle
        self._match_cycle = base = base + counts * self._prescaler
        self._event = self._scheduler.at(self._clock.edge(base), self._match)
        if not line.pending:
            line.request()
        for listener in self._listeners:
            listener()
