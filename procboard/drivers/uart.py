"""USART1 as a UART from SMCLK: an interrupt an octet each way, rings in between.

On a TelosB the UART leads to the USB converter, at 115 200 baud. SMCLK has to run for it, so the
CPU must not sleep deeper than LPM1 while it listens (TinyOS's McuSleepC decides the same way);
`REST` says so to whoever sets the sleep state.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.clock import CPU_HZ

REST: Final = "lpm1"
"""Deepest sleep in which SMCLK runs (SLAU049F, table 2-2)."""
RING_OCTETS: Final = 128
"""Of received octets that the firmware has not looked at: 11 ms at 115 200 baud."""

RECEIVE_CYCLES: Final = 60
"""Handler of URXIFG1: read U1RCTL and U1RXBUF, store, count, post a task; about 20 instructions
of 3 cycles (SLAU049F, tables 3-14 to 3-16)."""
TRANSMIT_CYCLES: Final = 40
"""Handler of UTXIFG1: load from the ring, write U1TXBUF; about 13 instructions."""

# U1CTL, U1TCTL, U1RCTL (SLAU049F, section 13.3); IE2, ME2; P3.6 UTXD1, P3.7 URXD1 (SLAS368).
_SWRST: Final = 0x01
_CHAR: Final = 0x10
_SSEL_SMCLK: Final = 0x20
_OE: Final = 0x20
_URXIE1, _UTXIE1 = 0x10, 0x20
_UTXE1_URXE1: Final = 0x30
_P3_UART1: Final = 0xC0


def divider(baud: int, clock_hz: int = CPU_HZ) -> tuple[int, int]:
    """Return UBR and UMCTL for a rate: each bit edge as near as a tick allows.

    Bit i of a character takes UBR + m_i ticks, m_0 belonging to the start bit; the eight m repeat
    (SLAU049F, section 13.2.6).
    """
    ratio = clock_hz / baud
    whole = int(ratio)
    ticks = modulation = 0
    for bit in range(8):
        ticks += whole
        if (bit + 1) * ratio - ticks > 0.5:
            ticks += 1
            modulation |= 1 << bit
    return whole, modulation


class Uart:
    """The UART and its two rings. `start` at every boot."""

    def __init__(self, mcu: Msp430F1611, baud: int) -> None:
        reg = mcu.reg
        self.arrived = Flag("UART: octets arrived")
        self.drained = Flag("UART: all octets sent")
        self.overruns = 0
        """Octets lost because the ring or U1RXBUF was full."""
        self._cpu = mcu.cpu
        self._ram = mcu.ram
        self._baud = baud
        self._control, self._format = reg["U1CTL"], reg["U1TCTL"]
        self._status, self._modulation = reg["U1RCTL"], reg["U1MCTL"]
        self._rate = (reg["U1BR0"], reg["U1BR1"])
        self._received, self._transmitted = reg["U1RXBUF"], reg["U1TXBUF"]
        self._modules, self._enables, self._pins = reg["ME2"], reg["IE2"], reg["P3SEL"]
        self._ring: deque[int] = deque()
        self._leaving: deque[int] = deque()

    def start(self) -> None:
        """Set the USART up (SLAU049F, section 13.2.1: under SWRST, interrupts last)."""
        whole, modulation = divider(self._baud)
        self._ram.allocate(RING_OCTETS)
        self._control.write(_SWRST)
        self._control.write(_CHAR | _SWRST)
        self._format.write(_SSEL_SMCLK)
        self._status.write(0)
        self._rate[0].write(whole & 0xFF)
        self._rate[1].write(whole >> 8)
        self._modulation.write(modulation)
        self._modules.set_bits(_UTXE1_URXE1)
        self._pins.set_bits(_P3_UART1)
        self._control.write(_CHAR)
        self._cpu.on_interrupt("USART1RX", self._receive)
        self._cpu.on_interrupt("USART1TX", self._transmit)
        self._cpu.sleep_state = REST
        self._enables.set_bits(_URXIE1)

    @property
    def idle(self) -> bool:
        """Whether the last octet of `write` stands in the transmitter."""
        return not self._leaving

    def read(self) -> bytes:
        """Take what has arrived."""
        octets = bytes(self._ring)
        self._ring.clear()
        return octets

    def write(self, octets: bytes) -> None:
        """Send octets after those that wait; `drained` is set when all have gone."""
        if octets:
            self._leaving.extend(octets)
            self._enables.set_bits(_UTXIE1)

    def _receive(self) -> int:
        if self._status.read() & _OE:
            self.overruns += 1
        octet = self._received.read()
        if len(self._ring) < RING_OCTETS:
            self._ring.append(octet)
        else:
            self.overruns += 1
        self.arrived.set()
        return RECEIVE_CYCLES

    def _transmit(self) -> int:
        self._transmitted.write(self._leaving.popleft())
        if not self._leaving:
            self._enables.clear_bits(_UTXIE1)
            self.drained.set()
        return TRANSMIT_CYCLES
