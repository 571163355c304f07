"""Driver of the M25P80: one SPI conversation an operation, waits slept away rather than polled.

A cycle's typical time is slept first; only then is WIP read, and again at short intervals if the
chip is slower. Sections are those of the Micron M25P80 datasheet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from procboard.coroutines import Firmware
from procboard.errors import FlashFailureError

WREN: Final = b"\x06"
RDSR: Final = b"\x05"
DP: Final = b"\xb9"
RES: Final = b"\xab"
RDID: Final = b"\x9f"
_PP: Final = 0x02 << 24
_READ: Final = 0x03 << 24
_SE: Final = 0xD8 << 24

WIP: Final = 0x01
WEL: Final = 0x02
_ZERO: Final = 0x60
"""Bits of the status register that are always zero."""

PROGRAM_BYTE_US: Final = 2.5
"""tPP = int(n/8) × 0.02 ms for n bytes ("AC Characteristics", note to tPP)."""
PROGRAM_MAX_US: Final = 5_000
"""tPP, maximum."""
ERASE_US: Final = 600_000
"""tSE, typical."""
ERASE_MAX_US: Final = 3_000_000
"""tSE, maximum."""
RELEASE_US: Final = 30
"""tRES, maximum."""
POWER_UP_US: Final = 10_000
"""tPUW, maximum: before it the chip does not write."""
IDENTIFICATION: Final = b"\x20\x20\x14"

OPERATION_CYCLES: Final = 90
"""Building a command and judging its answer: about 30 instructions of 3 cycles (estimate from the
TinyOS stm25p driver's assembly size)."""


class SpiDevice(Protocol):
    """A chip on a shared bus, reached through its chip select."""

    def exchange(self, command: bytes, answer_bytes: int = 0) -> Firmware[bytes]:
        """Select, send `command`, clock in `answer_bytes`, deselect; return the answer."""


Sleep = Callable[[int], Firmware[None]]
"""Sleeps for so many microseconds at least."""


class M25P80Driver:
    """Reads, programs and erases; every operation is complete when it returns."""

    def __init__(self, device: SpiDevice, sleep_us: Sleep) -> None:
        self._device = device
        self._sleep_us = sleep_us

    def start(self) -> Firmware[None]:
        """Wake the chip and make sure that it is the right one.

        Raises:
            FlashFailureError: it answers with another identification.

        """
        yield from self._sleep_us(POWER_UP_US)
        yield from self._device.exchange(RES)
        yield from self._sleep_us(RELEASE_US)
        identification = yield from self._device.exchange(RDID, 3)
        if identification != IDENTIFICATION and (yield from self.status()) & (WIP | _ZERO) == WIP:
            # A cycle outlives a reset of the CPU alone, and the chip tells its status only.
            yield from self._wait(10_000, ERASE_MAX_US)
            identification = yield from self._device.exchange(RDID, 3)
        if identification != IDENTIFICATION:
            raise FlashFailureError(f"flash identifies itself as {identification.hex()}")
        yield from self._wait(100, ERASE_MAX_US)

    def power_down(self) -> Firmware[None]:
        """Enter deep power-down; only `wake` helps then."""
        yield from self._device.exchange(DP)

    def wake(self) -> Firmware[None]:
        """Leave deep power-down."""
        yield from self._device.exchange(RES)
        yield from self._sleep_us(RELEASE_US)

    def status(self) -> Firmware[int]:
        """Read the status register."""
        answer = yield from self._device.exchange(RDSR, 1)
        return answer[0]

    def read(self, address: int, count: int) -> Firmware[bytes]:
        """Read bytes from anywhere."""
        yield OPERATION_CYCLES
        return (yield from self._device.exchange((_READ | address).to_bytes(4, "big"), count))

    def program(self, address: int, data: bytes) -> Firmware[None]:
        """Program bytes of one page and wait for the end of the cycle."""
        yield OPERATION_CYCLES
        yield from self._device.exchange(WREN)
        yield from self._device.exchange((_PP | address).to_bytes(4, "big") + data)
        yield from self._sleep_us(int(max(8, len(data) + 7) * PROGRAM_BYTE_US))
        yield from self._wait(100, PROGRAM_MAX_US)

    def erase_sector(self, address: int) -> Firmware[None]:
        """Erase the sector of that address and wait for the end of the cycle."""
        yield OPERATION_CYCLES
        yield from self._device.exchange(WREN)
        yield from self._device.exchange((_SE | address).to_bytes(4, "big"))
        yield from self._sleep_us(ERASE_US)
        yield from self._wait(10_000, ERASE_MAX_US)

    def _wait(self, interval_us: int, limit_us: int) -> Firmware[None]:
        waited_us = 0
        while (yield from self.status()) & WIP:
            if waited_us >= limit_us:
                raise FlashFailureError(f"flash still busy after {limit_us} µs")
            yield from self._sleep_us(interval_us)
            waited_us += interval_us
