"""The CC2420 as its host sees it: SPI accesses, registers, RAM, power, reset, pins at rest."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.power import Rail
from radio_802154 import cc2420_registers as r
from radio_802154.cc2420_registers import State

# Reset values (SWRS041B, section 37) that drivers rely on, as the models of Avrora and WSim have
# them; MDMCTRL1 and MANFIDH are those of later silicon.
DATASHEET = {
    0x10: 0xF800,  # MAIN
    0x11: 0x0AE2,  # MDMCTRL0: ADR_DECODE, CCA_HYST 2, CCA_MODE 3, AUTOCRC, PREAMBLE_LENGTH 2
    0x12: 0x0500,  # MDMCTRL1: CORR_THR 20
    0x13: 0xE080,  # RSSI: threshold −32, value −128
    0x14: 0xA70F,  # SYNCWORD
    0x15: 0xA0FF,  # TXCTRL: 0 dBm
    0x16: 0x12E5,  # RXCTRL0
    0x17: 0x0A56,  # RXCTRL1
    0x18: 0x4165,  # FSCTRL: 2405 MHz
    0x19: 0x03C4,  # SECCTRL0
    0x1C: 0x0040,  # IOCFG0: FIFOP_THR 64
    0x1E: 0x233D,  # MANFIDL
    0x1F: 0x3000,  # MANFIDH
    0x20: 0x7A94,  # FSMTC
}


def test_start_up_takes_its_time(world: Any) -> None:
    host = world.chip("a", listening=False)
    chip = host.chip
    chip.vreg_en(0)
    assert chip.state is State.VREG_OFF
    assert host.status() == 0  # nothing drives SO
    chip.vreg_en(1)
    world.run_us(299)
    assert chip.state is State.VREG_OFF
    world.run_us(1)
    assert chip.state is State.POWER_DOWN
    host.strobe(r.SXOSCON)
    world.run_us(859)
    assert not host.status() & r.STATUS_XOSC16M_STABLE
    world.run_us(1)
    assert host.status() == r.STATUS_XOSC16M_STABLE
    assert chip.state is State.IDLE


def test_registers_have_their_reset_values_after_power_up_and_reset(world: Any) -> None:
    host = world.chip("a", listening=False)
    host.write(r.TXCTRL, 0xA0E3)
    assert host.read(r.TXCTRL) == 0xA0E3
    host.chip.resetn(0)
    assert host.read(r.TXCTRL) == 0  # held in reset: no answer
    host.chip.resetn(1)
    assert {address: host.read(address) for address in DATASHEET} == DATASHEET
    assert host.chip.state is State.POWER_DOWN


def test_registers_can_be_accessed_without_the_oscillator_but_ram_cannot(world: Any) -> None:
    host = world.chip("a", listening=False)
    host.write_ram(r.RAM_PANID, b"\x34\x12")
    host.strobe(r.SXOSCOFF)
    host.write(r.TXCTRL, 0xA0E3)
    assert host.read(r.TXCTRL) == 0xA0E3
    assert host.read_ram(r.RAM_PANID, 2) == b"\0\0"
    host.strobe(r.SXOSCON)
    world.run_us(860)
    assert host.read_ram(r.RAM_PANID, 2) == b"\x34\x12"  # kept in power-down (section 13.5)


def test_several_registers_and_strobes_in_one_access(world: Any) -> None:
    host = world.chip("a", listening=False)
    answer = host.transfer(
        r.SNOP, r.MDMCTRL0 | 0x40, 0, 0, r.TXCTRL, 0xA0, 0xE3, r.TXCTRL | 0x40, 0, 0
    )
    stable = r.STATUS_XOSC16M_STABLE
    low = 0xE2 & 0xFF
    assert answer[0] == answer[1] == answer[4] == answer[7] == stable
    assert answer[3] == low
    assert answer[8:] == [0xA0, 0xE3]


def test_ram_access_wraps_nowhere_and_reads_while_writing(world: Any) -> None:
    host = world.chip("a", listening=False)
    host.write_ram(r.RAM_IEEEADR, bytes(range(8)))
    old = host.transfer(0x80 | 0x60, 0x80, 0xAA, 0xBB)  # IEEEADR is 0x60 of bank 2
    assert old[2:] == [0, 1]
    assert host.read_ram(r.RAM_IEEEADR, 8) == bytes((0xAA, 0xBB, 2, 3, 4, 5, 6, 7))


def test_read_only_registers_stay(world: Any) -> None:
    host = world.chip("a", listening=False)
    host.write(0x1E, 0xFFFF)
    assert host.read(0x1E) == 0x233D
    host.write(r.RSSI, 0xD055)  # threshold writable, value not
    assert host.read(r.RSSI) == 0xD080


def test_oscillator_on_the_cca_pin(world: Any) -> None:
    """IOCFG1.CCAMUX = 24 shows XOSC16M_STABLE on CCA, with an edge for the host's interrupt."""
    host = world.chip("a", listening=False)
    host.strobe(r.SXOSCOFF)
    edges: list[int] = []
    host.write(r.IOCFG1, 24)
    host.chip.cca.watch(edges.append)
    assert host.chip.cca.value == 0
    host.strobe(r.SXOSCON)
    world.run_us(860)
    assert edges == [1]
    assert host.chip.cca.value == 1


