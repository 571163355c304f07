"""Resets, watchdog, ADC, data EEPROM and ports."""

from __future__ import annotations

import pytest

from firmware_model.dspic30f.errors import LimitError
from firmware_model.dspic30f.mcu import DspicConfig
from firmware_model.dspic30f.system import ResetCause
from firmware_model.signals import constant
from firmware_model.time import FS_PER_NS, FS_PER_S

BOOT_S = 0.0642  # power-up timer 64 ms, oscillator start 0.139 ms, PLL lock 0.05 ms


def idle(mcu):
    """Firmware that does nothing."""


def causes(mcu):
    return ResetCause(mcu.reg["RCON"].read() & 0xC0D3)


# --- resets ------------------------------------------------------------------------------


def test_power_on_releases_after_the_power_up_timer(rig):
    boots = []
    r = rig(lambda mcu: boots.append((mcu.scheduler.now, causes(mcu))))
    r.run(0.1)
    assert len(boots) == 1
    assert boots[0][0] / FS_PER_S == pytest.approx(BOOT_S, abs=5e-5)
    assert boots[0][1] == ResetCause.POWER_ON | ResetCause.BROWN_OUT


def test_watchdog_resets_busy_firmware_only(rig):
    """The same time-out resets a CPU that spins and wakes one that idles."""
    boots = []

    def spin():
        while True:
            yield 10_000

    def firmware(mcu):
        boots.append(causes(mcu))
        mcu.reg["RCON"].set_bits(1 << 5)
        if len(boots) == 1:
            mcu.cpu.spawn("spin", spin())

    r = rig(firmware, DspicConfig(watchdog_prescaler_a=8, watchdog_prescaler_b=2))  # 32 ms
    r.run(BOOT_S + 0.031)
    assert len(boots) == 1
    r.run(BOOT_S + 0.2)
    assert len(boots) == 2
    assert boots[1] & ResetCause.WATCHDOG


def test_clrwdt_keeps_firmware_alive(rig):
    boots = []

    def spin(mcu):
        while True:
            mcu.watchdog.clear()
            yield 100_000  # 6.8 ms

    def firmware(mcu):
        boots.append(causes(mcu))
        mcu.reg["RCON"].set_bits(1 << 5)
        mcu.cpu.spawn("spin", spin(mcu))

    r = rig(firmware, DspicConfig(watchdog_prescaler_a=8, watchdog_prescaler_b=1))  # 16 ms
    r.run(0.5)
    assert len(boots) == 1


def test_software_reset_stops_the_task_that_asked(rig):
    log = []

    def task(mcu):
        log.append("asked")
        mcu.request_reset()
        yield 1
        log.append("went on")

    def firmware(mcu):
        log.append(causes(mcu))
        if len(log) == 1:
            mcu.cpu.spawn("task", task(mcu))

    r = rig(firmware)
    r.run(0.1)
    assert log[1] == "asked"
    assert log[2] & ResetCause.SOFTWARE
    assert len(log) == 3


@pytest.mark.parametrize(
    ("low", "expected"),
    [
        (2.0, ResetCause.BROWN_OUT),
        (0.0, ResetCause.BROWN_OUT | ResetCause.POWER_ON),
    ],
)
def test_a_dip_is_a_brown_out_and_a_loss_a_power_on(rig, low, expected):
    boots = []

    def firmware(mcu):
        boots.append(causes(mcu))
        mcu.reg["RCON"].clear_bits(0xC0D3)

    r = rig(firmware)
    r.run(0.1)
    r.rail.set_volts(low)
    r.run(0.2)
    assert not r.mcu.cpu.running
    r.rail.set_volts(3.3)
    r.run(0.4)
    assert boots[1:] == [expected]


def test_reset_clears_what_the_peripherals_were_doing(rig):
    def firmware(mcu):
        if mcu.resets == 1:
            mcu.reg["PR2"].write(36863)
            mcu.reg["OC1RS"].write(2765)
            mcu.reg["OC1CON"].write(6)
            mcu.reg["T2CON"].write(0x8010)
            mcu.reg["TRISD"].write(0)
            mcu.reg["LATD"].write(0x0010)

    r = rig(firmware)
    r.run(0.0852)  # within a pulse
    assert r.mcu.oc1.pin.value
    assert r.mcu.pin("RD4").value
    r.mcu.request_reset()
    r.run(0.0853)
    assert not r.mcu.oc1.pin.value
    assert not r.mcu.pin("RD4").value
    assert r.mcu.reg["PR2"].read() == 0xFFFF


# --- ADC ---------------------------------------------------------------------------------


def adc(rig, con1, con2, con3=31 << 8 | 19):
    r = rig(idle)
    for channel in range(16):
        r.mcu.adc.connect(channel, constant(0.1 + 0.2 * channel))
    reg = r.mcu.reg
    reg["ADCON2"].write(con2)
    reg["ADCON3"].write(con3)
    reg["ADCSSL"].write(0b0000_0000_1010_1000)  # AN3, AN5, AN7
    reg["ADCON1"].write(con1)
    return r, reg


def test_adc_auto_scan_takes_samc_plus_14_tad_each(rig):
    r, reg = adc(rig, 0x80E0, 1 << 10 | 2 << 2)
    assert r.mcu.adc.tad_fs == pytest.approx(678.17 * FS_PER_NS, rel=1e-4)
    reg["ADCON1"].set_bits(1 << 2)
    scan_s = 3 * (31 + 14) * r.mcu.adc.tad_fs / FS_PER_S
    r.run(scan_s - 1e-7)
    assert not reg["IFS0"].read() >> 11 & 1
    r.run(scan_s + 1e-7)
    assert reg["IFS0"].read() >> 11 & 1
    results = [reg[f"ADCBUF{i}"].read() for i in range(3)]
    assert results == [int(v / 3.3 * 4096) for v in (0.7, 1.1, 1.5)]


