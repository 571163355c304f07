"""Flash controller: AND semantics, erase, timing, keys, and what survives."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.msp430 import flash
from firmware_model.msp430.flash import FWKEY, segment_of
from firmware_model.time import FS_PER_S

MAIN, INFO_B, INFO_A = 0x8000, 0x1000, 0x1080


def unlock(bench: Any, control: int = flash.WRT) -> None:
    """About 375 kHz from SMCLK / 2."""
    bench.write(FCTL2=FWKEY | 0x80 | 1, FCTL3=FWKEY)
    bench.write(FCTL1=FWKEY | control)


def wait(bench: Any) -> None:
    while bench.read("FCTL3") & flash.BUSY:
        bench.run_us(100)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=5))
def test_programming_only_clears_bits(make_bench: Any, words: list[int]) -> None:
    bench = make_bench().start()
    unlock(bench)
    expected = 0xFFFF
    for word in words:
        bench.mcu.reg.write16(MAIN, word)
        wait(bench)
        expected &= word
    assert bench.mcu.reg.read16(MAIN) == expected
    assert bench.mcu.reg.read16(MAIN + 2) == 0xFFFF


@pytest.mark.parametrize(
    ("control", "periods"),
    [(flash.WRT, 35), (flash.ERASE, 4_819), (flash.MERAS, 5_297)],
)
def test_timing(bench: Any, control: int, periods: int) -> None:
    unlock(bench, control)
    assert flash.FTG_MIN_HZ <= bench.mcu.flash.generator_hz <= flash.FTG_MAX_HZ
    start = bench.scheduler.now
    bench.mcu.reg.write8(MAIN, 0)
    duration = round(periods * FS_PER_S / bench.mcu.flash.generator_hz)
    assert bench.read("FCTL3") & (flash.BUSY | flash.WAIT) == flash.BUSY
    bench.scheduler.run(start + duration - 10)
    assert bench.read("FCTL3") & flash.BUSY
    bench.scheduler.run(start + duration + 10)
    assert bench.read("FCTL3") & (flash.BUSY | flash.WAIT) == flash.WAIT


def test_the_cpu_is_held_while_flash_programs(bench: Any) -> None:
    times: list[int] = []

    def body() -> Any:
        unlock(bench)
        times.append(bench.scheduler.now)
        bench.mcu.reg.write16(MAIN, 0x1234)
        yield 5
        times.append(bench.scheduler.now)

    bench.task(body())
    bench.run_us(10_000)
    program = 35 * FS_PER_S / bench.mcu.flash.generator_hz
    cycle = bench.mcu.clocks.mclk.span(1)
    assert times[1] - times[0] == pytest.approx(program + 5 * cycle, abs=cycle)


def test_erase_reaches_its_segment_only(bench: Any) -> None:
    unlock(bench)
    for address in (MAIN - 1, MAIN, MAIN + 511, MAIN + 512, INFO_B, INFO_A):
        bench.mcu.reg.write8(address, 0x00)
        wait(bench)
    bench.write(FCTL1=FWKEY | flash.ERASE)
    bench.mcu.reg.write8(MAIN + 100, 0)
    wait(bench)
    read = bench.mcu.reg.read8
    assert [read(a) for a in (MAIN - 1, MAIN, MAIN + 511, MAIN + 512)] == [0, 0xFF, 0xFF, 0]
    bench.mcu.reg.write8(INFO_B, 0)
    wait(bench)
    assert (read(INFO_B), read(INFO_A)) == (0xFF, 0)
    assert bench.mcu.flash.erase_counts == {MAIN: 1, INFO_B: 1}


def test_mass_erase_spares_or_takes_the_information_memory(bench: Any) -> None:
    for control, left in ((flash.MERAS, 0x00), (flash.MERAS | flash.ERASE, 0xFF)):
        unlock(bench)
        bench.mcu.reg.write8(0x4000, 0)
        wait(bench)
        bench.mcu.reg.write8(INFO_A, 0)
        wait(bench)
        bench.write(FCTL1=FWKEY | control)
        bench.mcu.reg.write8(MAIN, 0)
        wait(bench)
        assert bench.mcu.reg.read8(0x4000) == 0xFF
        assert bench.mcu.reg.read8(INFO_A) == left


def test_segments() -> None:
    assert segment_of(0x4000) == (0x4000, 0x4200)
    assert segment_of(0xFFFE) == (0xFE00, 0x10000)
    assert segment_of(0x10FF) == (0x1080, 0x1100)
    assert segment_of(0x1000) == (0x1000, 0x1080)


def test_a_locked_flash_does_not_change(bench: Any) -> None:
    bench.write(FCTL1=FWKEY | flash.WRT)
    bench.mcu.reg.write8(MAIN, 0)
    assert bench.mcu.reg.read8(MAIN) == 0xFF
    assert not bench.mcu.flash.violated


def test_writes_without_wrt_and_reads_while_busy_violate(bench: Any) -> None:
    bench.mcu.reg.write8(MAIN, 0)
    assert bench.read("FCTL3") & flash.ACCVIFG
    unlock(bench)
    assert not bench.read("FCTL3") & flash.ACCVIFG
    bench.mcu.reg.write8(MAIN, 0)
    bench.mcu.reg.read8(MAIN)
    assert bench.read("FCTL3") & flash.ACCVIFG


def test_a_violation_is_an_nmi_without_gie(bench: Any) -> None:
    calls: list[int] = []
    bench.handle("NMI", lambda: calls.append(bench.read("FCTL3") & flash.ACCVIFG))
    bench.write(IE1=0x20)
    bench.mcu.reg.write8(MAIN, 0)
    bench.run_us(100)
    assert calls == [flash.ACCVIFG]
    assert not bench.read("IE1") & 0x20  # taking the NMI cleared its enable
    bench.write(IE1=0x20)
    bench.run_us(100)
    assert len(calls) == 2  # the flag still stands
    bench.write(FCTL3=FWKEY | flash.LOCK)
    bench.write(IE1=0x20)
    bench.run_us(100)
    assert len(calls) == 2


@pytest.mark.parametrize("register", ["FCTL1", "FCTL2", "FCTL3"])
def test_a_wrong_key_resets_and_leaves_its_mark(bench: Any, register: str) -> None:
    bench.write(**{register: 0x5A00})
    assert bench.boots == 1  # not inside the firmware that did it
    bench.run_us(10)
    assert bench.boots == 2
    assert bench.mcu.last_reset == "flash key"
    assert bench.read("FCTL3") & flash.KEYV
    assert bench.read("FCTL3") & flash.LOCK


def test_keys_read_back_as_96(bench: Any) -> None:
    assert [bench.read(f"FCTL{n}") >> 8 for n in (1, 2, 3)] == [0x96] * 3


def test_contents_survive_resets_and_loss_of_power(bench: Any) -> None:
    unlock(bench)
    for offset, byte in enumerate(b"fish"):
        bench.mcu.reg.write8(INFO_A + offset, byte)
        wait(bench)
    bench.mcu.request_reset("test")
    bench.run_us(100)
    bench.rail.set_volts(0.0)
    bench.run_us(100)
    bench.rail.set_volts(3.0)
    bench.run_us(5_000)
    assert bench.boots == 3
    assert bytes(bench.mcu.memory[INFO_A : INFO_A + 5]) == b"fish\xff"


def test_power_lost_in_the_middle_of_an_operation(bench: Any) -> None:
    unlock(bench)
    bench.mcu.reg.write16(MAIN, 0x1234)
    bench.rail.set_volts(0.0)
    assert bytes(bench.mcu.memory[MAIN : MAIN + 2]) == b"\x34\xff"  # half a word
    bench.rail.set_volts(3.0)
    bench.run_us(5_000)
    unlock(bench, flash.ERASE)
    bench.mcu.memory[MAIN : MAIN + 4] = b"abcd"
    bench.mcu.reg.write8(MAIN, 0)
    bench.rail.set_volts(0.0)
    assert bytes(bench.mcu.memory[MAIN : MAIN + 4]) == b"\xffb\xffd"  # half a segment


def test_emergency_exit(bench: Any) -> None:
    unlock(bench, flash.ERASE)
    bench.mcu.reg.write8(MAIN, 0)
    bench.write(FCTL3=FWKEY | flash.EMEX)
    assert not bench.read("FCTL3") & flash.BUSY
    assert bench.read("FCTL3") & flash.LOCK
