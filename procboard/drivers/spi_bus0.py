"""USART0 as TelosB uses it: one SPI bus for the radio and the flash, each with its chip select."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from firmware_model.registers import Register
from procboard.coroutines import Firmware, Lock
from procboard.drivers.spi import SpiMaster

SELECT_CYCLES: Final = 10
"""bic.b #n, &P4OUT and bis.b: 5 cycles each (SLAU049F, table 3-16)."""


class SpiBus0:
    """The bus and who has it: one conversation at a time."""

    __slots__ = ("lock", "master")

    def __init__(self, master: SpiMaster) -> None:
        self.master = master
        self.lock = Lock("SPI bus 0 free")


class SpiChip:
    """A chip on the bus: conversations under its chip select, active low."""

    __slots__ = ("_bus", "_exchange", "_lock", "_mask", "_output", "_poll")

    def __init__(self, bus: SpiBus0, output: Register, mask: int) -> None:
        self._bus = bus
        self._lock = bus.lock
        self._exchange = bus.master.exchange
        self._poll = bus.master.poll
        self._output = output
        self._mask = mask

    def exchange(self, command: bytes, answer_bytes: int = 0) -> Firmware[bytes]:
        """Select, send `command`, clock in `answer_bytes`, deselect; return the answer."""
        answer = yield from self.transfer(command + bytes(answer_bytes))
        return answer[len(command) :]

    def transfer(self, data: bytes) -> Firmware[bytes]:
        """Select, exchange all of `data`, deselect; return every byte that came back."""
        lock = self._lock
        if lock.held:
            yield from lock.acquire()
        else:
            lock.held = True
        self._output.clear_bits(self._mask)
        answer = yield from self._exchange(data)
        yield SELECT_CYCLES
        self._output.set_bits(self._mask)
        lock.release()
        return answer

    def hold(self) -> Firmware[None]:
        """Keep the bus, over several `brief` conversations, until `release`."""
        yield from self._lock.acquire()

    def release(self) -> None:
        """Let others have the bus."""
        self._lock.release()

    def brief(self, data: bytes) -> Generator[int, None, bytes]:
        """Exchange a few bytes while the bus is held; an interrupt handler may do it, too."""
        self._output.clear_bits(self._mask)
        answer = yield from self._poll(data)
        yield SELECT_CYCLES
        self._output.set_bits(self._mask)
        return answer

    def read_block(self, command: bytes) -> Firmware[bytes]:
        """Send `command`, take a length byte, then as many bytes as it says: one conversation."""
        lock = self._lock
        if lock.held:
            yield from lock.acquire()
        else:
            lock.held = True
        self._output.clear_bits(self._mask)
        head = yield from self._poll(command + b"\0")
        count = head[-1] & 0x7F
        answer = b""
        if count:
            answer = yield from self._exchange(bytes(count))
        yield SELECT_CYCLES
        self._output.set_bits(self._mask)
        lock.release()
        return answer
