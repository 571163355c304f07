"""The CC2420 radio at register level, as its host sees it over SPI and eight pins (SWRS041B).

This file is the host's side: supply, reset, SPI accesses, strobes. Below it stand transmission
(`cc2420_transmitter.py`), reception (`cc2420_receiver.py`), state and pins (`cc2420_core.py`), and
the data (`cc2420_registers.py`).

Not modelled: AES (SAES, SRXDEC, STXENC do nothing; SEC_MODE must be 0), the serial and random test
modes (TX_MODE, RX_MODE 0 only), the analog test registers, the crystal's error (symbols are exactly
16 µs).
"""

from __future__ import annotations

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_US
from radio_802154 import cc2420_registers as r
from radio_802154.air import Air
from radio_802154.cc2420_core import RX_STATES, TX_STATES
from radio_802154.cc2420_registers import State
from radio_802154.cc2420_transmitter import TransmittingChip

# phases of an SPI access (Figure 10)
_ADDRESS, _REGISTER_HIGH, _REGISTER_LOW, _RAM_BANK, _RAM_DATA, _TX_WRITE, _RX_READ, _IGNORE = range(
    8
)


class Cc2420(TransmittingChip):
    """A CC2420 on an SPI bus (`select`, `begin`, `end`) and an antenna of the medium.

    Output pins `fifo`, `fifop`, `sfd`, `cca` are signals of levels; the polarity bits of IOCFG0
    apply. Inputs are `vreg_en(level)` and `resetn(level)`. Without a rail the supply is taken as
    good. The chip starts without power at its core: VREG_EN is low.

    Args:
        scheduler: the run's time.
        air: the medium.
        name: of the antenna in the medium, and of pins and power consumer.
        rail: supply of the regulator's input; its loss resets the chip.

    """

    def __init__(
        self, scheduler: Scheduler, air: Air, name: str = "cc2420", rail: Rail | None = None
    ) -> None:
        super().__init__(scheduler, air, name, rail)
        self._selected = False
        self._phase = _ADDRESS
        self._address = 0
        self._read = False
        self._shift_out = 0
        self._written = 0
        self._port = air.attach(name, self)
        if rail is not None:
            rail.volts.watch(self._supply_changed)

    def vreg_en(self, level: bool) -> None:
        """VREG_EN pin: the internal regulator that feeds the core."""
        self._vreg_pin = level
        if level:
            self._power_up()
        else:
            self._power_off()

    def resetn(self, level: bool) -> None:
        """RESETn pin, active low: registers to reset values, oscillator off; RAM keeps."""
        falling = self._reset_pin and not level
        self._reset_pin = level
        if falling and self._state is not State.VREG_OFF:
            self._reset()

    def _supply_changed(self, volts: float) -> None:
        if volts < r.SUPPLY_MINIMUM_V:
            self._power_off()
        elif self._state is State.VREG_OFF and self._vreg_pin and self._start_event is None:
            self._power_up()

    def _power_up(self) -> None:
        good = self._rail is None or self._rail.volts.value >= r.SUPPLY_MINIMUM_V
        if self._state is State.VREG_OFF and self._start_event is None and good:
            self._start_event = self._scheduler.after(
                r.VREG_START_US * FS_PER_US, self._regulator_ready
            )

    def _regulator_ready(self) -> None:
        self._start_event = None
        self._ram[:] = bytes(r.RAM_OCTETS)  # unknown after power-up: zero (assumed)
        self._clear_digital()
        self._enter(State.POWER_DOWN)
        self._update_pins()

    def _power_off(self) -> None:
        self._stop_radio()
        self._scheduler.cancel(self._start_event)
        self._start_event = None
        self._oscillator = False
        self._clear_digital()
        self._enter(State.VREG_OFF)
        for pin in (self.fifo, self.fifop, self.sfd):
            pin.set(False)
        self.cca.refresh()

    def _reset(self) -> None:
        self._stop_radio()
        self._scheduler.cancel(self._start_event)
        self._start_event = None
        self._oscillator = False
        self._clear_digital()
        self._phase = _IGNORE if self._selected else _ADDRESS
        self._enter(State.POWER_DOWN)
        self.sfd.set(False)
        self._update_pins()

    def _status(self) -> int:
        status = 0
        if self._oscillator:
            status |= r.STATUS_XOSC16M_STABLE
        if self._tx_underflow:
            status |= r.STATUS_TX_UNDERFLOW
        if self._state in TX_STATES:
            status |= r.STATUS_TX_ACTIVE
        if self._lock_bits() & r.FSCTRL_LOCK_STATUS:
            status |= r.STATUS_LOCK
        if self._rssi_valid():
            status |= r.STATUS_RSSI_VALID
        return status

    def select(self, selected: bool) -> None:
        """CSn changed; True is active (low)."""
        self._selected = selected
        self._phase = _ADDRESS

    def begin(self) -> int:
        """First clock edge of an octet: return the octet shifted out."""
        phase = self._phase
        if self._state is State.VREG_OFF or not self._reset_pin or not self._selected:
            return 0
        if phase == _RX_READ:
            self._store_arrived()
            return self._rx.peek()
        if phase in (_ADDRESS, _TX_WRITE):
            return self._status()
        if phase == _REGISTER_HIGH:
            self._shift_out = self.register(self._address)
            return self._shift_out >> 8
        if phase == _REGISTER_LOW:
            return self._shift_out & 0xFF
        if phase == _RAM_DATA:
            self._store_arrived()
            return self._ram[self._address] if self._address < r.RAM_OCTETS else 0
        return 0

    def end(self, mosi: int) -> None:
        """Last clock edge of an octet: take the octet shifted in."""
        if self._state is State.VREG_OFF or not self._reset_pin or not self._selected:
            return
        phase = self._phase
        if phase == _RX_READ:
            self._pop()
        elif phase == _TX_WRITE:
            self._tx_write(mosi)
        elif phase == _ADDRESS:
            self._address_octet(mosi)
        elif phase == _REGISTER_HIGH:
            self._written = mosi << 8
            self._phase = _REGISTER_LOW
        elif phase == _REGISTER_LOW:
            self._phase = _ADDRESS
            if not self._read:
                self._write_register(self._address, self._written | mosi)
        elif phase == _RAM_BANK:
            self._address |= (mosi & 0xC0) << 1
            self._read = bool(mosi & r.RAM_READ_ONLY)
            self._phase = _RAM_DATA
        elif phase == _RAM_DATA:
            if not self._read and self._address < r.RAM_OCTETS:
                self._freeze_sent()
                self._ram[self._address] = mosi
            self._address += 1

    def _address_octet(self, octet: int) -> None:
        if octet & r.ADDRESS_RAM:
            self._address = octet & 0x7F
            self._phase = _RAM_BANK if self._oscillator else _IGNORE
            return
        address = octet & r.ADDRESS_MASK
        self._read = bool(octet & r.ADDRESS_READ)
        if address <= r.LAST_STROBE:
            self._strobe(address)
        elif address == r.RXFIFO:
            self._phase = _RX_READ if self._oscillator and self._read else _IGNORE
        elif address == r.TXFIFO:
            self._phase = _TX_WRITE if self._oscillator and not self._read else _IGNORE
        else:
            self._address = address
            self._phase = _REGISTER_HIGH

    def _write_register(self, address: int, value: int) -> None:
        mask = self._masks.get(address, 0)
        value = self._registers.get(address, 0) & ~mask | value & mask
        if address == r.MAIN and not value & r.MAIN_RESETN:
            self._reset()
        if address in self._registers:
            self._registers[address] = value
        if address in (r.IOCFG0, r.IOCFG1, r.MDMCTRL0):
            self._update_pins()
            self.cca.refresh()

    def _strobe(self, strobe: int) -> None:
        if strobe == r.SNOP:
            return
        if strobe == r.SXOSCON:
            if not self._oscillator and self._start_event is None:
                self._start_event = self._scheduler.after(
                    r.XOSC_START_US * FS_PER_US, self._oscillator_stable
                )
                self._enter(State.POWER_DOWN)
            return
        if strobe == r.SXOSCOFF:
            self._stop_radio()
            self._scheduler.cancel(self._start_event)
            self._start_event = None
            self._oscillator = False
            self._enter(State.POWER_DOWN)
            self._update_pins()
            return
        if not self._oscillator:
            return  # everything else needs the 16 MHz clock
        if strobe in (r.STXON, r.STXONCCA):
            from_idle = strobe == r.STXON and self._state is State.IDLE
            if (self._state in RX_STATES or from_idle) and (
                strobe == r.STXON or self._channel_clear()
            ):
                self._start_transmission(ack=False)
        elif strobe == r.SRXON:
            if self._state not in RX_STATES:
                self._stop_radio()
                self._start_search(self._turnaround_fs(), waiting=False)
        elif strobe == r.SRFOFF:
            if self._state is not State.IDLE:
                self._stop_radio()
                self._enter(State.IDLE)
                self.cca.refresh()
        elif strobe == r.SFLUSHRX:
            self._flush_rx()
        elif strobe == r.SFLUSHTX:
            if self._state is State.TX_FRAME:
                self._freeze_sent()
                self._underflow()
            self._tx_count = 0
            self._tx_flush_on_write = False
            self._tx_underflow = False
            if self._state is State.TX_UNDERFLOW:
                self._start_search(self._turnaround_fs(), waiting=False)
        elif strobe in (r.SACK, r.SACKPEND):
            self._strobe_ack(pending=strobe == r.SACKPEND)
        # STXCAL: the synthesizer calibrates anyway; SRXDEC, STXENC, SAES: no security

    def _oscillator_stable(self) -> None:
        self._start_event = None
        self._oscillator = True
        self._enter(State.IDLE)
        self.cca.refresh()
