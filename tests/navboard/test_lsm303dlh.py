"""LSM303DLH: the conversation on the bus byte by byte, formats, ranges, data rates, the driver."""

from __future__ import annotations

import math
import random
import struct

import pytest

from firmware_model.dspic30f.mcu import DsPic30F6014A
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_MS
from firmware_model.wires import I2cBus
from navboard.chips.lsm303dlh import (
    MAGNETOMETER_LSB_PER_GAUSS,
    Accelerometer,
    Magnetometer,
    earth_field,
)
from navboard.drivers.i2c import I2cDriver
from navboard.drivers.lsm303dlh import Lsm303dlh
from navboard.errors import BusError

G = 9.80665


def accelerometer(x=0.0, y=0.0, z=G, noise=0.0):
    scheduler = Scheduler()
    chip = Accelerometer(scheduler, constant(x), constant(y), constant(z), random.Random(1), noise)
    chip._bias_g = (0.0, 0.0, 0.0)
    return scheduler, chip


def magnetometer(field, noise=0.0, iron=(0.0, 0.0, 0.0)):
    scheduler = Scheduler()
    return scheduler, Magnetometer(scheduler, lambda t: field, random.Random(1), iron, noise)


def write(chip, address, register, *values):
    assert chip.address_match(address, False)
    for byte in (register, *values):
        assert chip.write(byte)
    chip.stop()


def read(chip, address, register, count):
    assert chip.address_match(address, False)
    assert chip.write(register)
    assert chip.address_match(address, True)
    data = bytes(chip.read() for _ in range(count))
    chip.stop()
    return data


def test_accelerometer_is_little_endian_left_aligned_with_auto_increment():
    _s, chip = accelerometer(x=G, y=-0.5 * G, z=0.25 * G)
    write(chip, 0x18, 0x20, 0x27)
    data = read(chip, 0x18, 0x28 | 0x80, 6)
    assert struct.unpack("<hhh", data) == (1000 << 4, -500 << 4, 250 << 4)
    assert data[0] & 0x0F == 0


def test_accelerometer_without_auto_increment_repeats_the_register():
    _s, chip = accelerometer(x=G)
    write(chip, 0x18, 0x20, 0x27)
    data = read(chip, 0x18, 0x29, 3)
    assert data == bytes([0x3E] * 3)  # high byte of 1000 << 4


@pytest.mark.parametrize(("fs", "mg"), [(0, 1.0), (1, 2.0), (3, 3.9)])
def test_accelerometer_ranges(fs, mg):
    _s, chip = accelerometer(x=1.9 * G)
    write(chip, 0x18, 0x20, 0x27)
    write(chip, 0x18, 0x23, fs << 4)
    (x,) = struct.unpack("<h", read(chip, 0x18, 0xA8, 2))
    assert (x >> 4) * mg == pytest.approx(1900, abs=mg)


def test_accelerometer_clips_at_its_range():
    _s, chip = accelerometer(x=5 * G)
    write(chip, 0x18, 0x20, 0x27)
    assert struct.unpack("<h", read(chip, 0x18, 0xA8, 2))[0] >> 4 == 2047


def test_accelerometer_gives_a_new_sample_once_a_data_period():
    scheduler = Scheduler()
    chip = Accelerometer(
        scheduler, lambda t: t / 1e15, constant(0), constant(0), random.Random(1), 0.0
    )
    write(chip, 0x18, 0x20, 0x27)  # 50 Hz
    first = read(chip, 0x18, 0xA8, 6)
    scheduler.run(19 * FS_PER_MS)
    assert read(chip, 0x18, 0xA8, 6) == first
    scheduler.run(2000 * FS_PER_MS)
    assert read(chip, 0x18, 0xA8, 6) != first


def test_accelerometer_noise_is_218_micro_g_per_root_hertz():
    scheduler, chip = accelerometer(noise=1.0)
    write(chip, 0x18, 0x20, 0x27)
    values = []
    for k in range(2000):
        scheduler.run(k * 20 * FS_PER_MS)
        values.append((struct.unpack("<h", read(chip, 0x18, 0xA8, 2))[0] >> 4) * 1e-3)
    m = sum(values) / len(values)
    rms = math.sqrt(sum((v - m) ** 2 for v in values) / len(values))
    expected = math.hypot(218e-6 * 5.0, 1e-3 / math.sqrt(12))  # 25 Hz, and rounding to 1 mg
    assert rms == pytest.approx(expected, rel=0.06)


def test_in_power_down_nothing_is_measured():
    _s, chip = accelerometer(x=G)
    assert read(chip, 0x18, 0xA8, 6) == bytes(6)


def test_foreign_addresses_are_not_acknowledged():
    _s, chip = accelerometer()
    assert not chip.address_match(0x19, False)
    assert not chip.address_match(0x1E, True)


@pytest.mark.parametrize("gain", sorted(MAGNETOMETER_LSB_PER_GAUSS))
def test_magnetometer_is_big_endian_xyz_with_the_gains_of_the_dlh(gain):
    _s, chip = magnetometer((0.3e-4, -0.2e-4, -0.5e-4))
    write(chip, 0x1E, 0x00, 0x10, gain << 5, 0x00)
    x, y, z = struct.unpack(">hhh", read(chip, 0x1E, 0x03, 6))
    xy, lsb_z = {
        1: (1055, 950),
        2: (795, 710),
        3: (635, 570),
        4: (430, 385),
        5: (375, 335),
        6: (320, 285),
        7: (230, 205),
    }[gain]
    assert (x, y, z) == tuple(math.floor(v + 0.5) for v in (0.3 * xy, -0.2 * xy, -0.5 * lsb_z))


