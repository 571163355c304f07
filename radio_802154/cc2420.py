"""The CC2420 radio at register level, as its host sees it over SPI and eight pins (SWRS041B).

The chip is a state machine (section 20, Figure 25) whose states mostly follow from the time: a
receiver that was switched on at t calibrates until t + 192 µs and searches from then on, without an
event. Events exist only where a pin changes or something starts. Octets of a frame that is arriving
are put into the RXFIFO when somebody looks: how many there are follows from the time since the SFD.

Not modelled: AES (SAES, SRXDEC, STXENC do nothing; SEC_MODE must be 0), the serial and random test
modes (TX_MODE, RX_MODE 0 only), the analog test registers, the crystal's error (symbols are exactly
16 µs).
"""

from __future__ import annotations

from typing import Final

from firmware_model.power import Rail
from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_US
from radio_802154 import cc2420_registers as r
from radio_802154.air import OCTET_FS, Air, Reception, Transmission
from radio_802154.cc2420_registers import State
from radio_802154.cc2420_rxfifo import RxFifo
from radio_802154.fcs import FCS_OCTETS, append_fcs, fcs_ok
from radio_802154.filtering import AddressFilter, accepts, header_octets
from radio_802154.mac import ack_frame, encode
from radio_802154.timing import SYMBOL_US, TURNAROUND_SYMBOLS

SYMBOL_FS: Final = SYMBOL_US * FS_PER_US
TURNAROUND_FS: Final = TURNAROUND_SYMBOLS * SYMBOL_FS
"""12 symbols: strobe to preamble, and frame to acknowledgement (sections 17.1, 19)."""
SHORT_TURNAROUND_FS: Final = 8 * SYMBOL_FS
"""With TXCTRL.TX_TURNAROUND clear (section 37, TXCTRL)."""
RX_WAIT_FS: Final = 8 * SYMBOL_FS
"""From the end of a frame to the next search (Figure 25: 12 or 8 symbol periods; as MSPSim)."""
RSSI_WINDOW_FS: Final = 8 * SYMBOL_FS
"""RSSI is the mean over 8 symbols, valid when the receiver has been on so long (section 23)."""
LOCK_ON_FS: Final = 3 * OCTET_FS
"""How long before the end of the SFD a receiver must be searching: SFD and two preamble octets
(assumed; the demodulator needs a few symbols to adjust frequency)."""

_ACK_REQUEST: Final = 0x20  # low octet of the frame control field
_SINR_BEST_DB: Final = 9.0
"""Ratio at which the correlation value reaches its best; with `_SINR_WORST_DB` a linear scale.
Assumed: the datasheet gives 50 and 110 and no curve."""
_SINR_WORST_DB: Final = -1.0

_RX_STATES: Final = (State.RX_SFD_SEARCH, State.RX_FRAME, State.RX_OVERFLOW)
_TX_STATES: Final = (
    State.TX_CALIBRATE,
    State.TX_PREAMBLE,
    State.TX_FRAME,
    State.TX_ACK_CALIBRATE,
    State.TX_ACK_PREAMBLE,
    State.TX_ACK,
)

# phases of an SPI access (Figure 10)
_ADDRESS, _REGISTER_HIGH, _REGISTER_LOW, _RAM_BANK, _RAM_DATA, _TX_WRITE, _RX_READ, _IGNORE = range(
    8
)


class CcaPin(Signal[int]):
    """The CCA pin: looked at, not pushed, because energy in the air is nobody's event.

    Reading `value` asks the chip. Listeners hear of changes that the chip itself causes (the
    oscillator, with CCAMUX = 24; strobes), not of energy coming and going.
    """

    __slots__ = ("_chip", "_last")

    def __init__(self, name: str, chip: Cc2420) -> None:
        self._chip = chip
        self._last = 0
        super().__init__(name, 0)

    @property
    def value(self) -> int:
        """Level of the pin now."""
        return self._chip.cca_level()

    @value.setter
    def value(self, value: int) -> None:
        self._last = value

    def refresh(self) -> None:
        """Tell listeners if the level has changed since they last heard."""
        level = self._chip.cca_level()
        if level != self._last:
            self._last = level
            for listener in self._listeners:
                listener(level)


