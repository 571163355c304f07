"""The whole board: start-up, samples, reports, commands, fail-safe, resets, faults, determinism."""

from __future__ import annotations

import itertools
import math

import pytest

from firmware_model.dspic30f.eeprom import blank_eeprom
from navboard.chips.gps18x import Gps18xConfig
from navboard.config import NavConfig, NavInputs
from navboard.drivers.reset_counter import keep_count
from navboard.sensor_controller import SAMPLE_CHANNELS
from navboard.sensors import SENSORS
from spi_bus.messages import (
    BoardEvent,
    BoardEventCode,
    CommandApplied,
    GpsReport,
    Ping,
    Pong,
    SensorReport,
    SetReporting,
    TailBeat,
)

BEAT = TailBeat(7, 0.2, 0.26, 0.9, 1.0)


def column(robot, name):
    index = SAMPLE_CHANNELS.index(name)
    return [values[index] for _t, values in robot.samples]


def events(robot, code):
    return [m for m in robot.master.of(BoardEvent) if m.code == code]


# --- samples and reports -----------------------------------------------------------------


def test_reports_carry_what_the_instruments_see(robot):
    inputs = NavInputs(
        gyro_z_rad_s=lambda t: 0.3,
        accel_x_m_s2=lambda t: 0.2,
        accel_y_m_s2=lambda t: -0.1,
        heading_rad=lambda t: 0.3 * t / 1e15,
        temperature_c=lambda t: 17.0,
        battery_v=lambda t: 7.7,
        servo_current_a=lambda t: 0.25,
        water_quality_ug_l=lambda t: 42.0,
    )
    r = robot(inputs)
    r.run(3.0)
    reports = r.master.of(SensorReport)
    assert 26 <= len(reports) <= 30
    assert [b.sequence - a.sequence for a, b in itertools.pairwise(reports)].count(1)
    last = reports[-1]
    assert last.gyro_z_rad_s == pytest.approx(0.3, abs=0.04)
    assert last.accel_x_m_s2 == pytest.approx(0.2, abs=0.3)
    assert last.accel_z_m_s2 == pytest.approx(9.81, abs=0.3)
    assert last.heading_rad == pytest.approx(0.3 * last.time_us / 1e6 + 0.3 * 0.064, abs=0.05)
    assert last.compass_rad == pytest.approx(last.heading_rad, abs=0.1)
    assert last.temperature_c == pytest.approx(17.0, abs=1.6)
    assert last.battery_v == pytest.approx(7.7, abs=0.1)
    assert last.servo_current_a == pytest.approx(0.25, abs=0.01)
    assert last.water_quality_ug_l == pytest.approx(42.0, abs=2.0)
    assert last.tail_command_rad == 0.0


def test_samples_come_at_50_hz_with_the_rates_of_each_instrument(robot):
    r = robot()
    r.run(4.1)
    r.samples.clear()
    r.run(8.1)
    assert len(r.samples) == 200
    counts = {name: sum(v is not None for v in column(r, name)) for name in SAMPLE_CHANNELS}
    assert counts["gyro_z_rad_s"] == 200
    assert counts["accel_x_m_s2"] == 100
    assert counts["compass_rad"] == 60
    assert counts["gps_x_m"] == counts["tail_angle_rad"] == 0
    assert counts["temperature_c"] == counts["water_quality_ug_l"] == 200 / 5


@pytest.mark.parametrize("hz", [20.0, 50.0, 100.0, 200.0])
def test_other_control_rates(robot, hz):
    r = robot(config=NavConfig(control_hz=hz))
    r.run(1.1)
    r.samples.clear()
    r.run(3.1)
    assert len(r.samples) == pytest.approx(2 * hz, abs=1)
    assert r.board.firmware.late_ticks == 0


def test_reporting_can_be_changed_and_stopped(robot):
    r = robot()
    r.run(1.0)
    r.master.link.send(SetReporting(0.5, False))
    r.run(1.3)
    r.master.messages.clear()
    r.run(4.3)
    assert 5 <= len(r.master.of(SensorReport)) <= 7
    r.master.link.send(SetReporting(0.0, False))
    r.run(5.0)
    r.master.messages.clear()
    r.run(7.0)
    assert r.master.messages == []


def test_ping_is_answered(robot):
    r = robot()
    r.run(0.5)
    r.master.link.send(Ping(4711))
    r.run(0.8)
    assert r.master.of(Pong) == [Pong(4711)]


