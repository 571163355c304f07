"""Servo pulses from OC1 on Timer2: 20 ms frames, the width from an angle in Q16.16 radians.

FCY / 8 makes a tick of 0.543 µs, 0.054° of a servo whose 600 µs are 60°; its dead band is seven
ticks. Writing OC1RS is all that an update takes: the module latches it at the next frame.
"""

from __future__ import annotations

import math

from firmware_model.dspic30f.mcu import DsPic30F6014A

FRAME_S = 0.020
MIDDLE_S = 1500e-6
SECONDS_PER_RAD = 600e-6 / math.radians(60.0)
_PRESCALER = 8
_SHIFT = 8  # ticks per radian are kept with eight binary places


class ServoPulse:
    """PWM for one servo."""

    __slots__ = ("_middle", "_scale", "_width", "frame_ticks")

    def __init__(self, mcu: DsPic30F6014A) -> None:
        tick_hz = float(mcu.clock.frequency_hz) / _PRESCALER
        self.frame_ticks = round(FRAME_S * tick_hz)
        self._middle = round(MIDDLE_S * tick_hz)
        self._scale = round(SECONDS_PER_RAD * tick_hz * (1 << _SHIFT))
        reg = mcu.reg
        self._width = reg["OC1RS"]
        reg["PR2"].write(self.frame_ticks - 1)
        self._width.write(self._middle)
        reg["OC1R"].write(self._middle)
        reg["OC1CON"].write(6)  # PWM, Timer2
        reg["T2CON"].write(1 << 15 | 1 << 4)  # TON, prescaler 8

    def set_angle(self, angle: int) -> None:
        """Take an angle in Q16.16 rad for the next frame."""
        self._width.write(self._middle + (angle * self._scale >> 16 + _SHIFT))
