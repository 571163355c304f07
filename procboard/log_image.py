"""Reading the log out of a flash image: what a mount would find, without a board.

It is the firmware's own mount and cursor, run over bytes, so a laboratory that reads out a flash
sees exactly what the robot would.
"""

from __future__ import annotations

from procboard import log_format as fmt
from procboard.coroutines import Firmware
from procboard.errors import FlashFailureError
from procboard.log_config import LogConfig
from procboard.storage import RecordLog


class _ImageReader:
    """A flash that is only bytes."""

    def __init__(self, memory: bytes) -> None:
        self._memory = memory

    def read(self, address: int, count: int) -> Firmware[bytes]:
        """Read bytes."""
        yield 0
        return bytes(self._memory[address : address + count])

    def program(self, address: int, data: bytes) -> Firmware[None]:
        """Refuse: an image is not written."""
        raise FlashFailureError("a flash image is only read")

    def erase_sector(self, address: int) -> Firmware[None]:
        """Refuse: an image is not written."""
        raise FlashFailureError("a flash image is only read")


def recover_records(memory: bytes, config: LogConfig | None = None) -> list[fmt.Record]:
    """Return the records that mounting a flash with these contents finds, oldest first."""
    records: list[fmt.Record] = []

    def read_all() -> Firmware[None]:
        log = RecordLog(_ImageReader(memory), config)
        yield from log.mount()
        cursor = log.cursor()
        while page := (yield from cursor.read()):
            records.extend(page)

    for _cost in read_all():
        pass
    return records
