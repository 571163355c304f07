"""Basic clock module of the MSP430x1xx (SLAU049, chapter 4): DCO, LFXT1, and MCLK, SMCLK, ACLK.

The three clock lines are `GatedClock` objects. A line that firmware retunes, or that a low-power
mode stops, tells the peripherals that listen, so that they move their scheduled events; nobody
counts ticks meanwhile. The DCO follows a law fitted to the typical column of the datasheet with a
device factor, so that a firmware's calibration against the watch crystal has real work to do. The
modulator's mix of two frequencies is modelled by its mean period, exact over each 32 DCO cycles.

Not modelled: an XT2 crystal (TelosB has none; choosing it raises OFIFG, and MCLK falls back to the
DCO as in hardware) and the external resistor of DCOR.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING

from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.time import Clock

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler

LFXT1_HZ = 32_768
"""Watch crystal of TelosB."""

# SLAS368, "DCO", V_CC = 3 V, T_A = 25 °C, typical: f(DCOx3) in Hz for RSEL = 0…7, DCO = 3, MOD = 0.
DCO_CENTRE_HZ = (130_000, 180_000, 280_000, 470_000, 750_000, 1_300_000, 2_000_000, 3_200_000)
# SLAS368: S(DCO) = f(DCO+1)/f(DCO) is 1.07…1.16, typically 1.12; f(DCO77) = 4.9 MHz over
# f(DCO73) = 3.2 MHz makes it 1.112 in the top range.
DCO_STEP = Fraction(1112, 1000)
DCO_FACTOR_MIN, DCO_FACTOR_MAX = 0.90, 1.10
"""Spread between devices: f(DCO77) is 4.4…5.4 MHz around 4.9 (SLAS368)."""
# SLAS368: temperature drift D_T, typically −0.38 %/°C at 3 V.
DCO_DRIFT_PER_C = Fraction(-38, 10_000)

REGISTERS = (
    RegisterSpec("DCOCTL", 0x0056, 8, reset=0x60),
    RegisterSpec("BCSCTL1", 0x0057, 8, reset=0x84),
    RegisterSpec("BCSCTL2", 0x0058, 8),
)

_FROZEN_PERIOD_FS = 1 << 150
FOREVER_FS = 1 << 140
"""Edges at or beyond this time belong to a stopped clock."""


class GatedClock(Clock):
    """A clock line that can stop and start, and tells listeners when its edges have moved.

    Tick numbers never go back: a stopped line keeps its count. `users` counts the peripherals
    that need the line; the low-power modes look at it so that nothing is done for idle lines.
    """

    __slots__ = ("_listeners", "running", "users")

    def __init__(self, frequency_hz: int | Fraction, drift_ppm: float = 0.0) -> None:
        super().__init__(frequency_hz, drift_ppm)
        self._listeners: tuple[Callable[[], None], ...] = ()
        self.running = True
        self.users = 0

    def watch(self, listener: Callable[[], None]) -> None:
        """Call `listener` after every change of frequency, stop or start."""
        self._listeners = (*self._listeners, listener)

    def retune(
        self, now_fs: int, frequency_hz: int | Fraction, drift_ppm: float | None = None
    ) -> None:
        """Change the frequency from the last edge on and tell the listeners."""
        super().retune(now_fs, frequency_hz, drift_ppm)
        if not self.running:
            self._freeze(now_fs)
        self._tell()

    def stop(self, now_fs: int) -> None:
        """Hold the line: the edges after now do not come."""
        if self.running:
            self.running = False
            self._freeze(now_fs)
            self._tell()

    def start(self, now_fs: int) -> None:
        """Let the line run again from now, at its frequency."""
        if not self.running:
            self.running = True
            self._origin_fs = now_fs
            self._set_ratio()
            self._set_offsets()
            self._tell()

    def _freeze(self, now_fs: int) -> None:
        self._base = self.ticks(now_fs)
        self._origin_fs = now_fs
        self._num, self._den = _FROZEN_PERIOD_FS, 1
        self._set_offsets()

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()


def dco_frequency_hz(rsel: int, dco: int, mod: int, factor: Fraction = Fraction(1)) -> int:
    """Return the mean DCO frequency for RSELx, DCOx and MODx, to the hertz.

    Over 32 cycles MODx of them are of the next higher DCO step (SLAU049, section 4.2.5); with
    DCOx = 7 the modulator does nothing.
    """
    base = DCO_CENTRE_HZ[rsel] * factor * DCO_STEP ** (dco - 3)
    if dco == 7 or mod == 0:
        return round(base)
    return round(32 / ((32 - mod) / base + mod / (base * DCO_STEP)))


class BasicClock:
    """DCOCTL, BCSCTL1, BCSCTL2 and the three lines they drive."""

    def __init__(
        self, scheduler: Scheduler, lfxt1_drift_ppm: float = 0.0, dco_factor: float = 1.0
    ) -> None:
        if not 0.5 <= dco_factor <= 2.0:
            raise ValueError(f"a DCO factor lies between 0.5 and 2, not {dco_factor}")
        self._scheduler = scheduler
        self._factor = Fraction(round(dco_factor * 10**6), 10**6)
        self._celsius = 25.0
        self.on_fault: Callable[[], None] = lambda: None
        self.bank = RegisterBank(
            REGISTERS,
            on_write={
                "DCOCTL": lambda value: self._write("DCOCTL", value),
                "BCSCTL1": lambda value: self._write("BCSCTL1", value),
                "BCSCTL2": lambda value: self._write("BCSCTL2", value),
            },
        )
        self._dcoctl = self.bank["DCOCTL"]
        self._bcsctl1 = self.bank["BCSCTL1"]
        self._bcsctl2 = self.bank["BCSCTL2"]
        self.dco_hz = self._dco()
        self.aclk = GatedClock(LFXT1_HZ, lfxt1_drift_ppm)
        self.mclk = GatedClock(self.dco_hz)
        self.smclk = GatedClock(self.dco_hz)
        self._lfxt1_drift_ppm = lfxt1_drift_ppm
        self._low_power = False

    def warm(self, celsius: float) -> None:
        """Set the die temperature that the DCO feels; the crystal's drift is a parameter."""
        self._celsius = celsius
        self._apply()

    def reset(self, por: bool) -> None:
        """Put all three registers back, as every PUC does: about 750 kHz from the DCO."""
        self.bank.reset()
        self._apply()

    def sleep(self, state: str) -> None:
        """Stop the lines that a low-power mode stops, as far as anybody uses them.

        SLAU049, table 2-2: SMCLK stops in LPM2–LPM4, ACLK in LPM4.
        """
        if state in _WITHOUT_SMCLK:
            now = self._scheduler.now
            if self.smclk.users:
                self.smclk.stop(now)
            if state == "lpm4" and self.aclk.users:
                self.aclk.stop(now)
            self._low_power = not (self.smclk.running and self.aclk.running)

    def wake(self) -> None:
        """Let the lines run again."""
        if self._low_power:
            self._low_power = False
            self.aclk.start(self._scheduler.now)
            self._select_smclk()

    def _write(self, name: str, value: int) -> None:
        self.bank[name].value = value
        self._apply()

    def _dco(self) -> int:
        warm = 1 + DCO_DRIFT_PER_C * Fraction(round((self._celsius - 25.0) * 1000), 1000)
        dcoctl = self._dcoctl.value
        return dco_frequency_hz(
            self._bcsctl1.value & 7, dcoctl >> 5, dcoctl & 31, self._factor * warm
        )

    def _apply(self) -> None:
        now = self._scheduler.now
        self.dco_hz = self._dco()
        bcsctl2 = self._bcsctl2.value
        # DIVAx: BCSCTL1 bits 5–4; SELMx 7–6, DIVMx 5–4, SELS 3, DIVSx 2–1 of BCSCTL2.
        aclk_hz = Fraction(LFXT1_HZ, 1 << (self._bcsctl1.value >> 4 & 3))
        if aclk_hz != self.aclk.frequency_hz:
            self.aclk.retune(now, aclk_hz)
        selm = bcsctl2 >> 6
        source_hz, drift = (LFXT1_HZ, self._lfxt1_drift_ppm) if selm == 3 else (self.dco_hz, 0.0)
        self._tune(self.mclk, Fraction(source_hz, 1 << (bcsctl2 >> 4 & 3)), drift)
        self._tune(self.smclk, Fraction(self.dco_hz, 1 << (bcsctl2 >> 1 & 3)), 0.0)
        self._select_smclk()
        if selm == 2 or bcsctl2 & 0x08:
            self.on_fault()  # XT2 has no crystal

    def _tune(self, clock: GatedClock, frequency_hz: Fraction, drift_ppm: float) -> None:
        if frequency_hz != clock.frequency_hz or drift_ppm != clock.drift_ppm:
            clock.retune(self._scheduler.now, frequency_hz, drift_ppm)

    def _select_smclk(self) -> None:
        """Run SMCLK, unless SELS asks for the missing XT2."""
        if self._bcsctl2.value & 0x08:
            self.smclk.stop(self._scheduler.now)
        else:
            self.smclk.start(self._scheduler.now)


_WITHOUT_SMCLK = frozenset({"lpm2", "lpm3", "lpm4"})
