"""The chips around a navigation board, without the board: what its pins and buses would see.

The same chips that the emulated board is wired with look at the swimmer; their voltages are
converted here, as the board's converter would, and the registers of the LSM303DLH are read as
bytes. The readings kept for channels.csv are those of the same samples, turned into SI units by the
data sheets: what the board can know at best, whatever its firmware makes of it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from firmware_model.dspic30f.adc import FULL_SCALE
from firmware_model.signals import Quantity
from firmware_model.time import FS_PER_S, FS_PER_US
from navboard.board import gps18x, lsm303dlh
from navboard.chips.gps18x import BAUD, BITS_PER_CHARACTER, LATENCY_FS, PULSE_WIDTH_FS
from navboard.chips.lsm303dlh import (
    ACCELEROMETER_ADDRESS,
    ACCELEROMETER_G_PER_LSB,
    CRB_REG_M,
    CTRL_REG4_A,
    MAGNETOMETER_ADDRESS,
    MAGNETOMETER_LSB_PER_GAUSS,
    MAGNETOMETER_OVERFLOW,
    OUT_X_H_M,
    OUT_X_L_A,
    SR_REG_M,
    STANDARD_GRAVITY_M_S2,
    STATUS_REG_A,
)
from navboard.drivers.gps18x import FixBuilder
from navboard.errors import SentenceError
from navboard.heading import wrap
from navboard.sensor_controller import local_position
from navboard.sensors import ANALOG_SENSORS, AnalogSensor
from spi_bus.plant_messages import (
    NMEA_MOST,
    GpsPulse,
    NmeaCharacters,
    SampleStatus,
    SensorSample,
)
from tools.bench.power import NAV_V
from tools.bench.robot import nav_config
from tools.records.data import Series

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from tools.bench.swimmer import Swimmer
    from tools.configuration import Scenario

SLOW_S: Final = 0.1
"""Slow inputs are kept for channels.csv ten times a second, as the emulated board scans them."""


class RawSignals:
    """All chips of the board, at the host.

    Args:
        config: the scenario.
        scheduler: time.
        swimmer: what they look at.

    """

    def __init__(self, config: Scenario, scheduler: Scheduler, swimmer: Swimmer) -> None:
        nav, seed = nav_config(config), config.scenario.seed
        inputs = swimmer.inputs()
        self._inputs: dict[int, Quantity] = {}
        self._sensors: list[AnalogSensor] = []
        for sensor in ANALOG_SENSORS:
            volts = sensor.outputs(inputs, nav, seed)
            if volts is not None:
                self._sensors.append(sensor)
                self._inputs.update(zip(sensor.channels, volts, strict=True))
        self.accelerometer, self.magnetometer = lsm303dlh(scheduler, inputs, nav, seed)
        self.gps = gps18x(scheduler, inputs, nav, seed)
        self.on_message: Callable[[object], None] = lambda message: None
        """Called with what has to reach the board beside the samples."""
        self.on = True
        self._north_rad = nav.north_rad
        self._readings: dict[str, list[tuple[float, float]]] = {}
        self._slow_due_fs = 0
        self._filled: tuple[int | None, int | None] = (None, None)
        self._scheduler = scheduler
        self._fixes = FixBuilder()
        if self.gps is not None:
            self.gps.sentence_listeners = (self._sentences,)
            self.gps.pps.watch(self._pulse)
            self.gps.power(True)

    @property
    def analog_inputs(self) -> int:
        """Bit n: ANn is driven."""
        return sum(1 << channel for channel in self._inputs)

    def power(self, on: bool) -> None:
        """Lose or regain the supply of all chips."""
        self.on = on
        self.accelerometer.power(on)
        self.magnetometer.power(on)
        if self.gps is not None:
            self.gps.power(on)

    def write(self, address: int, register: int, value: int) -> bool:
        """Write a register over the bus; return whether a chip took it."""
        for part in (self.accelerometer, self.magnetometer):
            if part.address_match(address, False):
                taken = part.write(register) and part.write(value)
                part.stop()
                return taken
        return False

    def sample(self, number: int, now_fs: int, *, late: bool = False) -> SensorSample:
        """Look at everything."""
        counts = {
            channel: _convert(volts(now_fs)) if self.on else 0
            for channel, volts in self._inputs.items()
        }
        self.accelerometer.address_match(ACCELEROMETER_ADDRESS, True)  # a read looks for new data
        self.magnetometer.address_match(MAGNETOMETER_ADDRESS, True)
        status = SampleStatus.SUPPLY_ON if self.on else SampleStatus(0)
        before = self._filled
        self._filled = (self.accelerometer.sampled_fs, self.magnetometer.sampled_fs)
        if self._filled[0] not in (before[0], None):
            status |= SampleStatus.ACCELEROMETER_NEW
        if self._filled[1] not in (before[1], None):
            status |= SampleStatus.MAGNETOMETER_NEW
        if late:
            status |= SampleStatus.LATE
        self._keep(now_fs, counts, status)
        return SensorSample.of(
            number,
            now_fs // FS_PER_US,
            status,
            counts,
            _contents(self.accelerometer.registers, STATUS_REG_A, 7),
            _contents(self.magnetometer.registers, OUT_X_H_M, SR_REG_M - OUT_X_H_M + 1),
        )

    def readings(self, until_s: float) -> dict[str, Series]:
        """Return what was read, by the names of channels.csv, up to a time."""
        found = {}
        for name, pairs in self._readings.items():
            array = np.array([pair for pair in pairs if pair[0] <= until_s], dtype=np.float64)
            if array.size:
                found[name] = Series(array[:, 0].copy(), array[:, 1].copy())
        return found

    # --- readings ----------------------------------------------------------------------

    def _note(self, name: str, at_s: float, value: float) -> None:
        self._readings.setdefault(name, []).append((at_s, value))

    def _keep(self, now_fs: int, counts: dict[int, int], status: SampleStatus) -> None:
        if not self.on:
            return
        at_s = now_fs / FS_PER_S
        slow = now_fs >= self._slow_due_fs
        if slow:
            self._slow_due_fs = now_fs + round(SLOW_S * FS_PER_S)
        for sensor in self._sensors:
            if slow or not sensor.slow:
                value = sensor.convert(*[counts[channel] for channel in sensor.channels])
                self._note(sensor.name, at_s, value)
        if status & SampleStatus.ACCELEROMETER_NEW:
            scale = self.accelerometer.registers[CTRL_REG4_A] >> 4 & 3
            per_lsb = ACCELEROMETER_G_PER_LSB.get(scale, 1e-3) * STANDARD_GRAVITY_M_S2
            words = struct.unpack("<hhh", _contents(self.accelerometer.registers, OUT_X_L_A, 6))
            for axis, word in zip("xyz", words, strict=True):
                self._note(f"accel_{axis}_m_s2", at_s, (word >> 4) * per_lsb)
        if status & SampleStatus.MAGNETOMETER_NEW:
            x, y, _ = struct.unpack(">hhh", _contents(self.magnetometer.registers, OUT_X_H_M, 6))
            gain = self.magnetometer.registers[CRB_REG_M] >> 5
            if MAGNETOMETER_OVERFLOW not in (x, y) and gain in MAGNETOMETER_LSB_PER_GAUSS:
                self._note("compass_rad", at_s, wrap(math.atan2(-y, x) + self._north_rad))

    # --- GPS ---------------------------------------------------------------------------

    def _sentences(self, fix_fs: int, text: bytes) -> None:
        """Send a burst ahead of its time, which is known: 0.15 s before its first character."""
        character_fs = BITS_PER_CHARACTER * FS_PER_S // BAUD
        complete_fs = fix_fs + LATENCY_FS + (2 * BITS_PER_CHARACTER - 1) * FS_PER_S // (2 * BAUD)
        for place in range(0, len(text), NMEA_MOST):
            piece = text[place : place + NMEA_MOST]
            due_us = (complete_fs + place * character_fs) // FS_PER_US
            self.on_message(NmeaCharacters.of(due_us, BAUD, piece))
        ends_s = (complete_fs + (len(text) - 1) * character_fs) / FS_PER_S
        for line in text.splitlines(keepends=True):
            try:
                fix = self._fixes.sentence(line)
            except SentenceError:  # no sentence of our own chip is damaged
                continue
            if fix is None or fix.latitude_deg is None or fix.longitude_deg is None:
                continue
            assert self.gps is not None
            x_m, y_m = local_position(self.gps.config, fix.latitude_deg, fix.longitude_deg)
            self._note("gps_x_m", ends_s, x_m)
            self._note("gps_y_m", ends_s, y_m)

    def _pulse(self, level: bool) -> None:
        """Announce the next pulse while this one rises: nothing arrives within a microsecond."""
        if level:
            second = self._scheduler.now // FS_PER_S + 1
            self.on_message(GpsPulse(second * 1_000_000, PULSE_WIDTH_FS // FS_PER_US))


def _convert(volts: float) -> int:
    """Return the counts of a 12-bit conversion against the board's 3.3 V."""
    return min(max(int(volts / NAV_V * FULL_SCALE), 0), FULL_SCALE - 1)


def _contents(registers: dict[int, int], first: int, count: int) -> bytes:
    return bytes(registers.get(first + place, 0) for place in range(count))