def test_magnetometer_sleeps_after_power_up_and_says_who_it_is():
    _s, chip = magnetometer((0.3e-4, 0.0, 0.0))
    assert read(chip, 0x1E, 0x03, 6) == bytes(6)
    assert read(chip, 0x1E, 0x0A, 3) == b"H43"


def test_magnetometer_output_registers_wrap_round():
    _s, chip = magnetometer((0.3e-4, -0.2e-4, -0.5e-4))
    write(chip, 0x1E, 0x00, 0x10, 0x20, 0x00)
    data = read(chip, 0x1E, 0x03, 8)
    assert data[6:8] == data[0:2]


def test_magnetometer_overflow_is_minus_4096():
    _s, chip = magnetometer((2.5e-4, 0.0, 0.0))
    write(chip, 0x1E, 0x00, 0x10, 0x20, 0x00)
    assert struct.unpack(">h", read(chip, 0x1E, 0x03, 2))[0] == -4096


@pytest.mark.parametrize("heading", [-3.0, -1.0, 0.0, 0.7, 2.0])
@pytest.mark.parametrize("north", [0.0, 1.2])
def test_earth_field_points_north_in_body_axes(heading, north):
    x, y, z = earth_field(constant(heading), north)(0)
    assert math.hypot(x, y) == pytest.approx(18.5e-6)
    assert z == pytest.approx(-50e-6)
    # Turning the body axes by the heading gives the direction of north in the tank.
    assert math.remainder(math.atan2(y, x) + heading - north, 2 * math.pi) == pytest.approx(0.0)


# --- the driver, on the emulated bus and registers ---------------------------------------


class Spy:
    """Puts down what goes over the bus, in front of the chips."""

    def __init__(self, *targets):
        self._targets = targets
        self._at = None
        self.log = []

    def address_match(self, address, read):
        self.log.append(f"{'R' if read else 'W'}{address:02X}")
        self._at = next((t for t in self._targets if t.address_match(address, read)), None)
        return self._at is not None

    def write(self, byte):
        self.log.append(f"{byte:02X}")
        return self._at.write(byte)

    def read(self):
        byte = self._at.read()
        self.log.append(f"({byte:02X})")
        return byte

    def stop(self):
        self.log.append("P")


def run_driver(script, *, heading=0.5, absent=False):
    """Run a driver script as the only task of an MCU; return its result, the log, seconds."""
    scheduler = Scheduler()
    result = []
    acc = Accelerometer(
        scheduler, constant(1.0), constant(-2.0), constant(G), random.Random(1), 0.0
    )
    mag = Magnetometer(scheduler, earth_field(constant(heading)), random.Random(1), noise_scale=0)
    spy = Spy() if absent else Spy(acc, mag)

    def firmware(mcu):
        imu = Lsm303dlh(I2cDriver(mcu))

        def task():
            start = scheduler.now
            try:
                value = yield from script(imu)
            except BusError as error:
                value = error
            result.append((value, (scheduler.now - start) / 1e15))

        mcu.i2c.bus = I2cBus((spy,))
        mcu.cpu.spawn("imu", task())

    DsPic30F6014A("nav", scheduler, Rail(scheduler, "3V3", 3.3), firmware)
    scheduler.run(200 * FS_PER_MS)
    return (*result[0], spy.log)


def test_driver_conversation_byte_by_byte():
    def script(imu):
        yield from imu.set_up()
        return (yield from imu.acceleration())

    (x, y, z), _seconds, log = run_driver(script)
    assert log[:9] == ["W18", "20", "27", "P", "W1E", "00", "14", "20", "00"]
    assert log[9:13] == ["P", "W18", "A8", "R18"]
    assert len(log) == 13 + 6 + 1
    assert log[-1] == "P"
    assert (x, y, z) == pytest.approx((1.0, -2.0, G), abs=0.3)  # zero-g offsets


def test_driver_reads_six_bytes_in_a_quarter_of_a_millisecond():
    def script(imu):
        return (yield from imu.acceleration())

    _value, seconds, _log = run_driver(script)
    bits = 4 * 9 + 6 * 9 + 3  # addresses and sub-address, data with acknowledge, S, Sr, P
    assert bits * 2.5e-6 < seconds < 1.25 * bits * 2.5e-6


@pytest.mark.parametrize("heading", [-2.5, -0.4, 0.0, 1.3, 3.0])
def test_driver_finds_the_heading(heading):
    def script(imu):
        yield from imu.set_up()
        return (yield from imu.heading())

    value, _seconds, _log = run_driver(script, heading=heading)
    assert value == pytest.approx(heading, abs=0.006)  # one count in 195 of the horizontal field


def test_driver_frees_the_bus_when_nobody_answers():
    def script(imu):
        return (yield from imu.acceleration())

    value, _seconds, log = run_driver(script, absent=True)
    assert isinstance(value, BusError)
    assert log == ["W18"]
