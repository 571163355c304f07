"""A board without its chips reads what it is given, through its own drivers and registers."""

from __future__ import annotations

import itertools
import math
import struct

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US
from firmware_model.trace import Trace
from navboard.board import NavBoard
from navboard.chips.gps18x import Gps18xConfig, framed
from navboard.chips.remote import RemoteChips
from navboard.config import NavConfig, NavInputs
from navboard.sensor_controller import SAMPLE_CHANNELS

COUNTS = {3: 1526, 4: 1600, 5: 868, 6: 3061, 7: 25, 8: 4095, 9: 0}


class Board:
    def __init__(self, **config) -> None:
        self.scheduler = Scheduler()
        self.chips = RemoteChips(self.scheduler)
        self.writes: list[tuple[int, int, int]] = []
        self.pulses: list[tuple[int, int]] = []
        self.samples: list[dict[str, float | None]] = []
        self.chips.on_write = lambda *write: self.writes.append(write)
        self.chips.on_pulse = lambda *pulse: self.pulses.append(pulse)
        for channel, count in COUNTS.items():
            self.chips.counts[channel] = count
        self.rail = Rail(self.scheduler, "3V3", 3.3)
        self.nav = NavBoard(
            self.scheduler,
            Trace(),
            self.rail,
            NavInputs(),
            lambda t, angle: None,
            NavConfig(**config),
            remote=self.chips,
        )
        self.nav.on_sample = lambda t, values: self.samples.append(
            dict(zip(SAMPLE_CHANNELS, values, strict=True))
        )

    def run(self, seconds: float) -> None:
        self.scheduler.run(round(seconds * FS_PER_S))


def latest(samples, name):
    return next(s[name] for s in reversed(samples) if s[name] is not None)


def test_every_count_arrives_in_the_converters_buffers():
    board = Board(tail_potentiometer_fitted=True)
    board.run(0.5)
    inputs = [3, 4, 5, 6, 7, 8, 9]
    assert board.nav.analog_inputs == sum(1 << place for place in inputs)
    scan = board.nav.firmware.scan
    whole = {place: register.value for place, register in scan.buffers(True).items()}
    while not scan.whole:  # the slow inputs are in one scan of five
        board.run(board.scheduler.now / FS_PER_S + 0.02)
    whole = {place: register.value for place, register in scan.buffers(True).items()}
    assert whole == COUNTS
    # And through its drivers, by the data sheet: 0.5 V + 10 mV/°C at 3.3 V / 4096 a count.
    celsius = ((868 + 0.5) * 3.3 / 4096 - 0.5) / 0.010
    assert math.isclose(latest(board.samples, "temperature_c"), celsius, rel_tol=1e-9)


def test_all_counts_survive_any_reference():
    """Also where the supply sags: the middle of a count is half a count from its neighbours."""
    chips = RemoteChips(Scheduler())
    for volts in (3.3, 3.0, 2.71):
        rail = Rail(Scheduler(), "x", volts)
        look = chips.volts(3, rail.volts)
        for count in range(4096):
            chips.counts[3] = count
            assert int(look(0) / volts * 4096) == count


def test_registers_are_read_over_the_bus_and_writes_come_out():
    board = Board()
    x, y, z = -0.25, 0.5, 1.0  # g, at 1 mg a count of twelve bits, left-aligned, little-endian
    words = struct.pack("<hhh", *(round(1000 * g) << 4 for g in (x, y, z)))
    board.chips.accelerometer.fill(b"\x0f" + words)
    # 0.185 gauss along −y: north is to the right, so the heading is +90°.
    board.chips.magnetometer.fill(struct.pack(">hhh", 0, round(-0.185 * 1055), -500) + b"\x01")
    board.run(0.5)
    for axis, g in zip("xyz", (x, y, z), strict=True):
        measured = latest(board.samples, f"accel_{axis}_m_s2")
        assert math.isclose(measured, g * 9.80665, rel_tol=1e-6)
    assert math.isclose(latest(board.samples, "compass_rad"), math.pi / 2, abs_tol=1e-6)
    # DS: CTRL_REG1_A 0x27 (normal, 50 Hz), CRA 0x14 (30 Hz), CRB 0x20 (±1.3 gauss), MR 0x00.
    assert board.writes == [
        (0x18, 0x20, 0x27), (0x1E, 0x00, 0x14), (0x1E, 0x01, 0x20), (0x1E, 0x02, 0x00),
    ]  # fmt: skip


