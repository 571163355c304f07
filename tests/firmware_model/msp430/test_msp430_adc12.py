"""ADC12: codes, timing of samples, sequences, triggers and vectors."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from firmware_model.msp430 import adc12
from firmware_model.time import FS_PER_S

ON, ENC, SC, MSC = adc12.ADC12ON, adc12.ENC, adc12.ADC12SC, adc12.MSC
SHP = adc12.SHP
OSC = 5_000_000


def single(bench: Any, control: int = 0, wait_us: float = 100.0, extra: int = 0) -> int:
    bench.write(ADC12CTL0=0)
    bench.write(ADC12CTL0=ON | extra, ADC12CTL1=SHP, ADC12MCTL0=control)
    bench.write(ADC12CTL0=ON | extra | ENC)
    bench.write(ADC12CTL0=ON | extra | ENC | SC)
    bench.run_us(wait_us)
    value: int = bench.read("ADC12MEM0")
    return value


@pytest.mark.parametrize(
    ("volts", "code"), [(-0.1, 0), (0.0, 0), (1.5, 2_048), (2.9, 3_958), (3.0, 4_095), (3.3, 4_095)]
)
def test_code_against_the_supply(bench: Any, volts: float, code: int) -> None:
    bench.mcu.adc12.inputs[3] = lambda _t: volts
    assert single(bench, 3) == code  # N = 4095 × V / 3.0


@pytest.mark.parametrize(("extra", "reference"), [(0, 1.5), (adc12.REF2_5V, 2.5)])
def test_internal_reference(bench: Any, extra: int, reference: float) -> None:
    bench.mcu.adc12.inputs[0] = lambda _t: 1.0
    assert single(bench, 0x10, extra=adc12.REFON | extra) == round(4_095 / reference)
    assert single(bench, 0x10) == 4_095  # without REFON there is no reference


def test_temperature_and_supply_sensors(bench: Any) -> None:
    bench.mcu.adc12.celsius = lambda _t: 20.0
    code = single(bench, 0x1A, extra=adc12.REFON)
    assert code == round(4_095 * (0.986 + 0.00355 * 20.0) / 1.5)
    bench.rail.set_volts(2.8)
    assert single(bench, 0x1B, extra=adc12.REFON) == round(4_095 * 1.4 / 1.5)


def test_external_reference(bench: Any) -> None:
    bench.mcu.adc12.external_reference = lambda _t: 2.0
    bench.mcu.adc12.inputs[1] = lambda _t: 0.5
    assert single(bench, 0x21) == round(4_095 * 0.25)


@pytest.mark.parametrize(("sht", "cycles"), [(0, 4), (2, 16), (6, 128), (12, 1_024)])
@pytest.mark.parametrize("divider", [1, 8])
def test_sample_and_conversion_time(bench: Any, sht: int, cycles: int, divider: int) -> None:
    """SLAU049, 17.2.5: the sample period is SHTx cycles, then 13 ADC12CLK cycles."""
    looked: list[int] = []

    def ramp(time_fs: int) -> float:
        looked.append(time_fs)
        return 1.0

    bench.mcu.adc12.inputs[0] = ramp
    bench.write(ADC12CTL0=ON | sht << 8, ADC12CTL1=SHP | (divider - 1) << 5, ADC12IE=1)
    done: list[int] = []
    bench.handle(
        "ADC12", lambda: (done.append(bench.scheduler.now), bench.mcu.reg["ADC12MEM0"].read())
    )
    bench.mcu.interrupts.gie = True
    bench.mcu.cpu.sleep_state = "lpm0"
    start = bench.scheduler.now
    bench.write(ADC12CTL0=ON | sht << 8 | ENC | SC)
    assert bench.read("ADC12CTL1") & adc12.ADC12BUSY
    bench.run_us(5_000)
    period = FS_PER_S // OSC
    assert looked == [pytest.approx(start + (cycles * divider + 1) * period, abs=period)]
    over = start + ((cycles + 13) * divider + 1) * period
    latency = bench.mcu.clocks.mclk.span(8)
    assert over - period <= done[0] <= over + period + latency
    assert not bench.read("ADC12CTL1") & adc12.ADC12BUSY


def sequence(bench: Any, mode: int, channels: tuple[int, ...], control0: int = MSC) -> None:
    for n, channel in enumerate(channels):
        last = adc12.EOS if n == len(channels) - 1 else 0
        bench.write(**{f"ADC12MCTL{n}": channel | last})
    bench.write(ADC12CTL0=ON | control0, ADC12CTL1=SHP | mode << adc12.CONSEQ_SHIFT)


def test_a_sequence_fills_its_memories(bench: Any) -> None:
    for n in range(4):
        bench.mcu.adc12.inputs[n] = lambda _t, n=n: 0.5 * n
    sequence(bench, 1, (3, 1, 2))
    bench.write(ADC12CTL0=ON | MSC | ENC | SC)
    bench.run_us(100)
    assert bench.read("ADC12IFG") == 0x0007
    values = [bench.read(f"ADC12MEM{n}") for n in range(3)]
    assert values == [round(4_095 * v / 3.0) for v in (1.5, 0.5, 1.0)]
    assert bench.read("ADC12IFG") == 0  # reading clears
    assert bench.scheduler.next_time() is None


def test_without_msc_each_conversion_needs_a_trigger(bench: Any) -> None:
    sequence(bench, 1, (0, 1), 0)
    for expected in (0x0001, 0x0003):
        bench.write(ADC12CTL0=ON | ENC | SC)
        bench.run_us(100)
        assert bench.read("ADC12IFG") == expected


def test_repeated_conversions_overflow_and_stop(bench: Any) -> None:
    sequence(bench, 2, (0,))
    bench.write(ADC12CTL0=ON | MSC | ENC | SC | adc12.ADC12OVIE)
    bench.run_us(100)
    assert bench.read("ADC12IV") == 2  # nobody read the memory
    bench.write(ADC12CTL0=ON | MSC)
    bench.run_us(100)
    assert bench.scheduler.next_time() is None


def test_a_repeated_sequence_starts_over(bench: Any) -> None:
    count = [0]

    def look(_t: int) -> float:
        count[0] += 1
        return 1.0

    for n in range(3):
        bench.mcu.adc12.inputs[n] = look
    sequence(bench, 3, (0, 1, 2))
    bench.write(ADC12CTL0=ON | MSC | ENC | SC)
    bench.run_us(10 * 17 / 5 + 0.5)
    assert count[0] == 10
    bench.write(ADC12CTL0=ON | MSC)


def test_too_early_a_trigger_is_a_time_overflow(bench: Any) -> None:
    bench.write(ADC12CTL0=ON | adc12.ADC12TOVIE, ADC12CTL1=SHP)
    bench.write(ADC12CTL0=ON | adc12.ADC12TOVIE | ENC | SC)
    bench.write(ADC12CTL0=ON | adc12.ADC12TOVIE | ENC | SC)
    assert bench.read("ADC12IV") == 4
    assert bench.read("ADC12IV") == 0


def test_vectors_by_memory(bench: Any) -> None:
    bench.write(ADC12IFG=0x8021, ADC12IE=0x8020)
    assert bench.read("ADC12IV") == 6 + 2 * 5
    bench.read("ADC12MEM5")
    assert bench.read("ADC12IV") == 6 + 2 * 15


def test_timer_b_triggers_conversions_on_time(bench: Any) -> None:
    """SHS = 3: each rise of TB.OUT1 samples, 100 times a second within an ACLK tick."""
    looked: list[int] = []

    def look(time_fs: int) -> float:
        looked.append(time_fs)
        return 1.0

    bench.mcu.adc12.inputs[0] = look
    bench.write(ADC12CTL0=ON, ADC12CTL1=SHP | 3 << adc12.SHS_SHIFT | 2 << adc12.CONSEQ_SHIFT)
    bench.write(ADC12CTL0=ON | ENC)
    bench.write(TBCCR0=327, TBCCR1=100, TBCCTL1=0x0060, TBCTL=0x0114)  # set/reset
    bench.run_us(100_000)
    gaps = [b - a for a, b in itertools.pairwise(looked)]
    assert len(looked) == 10
    assert gaps == pytest.approx([328 * FS_PER_S / 32_768] * 9, abs=2 * FS_PER_S / OSC)


def test_dma_takes_the_last_result_of_a_sequence(bench: Any) -> None:
    bench.mcu.adc12.inputs[1] = lambda _t: 1.5
    sequence(bench, 1, (0, 1))
    bench.write(DMACTL0=6, DMA0SA=0x0142, DMA0DA=0x1200, DMA0SZ=1, DMA0CTL=0x0010)
    bench.write(ADC12CTL0=ON | MSC | ENC | SC)
    bench.run_us(100)
    assert bench.mcu.reg.read16(0x1200) == 2_048
    assert bench.read("ADC12IFG") == 0x0001


def test_configuration_is_locked_while_enabled(bench: Any) -> None:
    bench.write(ADC12CTL0=ON | ENC, ADC12MCTL0=5)
    assert bench.read("ADC12MCTL0") == 0
    bench.write(ADC12CTL1=SHP | 0x0008)
    assert bench.read("ADC12CTL1") == 0