class Cc2420:
    """A CC2420 on an SPI bus (`select`, `begin`, `end`) and an antenna of the medium.

    Output pins `fifo`, `fifop`, `sfd`, `cca` are signals of 0 and 1; the polarity bits of IOCFG0
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
        self._scheduler = scheduler
        self._air = air
        self._rail = rail
        self._consumer = rail.consumer(name, r.CURRENTS_A) if rail is not None else None
        self._ram = bytearray(r.RAM_OCTETS)
        self._registers: dict[int, int] = {}
        self._masks = {address: mask for _, address, _, mask in r.REGISTERS}
        self._rx = RxFifo(self._ram)
        self._vreg_pin = 0
        self._reset_pin = 1
        self._state = State.VREG_OFF
        self._oscillator = False
        self._start_event: Event | None = None  # regulator or oscillator on their way
        self._selected = False
        self._phase = _ADDRESS
        self._address = 0
        self._read = False
        self._shift_out = 0
        self._written = 0
        self.fifo = Signal(f"{name}.FIFO", 0)
        self.fifop = Signal(f"{name}.FIFOP", 0)
        self.sfd = Signal(f"{name}.SFD", 0)
        self._clear_digital()
        self.cca = CcaPin(f"{name}.CCA", self)
        self._port = air.attach(name, self)
        if rail is not None:
            rail.volts.watch(self._supply_changed)

    def _clear_digital(self) -> None:
        self._registers = {address: reset for _, address, reset, _ in r.REGISTERS}
        self._rx.flush()
        self._tx_count = 0
        self._tx_flush_on_write = False
        self._tx_underflow = False
        self._tx_event: Event | None = None
        self._underflow_event: Event | None = None
        self._transmission: Transmission | None = None
        self._tx_content = bytearray()
        self._tx_length = 0
        self._sending_ack = False
        self._search_from = 0
        self._waiting = False  # RX_WAIT rather than RX_CALIBRATE until `_search_from`
        self._rssi_from = 0
        self._incoming: Transmission | None = None
        self._stored = 0  # octets of `_incoming` put into the RXFIFO, length octet included
        self._recognised = False
        self._threshold_event: Event | None = None
        self._overflow_event: Event | None = None
        self._frame_ready = False  # a complete frame, no octet of it read yet
        self._strobed_ack = False
        self._ack_pending = False
        self._last_sequence: int | None = None  # of the last good frame, for SACK after its end
        self._cca_was_clear = True
        self._rx_busy_until = 0

    # --- Power and reset -------------------------------------------------------------------------

    def vreg_en(self, level: int) -> None:
        """VREG_EN pin: the internal regulator that feeds the core."""
        self._vreg_pin = level
        if level:
            self._power_up()
        else:
            self._power_off()

    def resetn(self, level: int) -> None:
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
            pin.set(0)
        self.cca.refresh()

    def _reset(self) -> None:
        self._stop_radio()
        self._scheduler.cancel(self._start_event)
        self._start_event = None
        self._oscillator = False
        self._clear_digital()
        self._phase = _IGNORE if self._selected else _ADDRESS
        self._enter(State.POWER_DOWN)
        self.sfd.set(0)
        self._update_pins()

    def _enter(self, state: State) -> None:
        self._state = state
        consumer = self._consumer
        if consumer is None:
            return
        if state is State.VREG_OFF:
            volts = self._rail.volts.value if self._rail is not None else 0.0
            consumer.enter("vreg_off" if volts >= r.SUPPLY_MINIMUM_V else "off")
        elif state is State.POWER_DOWN:
            # a starting oscillator draws what a running one does (assumed)
            consumer.enter("idle" if self._start_event is not None else "power_down")
        elif state in (State.IDLE, State.TX_UNDERFLOW):
            consumer.enter("idle")
        elif state in _RX_STATES:
            consumer.enter("rx")
        else:
            consumer.draw("tx", r.pa_level(self._registers[r.TXCTRL] & r.TXCTRL_PA_LEVEL)[1])

    # --- What the chip is doing now --------------------------------------------------------------

    @property
    def state(self) -> State:
        """State of the radio control state machine now."""
        if self._state is State.RX_SFD_SEARCH and self._scheduler.now < self._search_from:
            return State.RX_WAIT if self._waiting else State.RX_CALIBRATE
        return self._state

    @property
    def frequency_mhz(self) -> int:
        """Frequency the synthesizer is programmed to."""
        return r.FSCTRL_FREQ_OFFSET_MHZ + (self._registers[r.FSCTRL] & r.FSCTRL_FREQ)

    def register(self, address: int) -> int:
        """Return what a read of a register gives now, statuses included."""
        value = self._registers.get(address, 0)
        if address == r.RSSI:
            return value & 0xFF00 | self._rssi_val()
        if address == r.FSMSTATE:
            return max(0, int(self.state))
        if address == r.FSCTRL:
            return value & ~0x3C00 | self._lock_bits()
        if address == r.BATTMON:
            return value & ~r.BATTMON_OK | self._battery_bit(value)
        return value

    def _rssi_valid(self) -> bool:
        return self._state in _RX_STATES and self._scheduler.now >= self._rssi_from

    def _rssi_val(self) -> int:
        if not self._rssi_valid():
            return r.RSSI_INVALID
        dbm = self._air.energy_dbm(self._port, self.frequency_mhz, RSSI_WINDOW_FS)
        return _rssi_octet(dbm)

    def _lock_bits(self) -> int:
        state = self.state
        if state in (State.RX_CALIBRATE, State.TX_CALIBRATE, State.TX_ACK_CALIBRATE):
            return r.FSCTRL_CAL_RUNNING
        if state in _RX_STATES or state in _TX_STATES or state is State.RX_WAIT:
            return r.FSCTRL_CAL_DONE | r.FSCTRL_LOCK_STATUS
        return 0

    def _battery_bit(self, value: int) -> int:
        if not value & r.BATTMON_EN or self._rail is None:
            return 0
        toggle = r.battmon_toggle_v(value & r.BATTMON_VOLTAGE)
        return r.BATTMON_OK if self._rail.volts.value > toggle else 0

    def _channel_clear(self) -> bool:
        """CCA as section 25 and MDMCTRL0 have it; not clear while not valid."""
        if not self._rssi_valid():
            return False
        control = self._registers[r.MDMCTRL0]
        mode = (control >> r.MDMCTRL0_CCA_MODE_SHIFT) & 0b11
        now = self._scheduler.now
        receiving = self._state is State.RX_FRAME or now < self._rx_busy_until
        if mode & 0b10 and receiving:
            return False
        if mode & 0b01:
            threshold = _signed(self._registers[r.RSSI] >> 8)
            hysteresis = (control >> r.MDMCTRL0_CCA_HYST_SHIFT) & 0b111
            rssi = _signed(self._rssi_val())
            if rssi >= threshold:
                self._cca_was_clear = False
            elif rssi < threshold - hysteresis:
                self._cca_was_clear = True
            return self._cca_was_clear
        return True

    def cca_level(self) -> int:
        """Level of the CCA pin now, multiplexer and polarity applied."""
        if self._state is State.VREG_OFF:
            return 0
        source = self._registers[r.IOCFG1] & r.IOCFG1_CCAMUX
        if source == r.CCAMUX_XOSC16M_STABLE:
            return int(self._oscillator)
        level = source == r.CCAMUX_CCA and self._channel_clear()
        return int(level) ^ bool(self._registers[r.IOCFG0] & r.IOCFG0_CCA_POLARITY)

    def _status(self) -> int:
        status = 0
        if self._oscillator:
            status |= r.STATUS_XOSC16M_STABLE
        if self._tx_underflow:
            status |= r.STATUS_TX_UNDERFLOW
        if self._state in _TX_STATES:
            status |= r.STATUS_TX_ACTIVE
        if self._lock_bits() & r.FSCTRL_LOCK_STATUS:
            status |= r.STATUS_LOCK
        if self._rssi_valid():
            status |= r.STATUS_RSSI_VALID
        return status

    # --- SPI (section 13) ------------------------------------------------------------------------

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

    # --- Strobes (sections 20 and 37) ------------------------------------------------------------

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
            if (self._state in _RX_STATES or from_idle) and (
                strobe == r.STXON or self._channel_clear()
            ):
                self._start_transmission(ack=False)
        elif strobe == r.SRXON:
            if self._state not in _RX_STATES:
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

    def _turnaround_fs(self) -> int:
        long = self._registers[r.TXCTRL] & r.TXCTRL_TX_TURNAROUND
        return TURNAROUND_FS if long else SHORT_TURNAROUND_FS

    def _start_search(self, delay_fs: int, *, waiting: bool) -> None:
        now = self._scheduler.now
        self._search_from = now + delay_fs
        self._waiting = waiting
        if not waiting:
            self._rssi_from = now + delay_fs + RSSI_WINDOW_FS
        self._enter(State.RX_SFD_SEARCH)

    def _stop_radio(self) -> None:
        """Stop whatever is being sent or received."""
        self._abandon_incoming()
        self._scheduler.cancel(self._tx_event)
        self._scheduler.cancel(self._underflow_event)
        self._tx_event = self._underflow_event = None
        if self._transmission is not None:
            transmission, self._transmission = self._transmission, None
            self._air.abort(transmission)
        self.sfd.set(self._polarity(0, r.IOCFG0_SFD_POLARITY))

    def _abandon_incoming(self) -> None:
        """Forget the frame that is arriving; what is left of it in the RXFIFO goes (assumed)."""
        if self._incoming is not None:
            self._end_incoming()
            self._rx.drop_open_frame()
            self._rx_busy_until = 0
            self._update_pins()
        self._strobed_ack = False

    def _end_incoming(self) -> None:
        self._incoming = None
        self._scheduler.cancel(self._threshold_event)
        self._scheduler.cancel(self._overflow_event)
        self._threshold_event = self._overflow_event = None
        self.sfd.set(self._polarity(0, r.IOCFG0_SFD_POLARITY))

    def _flush_rx(self) -> None:
        if self._incoming is not None:
            self._end_incoming()
        self._rx.flush()
        self._frame_ready = False
        if self._state in (State.RX_FRAME, State.RX_OVERFLOW):
            self._rx_busy_until = 0
            self._search_from = self._scheduler.now
            self._enter(State.RX_SFD_SEARCH)
        self._update_pins()

    def _strobe_ack(self, *, pending: bool) -> None:
        """SACK, SACKPEND: with AUTOACK only the pending flag counts (section 19)."""
        self._ack_pending = pending
        if self._registers[r.MDMCTRL0] & r.MDMCTRL0_AUTOACK:
            return
        if self._state is State.RX_FRAME:
            self._strobed_ack = True
        elif self._state is State.RX_SFD_SEARCH and self._last_sequence is not None:
            self._start_transmission(ack=True)

    # --- Transmission (section 17.1) -------------------------------------------------------------

    def _tx_write(self, octet: int) -> None:
        if self._tx_flush_on_write and not self._tx_underflow:
            self._freeze_sent()
            self._tx_count = 0
            self._tx_flush_on_write = False
        if self._tx_count < r.FIFO_OCTETS:
            self._ram[r.RAM_TXFIFO + self._tx_count] = octet
            self._tx_count += 1

    def _start_transmission(self, *, ack: bool) -> None:
        self._abandon_incoming()
        self._sending_ack = ack
        self._enter(State.TX_ACK_CALIBRATE if ack else State.TX_CALIBRATE)
        # an acknowledgement always begins 12 symbols after the frame (section 19)
        delay = TURNAROUND_FS if ack else self._turnaround_fs()
        self._tx_event = self._scheduler.after(delay, self._start_preamble)

    def _start_preamble(self) -> None:
        self._tx_event = None
        self._enter(State.TX_ACK_PREAMBLE if self._sending_ack else State.TX_PREAMBLE)
        self._tx_content = bytearray()
        self._tx_length = -1
        zeros = 1 + (self._registers[r.MDMCTRL0] & r.MDMCTRL0_PREAMBLE_LENGTH)
        power = r.pa_level(self._registers[r.TXCTRL] & r.TXCTRL_PA_LEVEL)[0]
        # leading zero octets, then the two octets of SYNCWORD, whose 0xF nibble sends a zero
        self._transmission = self._air.transmit(self._port, self.frequency_mhz, power, zeros + 2)

    def sfd_sent(self, transmission: Transmission) -> int | None:
        """The SFD has gone out: take the length octet, raise SFD."""
        self.sfd.set(self._polarity(1, r.IOCFG0_SFD_POLARITY))
        if self._sending_ack:
            self._enter(State.TX_ACK)
            sequence = self._last_sequence or 0
            ack = encode(ack_frame(sequence, frame_pending=self._ack_pending))
            self._tx_content += append_fcs(ack)
            self._tx_length = len(self._tx_content)
            return self._tx_length
        self._enter(State.TX_FRAME)
        if self._tx_count == 0:
            self._underflow()
            return None
        self._tx_length = self._ram[r.RAM_TXFIFO] & 0x7F
        transmission.length = self._tx_length
        self._check_underflow()
        return self._tx_length

    def _from_host(self) -> int:
        """Octets of the PSDU that must come out of the TXFIFO: the FCS may be the chip's."""
        if self._registers[r.MDMCTRL0] & r.MDMCTRL0_AUTOCRC:
            return max(0, self._tx_length - FCS_OCTETS)
        return self._tx_length

    def _check_underflow(self) -> None:
        """Look again when the first octet that is not there yet is due."""
        self._underflow_event = None
        transmission = self._transmission
        if transmission is None:
            return
        there = self._tx_count - 1
        if there >= self._from_host():
            return
        due = transmission.sfd_fs + (1 + there) * OCTET_FS
        if self._scheduler.now < due:
            self._underflow_event = self._scheduler.at(due, self._check_underflow)
            return
        self._underflow()

    def _underflow(self) -> None:
        transmission, self._transmission = self._transmission, None
        if transmission is not None and transmission.length >= 0:
            self._air.abort(transmission)
        self._tx_underflow = True
        self._enter(State.TX_UNDERFLOW)
        self.sfd.set(self._polarity(0, r.IOCFG0_SFD_POLARITY))

    def _freeze_sent(self) -> None:
        """Before the host changes RAM: octets that are out, or going out, stay as they were."""
        transmission = self._transmission
        if transmission is not None and self._tx_length >= 0 and not self._sending_ack:
            gone = (self._scheduler.now - transmission.sfd_fs) // OCTET_FS
            self.psdu(min(gone, self._tx_length))

    def psdu(self, octets: int) -> bytes:
        """Return the first octets of the PSDU that is being sent, fetching them if need be."""
        content = self._tx_content
        have = len(content)
        if have < octets:
            host = min(octets, self._from_host())
            if have < host:
                content += self._ram[r.RAM_TXFIFO + 1 + have : r.RAM_TXFIFO + 1 + host]
            if len(content) < octets:  # the FCS, which needs all that goes before
                content[:] = append_fcs(bytes(content[: self._from_host()]))[: self._tx_length]
        return bytes(content[:octets])

    def frame_control(self) -> int | None:
        """Return the frame control field about to be sent, if the host has written it."""
        if self._sending_ack:
            return int.from_bytes(self._tx_content[:2], "little")
        if self._tx_count < 3:
            return None
        return self._ram[r.RAM_TXFIFO + 1] | self._ram[r.RAM_TXFIFO + 2] << 8

    def sent(self, transmission: Transmission) -> None:
        """The last octet has gone out: SFD falls, the receiver comes back."""
        self._transmission = None
        self.sfd.set(self._polarity(0, r.IOCFG0_SFD_POLARITY))
        if not self._sending_ack:
            self._tx_flush_on_write = True
        self._start_search(self._turnaround_fs(), waiting=False)

    # --- Reception (sections 14.2, 17.2, 18) -----------------------------------------------------

    def hears(self, transmission: Transmission) -> bool:
        """Whether this chip has been searching long enough, on the right frequency."""
        return (
            self._state is State.RX_SFD_SEARCH
            and self._search_from <= transmission.sfd_fs - LOCK_ON_FS
            and transmission.frequency_mhz == self.frequency_mhz
        )

    def frame_begins(self, transmission: Transmission) -> None:
        """The SFD has been received."""
        self._incoming = transmission
        self._stored = 0
        self._recognised = not self._registers[r.MDMCTRL0] & r.MDMCTRL0_ADR_DECODE
        self._strobed_ack = False
        self._rx_busy_until = transmission.sfd_fs + (1 + transmission.length) * OCTET_FS
        self._enter(State.RX_FRAME)
        self._rx.begin_frame()
        self.sfd.set(self._polarity(1, r.IOCFG0_SFD_POLARITY))

    def frame_length(self, transmission: Transmission) -> None:
        """The length octet has been received; FIFO rises."""
        if self._incoming is not transmission:
            return
        if self._rx.free < 2 + transmission.length:
            self._watch_overflow()
        if self._incoming is transmission:
            self._store_arrived()
            self._plan_threshold()
            self._update_pins()

    def frame_header(self, transmission: Transmission) -> bool:
        """The MAC header has been received: address recognition."""
        if self._incoming is not transmission:
            return False
        control = self._registers[r.MDMCTRL0]
        if not control & r.MDMCTRL0_ADR_DECODE:
            return True
        start = transmission.psdu(2)
        octets = header_octets(start[0] | start[1] << 8)
        header = transmission.psdu(min(octets, transmission.arrived(self._scheduler.now) - 1))
        if not accepts(self._address_filter(), header):
            self._reject()
            return False
        self._recognised = True
        self._plan_threshold()
        self._update_pins()
        return True

    def _address_filter(self) -> AddressFilter:
        control = self._registers[r.MDMCTRL0]
        ram = self._ram
        return AddressFilter(
            pan_id=ram[r.RAM_PANID] | ram[r.RAM_PANID + 1] << 8,
            short_address=ram[r.RAM_SHORTADR] | ram[r.RAM_SHORTADR + 1] << 8,
            extended_address=int.from_bytes(ram[r.RAM_IEEEADR : r.RAM_IEEEADR + 8], "little"),
            pan_coordinator=bool(control & r.MDMCTRL0_PAN_COORDINATOR),
            accept_reserved=bool(control & r.MDMCTRL0_RESERVED_FRAME_MODE),
            accept_beacons=bool(self._registers[r.IOCFG0] & r.IOCFG0_BCN_ACCEPT),
        )

    def _reject(self) -> None:
        """Flush the frame, wait for its end, then search on (section 18)."""
        self._end_incoming()
        self._rx.drop_open_frame()
        self._search_from = self._rx_busy_until + RX_WAIT_FS
        self._waiting = True
        self._enter(State.RX_SFD_SEARCH)
        self._update_pins()

    def frame_ends(self, transmission: Transmission, reception: Reception) -> None:
        """The last octet has been received: RSSI and CRC into the FIFO, acknowledgement."""
        if self._incoming is not transmission:
            return
        octets = reception.octets
        autocrc = self._registers[r.MDMCTRL0] & r.MDMCTRL0_AUTOCRC and len(octets) >= FCS_OCTETS
        if not self._recognised:
            self._reject()
            return
        good = fcs_ok(octets)
        rest = octets[max(0, self._stored - 1) :]
        if autocrc:
            quality = _correlation(reception.sinr_db) | (r.CRC_OK if good else 0)
            rest = rest[:-FCS_OCTETS] + bytes((_rssi_octet(reception.power_dbm), quality))
        if len(rest) > self._rx.free:
            self._rx.push(rest[: self._rx.free])
            self._overflow()
            return
        self._rx.push(rest)
        self._rx.end_frame()
        self._frame_ready = True
        wanted = self._strobed_ack
        self._end_incoming()
        self._last_sequence = octets[2] if good and len(octets) >= 3 + FCS_OCTETS else None
        control = self._registers[r.MDMCTRL0]
        if control & r.MDMCTRL0_AUTOACK and control & r.MDMCTRL0_ADR_DECODE:
            wanted = bool(octets and octets[0] & _ACK_REQUEST)
        if wanted and autocrc and self._last_sequence is not None:
            self._start_transmission(ack=True)
        else:
            self._start_search(RX_WAIT_FS, waiting=True)
        self._update_pins()

    def _store_arrived(self) -> None:
        """Put into the RXFIFO what has arrived by now; the FCS octets come at the end."""
        transmission = self._incoming
        if transmission is None:
            return
        arrived = transmission.arrived(self._scheduler.now)
        if self._registers[r.MDMCTRL0] & r.MDMCTRL0_AUTOCRC:
            arrived = min(arrived, max(1, 1 + transmission.length - FCS_OCTETS))
        arrived = min(arrived, self._stored + self._rx.free)
        if arrived <= self._stored:
            return
        new = bytes((transmission.length,)) if self._stored == 0 else b""
        new += transmission.psdu(arrived - 1)[max(0, self._stored - 1) :]
        self._rx.push(new)
        self._stored = arrived

    def _watch_overflow(self) -> None:
        """Look again when the octet arrives for which there is no room now."""
        self._overflow_event = None
        transmission = self._incoming
        if transmission is None:
            return
        self._store_arrived()
        due = transmission.sfd_fs + (self._stored + self._rx.free + 1) * OCTET_FS
        if due > transmission.end_fs:
            return
        if self._scheduler.now >= due:
            self._overflow()
        else:
            self._overflow_event = self._scheduler.at(due, self._watch_overflow)

    def _overflow(self) -> None:
        """FIFO low while FIFOP high; what is stored stays; SFLUSHRX ends it (section 14.3)."""
        self._end_incoming()
        self._enter(State.RX_OVERFLOW)
        self._update_pins()

    def _pop(self) -> None:
        self._frame_ready = False
        if self._rx.pop():
            self._frame_ready = self._rx.complete_next
        if self._incoming is not None:
            self._plan_threshold()
        self._update_pins()

    # --- Pins (section 14) -----------------------------------------------------------------------

    def _polarity(self, level: int, bit: int) -> int:
        return level ^ bool(self._registers[r.IOCFG0] & bit)

    def _above_threshold(self) -> bool:
        threshold = self._registers[r.IOCFG0] & r.IOCFG0_FIFOP_THR
        return self._recognised_unread() > threshold

    def _recognised_unread(self) -> int:
        if self._incoming is not None and not self._recognised:
            return 0 if self._rx.unread == self._stored else self._rx.unread - self._stored
        return self._rx.unread

    def _plan_threshold(self) -> None:
        """Raise FIFOP in time when this frame will exceed the threshold before its end."""
        self._scheduler.cancel(self._threshold_event)
        self._threshold_event = None
        transmission = self._incoming
        if transmission is None or not self._recognised:
            return
        self._store_arrived()
        threshold = self._registers[r.IOCFG0] & r.IOCFG0_FIFOP_THR
        missing = threshold + 1 - self._rx.unread
        if missing <= 0:
            return
        due = transmission.sfd_fs + (self._stored + missing) * OCTET_FS
        if due < transmission.end_fs:
            self._threshold_event = self._scheduler.at(due, self._threshold_reached)

    def _threshold_reached(self) -> None:
        self._threshold_event = None
        self._store_arrived()
        self._update_pins()

    def _update_pins(self) -> None:
        if self._state is State.VREG_OFF:
            return
        overflow = self._state is State.RX_OVERFLOW
        fifo = self._rx.unread > 0 and not overflow
        fifop = overflow or self._frame_ready or self._above_threshold()
        self.fifo.set(self._polarity(int(fifo), r.IOCFG0_FIFO_POLARITY))
        self.fifop.set(self._polarity(int(fifop), r.IOCFG0_FIFOP_POLARITY))
        self.sfd.set(self._polarity(int(self._sfd_active()), r.IOCFG0_SFD_POLARITY))
        self.cca.refresh()

    def _sfd_active(self) -> bool:
        return self._state in (State.RX_FRAME, State.TX_FRAME, State.TX_ACK)


def _signed(octet: int) -> int:
    return octet - 256 if octet & 0x80 else octet


def _rssi_octet(dbm: float) -> int:
    """RSSI_VAL of a power: signed, P − RSSI_OFFSET, range −100 to 0 dBm (section 6.3)."""
    value = round(min(0.0, max(-100.0, dbm)) - r.RSSI_OFFSET_DB)
    return value & 0xFF


def _correlation(sinr_db: float) -> int:
    span = (sinr_db - _SINR_WORST_DB) / (_SINR_BEST_DB - _SINR_WORST_DB)
    return round(
        r.CORRELATION_WORST + (r.CORRELATION_BEST - r.CORRELATION_WORST) * min(1.0, max(0.0, span))
    )
