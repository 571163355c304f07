"""What a chip and an MCU peripheral agree on at a wire, one protocol a bus.

Bits are not events. A byte on a bus has a start and a bit period, which fixes every edge; the
masters below move whole bytes at the right times, and the waveform writer draws the bits. What a
slave answers is latched at the first clock edge, as shift registers do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

UartListener: TypeAlias = Callable[[int], None]
"""Takes a received character, called at the middle of its stop bit."""


class SpiTarget(Protocol):
    """A slave on an SPI bus."""

    def select(self, selected: bool) -> None:
        """Chip select changed; True is active, whatever the level of the pin."""

    def begin(self) -> int:
        """First clock edge: return the byte that will be shifted out."""

    def end(self, mosi: int) -> None:
        """Last clock edge: take the byte that was shifted in."""


class SpiPort(Protocol):
    """What an SPI master's shift register is connected to."""

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        """First clock edge of a byte."""

    def end(self) -> int:
        """Last clock edge of the byte: return what came back."""


class SpiBlockPort(SpiPort, Protocol):
    """A port that can take a block at its end where nobody could tell the difference.

    That is so for a memory: what it answers does not depend on when it is asked.
    """

    def takes_blocks(self) -> bool:
        """Return whether the chip that is selected now is such a one."""

    def exchange_block(self, mosi: bytes) -> bytes:
        """Exchange bytes that were clocked up to now; return what came back."""


class SpiPairPort(SpiPort, Protocol):
    """A port to a slave that works in words of two bytes: nothing happens between the two."""

    def takes_pairs(self) -> bool:
        """Return whether the slave that is selected now stands at the beginning of such a word."""

    def begin_pair(self, mosi: int, bit_period_fs: int) -> None:
        """First clock edge of two bytes without a gap, the first one in the upper eight bits."""

    def end_pair(self) -> int:
        """Last clock edge of the second byte: return what came back, in the same order."""

    def split_pair(self, first_is_over: bool) -> int:
        """Go on with `end` for the byte that is under way; return what the first brought back."""


class SpiPairTarget(SpiTarget, Protocol):
    """A slave that can work in words of two bytes."""

    def takes_pairs(self) -> bool:
        """Return whether it does so now and a word may begin."""

    def begin_pair(self) -> int:
        """First clock edge of a word: return the two bytes that will be shifted out."""

    def end_pair(self, mosi: int) -> None:
        """Last clock edge of a word: take the two bytes that were shifted in."""


class I2cTarget(Protocol):
    """A slave on an I²C bus; it acknowledges what it accepts."""

    def address_match(self, address: int, read: bool) -> bool:
        """Hear a (repeated) start with a 7-bit address; return whether it is ours."""

    def write(self, byte: int) -> bool:
        """Take a byte from the master; return whether it is acknowledged."""

    def read(self) -> int:
        """Return the next byte for the master."""

    def stop(self) -> None:
        """Stop condition."""


class I2cBus:
    """Open-drain wires with several targets; the first that matches an address answers."""

    __slots__ = ("_selected", "_targets")

    def __init__(self, targets: tuple[I2cTarget, ...]) -> None:
        self._targets = targets
        self._selected: I2cTarget | None = None

    def start(self, address: int, read: bool) -> bool:
        """Send a (repeated) start and an address; return whether anybody acknowledged."""
        self._selected = None
        for target in self._targets:
            if target.address_match(address, read):
                self._selected = target
                return True
        return False

    def write(self, byte: int) -> bool:
        """Send a byte; return whether it was acknowledged."""
        return self._selected is not None and self._selected.write(byte)

    def read(self) -> int:
        """Read a byte; an idle bus reads ones."""
        return 0xFF if self._selected is None else self._selected.read()

    def stop(self) -> None:
        """Send a stop condition."""
        if self._selected is not None:
            self._selected.stop()
            self._selected = None
