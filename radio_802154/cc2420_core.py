"""The CC2420's state: registers, what they read as now, and the pins (SWRS041B).

The radio control state machine (section 20, Figure 25) is kept so that most of it follows from the
time: a receiver that was switched on at t calibrates until t + 192 µs and searches from then on,
without an event. This is the lowest of four layers of one chip, a file each: state and pins (here),
reception, transmission, and the host's side (`cc2420.py`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

from firmware_model.power import Rail
from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_US
from radio_802154 import cc2420_registers as r
from radio_802154.air import OCTET_FS, Air, Transmission
from radio_802154.cc2420_registers import State
from radio_802154.cc2420_rxfifo import RxFifo
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

CORRELATION_BEST_SINR_DB: Final = 9.0
"""Ratio at which the correlation value reaches its best. Assumed: the datasheet gives 110 and 50
as best and worst value and no curve; taken as linear between this and the next."""
CORRELATION_WORST_SINR_DB: Final = -1.0
"""Ratio at which the correlation value is at its worst (assumed)."""

RX_STATES: Final = (State.RX_SFD_SEARCH, State.RX_FRAME, State.RX_OVERFLOW)
TX_STATES: Final = (
    State.TX_CALIBRATE,
    State.TX_PREAMBLE,
    State.TX_FRAME,
    State.TX_ACK_CALIBRATE,
    State.TX_ACK_PREAMBLE,
    State.TX_ACK,
)


class CcaPin(Signal[bool]):
    """The CCA pin: looked at, not pushed, because energy in the air is nobody's event.

    Reading `value` asks the chip: whoever shows the pin to a host reads it when the host does.
    Listeners hear of the oscillator (with CCAMUX = 24), of reset and of new register contents, not
    of energy coming and going.
    """

    __slots__ = ("_chip", "_last")

    def __init__(self, name: str, chip: Core) -> None:
        self._chip = chip
        self._last = False
        super().__init__(name, False)

    @property
    def value(self) -> bool:
        """Level of the pin now."""
        return self._chip.cca_level()

    @value.setter
    def value(self, value: bool) -> None:
        self._last = value

    def refresh(self) -> None:
        """Tell listeners if the level has changed since they last heard."""
        level = self._chip.cca_level()
        if level != self._last:
            self._last = level
            for listener in self._listeners:
                listener(level)


_SFD_STATES: Final = (State.RX_FRAME, State.TX_FRAME, State.TX_ACK)
"""States in which pin SFD is active."""


class Core(ABC):
    """Registers, RAM, state and pins of the chip; see `cc2420.Cc2420`."""

    def __init__(
        self, scheduler: Scheduler, air: Air, name: str = "cc2420", rail: Rail | None = None
    ) -> None:
        self._scheduler = scheduler
        self._air = air
        self._rail = rail
        self._consumer = rail.consumer("CC2420", r.CURRENTS_A) if rail is not None else None
        self._ram = bytearray(r.RAM_OCTETS)
        self._registers: dict[int, int] = {}
        self._masks = {address: mask for _, address, _, mask in r.REGISTERS}
        self._rx = RxFifo(self._ram)
        self._vreg_pin = False
        self._reset_pin = True
        self._state = State.VREG_OFF
        self._oscillator = False
        self._start_event: Event | None = None  # regulator or oscillator on their way
        self._port = -1  # of the medium
        self.fifo = Signal(f"{name}.FIFO", False)
        self.fifop = Signal(f"{name}.FIFOP", False)
        self.sfd = Signal(f"{name}.SFD", False)
        self._clear_digital()
        self.cca = CcaPin(f"{name}.CCA", self)
        self._enter(State.VREG_OFF)

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
        self._pin_event: Event | None = None
        self._overflow_event: Event | None = None
        self._frame_ready = False  # a complete frame, no octet of it read yet
        self._strobed_ack = False
        self._ack_pending = False
        self._last_sequence: int | None = None  # of the last good frame, for SACK after its end
        self._cca_was_clear = True
        self._rx_busy_until = 0

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
        elif state in RX_STATES:
            consumer.enter("rx")
        else:
            consumer.draw("tx", r.pa_level(self._registers[r.TXCTRL] & r.TXCTRL_PA_LEVEL)[1])

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
        return self._state in RX_STATES and self._scheduler.now >= self._rssi_from

    def _rssi_val(self) -> int:
        if not self._rssi_valid():
            return r.RSSI_INVALID
        dbm = self._air.energy_dbm(self._port, self.frequency_mhz, RSSI_WINDOW_FS)
        return rssi_octet(dbm)

    def _lock_bits(self) -> int:
        state = self.state
        if state in (State.RX_CALIBRATE, State.TX_CALIBRATE, State.TX_ACK_CALIBRATE):
            return r.FSCTRL_CAL_RUNNING
        if state in RX_STATES or state in TX_STATES or state is State.RX_WAIT:
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

    def cca_level(self) -> bool:
        """Level of the CCA pin now, multiplexer and polarity applied."""
        if self._state is State.VREG_OFF:
            return False
        source = self._registers[r.IOCFG1] & r.IOCFG1_CCAMUX
        if source == r.CCAMUX_XOSC16M_STABLE:
            return self._oscillator
        clear = source == r.CCAMUX_CCA and self._channel_clear()
        return self._polarity(clear, r.IOCFG0_CCA_POLARITY)

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

    def _polarity(self, level: bool, bit: int) -> bool:
        return level != bool(self._registers[r.IOCFG0] & bit)

    def _update_fifo_pins(self) -> None:
        # One function and no calls: every octet that any radio hears or a host reads comes here.
        unread, iocfg0 = self._rx.unread, self._registers[r.IOCFG0]
        overflow = self._state is State.RX_OVERFLOW
        recognised = unread
        if self._incoming is not None and not self._recognised:
            recognised -= self._stored
        fifop = overflow or self._frame_ready or recognised > iocfg0 & r.IOCFG0_FIFOP_THR
        fifop = fifop != bool(iocfg0 & r.IOCFG0_FIFOP_POLARITY)
        fifo = (unread > 0 and not overflow) != bool(iocfg0 & r.IOCFG0_FIFO_POLARITY)
        if fifo != self.fifo.value:
            self.fifo.set(fifo)
        if fifop != self.fifop.value:
            self.fifop.set(fifop)

    def _update_pins(self) -> None:
        if self._state is not State.VREG_OFF:
            self._update_fifo_pins()
            active = self._state in _SFD_STATES
            level = active != bool(self._registers[r.IOCFG0] & r.IOCFG0_SFD_POLARITY)
            if level != self.sfd.value:
                self.sfd.set(level)

    @abstractmethod
    def _start_transmission(self, *, ack: bool) -> None:
        """Send the TXFIFO, or an acknowledgement, after the turnaround."""


def _signed(octet: int) -> int:
    return octet - 256 if octet & 0x80 else octet


def rssi_octet(dbm: float) -> int:
    """RSSI_VAL of a power: signed, P − RSSI_OFFSET, range −100 to 0 dBm (section 6.3)."""
    value = round(min(0.0, max(-100.0, dbm)) - r.RSSI_OFFSET_DB)
    return value & 0xFF
