"""A plant in the loop, in a time that the tests move: what it sends, takes and says of itself."""

from __future__ import annotations

import itertools
import math
import random
import struct

import msgspec
import numpy as np
import pytest

from firmware_model.time import FS_PER_MS, FS_PER_S
from navboard.drivers.analog import gyro_rad_s
from navboard.sensor_controller import SAMPLE_CHANNELS
from spi_bus.link import MessageReceived, Role, StreamReceived
from spi_bus.plant_messages import (
    PLANT_VERSION,
    BoardGreeting,
    HostGreeting,
    RegisterWrite,
    SampleStatus,
    SensorSample,
    ServoPulse,
)
from tests.tools import plant_world
from tools.bench import Bench
from tools.bench.plant_line import PlantLine
from tools.bench.plant_rate import check_line, most_rate_hz
from tools.bench.plant_records import beat_frequency_hz
from tools.errors import ScenarioError

GPS = "navboard.gps.fitted=true"
DRIFT = "navboard.clock_drift_ppm=3000"
GREETING = BoardGreeting(PLANT_VERSION, 1000, 0x01F8, False)


class Scripted:
    """A rig, and a board that does what a test tells it."""

    def __init__(self, *sets: str, rate_hz: float = 100.0) -> None:
        self.time = plant_world.Time()
        here, self.there = plant_world.wires(self.time)
        config = plant_world.configured("swim-forward", *sets, rate_hz=rate_hz)
        self.rig = plant_world.make_rig(config, here, self.time)
        self.samples: list[SensorSample] = []
        self.messages: list[object] = []
        self.pulses = 0
        self.boot(2)

    def boot(self, epoch: int) -> None:
        self.line = PlantLine(self.there, Role.SLAVE, epoch, self.time)
        self.pulses = 0

    def run(self, seconds: float, each_ms=lambda: None) -> None:
        end_fs = self.rig.scheduler.now + round(seconds * FS_PER_S)
        while self.rig.scheduler.now < end_fs and not self.rig.stops:
            self.rig.scheduler.run(self.rig.scheduler.now + FS_PER_MS)
            self.line.poll()
            while self.line.events:
                match self.line.events.popleft()[1]:
                    case StreamReceived(message):
                        self.samples.append(message)
                    case MessageReceived(message):
                        self.messages.append(message)
            each_ms()

    def greet(self, greeting: BoardGreeting = GREETING) -> None:
        self.run(0.02)
        self.line.send(greeting)
        self.run(0.02)

    def pulse(self, width_s: float, *, number: int | None = None) -> None:
        self.pulses = self.pulses + 1 if number is None else number
        now_us = round(1e6 * (self.time.now_s - 1000.0))
        sample = self.samples[-1].number if self.samples else 0
        self.line.send_newest(ServoPulse(self.pulses, now_us, width_s, sample, 0))


@pytest.fixture
def scripted():
    return Scripted


# --- both ends ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swum():
    """Five seconds of swimming forward with both emulated boards at the far end, and a GPS."""
    config = plant_world.configured("swim-forward", GPS, DRIFT, duration_s=5.0)
    world = plant_world.World(config)
    world.sent = {}
    send = world.rig.line.send_newest

    def sending(sample: SensorSample) -> None:
        world.sent[sample.number] = sample
        send(sample)

    world.rig.line.send_newest = sending
    world.heard = []
    world.characters = []
    nav = world.board.bench.robot.nav
    nav.on_sample = lambda t, values: world.heard.append(
        dict(zip(SAMPLE_CHANNELS, values, strict=True))
    )
    listener = nav.gps.listener

    def hear(character: int) -> None:
        world.characters.append((world.board.scheduler.now, character))
        listener(character)

    nav.gps.listener = hear
    world.run(5.0)
    world.data = world.rig.run_data()
    return world


