"""The transmitting side of the CC2420 (SWRS041B, sections 14.1, 17.1, 19).

A frame is fetched from the TXFIFO octet by octet, but only when somebody needs the octets: before
the host changes the RAM, when a listener looks, at the end. So a host may change in the RAM what
has not gone out yet, as TinyOS does to stamp the time of the SFD into a frame.
"""

from __future__ import annotations

from radio_802154 import cc2420_registers as r
from radio_802154.air import OCTET_FS, Transmission
from radio_802154.cc2420_core import TURNAROUND_FS
from radio_802154.cc2420_receiver import ReceivingChip
from radio_802154.cc2420_registers import State
from radio_802154.fcs import FCS_OCTETS, append_fcs
from radio_802154.mac import ack_frame, encode


class TransmittingChip(ReceivingChip):
    """Implements `air.Sender` on top of the receiver."""

    def _strobe_ack(self, *, pending: bool) -> None:
        """SACK, SACKPEND: with AUTOACK only the pending flag counts (section 19)."""
        self._ack_pending = pending
        if self._registers[r.MDMCTRL0] & r.MDMCTRL0_AUTOACK:
            return
        if self._state is State.RX_FRAME:
            self._strobed_ack = True
        elif self._state is State.RX_SFD_SEARCH and self._last_sequence is not None:
            self._start_transmission(ack=True)

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
        self.sfd.set(self._polarity(True, r.IOCFG0_SFD_POLARITY))
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
        self.sfd.set(self._polarity(False, r.IOCFG0_SFD_POLARITY))

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
        self.sfd.set(self._polarity(False, r.IOCFG0_SFD_POLARITY))
        if not self._sending_ack:
            self._tx_flush_on_write = True
        self._start_search(self._turnaround_fs(), waiting=False)

    def _stop_radio(self) -> None:
        """Stop whatever is being sent or received."""
        self._abandon_incoming()
        self._scheduler.cancel(self._tx_event)
        self._scheduler.cancel(self._underflow_event)
        self._tx_event = self._underflow_event = None
        if self._transmission is not None:
            transmission, self._transmission = self._transmission, None
            self._air.abort(transmission)
        self.sfd.set(self._polarity(False, r.IOCFG0_SFD_POLARITY))
