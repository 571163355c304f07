"""ST LSM303DLH: accelerometer at 0x18 and magnetometer at 0x1E on one I²C bus.

Registers as in the data sheet (Doc ID 16941): the accelerometer's output is little-endian, twelve
bits left-aligned, its sub-address steps on only with bit 7 set; the magnetometer's is big-endian in
the order X, Y, Z (the DLHC differs) and steps on by itself. Mounted with x forward, y left, z up.

A new sample is taken when the bus looks and the data-rate period is over, so a sample may be
younger than the chip's own, by at most that period; reading faster than the data rate gives the
old one, as the chip does. Noise is white: 218 µg/√Hz over half the data rate for the accelerometer
(data sheet, table 3); the magnetometer's 0.3 µT is assumed.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Quantity
from firmware_model.time import FS_PER_S

ACCELEROMETER_ADDRESS = 0x18  # SA0 low
MAGNETOMETER_ADDRESS = 0x1E
AUTO_INCREMENT = 0x80
STANDARD_GRAVITY_M_S2 = 9.80665
TESLA_PER_GAUSS = 1e-4
SUPPLY_A = 0.83e-3  # data sheet, table 4: normal mode, both parts

CTRL_REG1_A = 0x20
CTRL_REG4_A = 0x23
STATUS_REG_A = 0x27
OUT_X_L_A = 0x28
CRA_REG_M = 0x00
CRB_REG_M = 0x01
MR_REG_M = 0x02
OUT_X_H_M = 0x03
SR_REG_M = 0x09
IRA_REG_M = 0x0A

ACCELEROMETER_RATES_HZ = (50, 100, 400, 1000)  # CTRL_REG1_A, DR<1:0>
ACCELEROMETER_G_PER_LSB = {0: 1.0e-3, 1: 2.0e-3, 3: 3.9e-3}  # CTRL_REG4_A, FS<1:0>
MAGNETOMETER_RATES_HZ = (0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0)  # CRA_REG_M, DO<2:0>
# CRB_REG_M, GN<2:0>: LSB/gauss of X and Y, and of Z.
MAGNETOMETER_LSB_PER_GAUSS = {
    1: (1055, 950),
    2: (795, 710),
    3: (635, 570),
    4: (430, 385),
    5: (375, 335),
    6: (320, 285),
    7: (230, 205),
}
MAGNETOMETER_OVERFLOW = -4096

# The sub-address after each: the accelerometer's steps on where bit 7 is set, the magnetometer's
# always, from the last byte of the output back to its first.
_ACCELEROMETER_FOLLOWING = tuple(
    AUTO_INCREMENT | (pointer + 1 & 0x7F) if pointer & AUTO_INCREMENT else pointer
    for pointer in range(256)
)
_MAGNETOMETER_FOLLOWING = tuple(
    OUT_X_H_M if pointer == OUT_X_H_M + 5 else pointer + 1 & 0xFF for pointer in range(256)
)

NOISE_DENSITY_G = 218e-6  # per √Hz
ZERO_G_SIGMA_G = 0.010  # the ±20 mg typical offset taken as two sigma
MAGNETIC_NOISE_T = 0.3e-6

# Earth's field near East Lansing (World Magnetic Model, rounded): horizontal and downward part.
FIELD_HORIZONTAL_T = 18.5e-6
FIELD_DOWN_T = 50.0e-6

Vector = Callable[[int], tuple[float, float, float]]


def earth_field(heading_rad: Quantity, north_rad: float = 0.0) -> Vector:
    """Return the earth's field in body axes (x forward, y left, z up), tesla.

    Args:
        heading_rad: ψ, counter-clockwise from the tank's +x.
        north_rad: direction of magnetic north in the tank, from +x.

    """

    def field(time_fs: int) -> tuple[float, float, float]:
        angle = north_rad - heading_rad(time_fs)
        return (
            FIELD_HORIZONTAL_T * math.cos(angle),
            FIELD_HORIZONTAL_T * math.sin(angle),
            -FIELD_DOWN_T,
        )

    return field


class _Part:
    """Sub-address logic that both parts share; a part fills its output registers.

    Args:
        address: on the bus, seven bits.
        scheduler: time.
        registers: those that do not reset to zero.
        following: the sub-address after each of the 256.
        register_mask: bits of the sub-address that name a register.

    """

    def __init__(
        self,
        address: int,
        scheduler: Scheduler,
        registers: dict[int, int],
        following: tuple[int, ...],
        register_mask: int,
    ) -> None:
        self._address = address
        self._following = following
        self._register_mask = register_mask
        self._scheduler = scheduler
        self._reset_values = dict(registers)
        self.registers = dict(registers)
        self._pointer = 0
        self._first = False  # the next byte written is a sub-address
        self.sampled_fs: int | None = None
        """When the output registers were filled; None: not since the supply came."""
        self._period_fs = 0  # of the data rate; 0 where the part does not measure
        self.powered = True

    def power(self, on: bool) -> None:
        """Lose or regain the supply: registers start from their reset values."""
        self.powered = on
        self.registers = dict(self._reset_values)
        self.sampled_fs = None
        self._configure()

    def address_match(self, address: int, read: bool) -> bool:
        """Hear an address; a read looks for a new sample."""
        if address != self._address or not self.powered:
            return False
        self._first = not read
        if read:
            self._refresh()
        return True

    def write(self, byte: int) -> bool:
        """Take a sub-address, then register contents."""
        if self._first:
            self._first = False
            self._pointer = byte
        else:
            pointer = self._pointer
            self._store(pointer & self._register_mask, byte)
            self._configure()
            self._pointer = self._following[pointer]
        return True

    def read(self) -> int:
        """Return the register at the sub-address."""
        pointer = self._pointer
        self._pointer = self._following[pointer]
        return self.registers.get(pointer & self._register_mask, 0)

    def stop(self) -> None:
        """Nothing: the sub-address stays."""

    def _store(self, register: int, byte: int) -> None:
        raise NotImplementedError

    def _configure(self) -> None:
        """Work out what the control registers say: the data rate, the scale."""
        raise NotImplementedError

    def _sample(self, now_fs: int) -> None:
        raise NotImplementedError

    def _refresh(self) -> None:
        period = self._period_fs
        now = self._scheduler.now
        if period and (self.sampled_fs is None or now - self.sampled_fs >= period):
            self.sampled_fs = now
            self._sample(now)


class Accelerometer(_Part):
    """Specific force in m/s² along x, y, z: what an accelerometer at rest shows is +g upward."""

    def __init__(
        self,
        scheduler: Scheduler,
        x_m_s2: Quantity,
        y_m_s2: Quantity,
        z_m_s2: Quantity,
        rng: random.Random,
        noise_scale: float = 1.0,
    ) -> None:
        # CTRL_REG1_A resets to 07h: power-down, axes enabled.
        super().__init__(
            ACCELEROMETER_ADDRESS,
            scheduler,
            {CTRL_REG1_A: 0x07, CTRL_REG4_A: 0},
            _ACCELEROMETER_FOLLOWING,
            0x7F,
        )
        self._quantities = (x_m_s2, y_m_s2, z_m_s2)
        self._bias_g = tuple(rng.gauss(0.0, ZERO_G_SIGMA_G) for _ in range(3))
        self._gauss = rng.gauss
        self._noise_scale = noise_scale
        self._configure()

    def _store(self, register: int, byte: int) -> None:
        if 0x20 <= register <= 0x25:
            self.registers[register] = byte

    def _configure(self) -> None:
        control = self.registers[CTRL_REG1_A]
        normal = control >> 5 == 1  # PM = 001; the low-power modes are not used
        rate_hz = ACCELEROMETER_RATES_HZ[control >> 3 & 3] if normal else 0
        self._period_fs = FS_PER_S // rate_hz if rate_hz else 0
        self._noise_g = self._noise_scale * NOISE_DENSITY_G * math.sqrt(rate_hz / 2.0)
        scale = self.registers[CTRL_REG4_A] >> 4 & 3
        self._g_per_lsb = ACCELEROMETER_G_PER_LSB.get(scale, 1.0e-3)

    def _sample(self, now_fs: int) -> None:
        per_lsb, noise_g = self._g_per_lsb, self._noise_g
        registers = self.registers
        gauss = self._gauss
        address = OUT_X_L_A
        for quantity, bias_g in zip(self._quantities, self._bias_g, strict=True):
            g = quantity(now_fs) / STANDARD_GRAVITY_M_S2 + bias_g + gauss(0.0, noise_g)
            code = math.floor(g / per_lsb + 0.5)
            code = -2048 if code < -2048 else min(code, 2047)
            word = code << 4 & 0xFFFF
            registers[address] = word & 0xFF
            registers[address + 1] = word >> 8
            address += 2
        registers[STATUS_REG_A] = 0x0F  # new data on every axis


class Magnetometer(_Part):
    """Magnetic field in tesla along x, y, z, with the hard iron of its surroundings."""

    def __init__(
        self,
        scheduler: Scheduler,
        field_t: Vector,
        rng: random.Random,
        hard_iron_t: tuple[float, float, float] = (0.0, 0.0, 0.0),
        noise_scale: float = 1.0,
    ) -> None:
        # Asleep (MR = 11b) after a reset; identification "H43".
        super().__init__(
            MAGNETOMETER_ADDRESS,
            scheduler,
            {
                CRA_REG_M: 0x10,
                CRB_REG_M: 0x20,
                MR_REG_M: 0x03,
                IRA_REG_M: 0x48,
                IRA_REG_M + 1: 0x34,
                IRA_REG_M + 2: 0x33,
            },
            _MAGNETOMETER_FOLLOWING,
            0xFF,
        )
        self._field = field_t
        self._hard_iron = hard_iron_t
        self._gauss = rng.gauss
        self._noise_gauss = noise_scale * MAGNETIC_NOISE_T / TESLA_PER_GAUSS
        self._configure()

    def _store(self, register: int, byte: int) -> None:
        if register <= MR_REG_M:
            self.registers[register] = byte

    def _configure(self) -> None:
        self._period_fs = 0
        if not self.registers[MR_REG_M] & 3:  # only continuous conversion is modelled
            rate_hz = MAGNETOMETER_RATES_HZ[min(self.registers[CRA_REG_M] >> 2 & 7, 6)]
            self._period_fs = int(FS_PER_S / rate_hz)
        gain = self.registers[CRB_REG_M] >> 5
        xy, z = MAGNETOMETER_LSB_PER_GAUSS.get(gain, (1055, 950))
        self._lsb_per_gauss = (xy, xy, z)

    def _sample(self, now_fs: int) -> None:
        registers = self.registers
        gauss = self._gauss
        address = OUT_X_H_M
        for tesla, iron, lsb in zip(
            self._field(now_fs), self._hard_iron, self._lsb_per_gauss, strict=True
        ):
            value = (tesla + iron) / TESLA_PER_GAUSS + gauss(0.0, self._noise_gauss)
            code = math.floor(value * lsb + 0.5)
            if not -2048 <= code <= 2047:
                code = MAGNETOMETER_OVERFLOW
            registers[address] = code >> 8 & 0xFF
            registers[address + 1] = code & 0xFF
            address += 2
        registers[SR_REG_M] = 0x01  # DRDY
