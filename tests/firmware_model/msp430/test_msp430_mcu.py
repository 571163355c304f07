"""The MCU as a whole: memory map, vectors, resets, supply, and power by mode."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.cpu import Coroutine
from firmware_model.errors import FirmwareError, RegisterError
from firmware_model.msp430.mcu import VECTORS
from firmware_model.time import FS_PER_S, FS_PER_US

# TI's msp430x16x.h: addresses that code compiled for the F1611 uses.
ADDRESSES = {
    "IE1": 0x0000, "IFG2": 0x0003, "ME2": 0x0005, "P1IN": 0x0020, "P1SEL": 0x0026, "P2IFG": 0x002B,
    "P3OUT": 0x0019, "P4DIR": 0x001E, "P5SEL": 0x0033, "P6IN": 0x0034, "DCOCTL": 0x0056,
    "BCSCTL1": 0x0057, "BCSCTL2": 0x0058, "U0CTL": 0x0070, "U0TXBUF": 0x0077, "U1CTL": 0x0078,
    "U1MCTL": 0x007B, "U1RXBUF": 0x007E, "ADC12MCTL15": 0x008F, "TBIV": 0x011E, "WDTCTL": 0x0120,
    "DMACTL0": 0x0122, "FCTL1": 0x0128, "FCTL3": 0x012C, "TAIV": 0x012E, "MPY": 0x0130,
    "RESHI": 0x013C, "ADC12MEM0": 0x0140, "TACTL": 0x0160, "TACCTL2": 0x0166, "TAR": 0x0170,
    "TACCR2": 0x0176, "TBCTL": 0x0180, "TBCCTL6": 0x018E, "TBR": 0x0190, "TBCCR6": 0x019E,
    "ADC12CTL0": 0x01A0, "ADC12IV": 0x01A8, "DMA0CTL": 0x01E0, "DMA1SA": 0x01EA, "DMA2SZ": 0x01F6,
}  # fmt: skip


@pytest.mark.parametrize("name", ADDRESSES)
def test_registers_stand_at_their_addresses(bench: Any, name: str) -> None:
    assert bench.mcu.reg[name].address == ADDRESSES[name]


def test_vectors_are_the_data_sheets(bench: Any) -> None:
    # SLAS368: 0xFFFA Timer_B CCIFG0, 0xFFE6 USART1 receive, 0xFFE0 DAC/DMA.
    assert 0xFFE0 + 2 * VECTORS["TIMERB0"] == 0xFFFA
    assert 0xFFE0 + 2 * VECTORS["USART1RX"] == 0xFFE6
    assert 0xFFE0 + 2 * VECTORS["DACDMA"] == 0xFFE0
    assert bench.mcu.interrupts.names()[:3] == ("NMI", "TIMERB0", "TIMERB1")


def test_ram_by_address_and_its_mirror(bench: Any) -> None:
    reg = bench.mcu.reg
    reg.write16(0x1101, 0xBEEF)  # an odd address means the word below
    assert reg.read16(0x1100) == 0xBEEF
    assert reg.read8(0x0201) == 0xBE  # 0x0200–0x09FF mirrors 0x1100–0x18FF
    reg.write8(0x0A00 - 1, 0x77)
    assert reg.read8(0x18FF) == 0x77
    reg.write8(0x38FF, 1)
    for hole in (0x0A00, 0x0FFF, 0x3900, 0x3FFF):
        with pytest.raises(RegisterError, match="no memory"):
            reg.read8(hole)


def test_allocation(bench: Any) -> None:
    ram = bench.mcu.ram
    assert [ram.allocate(3), ram.allocate(2), ram.allocate(1)] == [0x1100, 0x1104, 0x1106]
    assert ram.free == 10_240 - 8
    with pytest.raises(FirmwareError, match="RAM is full"):
        ram.allocate(10_233)
    ram.store(0x38FE, b"ab")
    assert ram.load(0x38FE, 2) == b"ab"
    with pytest.raises(FirmwareError, match="not in RAM"):
        ram.store(0x38FF, b"ab")


def test_boot_waits_for_the_supply(make_bench: Any) -> None:
    bench = make_bench()
    bench.scheduler.run(1_999 * FS_PER_US)
    assert bench.boots == 0
    bench.scheduler.run(2_001 * FS_PER_US)
    assert bench.boots == 1
    assert bench.mcu.last_reset == "power-up"


def test_brown_out_and_recovery(bench: Any) -> None:
    mcu = bench.mcu
    address = mcu.ram.allocate(4)
    mcu.ram.store(address, b"data")
    mcu.reg["P5OUT"].write(0x10)
    mcu.reg["P5DIR"].write(0x10)
    bench.rail.set_volts(1.75)
    assert mcu.powered  # V(B_IT−) is 1.71 V
    bench.rail.set_volts(1.70)
    assert not mcu.powered
    assert not mcu.cpu.running
    assert not mcu.pin_signal(5, 4).value
    assert mcu.consumer.amps == 0.0
    bench.rail.set_volts(1.80)
    bench.run_us(10_000)
    assert bench.boots == 1  # hysteresis
    bench.rail.set_volts(3.0)
    bench.run_us(10_000)
    assert bench.boots == 2
    assert mcu.ram.load(address, 4) != b"data"
    assert mcu.reg["P5OUT"].value == 0


def test_a_dip_during_start_up_starts_over(make_bench: Any) -> None:
    bench = make_bench()
    bench.run_us(1_000)
    bench.rail.set_volts(1.0)
    bench.run_us(500)
    bench.rail.set_volts(3.0)
    bench.run_us(1_999)
    assert bench.boots == 0
    bench.run_us(2)
    assert bench.boots == 1


def test_firmware_can_cut_its_own_supply(bench: Any) -> None:
    bench.mcu.pin_signal(4, 0).watch(lambda level: bench.rail.set_volts(0.0 if level else 3.0))
    reached: list[str] = []

    def body() -> Coroutine:
        bench.mcu.reg["P4DIR"].write(0x01)
        bench.mcu.reg["P4OUT"].write(0x01)
        reached.append("the end of the instruction")
        yield 1
        reached.append("never")

    bench.task(body())
    bench.run_us(5_000)
    assert reached == ["the end of the instruction"]
    # A pin without supply lets go, so this board comes up again.
    assert bench.boots == 2


def test_a_puc_keeps_ram(bench: Any) -> None:
    bench.mcu.ram.store(0x1200, b"kept")
    bench.mcu.request_reset("one")
    bench.mcu.request_reset("two")  # of several in one instant the first counts
    bench.run_us(10)
    assert bench.boots == 2
    assert bench.mcu.last_reset == "one"
    assert bench.mcu.ram.load(0x1200, 4) == b"kept"


def test_a_reset_ends_firmware_and_its_interrupts(bench: Any) -> None:
    ticks: list[int] = []

    def body() -> Coroutine:
        while True:
            ticks.append(1)
            yield 100

    bench.task(body())
    bench.mcu.interrupts.gie = True
    bench.run_us(1_000)
    assert ticks
    bench.mcu.press_reset()
    ticks.clear()
    bench.run_us(1_000)
    assert ticks == []
    assert not bench.mcu.interrupts.gie
    assert bench.boots == 2


@pytest.mark.parametrize(
    ("state", "amps"),
    [("lpm0", 75e-6), ("lpm1", 75e-6), ("lpm2", 17e-6), ("lpm3", 2.6e-6), ("lpm4", 0.2e-6)],
)
def test_sleep_currents(make_bench: Any, state: str, amps: float) -> None:
    bench = make_bench().start(lambda mcu: setattr(mcu.cpu, "sleep_state", state))
    bench.run_us(1_000)
    assert bench.mcu.consumer.state == state
    assert bench.mcu.consumer.amps == amps


def test_active_current_follows_mclk_and_the_supply(bench: Any) -> None:
    def body() -> Coroutine:
        while True:
            yield 1_000

    bench.task(body())
    bench.run_us(1_000)
    for mclk, volts in ((0x60, 3.0), (0xA0, 3.0), (0xA0, 2.2)):
        bench.write(DCOCTL=mclk)
        bench.rail.set_volts(volts)
        per_mhz = 500e-6 if volts == 3.0 else 330e-6  # SLAS368
        expected = per_mhz * bench.mcu.clocks.dco_hz / 1e6
        assert bench.mcu.consumer.amps == pytest.approx(expected)


def test_wake_up_from_lpm3_takes_6_us(bench: Any) -> None:
    woken: list[int] = []
    bench.handle("PORT1", lambda: (woken.append(bench.scheduler.now), bench.write(P1IFG=0)))
    bench.mcu.interrupts.gie = True
    bench.write(BCSCTL1=0x87, DCOCTL=0xA0, P1IE=0x01)
    start = bench.scheduler.now
    bench.mcu.ports[1].pins[0].input.set(True)
    bench.run_us(100)
    cycle = bench.mcu.clocks.mclk.span(1)
    assert 6 * FS_PER_US + 6 * cycle < woken[0] - start <= 6 * FS_PER_US + 7 * cycle


def test_average_current_of_a_blinking_sleeper(bench: Any) -> None:
    """A wake-up each second with 1 ms of work: energy is the datasheet's arithmetic."""
    bench.handle("TIMERB0", lambda: None, cycles=round(bench.mcu.clocks.dco_hz * 1e-3))
    bench.mcu.interrupts.gie = True
    bench.write(TBCCR0=32_767, TBCCTL0=0x10, TBCTL=0x0114)
    before = bench.mcu.consumer.joules
    bench.scheduler.run(bench.scheduler.now + 10 * FS_PER_S)
    active = 500e-6 * bench.mcu.clocks.dco_hz / 1e6
    expected = 3.0 * (10 * 1e-3 * active + (10 - 0.01) * 2.6e-6)
    assert bench.mcu.consumer.joules - before == pytest.approx(expected, rel=0.03)
