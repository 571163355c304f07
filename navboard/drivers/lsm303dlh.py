"""LSM303DLH: set it up, read it, turn its bytes into m/s² and a magnetic heading."""

from __future__ import annotations

import math
import struct
from collections.abc import Generator

from navboard.drivers.i2c import I2cDriver, Steps

ACCELEROMETER = 0x18
MAGNETOMETER = 0x1E
_M_S2_PER_LSB = 9.80665e-3  # ±2 g: 1 mg a count of twelve bits
_T_PER_LSB = 1e-4 / 1055  # ±1.3 gauss, X and Y


class Lsm303dlh:
    """Both parts on one bus. `hard_iron_t` is what calibration found, in tesla."""

    def __init__(self, bus: I2cDriver, hard_iron_t: tuple[float, float] = (0.0, 0.0)) -> None:
        self._bus = bus
        self._hard_iron = hard_iron_t

    def set_up(self) -> Steps:
        """Accelerometer: normal mode, 50 Hz, ±2 g. Magnetometer: 30 Hz, ±1.3 gauss.

        Both run at twice the rate at which they are read, so that every reading is a new one.
        """
        yield from self._bus.write_registers(ACCELEROMETER, 0x20, b"\x27")
        yield from self._bus.write_registers(MAGNETOMETER, 0x00, b"\x14\x20\x00")

    def acceleration(self) -> Generator[int, None, tuple[float, float, float]]:
        """Read specific force along x, y, z, m/s²."""
        data = yield from self._bus.read_registers(ACCELEROMETER, 0x28 | 0x80, 6)
        x, y, z = struct.unpack("<hhh", data)  # little-endian, left-aligned in 16 bits
        return (
            (x >> 4) * _M_S2_PER_LSB,
            (y >> 4) * _M_S2_PER_LSB,
            (z >> 4) * _M_S2_PER_LSB,
        )

    def heading(self) -> Generator[int, None, float | None]:
        """Read the magnetic heading: angle of the x axis from north, counter-clockwise, rad.

        The fish swims level, so tilt is left out. None where the field is out of range.
        """
        data = yield from self._bus.read_registers(MAGNETOMETER, 0x03, 6)
        x, y, z = struct.unpack(">hhh", data)
        if -4096 in (x, y, z):
            return None
        return math.atan2(
            -(y * _T_PER_LSB - self._hard_iron[1]), x * _T_PER_LSB - self._hard_iron[0]
        )