def test_gps_reports_are_stamped_with_the_pulse(robot):
    r = robot(config=NavConfig(gps=Gps18xConfig(noise_m=0.0)))
    r.run(8.5)
    reports = [m for m in r.master.of(GpsReport) if m.latitude_deg is not None]
    assert len(reports) >= 6
    boot_us = 64_210  # the board's clock starts when the power-up timer lets go
    for report in reports[4:]:
        second = report.fix_time_s - 12 * 3600
        assert report.time_us + boot_us == pytest.approx(second * 1e6, abs=100)
        assert report.latitude_deg == pytest.approx(42.7249, abs=2e-6)
    positions = [v for v in column(r, "gps_x_m") if v is not None]
    assert len(positions) == len(reports)
    assert max(abs(p) for p in positions) < 0.2


# --- the tail ----------------------------------------------------------------------------


def test_tail_beats_as_commanded(robot):
    r = robot()
    r.run(0.5)
    r.master.link.send(TailBeat(1, 0.2, 0.26, 0.9, 60.0))
    r.run(12.0)
    applied = r.master.of(CommandApplied)
    assert [a.command_id for a in applied] == [1]
    angles = [(t, a) for t, a in r.targets if t > 2.0]
    mean = (max(a for _t, a in angles) + min(a for _t, a in angles)) / 2
    assert mean == pytest.approx(0.2, abs=0.005)
    assert max(a for _t, a in angles) == pytest.approx(0.46, abs=0.005)
    up = [t for (t, a), (_u, b) in itertools.pairwise(angles) if a < 0.2 <= b]
    periods = [b - a for a, b in itertools.pairwise(up)]
    assert sum(periods) / len(periods) == pytest.approx(1 / 0.9, rel=0.005)


def test_servo_is_told_within_a_few_milliseconds_of_the_sample(robot):
    r = robot()
    r.run(0.5)
    r.master.link.send(TailBeat(1, 0.5, 0.0, 0.0, 60.0))
    r.run(1.0)
    commands = column(r, "tail_command_rad")
    first = next(i for i, c in enumerate(commands) if c > 0)
    sampled = r.samples[first][0]
    told, angle = next((t, a) for t, a in r.targets if a > 0.001)
    assert angle == pytest.approx(commands[first], abs=0.002)
    assert 0.001 < told - sampled < 0.004  # lead, and the length of the pulse


def test_fail_safe_centres_the_tail_and_reports_it(robot):
    r = robot()
    r.run(0.5)
    r.master.link.send(BEAT)
    r.run(3.5)
    assert abs(column(r, "tail_command_rad")[-1]) == 0.0
    on, off = events(r, BoardEventCode.FAIL_SAFE_ON), events(r, BoardEventCode.FAIL_SAFE_OFF)
    assert [e.detail for e in on] == [7]
    assert [e.detail for e in off] == [7]
    assert on[0].time_us - off[0].time_us == pytest.approx(1_000_000, abs=60_000)
    r.master.link.send(BEAT)
    r.run(4.0)
    assert column(r, "tail_command_rad")[-1] != 0.0


def test_validity_zero_means_the_board_s_own(robot):
    r = robot(config=NavConfig(fail_safe_s=0.5))
    r.run(0.5)
    r.master.link.send(TailBeat(1, 0.2, 0.2, 1.0, 0.0))
    r.run(2.0)
    assert len(events(r, BoardEventCode.FAIL_SAFE_ON)) == 1


# --- resets and faults -------------------------------------------------------------------


def test_power_on_is_reported_with_its_cause(robot):
    r = robot()
    r.run(0.5)
    reset = events(r, BoardEventCode.RESET)
    assert len(reset) == 1
    assert reset[0].detail & 3 == 3


def test_a_hung_control_task_resets_the_board(robot):
    """The supervisor in the tick handler: nothing spins, so the watchdog would sleep on."""
    r = robot()
    r.run(1.0)
    first = r.board.firmware
    first._scan_done._waiters.clear()  # the control task never hears of a scan again
    r.run(2.5)
    assert r.board.firmware is not first
    resets = events(r, BoardEventCode.RESET)
    assert resets[-1].detail & 1 << 6
    assert r.master.link.statistics.peer_resets == 1


def test_firmware_that_spins_is_reset_by_the_watchdog(robot):
    r = robot()
    r.run(1.0)
    first = r.board.firmware
    first.mcu.reg["IEC0"].write(0)  # no interrupt will help it out of this loop

    def spin():
        while True:
            yield 100_000

    first.mcu.cpu.spawn("spin", spin())
    r.run(1.4)
    assert r.board.firmware is first
    r.run(3.0)
    assert r.board.firmware is not first
    assert events(r, BoardEventCode.RESET)[-1].detail & 1 << 4


def test_power_loss_and_return_start_a_new_epoch(robot):
    r = robot()
    r.run(1.0)
    r.rail.set_volts(0.0)
    assert not r.board.data_ready.value
    r.run(1.5)
    assert r.targets[-1][1] is None  # the servo let go
    samples = len(r.samples)
    r.rail.set_volts(3.3)
    r.run(3.0)
    assert len(r.samples) > samples + 50
    assert r.master.link.peer_epoch == 2
    assert column(r, "compass_rad")[-4:] != [None] * 4  # the magnetometer was set up again


