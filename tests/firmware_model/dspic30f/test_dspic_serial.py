"""SPI slave, UART and I²C master at register level."""

from __future__ import annotations

import pytest

from firmware_model.dspic30f.errors import LimitError, UnsupportedModeError
from firmware_model.time import FS_PER_S, FS_PER_US
from firmware_model.wires import I2cBus

FCY = 14_745_600


def idle(mcu):
    """Firmware that does nothing."""


# --- SPI ---------------------------------------------------------------------------------


def spi_slave(rig):
    r = rig(idle)
    reg = r.mcu.reg
    reg["SPI1CON"].write(1 << 8 | 1 << 7)
    reg["SPI1STAT"].write(1 << 15)
    r.mcu.spi1.select(True)
    return r, reg


def exchange(r, byte):
    out = r.mcu.spi1.begin()
    r.mcu.spi1.end(byte)
    return out


def test_spi_is_double_buffered_in_both_directions(rig):
    r, reg = spi_slave(rig)
    reg["SPI1BUF"].write(0x11)  # to the shift register
    assert not reg["SPI1STAT"].read() & 2
    reg["SPI1BUF"].write(0x22)  # to the transmit buffer
    assert reg["SPI1STAT"].read() & 2
    assert exchange(r, 0xA1) == 0x11
    assert reg["SPI1STAT"].read() & 3 == 1  # received, transmit buffer moved up
    assert reg["IFS0"].read() >> 8 & 1
    assert reg["SPI1BUF"].read() == 0xA1
    assert exchange(r, 0xA2) == 0x22
    assert reg["SPI1BUF"].read() == 0xA2


def test_spi_overflow_stops_reception_until_cleared(rig):
    r, reg = spi_slave(rig)
    exchange(r, 1)
    exchange(r, 2)
    assert reg["SPI1STAT"].read() & 0x40
    assert reg["SPI1BUF"].read() == 1
    exchange(r, 3)
    assert not reg["SPI1STAT"].read() & 1
    reg["SPI1STAT"].clear_bits(0x40)
    exchange(r, 4)
    assert reg["SPI1BUF"].read() == 4
    assert r.mcu.spi1.overruns == 2


def test_spi_unloaded_gives_back_what_came_in(rig):
    r, _reg = spi_slave(rig)
    exchange(r, 0x5A)
    assert exchange(r, 0) == 0x5A
    assert r.mcu.spi1.underruns == 2


def test_spi_unselected_does_not_listen(rig):
    r, reg = spi_slave(rig)
    r.mcu.spi1.select(False)
    assert exchange(r, 9) == 0x00
    assert not reg["SPI1STAT"].read() & 1


def test_spi_master_mode_is_refused(rig):
    with pytest.raises(UnsupportedModeError):
        rig(idle).mcu.reg["SPI1CON"].write(1 << 5)


# --- UART --------------------------------------------------------------------------------


