"""Output compare in PWM mode: two edges a period, exact to a tick of its timer.

At the period match OCxR takes what firmware left in OCxRS, the pin rises, and it falls OCxR ticks
later (DS70046, section 14.3.3): firmware can write a new duty at any time without a glitch.
"""

from __future__ import annotations

from firmware_model.dspic30f.errors import UnsupportedModeError
from firmware_model.dspic30f.timers import Timer
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Priority, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import Clock

OCM_OFF = 0
OCM_PWM = 6  # PWM, fault pin disabled
OCTSEL = 1 << 3  # 1: Timer3, 0: Timer2

_WIRE = int(Priority.WIRE)


def output_compare_registers(number: int) -> tuple[RegisterSpec, ...]:
    """Return OCxRS, OCxR and OCxCON (DS70143, table 13-1: 0x0180 + 6 (x − 1))."""
    base = 0x0180 + 6 * (number - 1)
    return (
        RegisterSpec(f"OC{number}RS", base),
        RegisterSpec(f"OC{number}R", base + 2),
        RegisterSpec(f"OC{number}CON", base + 4, writable=0x200F),
    )


class OutputCompare:
    """One output compare module; `pin` is its output."""

    def __init__(
        self,
        number: int,
        scheduler: Scheduler,
        clock: Clock,
        timer2: Timer,
        timer3: Timer,
    ) -> None:
        self.number = number
        self.pin: Signal[bool] = Signal(f"OC{number}", False)
        self.bank = RegisterBank(
            output_compare_registers(number),
            on_write={f"OC{number}CON": self._write_control, f"OC{number}R": self._write_compare},
        )
        self._scheduler = scheduler
        self._clock = clock
        self._timers = (timer2, timer3)
        self._next = self.bank[f"OC{number}RS"]
        self._compare = self.bank[f"OC{number}R"]
        self._control = self.bank[f"OC{number}CON"]
        self._timer: Timer | None = None
        self._event: Event | None = None
        timer2.on_match(lambda: self._period(timer2))
        timer3.on_match(lambda: self._period(timer3))

    def reset(self) -> None:
        """Release the pin; registers to their reset values."""
        self.bank.reset()
        self._off()

    def _off(self) -> None:
        self._scheduler.cancel(self._event)
        self._event = None
        self._timer = None
        self.pin.set(False)

    def _write_control(self, value: int) -> None:
        self._control.value = value
        mode = value & 7
        if mode == OCM_OFF:
            self._off()
        elif mode == OCM_PWM:
            self._timer = self._timers[bool(value & OCTSEL)]
        else:
            raise UnsupportedModeError(f"OC{self.number}: OCM = {mode}; only PWM is modelled")

    def _write_compare(self, value: int) -> None:
        if self._timer is None:  # read-only in PWM mode
            self._compare.value = value

    def _period(self, timer: Timer) -> None:
        if timer is not self._timer:
            return
        self._compare.value = ticks = self._next.value
        if ticks == 0:
            self.pin.set(False)
            return
        self.pin.set(True)
        if ticks < timer.period:  # else the pin stays high for the whole period
            fall = timer.base_cycle + ticks * timer.prescaler
            self._event = self._scheduler.at(self._clock.edge(fall), self._fall, _WIRE)

    def _fall(self) -> None:
        self._event = None
        self.pin.set(False)