def test_polarity_bits_invert_the_pins(world: Any) -> None:
    host = world.chip("a", listening=False)
    pins = (host.chip.fifo, host.chip.fifop, host.chip.sfd)
    assert [pin.value for pin in pins] == [0, 0, 0]
    host.write(r.IOCFG0, r.IOCFG0_FIFO_POLARITY | r.IOCFG0_FIFOP_POLARITY | r.IOCFG0_SFD_POLARITY)
    assert [pin.value for pin in pins] == [1, 1, 1]


def test_lock_and_rssi_valid_follow_the_receiver(world: Any) -> None:
    host = world.chip("a", listening=False)
    host.strobe(r.SRXON)
    assert host.chip.state is State.RX_CALIBRATE
    assert not host.status() & r.STATUS_LOCK
    assert host.read(r.RSSI) & 0xFF == 0x80
    world.run_us(192)
    assert host.chip.state is State.RX_SFD_SEARCH
    assert host.read(r.FSMSTATE) == 3
    assert host.status() & r.STATUS_LOCK
    assert not host.status() & r.STATUS_RSSI_VALID
    world.run_us(128)
    assert host.status() & r.STATUS_RSSI_VALID
    host.strobe(r.SRFOFF)
    assert host.chip.state is State.IDLE
    assert host.status() == r.STATUS_XOSC16M_STABLE


def test_energy_by_state(world: Any) -> None:
    rail = Rail(world.scheduler, "3V", 3.0)
    host = world.chip("a", rail=rail)
    consumer = rail.consumers[0]
    assert consumer.amps == pytest.approx(18.8e-3)
    host.write(r.TXCTRL, 0xA0E3)
    host.load(bytes(10))
    host.strobe(r.STXON)
    world.run_us(1)
    assert consumer.amps == pytest.approx(8.5e-3)  # −25 dBm
    host.strobe(r.SRFOFF)
    assert consumer.amps == pytest.approx(426e-6)
    host.strobe(r.SXOSCOFF)
    assert consumer.amps == pytest.approx(20e-6)
    host.chip.vreg_en(0)
    assert consumer.amps == pytest.approx(0.02e-6)


def test_supply_loss_resets_and_recovery_starts_again(world: Any) -> None:
    rail = Rail(world.scheduler, "3V", 3.0)
    host = world.chip("a", rail=rail, address=1)
    rail.set_volts(1.9)
    assert host.chip.state is State.VREG_OFF
    assert rail.consumers[0].state == "off"
    rail.set_volts(3.0)
    world.run_us(300)
    assert host.chip.state is State.POWER_DOWN
    assert host.read(r.MDMCTRL0) == 0x0AE2
    host.strobe(r.SXOSCON)
    world.run_us(860)
    assert host.read_ram(r.RAM_SHORTADR, 2) == b"\0\0"


def test_battery_monitor(world: Any) -> None:
    """Toggle voltage 1.25 V · (72 − setting) / 27 (section 27): 2.1 V is setting 27 (2.08 V)."""
    rail = Rail(world.scheduler, "3V", 2.5)
    host = world.chip("a", rail=rail)
    host.write(r.BATTMON, r.BATTMON_EN | 27)
    assert host.read(r.BATTMON) & r.BATTMON_OK
    host.write(r.BATTMON, r.BATTMON_EN | 10)  # 2.87 V
    assert not host.read(r.BATTMON) & r.BATTMON_OK


@pytest.mark.parametrize(
    ("level", "dbm", "milliamps"), [(31, 0, 17.4), (19, -5, 13.9), (3, -25, 8.5), (29, -0.5, 16.95)]
)
def test_power_amplifier_levels(level: int, dbm: float, milliamps: float) -> None:
    power, current = r.pa_level(level)
    assert power == pytest.approx(dbm)
    assert current == pytest.approx(milliamps / 1000)


@pytest.mark.parametrize("level", range(31))
def test_more_level_is_more_power(level: int) -> None:
    assert r.pa_level(level)[0] < r.pa_level(level + 1)[0]
