"""Microseconds since the reset, from Timer4 and Timer5 as one 32-bit counter of FCY.

The pair wraps after 291 s; firmware extends it in software whenever it reads, which the control
tick does fifty times a second. 14.7456 cycles are a microsecond: µs = cycles × 625 / 9216, exact in
integers for this crystal; other clocks get their own ratio.
"""

from __future__ import annotations

from fractions import Fraction

from firmware_model.dspic30f.mcu import DsPic30F6014A

_WRAP = 1 << 32


class BoardClock:
    """The board's own time; the crystal's error is in it."""

    __slots__ = ("_denominator", "_high", "_high_word", "_last", "_low_word", "_numerator")

    def __init__(self, mcu: DsPic30F6014A) -> None:
        ratio = Fraction(10**6) / mcu.clock.frequency_hz
        self._numerator, self._denominator = ratio.numerator, ratio.denominator
        reg = mcu.reg
        self._low_word = reg["TMR4"]
        self._high_word = reg["TMR5HLD"]
        self._last = 0
        self._high = 0
        reg["PR4"].write(0xFFFF)
        reg["PR5"].write(0xFFFF)
        reg["T4CON"].write(1 << 15 | 1 << 3)  # TON, T32, prescaler 1

    def now_us(self) -> int:
        """Return microseconds since the clock was started."""
        cycles = self._low_word.read() | self._high_word.read() << 16
        if cycles < self._last:
            self._high += _WRAP
        self._last = cycles
        return (self._high + cycles) * self._numerator // self._denominator
