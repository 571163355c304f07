"""SPI masters of the MSP430 (USART0, USART1) and the pair of DMA channels that serves both.

A short exchange is polled: the CPU writes a byte, works or waits for its eight bits, reads one. A
long one is left to DMA: channel 0 empties UxRXBUF into RAM, channel 1 refills UxTXBUF from RAM, and
the CPU sleeps in LPM0, because SMCLK has to run. The chip has three channels and two full-duplex
buses want four, so the pair is shared under a lock.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.coroutines import Firmware, Lock

BUFFER_BYTES: Final = 264
"""A flash page with its command; longer than any frame of radio or link."""

POLL_OVERHEAD_CYCLES: Final = 18
"""Of a polled byte beyond its bits: mov to UxTXBUF (5), bit and jz on URXIFG (4 + 2), mov from
UxRXBUF (4), store and count (3): SLAU049F, section 3.4.4."""
DMA_SETUP_CYCLES: Final = 60
"""Writing nine DMA registers, mov #n, &EDE of 5 cycles each (SLAU049F, table 3-16), and a call."""
DMA_DONE_CYCLES: Final = 20
"""DMA handler: clear DMAIFG, post a task."""

# UxCTL, UxTCTL (SLAU049F, section 14.3).
_SWRST: Final = 0x01
_MM: Final = 0x02
_SYNC: Final = 0x04
_CHAR: Final = 0x10
_STC: Final = 0x02
_SSEL_SMCLK: Final = 0x20
_CKPH: Final = 0x80
# DMAxCTL (SLAU049F, section 8.3).
_DMAEN: Final = 0x0010
_DMAIFG: Final = 0x0008
_DMAIE: Final = 0x0004
_BYTES: Final = 0x00C0
_SRCINCR: Final = 0x0300
_DSTINCR: Final = 0x0C00
# DMACTL0: triggers of channel 0 (receive) and 1 (transmit), by USART.
_TRIGGERS: Final = (0x0043, 0x00A9)


class DmaPair:
    """DMA channels 0 and 1, and their buffers in RAM. `start` at every boot.

    `rest` is the state in which the CPU sleeps while no block is under way.
    """

    def __init__(self, mcu: Msp430F1611, rest: str = "lpm3") -> None:
        reg = mcu.reg
        self._cpu = mcu.cpu
        self._rest = rest
        self._ram = mcu.ram
        self._select = reg["DMACTL0"]
        self._control0, self._control1 = reg["DMA0CTL"], reg["DMA1CTL"]
        self._source0, self._source1 = reg["DMA0SA"], reg["DMA1SA"]
        self._destination0, self._destination1 = reg["DMA0DA"], reg["DMA1DA"]
        self._size0, self._size1 = reg["DMA0SZ"], reg["DMA1SZ"]
        self._done = Flag("DMA done")
        self._lock = Lock("DMA free")
        self._user = -1
        self._received = self._sent = 0

    def start(self) -> None:
        """Take RAM and the interrupt."""
        self._received = self._ram.allocate(BUFFER_BYTES)
        self._sent = self._ram.allocate(BUFFER_BYTES)
        self._cpu.on_interrupt("DACDMA", self._finished)

    def exchange(self, master: SpiMaster, data: bytes) -> Firmware[bytes]:
        """Clock `data` (at least two bytes) through a master; return what came back."""
        lock = self._lock
        if lock.held:
            yield from lock.acquire()
        else:
            lock.held = True
        count = len(data)
        sent = self._sent
        self._ram.store(sent, data)
        if self._user != master.number:
            self._user = master.number
            self._select.write(_TRIGGERS[master.number])
            self._source0.write(master.receive.address)
            self._destination0.write(self._received)
            self._source1.write(sent + 1)  # firmware itself sends the first byte
            self._destination1.write(master.transmit.address)
        self._size0.write(count)
        self._control0.write(_DSTINCR | _BYTES | _DMAIE | _DMAEN)
        self._size1.write(count - 1)
        self._control1.write(_SRCINCR | _BYTES | _DMAEN)
        self._done.is_set = False
        yield DMA_SETUP_CYCLES
        self._cpu.sleep_state = "lpm0"
        master.transmit.write(data[0])
        yield self._done
        self._cpu.sleep_state = self._rest
        answer = self._ram.load(self._received, count)
        lock.release()
        return answer

    def _finished(self) -> int:
        self._control0.write(self._control0.value & ~_DMAIFG)
        self._done.set()
        return DMA_DONE_CYCLES


class SpiMaster:
    """One USART as a three-wire SPI master, mode 0, from SMCLK."""

    def __init__(self, mcu: Msp430F1611, number: int, divider: int, dma: DmaPair) -> None:
        reg = mcu.reg
        prefix = f"U{number}"
        self.number = number
        self.receive = reg[f"{prefix}RXBUF"]
        self.transmit = reg[f"{prefix}TXBUF"]
        self._divider = divider
        self._control = reg[f"{prefix}CTL"]
        self._format = reg[f"{prefix}TCTL"]
        self._rate = (reg[f"{prefix}BR0"], reg[f"{prefix}BR1"])
        self._modulation = reg[f"{prefix}MCTL"]
        self._enable = reg["ME1"] if number == 0 else reg["ME2"]
        self._enable_bits = 0x40 if number == 0 else 0x10  # USPIE0, USPIE1
        self._poll_cycles = 8 * divider + POLL_OVERHEAD_CYCLES
        self._dma = dma

    def start(self) -> None:
        """Set the USART up (SLAU049F, section 14.2.1: under SWRST, enable last)."""
        self._control.write(_SWRST)
        self._control.write(_CHAR | _SYNC | _MM | _SWRST)
        self._format.write(_CKPH | _SSEL_SMCLK | _STC)
        self._rate[0].write(self._divider & 0xFF)
        self._rate[1].write(self._divider >> 8)
        self._modulation.write(0)
        self._enable.set_bits(self._enable_bits)
        self._control.write(_CHAR | _SYNC | _MM)

    def poll(self, data: bytes) -> Generator[int, None, bytes]:
        """Exchange a few bytes under the CPU's own hands."""
        answer = bytearray()
        write, read = self.transmit.write, self.receive.read
        cycles = self._poll_cycles
        for byte in data:
            write(byte)
            yield cycles
            answer.append(read())
        return bytes(answer)

    def exchange(self, data: bytes) -> Firmware[bytes]:
        """Exchange bytes the cheaper way."""
        # Below about eight bytes setting up DMA and an interrupt costs more than polling.
        if len(data) < 8:
            return self.poll(data)
        return self._dma.exchange(self, data)
