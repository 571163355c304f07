"""The receiving side of the CC2420 (SWRS041B, sections 14.2, 14.3, 17.2, 18).

Octets of a frame that is arriving are put into the RXFIFO when somebody looks: how many there are
follows from the time since the SFD. Events of the chip's own are two, and rare: the FIFOP threshold
inside a frame, and an overflow.
"""

from __future__ import annotations

from typing import Final

from radio_802154 import cc2420_registers as r
from radio_802154.air import OCTET_FS, Reception, Transmission
from radio_802154.cc2420_core import (
    CORRELATION_BEST_SINR_DB,
    CORRELATION_WORST_SINR_DB,
    LOCK_ON_FS,
    RX_WAIT_FS,
    Core,
    rssi_octet,
)
from radio_802154.cc2420_registers import State
from radio_802154.fcs import FCS_OCTETS, fcs_ok
from radio_802154.filtering import AddressFilter, accepts, header_octets

_ACK_REQUEST: Final = 0x20  # low octet of the frame control field


class ReceivingChip(Core):
    """Implements `air.Receiver`."""

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
        self._scheduler.cancel(self._pin_event)
        self._scheduler.cancel(self._overflow_event)
        self._pin_event = self._overflow_event = None
        self.sfd.set(self._polarity(False, r.IOCFG0_SFD_POLARITY))

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
        self.sfd.set(self._polarity(True, r.IOCFG0_SFD_POLARITY))

    def frame_length(self, transmission: Transmission) -> None:
        """The length octet has been received; FIFO rises."""
        if self._incoming is not transmission:
            return
        if self._rx.free < 2 + transmission.length:
            self._watch_overflow()
        if self._incoming is transmission:
            self._plan_pins()
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
        self._plan_pins()
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
            rest = rest[:-FCS_OCTETS] + bytes((rssi_octet(reception.power_dbm), quality))
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
            self._plan_pins()
        self._update_fifo_pins()

    def _plan_pins(self) -> None:
        """Look again when FIFO or FIFOP will rise within this frame, if the host reads no more."""
        self._scheduler.cancel(self._pin_event)
        self._pin_event = None
        transmission = self._incoming
        if transmission is None:
            return
        self._store_arrived()
        if self._rx.unread == 0:
            missing = 1
        elif self._recognised:
            threshold = self._registers[r.IOCFG0] & r.IOCFG0_FIFOP_THR
            missing = threshold + 1 - self._rx.unread
        else:
            return
        due = transmission.sfd_fs + (self._stored + missing) * OCTET_FS
        if missing > 0 and self._scheduler.now < due < transmission.end_fs:
            self._pin_event = self._scheduler.at(due, self._octet_arrived)

    def _octet_arrived(self) -> None:
        self._pin_event = None
        self._plan_pins()
        self._update_fifo_pins()


def _correlation(sinr_db: float) -> int:
    span = (sinr_db - CORRELATION_WORST_SINR_DB) / (
        CORRELATION_BEST_SINR_DB - CORRELATION_WORST_SINR_DB
    )
    return round(
        r.CORRELATION_WORST + (r.CORRELATION_BEST - r.CORRELATION_WORST) * min(1.0, max(0.0, span))
    )