def test_adc_timer3_trigger_converts_one_input_a_match(rig):
    r, reg = adc(rig, 0x8044, 1 << 10 | 2 << 2)
    reg["PR3"].write(999)
    reg["T3CON"].write(0x8000)
    r.run(2 * 1000 / 14_745_600 + 12e-6)
    assert not reg["IFS0"].read() >> 11 & 1
    r.run(3 * 1000 / 14_745_600 + 9.6e-6)  # 14 TAD = 9.49 µs
    assert reg["IFS0"].read() >> 11 & 1
    assert [reg[f"ADCBUF{i}"].read() for i in range(3)] == [868, 1365, 1861]


def test_adc_manual_conversion_and_limits(rig):
    r, reg = adc(rig, 0x8000, 0)
    reg["ADCHS"].write(15)
    reg["ADCON1"].set_bits(2)
    reg["ADCON1"].clear_bits(2)
    r.run(1e-5)
    assert reg["ADCON1"].read() & 1
    assert reg["ADCBUF0"].read() == int(3.1 / 3.3 * 4096)


@pytest.mark.parametrize(("volts", "code"), [(-1.0, 0), (0.0, 0), (3.3, 4095), (9.0, 4095)])
def test_adc_clips(rig, volts, code):
    r, reg = adc(rig, 0x8000, 0)
    r.mcu.adc.connect(3, constant(volts))
    reg["ADCHS"].write(3)
    reg["ADCON1"].set_bits(2)
    reg["ADCON1"].clear_bits(2)
    assert reg["ADCBUF0"].read() == code


def test_adc_clock_below_667_ns_is_refused(rig):
    with pytest.raises(LimitError, match="TAD"):
        adc(rig, 0x8000, 0, con3=10)


# --- data EEPROM -------------------------------------------------------------------------

WORD = 0x7FF010


def nvm(mcu, operation):
    mcu.reg["NVMCON"].write(0x4000 | operation)
    mcu.reg["NVMKEY"].write(0x55)
    mcu.reg["NVMKEY"].write(0xAA)
    mcu.reg["NVMCON"].set_bits(0x8000)


def test_eeprom_erases_and_writes_in_2_ms_each(rig):
    r = rig(idle)
    r.mcu.eeprom.table_write(WORD, 0x1234)
    nvm(r.mcu, 0x04)
    assert r.mcu.reg["NVMCON"].read() & 0x8000
    r.run(0.0021)
    assert not r.mcu.reg["NVMCON"].read() & 0x8000
    assert r.mcu.eeprom.table_read(WORD) == 0x1234
    r.mcu.eeprom.table_write(WORD, 0xFF00)
    nvm(r.mcu, 0x04)
    r.run(0.0045)
    assert r.mcu.eeprom.table_read(WORD) == 0x1200  # writing only clears bits
    nvm(r.mcu, 0x44)
    r.run(0.0070)
    assert r.mcu.eeprom.table_read(WORD) == 0xFFFF


def test_eeprom_needs_its_key(rig):
    r = rig(idle)
    r.mcu.eeprom.table_write(WORD, 0)
    r.mcu.reg["NVMCON"].write(0x4004)
    r.mcu.reg["NVMKEY"].write(0xAA)
    r.mcu.reg["NVMCON"].set_bits(0x8000)
    r.run(0.01)
    assert r.mcu.eeprom.table_read(WORD) == 0xFFFF


def test_eeprom_write_cut_by_power_leaves_the_word_erased(rig):
    r = rig(idle)
    r.run(0.1)
    r.mcu.eeprom.table_write(WORD, 0x4242)
    nvm(r.mcu, 0x04)
    r.run(0.101)
    r.rail.set_volts(0.0)
    r.run(0.2)
    assert r.mcu.eeprom.table_read(WORD) == 0xFFFF


# --- registers at their addresses --------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "address"),
    [
        ("IFS0", 0x084),
        ("IEC2", 0x090),
        ("IPC10", 0x0A8),
        ("T1CON", 0x104),
        ("TMR3HLD", 0x108),
        ("PR5", 0x11C),
        ("OC1CON", 0x184),
        ("I2CSTAT", 0x208),
        ("U2RXREG", 0x21C),
        ("SPI1BUF", 0x224),
        ("ADCBUFF", 0x29E),
        ("ADCSSL", 0x2AA),
        ("LATD", 0x2D6),
        ("RCON", 0x740),
        ("NVMKEY", 0x766),
    ],
)
def test_registers_stand_at_datasheet_addresses(rig, name, address):
    space = rig(idle).mcu.reg
    assert space.at(address) is space[name]


def test_int1_follows_its_edge_select(rig):
    r = rig(idle)
    pin = r.mcu.pin("RA12")
    pin.set(True)
    assert r.mcu.reg["IFS1"].read() & 1
    r.mcu.reg["IFS1"].clear_bits(1)
    pin.set(False)
    assert not r.mcu.reg["IFS1"].read() & 1
    r.mcu.reg["INTCON2"].set_bits(2)
    pin.set(True)
    assert not r.mcu.reg["IFS1"].read() & 1
    pin.set(False)
    assert r.mcu.reg["IFS1"].read() & 1