def uart(rig, urxisel=0):
    r = rig(idle)
    reg = r.mcu.reg
    reg["U2BRG"].write(FCY // (16 * 4800) - 1)
    reg["U2MODE"].write(1 << 15)
    reg["U2STA"].write(1 << 10 | urxisel << 6)
    return r, reg


def test_uart_bit_time_of_4800_baud(rig):
    r, _reg = uart(rig)
    assert r.mcu.uart2.bit_cycles == FCY / 4800  # 192 × 16: no error at this crystal


def test_uart_character_takes_ten_bits(rig):
    r, reg = uart(rig)
    heard = []
    r.mcu.uart2.listener = lambda c: heard.append((r.scheduler.now, c))
    reg["U2TXREG"].write(0x55)
    reg["U2TXREG"].write(0x56)
    r.run(0.0043)
    assert [c for _t, c in heard] == [0x55, 0x56]
    spacing = heard[1][0] - heard[0][0]
    assert spacing == pytest.approx(10 * FS_PER_S / 4800, abs=2 * FS_PER_S / FCY)
    assert reg["U2STA"].read() & 0x100  # TRMT


@pytest.mark.parametrize(("urxisel", "needed"), [(0, 1), (1, 1), (2, 3), (3, 4)])
def test_uart_interrupt_threshold(rig, urxisel, needed):
    r, reg = uart(rig, urxisel)
    for i in range(1, 5):
        r.mcu.uart2.receive(i)
        assert bool(reg["IFS1"].read() >> 8 & 1) == (i >= needed)


def test_uart_fifth_character_sets_oerr_and_clearing_it_empties_the_fifo(rig):
    r, reg = uart(rig)
    for i in range(6):
        r.mcu.uart2.receive(i)
    assert reg["U2STA"].read() & 2
    assert r.mcu.uart2.overruns == 2
    assert reg["U2RXREG"].read() == 0
    reg["U2STA"].clear_bits(2)
    assert not reg["U2STA"].read() & 1
    r.mcu.uart2.receive(7)
    assert reg["U2RXREG"].read() == 7


# --- I²C ---------------------------------------------------------------------------------


class Echo:
    """A target at 0x18 that remembers what it was told and counts up when read."""

    def __init__(self):
        self.log = []
        self.value = 0x40

    def address_match(self, address, read):
        if address == 0x18:
            self.log.append(("R" if read else "W", address))
        return address == 0x18

    def write(self, byte):
        self.log.append(byte)
        return byte != 0xEE

    def read(self):
        self.value += 1
        return self.value

    def stop(self):
        self.log.append("stop")


def i2c(rig, brg=23):
    r = rig(idle)
    target = Echo()
    r.mcu.i2c.bus = I2cBus((target,))
    reg = r.mcu.reg
    reg["I2CBRG"].write(brg)
    reg["I2CCON"].write(1 << 15)
    return r, reg, target


def wait(r, bits):
    r.run((r.scheduler.now + bits * r.mcu.i2c.bit_fs + FS_PER_US) / FS_PER_S)


@pytest.mark.parametrize(("brg", "scl_hz"), [(23, 397_000), (133, 99_900)])
def test_i2c_clock_follows_the_manual_s_formula(rig, brg, scl_hz):
    r, _reg, _target = i2c(rig, brg)
    assert FS_PER_S / r.mcu.i2c.bit_fs == pytest.approx(
        1 / ((brg + 1) / FCY + 1 / 1_111_111), rel=1e-6
    )
    assert FS_PER_S / r.mcu.i2c.bit_fs == pytest.approx(scl_hz, rel=0.01)


def test_i2c_faster_than_400_khz_is_refused(rig):
    _r, reg, _target = i2c(rig, 10)
    with pytest.raises(LimitError):
        reg["I2CCON"].set_bits(1)


def test_i2c_conversation_byte_by_byte(rig):
    r, reg, target = i2c(rig)
    reg["I2CCON"].set_bits(1)  # SEN
    assert reg["I2CCON"].read() & 1
    wait(r, 1)
    assert not reg["I2CCON"].read() & 1
    assert reg["IFS0"].read() >> 14 & 1  # MI2CIF
    reg["I2CTRN"].write(0x30)
    assert reg["I2CSTAT"].read() & 0x4000  # TRSTAT
    wait(r, 8)
    assert reg["I2CSTAT"].read() & 0x4000  # the ninth bit is still missing
    wait(r, 1)
    assert reg["I2CSTAT"].read() & 0xC000 == 0  # done, acknowledged
    reg["I2CTRN"].write(0xEE)
    wait(r, 9)
    assert reg["I2CSTAT"].read() & 0x8000  # not acknowledged
    reg["I2CCON"].set_bits(2)  # RSEN
    wait(r, 1)
    reg["I2CTRN"].write(0x31)
    wait(r, 9)
    reg["I2CCON"].set_bits(8)  # RCEN
    wait(r, 8)
    assert reg["I2CSTAT"].read() & 2
    assert reg["I2CRCV"].read() == 0x41
    assert not reg["I2CSTAT"].read() & 2
    reg["I2CCON"].set_bits(4)  # PEN
    wait(r, 1)
    assert target.log == [("W", 0x18), 0xEE, ("R", 0x18), "stop"]


def test_i2c_absent_target_does_not_acknowledge(rig):
    r, reg, _target = i2c(rig)
    reg["I2CCON"].set_bits(1)
    wait(r, 1)
    reg["I2CTRN"].write(0x3C)
    wait(r, 9)
    assert reg["I2CSTAT"].read() & 0x8000


def test_i2c_interrupt_comes_at_the_end_of_the_operation(rig):
    times = []
    r, reg, _target = i2c(rig)
    r.run(0.065)
    r.mcu.cpu.on_interrupt("MI2C", lambda: (times.append(r.scheduler.now), 4)[1])
    reg["I2CBRG"].write(133)
    reg["I2CCON"].write(1 << 15)
    reg["IEC0"].set_bits(1 << 14)
    begun = r.scheduler.now
    reg["I2CCON"].set_bits(1)
    r.run(0.0651)
    assert times[0] - begun - r.mcu.i2c.bit_fs < 10 * FS_PER_S // FCY


def test_i2c_write_while_busy_collides(rig):
    r, reg, target = i2c(rig)
    reg["I2CCON"].set_bits(1)
    reg["I2CTRN"].write(0x30)
    assert reg["I2CSTAT"].read() & 0x80
    wait(r, 1)
    assert target.log == []