def test_epochs_survive_in_the_eeprom(robot):
    cells = blank_eeprom()
    epochs = []
    for _ in range(4):
        r = robot(eeprom=cells, master=False)
        r.run(0.2)
        epochs.append(r.board.firmware.link.link.epoch)
    assert epochs == [1, 2, 3, 4]


@pytest.mark.parametrize(("boots", "next_epoch"), [(1, 2), (40_000, 40_001), (0xFFFF, 1)])
def test_a_board_that_had_boots_before_counts_on(robot, boots, next_epoch):
    r = robot(master=False)
    keep_count(r.board.mcu.eeprom.cells, boots)
    r.run(0.2)
    assert r.board.firmware.link.link.epoch == next_epoch


@pytest.mark.parametrize("cut_ms", [64.3, 66.0, 68.5, 70.0, 72.0, 80.0])
def test_a_power_cut_while_the_epoch_is_stored_never_sets_it_back(robot, cut_ms):
    cells = blank_eeprom()
    for _ in range(3):
        robot(eeprom=cells, master=False).run(0.2)
    r = robot(eeprom=cells, master=False)
    r.run(cut_ms / 1000)
    r.rail.set_volts(0.0)
    r.run(0.2)
    after = robot(eeprom=cells, master=False)
    after.run(0.2)
    assert after.board.firmware.link.link.epoch in (4, 5)


def test_a_dead_compass_is_reported_and_comes_back(robot):
    r = robot()
    r.run(1.0)
    r.board.accelerometer.power(False)
    r.board.magnetometer.power(False)
    r.run(2.0)
    faults = events(r, BoardEventCode.SENSOR_FAULT)
    assert faults
    assert SENSORS[faults[0].detail].part == "ST LSM303DLH"
    assert r.master.of(SensorReport)[-1].compass_rad is None
    r.board.accelerometer.power(True)
    r.board.magnetometer.power(True)
    r.run(4.5)
    assert r.master.of(SensorReport)[-1].compass_rad is not None


def test_noise_on_mosi_is_survived(robot):
    r = robot()
    r.run(1.0)
    for k in range(2000):
        r.board.spi.select(True)
        r.board.spi.begin()
        r.scheduler.run(r.scheduler.now + 31 * 10**9)
        r.board.spi.end((k * 37 + 11) & 0xFF or 1)
    r.master.messages.clear()
    r.run(4.0)
    assert len(r.master.of(SensorReport)) > 10


def test_energy_is_accounted_by_part(robot):
    r = robot()
    r.run(5.0)
    joules = {consumer.name: consumer.joules for consumer in r.rail.consumers}
    mcu = r.board.mcu.consumer.table()
    assert mcu["idle"][0] > 4.0
    assert joules["dsPIC30F6014A"] == pytest.approx(0.028 * 3.3 * 5, rel=0.1)
    assert joules["LPY503AL"] == pytest.approx(6.8e-3 * 3.3 * 5, rel=1e-6)


# --- determinism -------------------------------------------------------------------------


def test_same_seed_same_trace_and_other_seed_another(robot):
    def digest(seed):
        r = robot(config=NavConfig(gps=Gps18xConfig()), seed=seed)
        r.run(0.5)
        r.master.link.send(BEAT)
        r.run(3.0)
        return r.trace.sha256()

    assert digest(1) == digest(1)
    assert digest(1) != digest(2)


def test_heading_estimate_beats_the_compass_while_the_tail_beats(robot):
    """Yaw oscillates with the tail as a swimming fish's does; the hard iron is calibrated away."""

    def heading(t):
        return 0.1 * t / 1e15 + 0.15 * math.sin(2 * math.pi * 0.9 * t / 1e15)

    def rate(t):
        return 0.1 + 0.15 * 2 * math.pi * 0.9 * math.cos(2 * math.pi * 0.9 * t / 1e15)

    r = robot(NavInputs(gyro_z_rad_s=rate, heading_rad=heading))
    r.run(40.0)
    estimate, compass = column(r, "heading_estimate_rad"), column(r, "compass_rad")
    errors, raw = [], []
    for (t, _values), e, c in zip(r.samples, estimate, compass, strict=True):
        if t > 20.0:
            errors.append(math.remainder(e - heading(t * 1e15), 2 * math.pi))
            if c is not None:
                raw.append(math.remainder(c - heading(t * 1e15), 2 * math.pi))
    rms = [math.sqrt(sum(x * x for x in v) / len(v)) for v in (errors, raw)]
    assert rms[0] < 0.02
    assert rms[0] < 0.7 * rms[1]
