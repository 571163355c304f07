"""One flash chip for several logs: each has sectors of its own, and they take turns.

The chip does nothing else while it programs or erases, and would answer nonsense: an operation is
over before another log's begins.
"""

from __future__ import annotations

from procboard.coroutines import Firmware, Lock, T
from procboard.drivers.m25p80 import M25P80Driver


class FlashRegion:
    """Some of a chip's sectors, as a flash of its own whose addresses begin at zero."""

    __slots__ = ("_driver", "_lock", "_start")

    def __init__(self, driver: M25P80Driver, lock: Lock, start: int) -> None:
        self._driver = driver
        self._lock = lock
        self._start = start

    def start(self) -> Firmware[None]:
        """Wake the chip and make sure that it is the right one.

        Raises:
            FlashFailureError: it is not.

        """
        yield from self._turn(self._driver.start())

    def read(self, address: int, count: int) -> Firmware[bytes]:
        """Read bytes."""
        return (yield from self._turn(self._driver.read(self._start + address, count)))

    def program(self, address: int, data: bytes) -> Firmware[None]:
        """Clear bits within a page."""
        yield from self._turn(self._driver.program(self._start + address, data))

    def erase_sector(self, address: int) -> Firmware[None]:
        """Set all bits of the sector of that address."""
        yield from self._turn(self._driver.erase_sector(self._start + address))

    def _turn(self, operation: Firmware[T]) -> Firmware[T]:
        yield from self._lock.acquire()
        try:
            return (yield from operation)
        finally:
            self._lock.release()