def test_the_fish_swims_as_in_the_plain_emulation(swum):
    plain = Bench.from_scenario(plant_world.configured("swim-forward", duration_s=5.0))
    plain.run(lambda seconds: None, lambda: False)
    expected = plain.run_data(compare=False).truth
    truth = swum.data.truth
    assert truth["time_s"].shape == expected["time_s"].shape
    # Commands reach the tail later by the boards' start and the line: a few hundredths of a second.
    assert truth["x_m"][-1] == pytest.approx(expected["x_m"][-1], rel=0.05)
    assert truth["x_m"][-1] > 0.02
    assert abs(truth["y_m"][-1] - expected["y_m"][-1]) < 0.002
    swing = np.ptp(truth["tail_angle_rad"][truth["time_s"] > 3.0])
    assert swing == pytest.approx(
        np.ptp(expected["tail_angle_rad"][expected["time_s"] > 3.0]), rel=0.02
    )


def test_every_sample_arrives_and_the_board_reads_the_counts_that_were_sent(swum):
    told = swum.data.hil
    assert told["samples"]["sent"] == len(swum.sent) > 450
    assert told["samples"]["skipped"] == told["samples"]["replaced"] == 0
    port = swum.board.port
    assert port.samples >= len(swum.sent) - 1  # one may be on its way
    assert port.missing == port.repeated == port.stalls == 0
    sent = {gyro_rad_s(sample.an3, sample.an4) for sample in swum.sent.values()}
    read = [values["gyro_z_rad_s"] for values in swum.heard if values["gyro_z_rad_s"] is not None]
    after = [rate for rate in read[5:] if rate not in sent]
    assert len(read) > 200
    assert not after
    assert len(set(read)) > 50, "and they change"


def test_registers_go_one_way_and_what_the_driver_wrote_the_other(swum):
    assert swum.rig.figures.registers_written == 4
    assert swum.rig.signals.accelerometer.registers[0x20] == 0x27
    assert swum.rig.signals.magnetometer.registers[0x02] == 0x00
    words = {struct.unpack("<hhh", sample.accelerometer[1:]) for sample in swum.sent.values()}
    fills = sum(bool(s.status & SampleStatus.ACCELEROMETER_NEW) for s in swum.sent.values())
    sent = {(x >> 4) * 9.80665e-3 for x, _, _ in words}
    read = {v["accel_x_m_s2"] for v in swum.heard if v["accel_x_m_s2"] is not None}
    assert fills > 220  # 50 Hz
    assert len(read - {0.0}) > 2
    assert read - {0.0} <= sent
    compass = {v["compass_rad"] for v in swum.heard if v["compass_rad"] is not None} - {0.0}
    assert len(compass) > 10
    # The driver scales to tesla before it takes the angle: one unit in the last place.
    told = swum.data.channels["compass_rad"].value
    assert max(np.min(np.abs(told - angle)) for angle in compass) < 1e-12


