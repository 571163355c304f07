"""Analog chips against data sheet figures, and each with its driver behind a converter."""

from __future__ import annotations

import math
import random

import pytest

from firmware_model.signals import constant
from firmware_model.time import FS_PER_MS
from navboard.chips import analog as chips
from navboard.chips.lpy503al import Lpy503al
from navboard.drivers import analog as drivers


def rng(name="x"):
    return random.Random(name)


def counts(volts):
    return min(4095, max(0, int(volts / 3.3 * 4096)))


def mean(output, n=2000, step=20 * FS_PER_MS):
    return sum(output(k * step) for k in range(n)) / n


# --- LPY503AL ----------------------------------------------------------------------------


def gyro(rate_dps, bias=0.0, noise=1.0):
    return Lpy503al(constant(math.radians(rate_dps)), rng(), 3.3, bias, noise)


@pytest.mark.parametrize("rate", [-30.0, -7.0, 0.0, 12.0, 30.0])
def test_gyro_sensitivity_and_zero_rate_level(rate):
    chip = gyro(rate, noise=0.0)
    assert chip.x4(FS_PER_MS) == pytest.approx(1.23 + 0.0333 * rate, abs=1e-9)
    assert chip.x1(FS_PER_MS) == pytest.approx(1.23 + 0.0083 * rate, abs=1e-9)


def test_gyro_noise_is_density_times_root_bandwidth():
    chip = gyro(0.0)
    values = [chip.x4(k * 20 * FS_PER_MS) for k in range(4000)]
    m = sum(values) / len(values)
    rms = math.sqrt(sum((v - m) ** 2 for v in values) / len(values))
    assert rms == pytest.approx(0.0333 * 0.014 * math.sqrt(140 * math.pi / 2), rel=0.05)


def test_gyro_bandwidth_is_one_pole_at_140_hz():
    """A step looked at after one time constant (1.137 ms) has gone 63 % of the way."""
    rate = [0.0]
    chip = Lpy503al(lambda t: rate[0], rng(), 3.3, 0.0, 0.0)
    chip.x1(0)
    rate[0] = math.radians(100.0)
    tau_fs = round(1e15 / (2 * math.pi * 140))
    assert (chip.x1(tau_fs) - 1.23) / 0.83 == pytest.approx(1 - math.exp(-1), abs=1e-6)


def test_gyro_outputs_clip_before_the_rails():
    chip = gyro(100.0, noise=0.0)
    assert chip.x4(0) == 3.25
    assert chip.x1(0) == pytest.approx(2.06)


@pytest.mark.parametrize("rate", [-110.0, -29.5, -28.0, 0.0, 15.0, 60.0, 119.0])
def test_gyro_driver_returns_the_rate(rate):
    chip = gyro(rate, noise=0.0)
    got = drivers.gyro_rad_s(counts(chip.x4(0)), counts(chip.x1(0)))
    lsb_dps = 3.3 / 4096 / (0.0333 if abs(rate) < 29 else 0.0083)
    assert math.degrees(got) == pytest.approx(rate, abs=0.51 * lsb_dps)


# --- the others --------------------------------------------------------------------------


def test_tmp36_is_750_mv_at_25_degrees_within_its_tolerance():
    errors = []
    for seed in range(300):
        chip = chips.Tmp36(constant(25.0), rng(seed))
        errors.append((mean(chip.volts, 20) - 0.750) / 0.010)
    assert max(abs(e) for e in errors) < 2.0
    assert sum(abs(e) <= 1.0 for e in errors) > 0.9 * len(errors)  # ±1 °C


@pytest.mark.parametrize(
    ("chip", "values", "convert", "tolerance"),
    [
        (chips.Tmp36, (5.0, 20.0, 35.0), drivers.temperature_c, 1.5),
        (chips.BatteryDivider, (6.0, 7.4, 8.4), drivers.battery_v, 0.1),
        (chips.ShuntAmplifier, (0.0045, 0.33, 2.1), drivers.servo_current_a, 0.04),
        (chips.WaterProbe, (0.0, 10.0, 450.0), drivers.water_quality_ug_l, 15.0),
        (chips.TailPotentiometer, (-1.0, 0.0, 1.0), drivers.tail_angle_rad, 0.002),
    ],
)
def test_chip_and_driver_agree_within_tolerance(chip, values, convert, tolerance):
    for value in values:
        instrument = chip(constant(value), rng("one"))
        got = sum(convert(counts(instrument.volts(k))) for k in range(500)) / 500
        assert got == pytest.approx(value, abs=tolerance)


@pytest.mark.parametrize(
    "chip",
    [
        chips.Tmp36,
        chips.BatteryDivider,
        chips.ShuntAmplifier,
        chips.WaterProbe,
        chips.TailPotentiometer,
    ],
)
def test_same_seed_same_voltages(chip):
    first = [chip(constant(1.0), rng(5)).volts(k) for k in range(3)]
    again = [chip(constant(1.0), rng(5)).volts(k) for k in range(3)]
    other = [chip(constant(1.0), rng(6)).volts(k) for k in range(3)]
    assert first == again
    assert first != other