def test_without_an_answer_the_firmware_notices_and_sets_up_again():
    board = Board()
    board.run(0.5)
    board.chips.accelerometer.powered = False
    board.run(1.0)
    assert board.samples[-1]["accel_x_m_s2"] is None
    before = len(board.writes)
    board.chips.accelerometer.powered = True
    board.run(4.0)
    assert len(board.writes) > before
    assert latest(board.samples[-10:], "accel_z_m_s2") is not None


def test_characters_reach_the_uart_and_pulses_the_pin():
    board = Board(gps=Gps18xConfig())
    body = "GPRMC,120001,A,4243.5940,N,08428.7580,W,000.5,090.0,010514,000.0,E"
    fix = "GPGGA,120001,4243.5940,N,08428.7580,W,1,08,1.1,260.0,M,-34.0,M,,"
    at_fs = 500 * FS_PER_MS
    for character in (framed(body) + framed(fix)).encode():
        board.scheduler.at(at_fs, lambda c=character: board.chips.gps.character(c))
        at_fs += FS_PER_S // 480
    levels = []
    board.chips.gps.pps.watch(levels.append)
    board.scheduler.at(300 * FS_PER_MS, lambda: board.chips.gps.pulse(True))
    board.scheduler.at(310 * FS_PER_MS, lambda: board.chips.gps.pulse(False))
    board.run(1.5)
    # 0.1 minutes north of the reference, of 1852 m (mean) to within the ellipsoid's half percent.
    assert math.isclose(latest(board.samples, "gps_x_m"), 185.2, rel_tol=0.005)
    assert math.isclose(latest(board.samples, "gps_y_m"), 0.0, abs_tol=0.1)
    assert levels == [True, False]
    assert board.nav.mcu.uart2.overruns == 0


def test_pulses_are_measured_at_the_pin():
    board = Board()
    board.run(0.5)
    assert len(board.pulses) > 15
    rises = [rise for rise, _ in board.pulses]
    steps = {later - earlier for earlier, later in itertools.pairwise(rises)}
    assert max(abs(step - 20 * FS_PER_MS) for step in steps) < FS_PER_US  # 50 Hz by Timer2
    assert all(abs(width - 1500 * FS_PER_US) < FS_PER_US for _, width in board.pulses)


def test_without_supply_nothing_is_heard():
    board = Board(gps=Gps18xConfig())
    board.run(0.3)
    heard = []
    board.chips.gps.listener = heard.append
    board.chips.gps.character(65)
    board.rail.set_volts(0.0)
    board.chips.gps.character(66)
    board.chips.gps.pulse(True)
    assert heard == [65]
    assert not board.chips.gps.pps.value
    assert not board.chips.accelerometer.address_match(0x18, True)


def test_contents_that_come_during_a_read_wait_for_the_next():
    """Else the bytes of two samples would make a third that nobody sent."""
    part = RemoteChips(Scheduler()).magnetometer
    part.fill(bytes((1, 2, 3, 4, 5, 6, 1)))
    part.address_match(0x1E, False)
    part.write(0x03)
    part.address_match(0x1E, True)
    first = [part.read() for _ in range(3)]
    part.fill(bytes((11, 12, 13, 14, 15, 16, 1)))
    assert first + [part.read() for _ in range(3)] == [1, 2, 3, 4, 5, 6]
    part.address_match(0x1E, True)
    assert [part.read() for _ in range(6)] == [11, 12, 13, 14, 15, 16]
