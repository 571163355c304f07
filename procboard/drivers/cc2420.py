"""Driver of the CC2420: start-up, strobes, FIFOs, pins. Sections are those of SWRS041B.

Address recognition, FCS and acknowledgements are left to the chip (MDMCTRL0). FIFOP_THR is at its
top, so FIFOP rises once a frame: when it is complete and was accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.alarms import Alarms, ticks_of_us
from procboard.coroutines import Firmware
from procboard.drivers.m25p80 import Sleep
from procboard.drivers.sfd_capture import SfdCapture
from procboard.drivers.spi_bus0 import SpiChip
from procboard.errors import RadioFailureError
from radio_802154 import cc2420_registers as r
from radio_802154.timing import OCTET_US

VREG_US: Final = 600
"""Voltage regulator start-up, maximum (section 6.9)."""
RESET_US: Final = 10
"""RESETn held low: TinyOS CC2420ControlP waits as long."""
OSCILLATOR_US: Final = 1_000
"""Crystal start-up: 0.86 ms typical (section 6.6), then the status is asked."""

COMMAND_CYCLES: Final = 40
"""Call and bookkeeping of a strobe or a register access (estimate from TinyOS CC2420SpiP)."""

STAMP_CYCLES: Final = 500
"""Interrupt of an SFD: the shared time from the local one, a multiplication of 32 bits by 32 and a
shift of 64, and the octets of the mark (estimate)."""
SFD_WAIT_US: Final = 2_000
"""From STXONCCA to the SFD: 352 µs, then the stamp is written. Beyond it there was none."""

_MDMCTRL0: Final = (
    2 << r.MDMCTRL0_CCA_HYST_SHIFT
    | 3 << r.MDMCTRL0_CCA_MODE_SHIFT  # clear: below the threshold and no frame on its way
    | r.MDMCTRL0_AUTOCRC
    | 2  # preamble of 3 octets beyond the first: as 802.15.4 has it
)
_RECOGNISE: Final = r.MDMCTRL0_ADR_DECODE | r.MDMCTRL0_AUTOACK
_RXCTRL1: Final = 0x2A56
"""RXBPF_LOCUR = 1, recommended for new designs (section 37, RXCTRL1)."""
_REGISTER_RXCTRL1: Final = 0x17
_FIFO_BIT, _FIFOP_BIT = 0x08, 0x01  # P1.3, P1.0


Stamp: TypeAlias = Callable[[int], tuple[int, bytes]]
"""Gives, for the count at an SFD, octets to be put into the frame and where."""


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """A frame out of the RXFIFO: MAC header and payload, and how it came."""

    octets: bytes
    rssi_dbm: int
    correlation: int
    crc_ok: bool


class Cc2420Driver:
    """The radio chip behind `chip` (SPI) and its pins on ports 1 and 4."""

    def __init__(self, mcu: Msp430F1611, chip: SpiChip, sleep_us: Sleep) -> None:
        self._chip = chip
        self._sleep_us = sleep_us
        self._in1 = mcu.reg["P1IN"]
        self._out4 = mcu.reg["P4OUT"]
        self._vreg, self._reset = 0x20, 0x40  # P4.5, P4.6
        self.overflows = 0

    def start(
        self, channel: int, pan_id: int, address: int, pa_level: int, *, recognise: bool = True
    ) -> Firmware[None]:
        """Power the chip up, configure it and switch the receiver on.

        Without `recognise` frames for every address come, and none is acknowledged.

        Raises:
            RadioFailureError: the oscillator does not start.

        """
        self._out4.clear_bits(self._reset)
        self._out4.set_bits(self._vreg)
        yield from self._sleep_us(VREG_US)
        self._out4.clear_bits(self._reset)
        yield from self._sleep_us(RESET_US)
        self._out4.set_bits(self._reset)
        yield from self._start_oscillator()
        frequency_mhz = 2405 + 5 * (channel - 11)
        for register, value in (
            (r.MDMCTRL0, _MDMCTRL0 | (_RECOGNISE if recognise else 0)),
            (_REGISTER_RXCTRL1, _RXCTRL1),
            (r.IOCFG0, r.IOCFG0_FIFOP_THR),
            (r.TXCTRL, 0xA0E0 | pa_level),
            (r.FSCTRL, 0x4000 | (frequency_mhz - r.FSCTRL_FREQ_OFFSET_MHZ)),
        ):
            yield from self.write_register(register, value)
        identity = pan_id.to_bytes(2, "little") + address.to_bytes(2, "little")
        ram = bytes((r.ADDRESS_RAM | r.RAM_PANID & 0x7F, (r.RAM_PANID & 0x180) >> 1))
        yield from self._chip.transfer(ram + identity)
        yield from self.flush_received()
        yield from self.strobe(r.SRXON)

    def off(self) -> Firmware[None]:
        """Switch radio and oscillator off: 20 µA; registers and RAM keep (section 35)."""
        yield from self.strobe(r.SRFOFF)
        yield from self.strobe(r.SXOSCOFF)

    def on(self) -> Firmware[None]:
        """Switch both on again; the receiver hears 320 µs later.

        Raises:
            RadioFailureError: the oscillator does not start.

        """
        yield from self._start_oscillator()
        yield from self.strobe(r.SRXON)

    def _start_oscillator(self) -> Firmware[None]:
        yield from self.strobe(r.SXOSCON)
        for _attempt in range(10):
            yield from self._sleep_us(OSCILLATOR_US)
            if (yield from self.strobe(r.SNOP)) & r.STATUS_XOSC16M_STABLE:
                return
        raise RadioFailureError("the CC2420's oscillator does not start")

    def strobe(self, command: int) -> Firmware[int]:
        """Send a command strobe; return the status byte."""
        yield COMMAND_CYCLES
        return (yield from self._chip.transfer(bytes((command,))))[0]

    def write_register(self, address: int, value: int) -> Firmware[None]:
        """Write a configuration register."""
        yield COMMAND_CYCLES
        yield from self._chip.transfer(bytes((address, value >> 8, value & 0xFF)))

    def read_register(self, address: int) -> Firmware[int]:
        """Read a register."""
        yield COMMAND_CYCLES
        answer = yield from self._chip.exchange(bytes((address | r.ADDRESS_READ,)), 2)
        return answer[0] << 8 | answer[1]

    def load(self, octets: bytes) -> Firmware[None]:
        """Put a frame without its FCS into the TXFIFO; it stays for retries."""
        yield COMMAND_CYCLES
        yield from self._chip.transfer(bytes((r.TXFIFO, len(octets) + 2)) + octets)

    def transmit_if_clear(self) -> Firmware[bool]:
        """Send what is in the TXFIFO if the channel is clear now; return whether it is sent."""
        yield COMMAND_CYCLES
        # The status byte of a strobe is the status before it, so the second one tells.
        answer = yield from self._chip.transfer(bytes((r.STXONCCA, r.SNOP)))
        return bool(answer[1] & r.STATUS_TX_ACTIVE)

    def transmit_stamped(
        self, sfd: SfdCapture, octets_before: int, stamp: Stamp, alarms: Alarms
    ) -> Firmware[bool | None]:
        """As `transmit_if_clear`; when the SFD is out, put its time into the frame.

        The RAM of the TXFIFO is written while the frame goes out of it (section 13.5), in the
        interrupt of the SFD, with the bus held for it. `octets_before` stand in front of the part
        of the MPDU that `stamp` speaks of. Returns None where the stamp came too late: the frame
        was broken off, its FCS is wrong for all.
        """
        chip, told = self._chip, Flag("radio: SFD")
        in_time = False

        def rise(ticks: int) -> Generator[int, None, None]:
            nonlocal in_time
            offset, octets = stamp(ticks)
            yield STAMP_CYCLES
            first = 1 + octets_before + offset  # the length is the TXFIFO's first octet
            head = bytes((r.ADDRESS_RAM | first & 0x7F, (first & 0x180) >> 1))
            yield from chip.brief(head + octets)
            gone_us = (first - 1) * OCTET_US
            in_time = alarms.now() - ticks < ticks_of_us(gone_us)
            if not in_time:
                # What was broken off stays in the TXFIFO, and would go once more before the next.
                yield from chip.brief(bytes((r.SRFOFF, r.SFLUSHTX, r.SRXON)))
            told.set()

        yield COMMAND_CYCLES
        yield from chip.hold()
        sfd.await_rise(rise)
        answer = yield from chip.brief(bytes((r.STXONCCA, r.SNOP)))
        sent = bool(answer[1] & r.STATUS_TX_ACTIVE)
        if sent:
            alarm = alarms.after_us(SFD_WAIT_US, told)
            yield told
            alarms.cancel(alarm)
        sfd.forget()
        chip.release()
        if not sent:
            return False
        return True if in_time else None

    @property
    def frame_waits(self) -> bool:
        """Whether FIFOP is high: a complete frame, or an overflow."""
        return bool(self._in1.read() & _FIFOP_BIT)

    def read_frame(self) -> Firmware[ReceivedFrame | None]:
        """Take a frame out of the RXFIFO; None where it overflowed and had to be emptied."""
        yield COMMAND_CYCLES
        if not self._in1.read() & _FIFO_BIT:  # FIFOP without FIFO: overflow (section 14.3)
            self.overflows += 1
            yield from self.flush_received()
            return None
        answer = yield from self._chip.read_block(bytes((r.RXFIFO | r.ADDRESS_READ,)))
        if len(answer) < 3 + 2:  # no frame is so short: the FIFO is out of step
            self.overflows += 1
            yield from self.flush_received()
            return None
        rssi = answer[-2] - 256 if answer[-2] & 0x80 else answer[-2]
        quality = answer[-1]
        return ReceivedFrame(
            answer[:-2], rssi + r.RSSI_OFFSET_DB, quality & 0x7F, bool(quality & r.CRC_OK)
        )

    def flush_received(self) -> Firmware[None]:
        """Empty the RXFIFO; twice, as section 14.3 wants it after an overflow."""
        yield from self.strobe(r.SFLUSHRX)
        yield from self.strobe(r.SFLUSHRX)
