"""Chips whose readings come from elsewhere: the far end of a plant in the loop, at a board's pins.

A board with these in the place of its chips converts, reads and hears what somebody else computed:
voltages that give exactly the counts that were sent, an LSM303DLH that answers with the registers
that were sent, a UART that gets characters at their times. Its servo output is measured as a servo
does it. What the firmware writes into the chips goes back, since full scale and data rate are
settings of the chips that are computed elsewhere.

The board's code is the same in both cases: the seam runs along the pins.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Final

from firmware_model.dspic30f.adc import CHANNELS, FULL_SCALE
from firmware_model.scheduler import Scheduler
from firmware_model.signals import Quantity, Signal, constant
from firmware_model.wires import UartListener
from navboard.chips.gps18x import SentenceListener
from navboard.chips.lsm303dlh import (
    ACCELEROMETER_ADDRESS,
    MAGNETOMETER_ADDRESS,
    OUT_X_H_M,
    STATUS_REG_A,
    Accelerometer,
    Magnetometer,
)

OnWrite = Callable[[int, int, int], None]
"""Takes the address on the bus, the register and what was written into it."""
OnPulse = Callable[[int, int], None]
"""Takes the rising edge and the width of a pulse, femtoseconds."""
_NOTHING: Final = constant(0.0)


def _ignore_write(_address: int, _register: int, _value: int) -> None:
    """Stand in where nobody listens."""


def _ignore_pulse(_rise_fs: int, _width_fs: int) -> None:
    """Stand in where nobody listens."""


class RemoteAccelerometer(Accelerometer):
    """The register logic of the accelerometer; contents of its outputs are brought by `fill`."""

    def __init__(self, scheduler: Scheduler, on_write: OnWrite) -> None:
        super().__init__(scheduler, _NOTHING, _NOTHING, _NOTHING, random.Random(0))
        self._on_write = on_write
        self._contents = b""

    def fill(self, contents: bytes) -> None:
        """Take STATUS_REG_A to OUT_Z_H_A; a read that is under way goes on with what there was."""
        self._contents = contents

    def _store(self, register: int, byte: int) -> None:
        super()._store(register, byte)
        self._on_write(ACCELEROMETER_ADDRESS, register, byte)

    def _refresh(self) -> None:
        self.registers.update(enumerate(self._contents, STATUS_REG_A))


class RemoteMagnetometer(Magnetometer):
    """The register logic of the magnetometer; contents of its outputs are brought by `fill`."""

    def __init__(self, scheduler: Scheduler, on_write: OnWrite) -> None:
        super().__init__(scheduler, lambda _time_fs: (0.0, 0.0, 0.0), random.Random(0))
        self._on_write = on_write
        self._contents = b""

    def fill(self, contents: bytes) -> None:
        """Take OUT_X_H_M to SR_REG_M; a read that is under way goes on with what there was."""
        self._contents = contents

    def _store(self, register: int, byte: int) -> None:
        super()._store(register, byte)
        self._on_write(MAGNETOMETER_ADDRESS, register, byte)

    def _refresh(self) -> None:
        self.registers.update(enumerate(self._contents, OUT_X_H_M))


class RemoteGps:
    """Where the receiver's wires end; whoever has its characters calls `character`."""

    def __init__(self) -> None:
        self.pps: Signal[bool] = Signal("PPS", False)
        self.listener: UartListener | None = None
        self.sentence_listeners: tuple[SentenceListener, ...] = ()
        self._on = False

    def power(self, on: bool) -> None:
        """Without supply nothing is heard of it."""
        self._on = on
        if not on:
            self.pps.set(False)

    def character(self, character: int) -> None:
        """Deliver a character, at the middle of its stop bit."""
        if self._on and self.listener is not None:
            self.listener(character)

    def pulse(self, level: bool) -> None:
        """Drive the measurement pulse."""
        self.pps.set(level and self._on)


class RemoteChips:
    """Everything around a board's MCU that a plant in the loop stands for."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.counts: list[int] = [0] * CHANNELS
        """What the converter is to find at AN0 to AN15."""
        self.on_write: OnWrite = _ignore_write
        self.on_pulse: OnPulse = _ignore_pulse
        self.accelerometer = RemoteAccelerometer(scheduler, self._written)
        self.magnetometer = RemoteMagnetometer(scheduler, self._written)
        self.gps = RemoteGps()
        self._scheduler = scheduler
        self._rise_fs: int | None = None

    def volts(self, channel: int, reference_v: Signal[float]) -> Quantity:
        """Return the voltage at ANx: the middle of what gives these counts."""
        counts = self.counts

        def look(_time_fs: int) -> float:
            return (counts[channel] + 0.5) * reference_v.value / FULL_SCALE

        return look

    def watch_servo(self, pin: Signal[bool]) -> None:
        """Measure the pulses on a pin."""
        pin.watch(self._edge)

    def _written(self, address: int, register: int, value: int) -> None:
        self.on_write(address, register, value)

    def _edge(self, level: bool) -> None:
        now = self._scheduler.now
        rise, self._rise_fs = self._rise_fs, now if level else None
        if not level and rise is not None:
            self.on_pulse(rise, now - rise)
