"""Basic clock: the DCO's law, calibration as TinyOS does it, dividers, low-power modes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.cpu import Coroutine
from firmware_model.msp430.clocks import (
    DCO_FACTOR_MAX,
    DCO_FACTOR_MIN,
    GatedClock,
    dco_frequency_hz,
)
from firmware_model.time import FS_PER_MS, FS_PER_S

# SLAS368, 3 V: minimum and maximum of f(DCOx3) in hertz.
DATA_SHEET_RANGE = (
    (80e3, 160e3), (140e3, 220e3), (220e3, 340e3), (370e3, 560e3), (610e3, 900e3),
    (1.0e6, 1.5e6), (1.69e6, 2.29e6), (2.7e6, 3.65e6),
)  # fmt: skip


@pytest.mark.parametrize("rsel", range(8))
def test_each_range_is_inside_the_data_sheet(rsel: int) -> None:
    low, high = DATA_SHEET_RANGE[rsel]
    assert low <= dco_frequency_hz(rsel, 3, 0) <= high


def test_top_of_the_top_range() -> None:
    # SLAS368: f(DCO77) = 4.4…5.4 MHz, typically 4.9 at 3 V.
    assert dco_frequency_hz(7, 7, 0) == pytest.approx(4.9e6, rel=0.01)


@given(st.integers(0, 7), st.integers(0, 6))
def test_frequency_rises_with_modulation_between_its_neighbours(rsel: int, dco: int) -> None:
    steps = [dco_frequency_hz(rsel, dco, mod) for mod in range(32)]
    above = dco_frequency_hz(rsel, dco + 1, 0)
    assert steps == sorted(steps)
    assert steps[0] < steps[31] < above
    # SLAU049, 4.2.5: the mean period of 32 − MOD periods and MOD shorter ones.
    expected = 32 / (Fraction(16, steps[0]) + Fraction(16, above))
    assert abs(steps[16] - expected) <= 1


def test_with_dco_7_the_modulator_does_nothing() -> None:
    assert dco_frequency_hz(7, 7, 31) == dco_frequency_hz(7, 7, 0)


def calibrate(bench: Any, result: list[int]) -> Coroutine:
    """Find RSEL, DCO, MOD by binary search against ACLK, as TinyOS's Msp430ClockP does."""
    reg = bench.mcu.reg
    reg["TACTL"].write(0x0220)  # SMCLK, continuous
    reg["TBCTL"].write(0x0120)  # ACLK, continuous
    reg["TBCCTL0"].write(0x4000)
    calibration, step = 0, 0x800
    while step:
        trial = calibration | step
        reg["BCSCTL1"].write(0x80 | trial >> 8 & 7)
        reg["DCOCTL"].write(trial & 0xFF)
        last = delta = 0
        for _ in range(2):
            reg["TBCCR0"].write(reg["TBR"].read() + 8)
            reg["TBCCTL0"].clear_bits(1)
            while not reg["TBCCTL0"].read() & 1:
                yield 8
            now = reg["TAR"].read()
            delta, last = (now - last) & 0xFFFF, now
        if delta <= 1024:  # 4 MiHz against 8 ticks of 32 768 Hz
            calibration = trial
        step >>= 1
    reg["BCSCTL1"].write(0x80 | calibration >> 8 & 7)
    reg["DCOCTL"].write(calibration & 0xFF)
    result.append(calibration)


@settings(max_examples=10, deadline=None)
@given(st.floats(DCO_FACTOR_MIN, DCO_FACTOR_MAX))
def test_a_calibration_against_the_crystal_finds_4_mihz(make_bench: Any, factor: float) -> None:
    bench = make_bench(dco_factor=factor).start()
    result: list[int] = []
    bench.task(calibrate(bench, result))
    bench.run_us(20_000)
    assert result
    # One step of the modulator is up to 0.4 %, and polling by the CPU adds its own spread.
    assert bench.mcu.clocks.dco_hz == pytest.approx(4_194_304, rel=0.008)


def test_reset_frequency_and_dividers(make_bench: Any) -> None:
    bench = make_bench().start()
    clocks = bench.mcu.clocks
    assert clocks.mclk.frequency_hz == clocks.dco_hz == pytest.approx(750e3, rel=0.01)
    bench.write(BCSCTL2=0x36)  # DIVM = 8, DIVS = 8
    assert clocks.mclk.frequency_hz == Fraction(clocks.dco_hz, 8)
    assert clocks.smclk.frequency_hz == Fraction(clocks.dco_hz, 8)
    bench.write(BCSCTL1=0x84 | 0x20)  # DIVA = 4
    assert clocks.aclk.frequency_hz == 8_192
    bench.write(BCSCTL2=0xC0)  # MCLK from LFXT1
    assert clocks.mclk.frequency_hz == 32_768


def test_crystal_drift_reaches_aclk(make_bench: Any) -> None:
    bench = make_bench(lfxt1_drift_ppm=40.0)
    assert bench.mcu.clocks.aclk.ticks(1_000 * FS_PER_S) == 32_768_000 + 1_310


def test_warmth_slows_the_dco(bench: Any) -> None:
    cold = bench.mcu.clocks.dco_hz
    bench.mcu.clocks.warm(35.0)
    assert bench.mcu.clocks.dco_hz == pytest.approx(cold * (1 - 0.038), rel=1e-5)


def test_the_missing_xt2_is_an_oscillator_fault(bench: Any) -> None:
    bench.write(IFG1=0x80)
    bench.write(BCSCTL2=0x88)
    assert bench.read("IFG1") & 0x02
    assert bench.mcu.clocks.mclk.frequency_hz == bench.mcu.clocks.dco_hz
    assert not bench.mcu.clocks.smclk.running
    bench.write(BCSCTL2=0x00)
    assert bench.mcu.clocks.smclk.running


def test_a_gated_clock_keeps_its_count() -> None:
    clock = GatedClock(1_000)
    calls: list[int] = []
    clock.watch(lambda: calls.append(1))
    clock.stop(10 * FS_PER_MS)
    assert clock.ticks(FS_PER_S) == 10
    clock.retune(20 * FS_PER_MS, 2_000)
    assert clock.ticks(FS_PER_S) == 10
    clock.start(50 * FS_PER_MS)
    assert clock.ticks(51 * FS_PER_MS) == 12
    clock.start(50 * FS_PER_MS)
    assert len(calls) == 3


def test_lpm3_stops_a_timer_on_smclk_and_not_one_on_aclk(make_bench: Any) -> None:
    def setup(mcu: Any) -> None:
        mcu.cpu.sleep_state = "lpm3"
        mcu.reg["TACTL"].write(0x0224)
        mcu.reg["TBCTL"].write(0x0124)

    bench = make_bench().start(setup)
    before_a, before_b = bench.read("TAR"), bench.read("TBR")
    bench.run_us(100_000)
    assert bench.read("TAR") == before_a
    assert bench.read("TBR") == pytest.approx(before_b + 3_277, abs=1)


def test_lpm0_keeps_smclk(make_bench: Any) -> None:
    def setup(mcu: Any) -> None:
        mcu.cpu.sleep_state = "lpm0"
        mcu.reg["TACTL"].write(0x0224)

    bench = make_bench().start(setup)
    before = bench.read("TAR")
    bench.run_us(10_000)
    elapsed = (bench.read("TAR") - before) & 0xFFFF
    assert elapsed == pytest.approx(bench.mcu.clocks.dco_hz * 0.01, abs=1)
