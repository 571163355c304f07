"""Shape and policy of the storage log, what it counts, and what it needs of a flash driver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from procboard import log_format as fmt
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError


class FullPolicy(Enum):
    """What happens when every sector holds records that were not given up."""

    STOP = "stop"
    OVERWRITE_OLDEST = "overwrite-oldest"


@dataclass(frozen=True, slots=True)
class LogConfig:
    """Shape and policy of the log; sizes in bytes."""

    sector_count: int = 16
    sector_bytes: int = 65536
    page_bytes: int = 256
    buffer_bytes: int = 1024
    policy: FullPolicy = FullPolicy.OVERWRITE_OLDEST

    def __post_init__(self) -> None:
        if self.sector_count < 3:
            raise ProcConfigError(f"a log needs 3 sectors at least, not {self.sector_count}")
        least = fmt.SECTOR_BLOCK_BYTES + 2 * fmt.OPEN_BLOCK_BYTES
        if not least <= self.page_bytes <= 256 or self.sector_bytes < 2 * self.page_bytes:
            raise ProcConfigError(f"a log needs pages of {least} to 256 bytes, two a sector")

    @property
    def max_payload_bytes(self) -> int:
        """The longest record: one that has a page of its own."""
        return self.page_bytes - fmt.BLOCK_HEADER_BYTES - fmt.RECORD_HEADER_BYTES


@dataclass(slots=True)
class LogStatistics:
    """Counted since the last mount."""

    appended: int = 0
    stored: int = 0
    blocks: int = 0
    rejected: int = 0
    torn_pages: int = 0
    corrupt_records: int = 0
    program_failures: int = 0
    sectors_erased: int = 0


class Flash(Protocol):
    """What the log needs of a flash driver."""

    def read(self, address: int, count: int) -> Firmware[bytes]:
        """Read bytes."""

    def program(self, address: int, data: bytes) -> Firmware[None]:
        """Clear bits within a page."""

    def erase_sector(self, address: int) -> Firmware[None]:
        """Set all bits of the sector of that address."""