def test_characters_of_the_gps_come_at_their_times(swum):
    """150 ms after the second, 9.5 bits until complete, then a character every ten bits."""
    text = bytes(character for _, character in swum.characters)
    assert text.count(b"$GPRMC") == text.count(b"$GPGGA") >= 3
    assert swum.board.port.characters_late == 0
    starts = [t for t, c in swum.characters if c == ord("$")][::2]
    for at_fs in starts:
        late_fs = (at_fs - 150 * FS_PER_MS - 19 * FS_PER_S // 9600) % FS_PER_S
        late_fs -= FS_PER_S * (late_fs > FS_PER_S // 2)
        # The line's quickest way, and a turn of this test, by which the board's clock is behind.
        assert -1.1 * FS_PER_MS < late_fs < 4 * FS_PER_MS
    gaps = [b - a for (a, _), (b, _) in itertools.pairwise(swum.characters)]
    assert min(gaps) == FS_PER_S // 480
    fixes = {v["gps_x_m"] for v in swum.heard if v["gps_x_m"] is not None}
    assert fixes
    assert fixes <= set(swum.data.channels["gps_x_m"].value.tolist())


def test_a_late_board_takes_nothing_off_the_round_trip():
    """It makes up for 40 ms at once: by its own time samples are old that came just now."""
    config = plant_world.configured("swim-forward", duration_s=2.0)
    world = plant_world.World(config, turn_fs=40 * FS_PER_MS)
    world.board.scheduler.run(0)  # its time begins before the rig's first turn
    world.run(2.0)
    figures = world.rig.figures
    assert figures.round_trip.count > 10
    assert figures.round_trip.minimum_s > 0.00099  # the wire, both ways


def test_times_are_those_of_the_wire(swum):
    """Half a millisecond each way, and the test's own millisecond between the two sides' turns."""
    told = swum.data.hil
    assert told["round_trip"]["count"] == told["pulses"]["received"] > 200
    assert 0.0009 < told["round_trip"]["median_s"] <= told["round_trip"]["maximum_s"] < 0.0035
    assert told["sample_age"]["maximum_s"] < 0.0125
    clock = told["clock"]
    assert clock["drift_ppm"] == pytest.approx(3000, abs=3 * clock["drift_uncertainty_ppm"])
    assert told["pulses"] == {
        "received": told["pulses"]["received"], "missing": 0, "repeated": 0, "ignored": 0,
    }  # fmt: skip
    assert told["connected"]
    assert told["diagnosis"] == ""


def test_channels_are_readings_and_commands(swum):
    channels = swum.data.channels
    assert {"gyro_z_rad_s", "accel_x_m_s2", "compass_rad", "tail_command_rad", "x_m"} <= set(
        channels
    )
    gyro, truth = channels["gyro_z_rad_s"], swum.data.truth
    true = np.interp(gyro.time_s, truth["time_s"], truth["yaw_rate_rad_s"])
    bias = float(np.mean(gyro.value - true))
    assert abs(bias) < 0.06  # 0.5 °/s sigma, drawn
    assert np.std(gyro.value - true - bias) < 0.05
    assert np.ptp(channels["tail_command_rad"].value) == pytest.approx(
        2 * math.radians(15), rel=0.02
    )
    assert swum.data.beat_frequency_hz == pytest.approx(0.9, rel=0.02)
    assert "tail_bias_rad" not in channels, "nobody told it"


def test_a_bad_line_loses_samples_and_nothing_else():
    """One chunk in ten vanishes and one in twenty is damaged, both ways."""
    config = plant_world.configured("swim-forward", GPS, duration_s=4.0)
    world = plant_world.World(config)
    rng = random.Random(5)

    def damage(data: bytes) -> bytes:
        draw = rng.random()
        if draw < 0.1:
            return b""
        if draw < 0.15:
            place = rng.randrange(len(data))
            return data[:place] + bytes((data[place] ^ 1 << rng.randrange(8),)) + data[place + 1 :]
        return data

    world.here.damage = world.there.damage = damage
    world.run(4.0)
    world.here.damage = world.there.damage = lambda data: data
    world.run(4.6)
    rig, port = world.rig, world.board.port
    assert port.missing > 20
    assert rig.figures.pulses_missing > 10
    assert port.repeated == rig.figures.pulses_repeated == 0
    assert rig.figures.sent - port.samples - port.missing <= 1
    # What has to arrive arrived, in spite of it.
    for part, far in (
        (rig.signals.accelerometer, world.board.port.chips.accelerometer),
        (rig.signals.magnetometer, world.board.port.chips.magnetometer),
    ):
        for register in (0x00, 0x01, 0x02, 0x20):
            assert part.registers.get(register) == far.registers.get(register)
    assert rig.figures.characters == port.characters > 300
    assert rig.swimmer.vehicle.x(rig.scheduler.now) > 0.01


# --- a board by the script ---------------------------------------------------------------


def test_counts_are_those_of_twelve_bits_over_3_3_volts(scripted):
    world = scripted("navboard.gyro.bias_rad_s=0.0")
    world.greet()
    world.run(1.0)
    # A fish at rest: the gyro's zero-rate level, 1.23 V (LPY503AL), by 3.3 V / 4096 a count.
    still = np.mean([sample.an3 for sample in world.samples])
    assert still == pytest.approx(1.23 / 3.3 * 4096, abs=8)


def test_samples_begin_when_the_board_has_greeted(scripted):
    world = scripted()
    world.run(0.2)
    assert world.samples == world.messages == []
    assert "no BoardGreeting came" in world.rig.diagnosis()
    world.greet()
    assert world.messages == [HostGreeting(PLANT_VERSION, 10_000, 100_000)]
    world.run(0.5)
    numbers = [sample.number for sample in world.samples]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) == pytest.approx(52, abs=2)
    # A sample is of the moment that its stamp says: origin + n periods, whenever it was taken.
    assert all(s.host_time_us == (s.number - 1) * 10_000 for s in world.samples)
    assert all(s.status & SampleStatus.SUPPLY_ON for s in world.samples)
    assert [place for place, count in enumerate(world.samples[0].counts) if count is not None] == [
        3, 4, 5, 6, 7, 8,
    ]  # fmt: skip
    assert world.rig.diagnosis() == ""


def test_a_rate_that_is_no_divisor_keeps_its_count(scripted):
    world = scripted(rate_hz=333.3)
    world.greet()
    world.run(1.0)
    stamps = {s.number: s.host_time_us for s in world.samples}
    assert all(abs(at - (n - 1) * 1e6 / 333.3) < 1.0 for n, at in stamps.items())


def test_who_is_late_by_a_period_leaves_samples_out_and_says_so(scripted):
    world = scripted()
    world.greet()
    world.run(0.1)
    before = len(world.samples)
    world.time.now_s += 0.0552  # the machine was elsewhere
    world.run(0.1)
    numbers = [s.number for s in world.samples[before - 1 :]]
    assert world.rig.figures.skipped in (4, 5)
    assert numbers[1] - numbers[0] == world.rig.figures.skipped + 1
    assert numbers[1:] == list(range(numbers[1], numbers[1] + len(numbers) - 1))
    assert world.samples[before].status & SampleStatus.LATE or numbers[1] - numbers[0] == 5
    assert world.rig.scheduler.lateness_s.maximum_s > 0.05


def test_pulses_move_the_servo_and_their_end_lets_it_go(scripted):
    world = scripted()
    world.greet()
    for _ in range(15):
        world.pulse(0.0018)  # 300 µs from the middle: 30° of 600 µs for 60°
        world.run(0.02)
    vehicle = world.rig.swimmer.vehicle
    assert world.rig.servo.target_rad == pytest.approx(math.radians(30), abs=1e-6)
    assert vehicle.tail_angle(world.rig.scheduler.now) == pytest.approx(math.radians(30), abs=0.01)
    world.run(0.2)
    assert world.rig.servo.target_rad is None
    assert any("lets go" in event.what for event in world.rig.run_data().events)
    world.pulse(0.0050)  # none of a servo's
    world.pulse(0.0050)
    world.run(0.02)
    assert world.rig.servo.target_rad is None
    assert world.rig.summary()["pulses"]["ignored"] == 2


def test_a_pulse_that_comes_twice_counts_once_and_gaps_are_counted(scripted):
    world = scripted()
    world.greet()
    for number in (1, 2, 2, 5, 4, 6):
        world.pulse(0.0015, number=number)
        world.run(0.02)
    told = world.rig.summary()["pulses"]
    assert (told["received"], told["missing"], told["repeated"]) == (4, 2, 2)


def test_a_board_that_resets_greets_again(scripted):
    world = scripted()
    world.greet()
    world.run(0.1)
    world.boot(3)
    world.run(0.3)
    count = len(world.samples)
    assert world.rig.figures.board_resets == 1
    world.run(0.1)
    assert len(world.samples) == count, "not before it has greeted"
    world.greet()
    world.pulse(0.0015)
    world.run(0.1)
    assert len(world.samples) > count + 5
    assert world.rig.figures.pulses_repeated == 0, "its numbers begin anew"


@pytest.mark.parametrize(
    ("greeting", "says"),
    [
        (BoardGreeting(PLANT_VERSION + 1, 1000, 0, False), "speaks version 2"),
        (BoardGreeting(PLANT_VERSION, 50, 0, False), "at most 50 samples a second, not 100"),
    ],
)
def test_a_board_that_does_not_fit_ends_the_run_in_one_line(scripted, greeting, says):
    world = scripted()
    world.greet(greeting)
    world.run(0.1)
    assert world.rig.stops
    assert says in world.rig.diagnosis()
    assert "\n" not in world.rig.diagnosis()
    assert world.samples == []


def test_full_scale_and_data_rate_are_the_boards_choice(scripted):
    world = scripted()
    world.greet()
    world.run(0.1)
    assert world.samples[-1].accelerometer == bytes(7), "power-down after a reset"
    world.line.send(RegisterWrite(0x18, 0x23, 0x30))  # CTRL_REG4_A: ±8 g, 3.9 mg a count
    world.line.send(RegisterWrite(0x18, 0x20, 0x3F))  # 1 kHz
    world.line.send(RegisterWrite(0x55, 0x00, 0xFF))  # nobody is there
    world.run(0.3)
    z = struct.unpack("<h", world.samples[-1].accelerometer[5:])[0] >> 4
    assert z == pytest.approx(1 / 3.9e-3, abs=12)
    assert all(s.status & SampleStatus.ACCELEROMETER_NEW for s in world.samples[-10:])
    assert not any(s.status & SampleStatus.MAGNETOMETER_NEW for s in world.samples)
    readings = world.rig.signals.readings(10.0)
    assert readings["accel_z_m_s2"].value[-1] == pytest.approx(9.80665, abs=0.4)
    assert "compass_rad" not in readings


def test_without_supply_counts_are_zero_and_it_says_so(scripted):
    world = scripted()
    world.greet()
    world.rig.swimmer.power.cut()
    world.run(0.1)
    assert not world.samples[-1].status & SampleStatus.SUPPLY_ON
    assert set(world.samples[-1].counts) == {0, None}
    world.rig.swimmer.power.restore()
    world.run(0.1)
    assert world.samples[-1].status & SampleStatus.SUPPLY_ON
    assert world.samples[-1].an3 > 1000


# --- figures -----------------------------------------------------------------------------


def test_the_beat_is_found_in_the_commands():
    def beat(frequency_hz: float, bias: float, amplitude: float):
        return [
            (k / 50, bias + amplitude * math.sin(2 * math.pi * frequency_hz * k / 50))
            for k in range(500)
        ]

    assert beat_frequency_hz(beat(0.9, 0.3, 0.2)) == pytest.approx(0.9, rel=1e-3)
    assert beat_frequency_hz(beat(2.3, -0.1, 0.2)) == pytest.approx(2.3, rel=1e-3)
    assert beat_frequency_hz(beat(0.9, 0.3, 0.002)) == 0.0
    assert beat_frequency_hz([]) == 0.0


@pytest.mark.parametrize(
    ("url", "rate_hz", "gps", "says"),
    [
        ("serial:///dev/x?baud=9600", 100.0, False, "--rate 12 or a line of 115200 baud"),
        ("serial:///dev/x?baud=115200", 400.0, False, "--rate 150 or a line of 460800 baud"),
        ("serial:///dev/x?baud=1200", 100.0, False, "use a line of 115200 baud"),
        ("can://slcan/x?tx=1&rx=2&bitrate=125000", 100.0, False, "not fit a line of 125000 bit/s"),
    ],
)
def test_a_rate_that_the_line_does_not_carry_is_refused(url, rate_hz, gps, says):
    with pytest.raises(ScenarioError, match="plant_rate_hz") as refused:
        check_line(url, rate_hz, gps=gps)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_fits_fits_with_a_tenth_to_spare():
    check_line("serial:///dev/x?baud=115200", 100.0, gps=True)
    check_line("pty:", 1000.0, gps=True)
    from spi_bus.transports.capacity import LineSpeed

    most = most_rate_hz(LineSpeed(115_200), gps=False)
    assert most * 690 == pytest.approx(0.9 * 115_200)  # 69 bytes of ten bits
    assert most_rate_hz(LineSpeed(115_200), gps=True) < most


def test_an_ideal_servo_takes_no_pulses():
    from tools.bench.plant_rig import PlantRig

    config = plant_world.configured("wang2014")
    hil = msgspec.structs.replace(config.hil, plant_for="pty:")
    with pytest.raises(ScenarioError, match=r"plant\.servo\.ideal"):
        PlantRig.from_scenario(msgspec.structs.replace(config, hil=hil))
