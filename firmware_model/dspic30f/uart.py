"""UART with its four-deep receive FIFO: one event a character, none a bit.

Characters arrive whole at the middle of their stop bit (`UartListener`). URXISEL decides how many
of them it takes to raise UxRXIF. A fifth character that finds the FIFO full sets OERR; nothing more
is taken until firmware clears OERR, which empties the FIFO (DS70046, section 19.5).
"""

from __future__ import annotations

from collections import deque

from firmware_model.dspic30f.errors import UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import Clock
from firmware_model.wires import UartListener

UARTEN = 1 << 15
STSEL = 1 << 0
PDSEL = 3 << 1
UTXEN = 1 << 10
UTXBF = 1 << 9
TRMT = 1 << 8
RIDLE = 1 << 4
PERR = 1 << 3
FERR = 1 << 2
OERR = 1 << 1
URXDA = 1 << 0
FIFO_DEPTH = 4
_THRESHOLD = (1, 1, 3, 4)  # characters in the FIFO for an interrupt, by URXISEL<1:0>
_FRAME_BITS = 10  # start, eight data, stop


def uart_registers(number: int) -> tuple[RegisterSpec, ...]:
    """Return the register map of UART1 or UART2 (DS70143, tables 16-1, 16-2)."""
    base = 0x020C + 10 * (number - 1)
    name = f"U{number}"
    return (
        RegisterSpec(f"{name}MODE", base, writable=0xA4E7),
        RegisterSpec(f"{name}STA", base + 2, reset=0x0110, writable=0x8CE2),
        RegisterSpec(f"{name}TXREG", base + 4, writable=0x01FF),
        RegisterSpec(f"{name}RXREG", base + 6, writable=0),
        RegisterSpec(f"{name}BRG", base + 8),
    )


class Uart:
    """One UART, 8 data bits, no parity, one stop bit."""

    def __init__(
        self,
        number: int,
        scheduler: Scheduler,
        clock: Clock,
        receive_line: InterruptLine,
        transmit_line: InterruptLine,
    ) -> None:
        name = f"U{number}"
        self.name = name
        self.bank = RegisterBank(
            uart_registers(number),
            on_read={f"{name}RXREG": self._read_receive},
            on_write={
                f"{name}MODE": self._write_mode,
                f"{name}STA": self._write_status,
                f"{name}TXREG": self._write_transmit,
            },
        )
        self._scheduler = scheduler
        self._clock = clock
        self._rx_line = receive_line
        self._tx_line = transmit_line
        self._mode = self.bank[f"{name}MODE"]
        self._status = self.bank[f"{name}STA"]
        self._brg = self.bank[f"{name}BRG"]
        self._rx: deque[int] = deque()
        self._tx: deque[int] = deque()
        self._shifting: int | None = None
        self._event: Event | None = None
        self._threshold = 1
        self.overruns = 0
        """Characters lost because the FIFO was full."""
        self.listener: UartListener | None = None
        """Who hears what is transmitted."""

    @property
    def bit_cycles(self) -> int:
        """Instruction cycles a bit: 16 (UxBRG + 1) (DS70046, equation 19-1)."""
        return 16 * (self._brg.value + 1)

    def reset(self) -> None:
        """Empty both FIFOs and stop."""
        self._scheduler.cancel(self._event)
        self._event = None
        self._rx.clear()
        self._tx.clear()
        self._shifting = None
        self._threshold = 1
        self.bank.reset()

    # --- receiving -------------------------------------------------------------------

    def receive(self, character: int) -> None:
        """Take a character from the wire (the `UartListener` of whoever sends)."""
        if not self._mode.value & UARTEN:
            return
        rx = self._rx
        status = self._status
        if status.value & OERR or len(rx) >= FIFO_DEPTH:
            self.overruns += 1
            status.value |= OERR
            return
        rx.append(character & 0xFF)
        status.value |= URXDA
        if len(rx) >= self._threshold:
            self._rx_line.request()

    def _read_receive(self) -> int:
        if not self._rx:
            return 0
        character = self._rx.popleft()
        if not self._rx:
            self._status.value &= ~URXDA
        return character

    # --- transmitting ----------------------------------------------------------------

    def _write_transmit(self, value: int) -> None:
        status = self._status
        if not status.value & UTXEN or len(self._tx) >= FIFO_DEPTH:
            return
        self._tx.append(value & 0xFF)
        if self._shifting is None:
            self._shift_next()
        elif len(self._tx) >= FIFO_DEPTH:
            status.value |= UTXBF

    def _shift_next(self) -> None:
        self._shifting = self._tx.popleft()
        self._status.value &= ~(UTXBF | TRMT)
        done = self._clock.ticks(self._scheduler.now) + 1 + _FRAME_BITS * self.bit_cycles
        self._event = self._scheduler.at(self._clock.edge(done), self._shifted)
        if not self._status.value >> 15:  # UTXISEL = 0: at every transfer into the shift register
            self._tx_line.request()

    def _shifted(self) -> None:
        character, self._shifting, self._event = self._shifting, None, None
        if self._tx:
            self._shift_next()
        else:
            self._status.value |= TRMT
            if self._status.value >> 15:
                self._tx_line.request()
        if self.listener is not None and character is not None:
            self.listener(character)

    # --- control ---------------------------------------------------------------------

    def _write_mode(self, value: int) -> None:
        if value & (PDSEL | STSEL):
            raise UnsupportedModeError(f"{self.name}: only 8 data bits, no parity, one stop bit")
        self._mode.value = value
        if not value & UARTEN:
            self._rx.clear()
            self._status.value &= ~(URXDA | OERR | UTXEN)

    def _write_status(self, value: int) -> None:
        old = self._status.value
        if old & OERR and not value & OERR:
            self._rx.clear()
            value &= ~URXDA
        if not self._mode.value & UARTEN:
            value &= ~UTXEN  # UTXEN can be set only after UARTEN (DS70046, 19.5.1)
        self._status.value = (value & ~OERR) | (value & old & OERR)
        self._threshold = _THRESHOLD[value >> 6 & 3]
