"""Timers, output compare and interrupt nesting against the formulas of DS70046."""

from __future__ import annotations

import itertools
from fractions import Fraction

import pytest

from firmware_model.dspic30f.errors import LimitError, UnsupportedModeError
from firmware_model.dspic30f.mcu import DspicConfig
from firmware_model.time import FS_PER_S

FCY = 7_372_800 * 8 // 4


def idle(mcu):
    """Firmware that does nothing."""


def test_instruction_clock_is_14_7456_mips(rig):
    assert rig(idle).mcu.clock.frequency_hz == 14_745_600


def test_a_clock_beyond_15_mips_is_refused_at_3v3(rig):
    with pytest.raises(LimitError, match="too fast"):
        rig(idle, DspicConfig(pll=16))


@pytest.mark.parametrize(("tckps", "prescaler"), [(0, 1), (1, 8), (2, 64), (3, 256)])
def test_period_interrupts_come_every_pr_plus_one_ticks(rig, tckps, prescaler):
    times = []

    def firmware(mcu):
        reg = mcu.reg

        def handler():
            times.append(mcu.scheduler.now)
            reg["IFS0"].clear_bits(1 << 3)
            return 4

        mcu.cpu.on_interrupt("T1", handler)
        reg["PR1"].write(999)
        reg["IEC0"].set_bits(1 << 3)
        reg["T1CON"].write(0x8000 | tckps << 4)

    r = rig(firmware)
    r.run(0.2)
    assert len(times) >= 5
    clock = r.mcu.clock
    cycles = [clock.ticks(t) for t in times]
    assert {b - a for a, b in itertools.pairwise(cycles)} == {1000 * prescaler}


def test_32_bit_pair_latches_its_high_word(rig):
    def firmware(mcu):
        mcu.reg["PR4"].write(0xFFFF)
        mcu.reg["PR5"].write(0xFFFF)
        mcu.reg["T4CON"].write(0x8008)

    r = rig(firmware)
    r.run(0.5)
    start = r.mcu.timers[4].base_cycle
    low = r.mcu.reg["TMR4"].read()
    elapsed = r.mcu.clock.ticks(r.scheduler.now) - start
    assert r.mcu.reg["TMR5HLD"].read() << 16 | low == elapsed
    assert elapsed > 1 << 16


def test_count_written_beyond_the_period_wraps_at_full_width(rig):
    times = []

    def firmware(mcu):
        mcu.cpu.on_interrupt("T1", lambda: (times.append(mcu.clock.ticks(mcu.scheduler.now)), 4)[1])
        mcu.reg["PR1"].write(99)
        mcu.reg["TMR1"].write(0xFFF0)
        mcu.reg["IEC0"].set_bits(1 << 3)
        mcu.reg["T1CON"].write(0x8000)
        times.append(mcu.clock.ticks(mcu.scheduler.now))

    r = rig(firmware)
    boot_s = 0.0642
    r.run(boot_s)
    # To the wrap, a period, the next cycle edge of a sleeping CPU, and interrupt entry.
    assert times[1] - times[0] == 0x10 + 100 + 1 + 4


def test_external_clock_is_refused(rig):
    r = rig(idle)
    with pytest.raises(UnsupportedModeError):
        r.mcu.reg["T1CON"].write(0x8002)


@pytest.mark.parametrize("duty", [1, 2765, 36863])
def test_pwm_pulse_is_exact_to_a_timer_tick(rig, duty):
    edges = []

    def firmware(mcu):
        reg = mcu.reg
        reg["PR2"].write(36863)  # 20 ms at FCY / 8
        reg["OC1RS"].write(duty)
        reg["OC1R"].write(duty)
        reg["OC1CON"].write(6)
        reg["T2CON"].write(0x8010)

    r = rig(firmware)
    r.mcu.oc1.pin.watch(lambda level: edges.append((r.scheduler.now, level)))
    r.run(0.2)
    rises = [t for t, level in edges if level]
    falls = [t for t, level in edges if not level]
    tick = Fraction(8 * FS_PER_S, FCY)
    for rise, fall in zip(rises, falls, strict=False):
        assert abs(fall - rise - duty * tick) <= 1  # rounding of two edges
    for a, b in itertools.pairwise(rises):
        assert abs(b - a - FS_PER_S // 50) <= 1


def test_duty_is_latched_at_the_period(rig):
    """A new duty in the middle of a pulse must not change that pulse."""
    r = rig(
        lambda mcu: (
            [
                mcu.reg[n].write(v)
                for n, v in (("PR2", 36863), ("OC1RS", 2000), ("OC1CON", 6), ("T2CON", 0x8010))
            ]
            and None
        )
    )
    widths = []
    rise = 0

    def edge(level):
        nonlocal rise
        if level:
            rise = r.scheduler.now
            r.mcu.reg["OC1RS"].write(3000 + len(widths))
        else:
            widths.append(round((r.scheduler.now - rise) * FCY / 8 / FS_PER_S))

    r.mcu.oc1.pin.watch(edge)
    r.run(0.15)
    assert widths[:3] == [2000, 3000, 3001]


def test_duty_zero_and_beyond_the_period_hold_the_pin(rig):
    levels = []

    def firmware(mcu):
        mcu.reg["PR2"].write(999)
        mcu.reg["OC1RS"].write(0)
        mcu.reg["OC1CON"].write(6)
        mcu.reg["T2CON"].write(0x8000)

    r = rig(firmware)
    r.mcu.oc1.pin.watch(levels.append)
    r.run(0.07)
    assert levels == []
    r.mcu.reg["OC1RS"].write(1000)
    r.run(0.08)
    assert levels == [True]


def test_interrupts_nest_by_priority(rig):
    """A handler of priority 5 runs in the middle of one of priority 2, never the other way."""
    log = []

    def firmware(mcu):
        reg, cpu = mcu.reg, mcu.cpu

        def slow():
            log.append("slow in")
            reg["IFS0"].clear_bits(1 << 3)
            reg["IEC0"].clear_bits(1 << 3)
            for _ in range(10):
                yield 1000
            log.append("slow out")

        def fast():
            log.append(f"fast at {cpu.level}")
            reg["IFS0"].clear_bits(1 << 6)
            reg["IEC0"].clear_bits(1 << 6)
            return 10

        cpu.on_interrupt("T1", slow)
        cpu.on_interrupt("T2", fast)
        reg["IPC0"].write(0x2444)  # T1: 2
        reg["IPC1"].write(0x4544)  # T2: 5
        reg["IEC0"].write(1 << 3 | 1 << 6)
        reg["PR1"].write(1000)
        reg["PR2"].write(3000)
        reg["T1CON"].write(0x8000)
        reg["T2CON"].write(0x8000)

    r = rig(firmware)
    r.run(0.07)
    assert log == ["slow in", "fast at 5", "slow out"]
