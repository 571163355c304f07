"""SPI1 as a slave: a shift register, a transmit and a receive buffer behind one address.

Whole bytes come through the `SpiTarget` protocol; with MODE16 two of them make a word, and a chip
select that is released between them abandons it. A write to SPIxBUF goes into the shift register if
that is empty and no word is under way, else into the transmit buffer (SPITBF); a word that is
complete goes into the receive buffer (SPIRBF) and raises the interrupt. A word that finds the
receive buffer full is lost and sets SPIROV, and nothing is received until firmware clears it
(DS70046, section 20). With nothing to send the shift register gives back what was shifted in
before: that follows from a shift register that nobody reloads, the manual does not promise it.
"""

from __future__ import annotations

from firmware_model.dspic30f.errors import UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec

SPIEN = 1 << 15
SPIROV = 1 << 6
SPITBF = 1 << 1
SPIRBF = 1 << 0
FRMEN = 1 << 14
DISSDO = 1 << 11
MODE16 = 1 << 10
CKE = 1 << 8
SSEN = 1 << 7
MSTEN = 1 << 5

FLOATING = 0x00  # MISO with nobody driving it: assumed pulled down, so it reads as filler
_NONE = -1

# DS70143, table 14-1 (SPI1 register map).
SPI1_REGISTERS = (
    RegisterSpec("SPI1STAT", 0x0220, writable=0xA040),
    RegisterSpec("SPI1CON", 0x0222, writable=0x6FFF),
    RegisterSpec("SPI1BUF", 0x0224),
)


class SpiSlave:
    """SPI1 in slave mode, 8 or 16 bits; it is the `SpiTarget` that a master's wires lead to."""

    __slots__ = (
        "_buffer",
        "_busy",
        "_control",
        "_first",
        "_line",
        "_loaded",
        "_received",
        "_selected",
        "_shift",
        "_status",
        "_transmit",
        "_wide",
        "bank",
        "overruns",
        "underruns",
    )

    def __init__(self, line: InterruptLine) -> None:
        self.bank = RegisterBank(
            SPI1_REGISTERS,
            on_read={"SPI1BUF": self._read_buffer},
            on_write={
                "SPI1BUF": self._write_buffer,
                "SPI1STAT": self._write_status,
                "SPI1CON": self._write_control,
            },
        )
        self._status = self.bank["SPI1STAT"]
        self._control = self.bank["SPI1CON"]
        self._buffer = self.bank["SPI1BUF"]
        self._line = line
        self._selected = False
        self._shift = FLOATING
        self._loaded = False  # the shift register holds a byte that firmware wrote
        self._busy = False  # a word is being shifted
        self._wide = False  # MODE16
        self._first = _NONE  # first byte of a wide word that is under way
        self._transmit = 0
        self._received = 0
        self.overruns = 0
        """Words lost because firmware was late to read."""
        self.underruns = 0
        """Words begun with nothing loaded."""

    def reset(self) -> None:
        """Disable; a word under way is lost."""
        self.bank.reset()
        self._loaded = self._busy = self._wide = False
        self._first = _NONE

    # --- the wires -------------------------------------------------------------------

    def select(self, selected: bool) -> None:
        """Take the level of SS1; releasing it abandons a word under way."""
        self._selected = selected
        self._busy = False
        self._first = _NONE

    def begin(self) -> int:
        """First clock edge of a byte: return what is shifted out."""
        if self._first != _NONE:
            return FLOATING if self._control.value & DISSDO else self._shift & 0xFF
        if not self._listening():
            return FLOATING
        self._busy = True
        if not self._loaded:
            self.underruns += 1
        if self._control.value & DISSDO:
            return FLOATING
        return self._shift >> 8 if self._wide else self._shift

    def end(self, mosi: int) -> None:
        """Last clock edge of a byte: take a complete word in, move the next one up."""
        if not self._busy:
            return
        if self._wide:
            if self._first == _NONE:
                self._first = mosi
                return
            mosi |= self._first << 8
            self._first = _NONE
        self._word_over(mosi)

    def takes_pairs(self) -> bool:
        """Return whether a wide word may begin (`SpiPairTarget`)."""
        return self._wide and not self._busy and self._listening()

    def begin_pair(self) -> int:
        """First clock edge of a wide word: return both bytes that are shifted out."""
        self._busy = True
        if not self._loaded:
            self.underruns += 1
        return FLOATING << 8 | FLOATING if self._control.value & DISSDO else self._shift

    def end_pair(self, mosi: int) -> None:
        """Last clock edge of a wide word."""
        if self._busy:
            self._word_over(mosi)

    def _word_over(self, mosi: int) -> None:
        self._busy = False
        status = self._status
        value = status.value
        if value & (SPIRBF | SPIROV):
            value |= SPIROV
            self.overruns += 1
        else:
            self._received = mosi
            value |= SPIRBF
        if value & SPITBF:
            self._shift = self._transmit
            value &= ~SPITBF
            self._loaded = True
        else:
            self._shift = mosi
            self._loaded = False
        status.value = value
        self._line.request()

    def _listening(self) -> bool:
        if not self._status.value & SPIEN:
            return False
        return self._selected or not self._control.value & SSEN

    # --- the registers ---------------------------------------------------------------

    def _read_buffer(self) -> int:
        self._status.value &= ~SPIRBF
        return self._received

    def _write_buffer(self, value: int) -> None:
        if not self._status.value & SPIEN:
            return
        if not self._loaded and not self._busy:
            self._shift = value & (0xFFFF if self._wide else 0xFF)
            self._loaded = True
        elif not self._status.value & SPITBF:
            self._transmit = value & (0xFFFF if self._wide else 0xFF)
            self._status.value |= SPITBF

    def _write_status(self, value: int) -> None:
        old = self._status.value
        if not value & SPIEN:
            value &= ~(SPITBF | SPIRBF | SPIROV)
            self._loaded = self._busy = False
        # SPIROV can only be cleared by firmware; the buffer flags are read-only.
        self._status.value = (value & ~SPIROV) | (value & old & SPIROV)

    def _write_control(self, value: int) -> None:
        if value & (MSTEN | FRMEN):
            raise UnsupportedModeError("SPI1: only the slave without frame sync is modelled")
        self._control.value = value
        self._wide = bool(value & MODE16)
        self._first = _NONE
