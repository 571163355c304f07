"""What of the network layer is compiled into a board, and the RAM it takes there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from procboard.errors import ProcConfigError
from procboard.log_config import FullPolicy, LogConfig
from procboard.routing.duty import DutyConfig

BUFFER_BYTES: Final = 256
"""Records or items that wait to be stored: seven of the longest, of each sort."""
ITEM_LIMIT: Final = 512
"""Items of all boards that are kept: nearly a grid of 24 × 24 (our choice; 3 octets each)."""
EVENT_LIMIT: Final = 16
"""What came and waits for the application or the flash; beyond it nothing more is taken from the
air that would have to be kept, and comes again (our choice; 32 octets each)."""
TABLE_BYTES: Final = 416 + 1_100 + 1_200 + 64
"""Neighbours, collection, sharing, time: as their files say."""
LEDGER_BYTES: Final = 128 * 8
"""Of the base (`delivery.LEDGER_LIMIT`)."""


@dataclass(frozen=True, slots=True)
class RoutingConfig:
    """The board's part, and how many sectors of the flash it has.

    A robot's oldest records make room when its sectors are full, and are counted at the base. A
    base whose sectors are full takes no more: the records stay where they are.
    """

    base: bool = False
    """Root of the collection tree."""
    record_sectors: int = 3
    """For records on their way to the base; at the base for those that came. Of three a robot keeps
    2300 of the longest records at least (a full sector), the base 5300 (all of them)."""
    item_sectors: int = 3
    item_limit: int = ITEM_LIMIT
    duty: DutyConfig | None = None
    """When all boards listen; None: always."""

    def __post_init__(self) -> None:
        if min(self.record_sectors, self.item_sectors) < 3:
            raise ProcConfigError("routing needs 3 sectors for records and 3 for items at least")
        if self.item_limit < 1:
            raise ProcConfigError("routing: item_limit is 1 or more")

    @property
    def sectors(self) -> int:
        """Sectors of the flash that are taken."""
        return self.record_sectors + self.item_sectors

    def record_log(self, like: LogConfig) -> LogConfig:
        """Return the log of records, on a flash of which another log is known."""
        policy = FullPolicy.STOP if self.base else FullPolicy.OVERWRITE_OLDEST
        return LogConfig(
            self.record_sectors, like.sector_bytes, like.page_bytes, BUFFER_BYTES, policy
        )

    def item_log(self, like: LogConfig) -> LogConfig:
        """Return the log of items: none may be given up, others may ask for it."""
        return LogConfig(
            self.item_sectors, like.sector_bytes, like.page_bytes, BUFFER_BYTES, FullPolicy.STOP
        )

    def ram_bytes(self, page_bytes: int) -> int:
        """Return what a C program would have as static arrays; one page is read at a time."""
        total = TABLE_BYTES + 2 * BUFFER_BYTES + page_bytes + 3 * self.item_limit + 32 * EVENT_LIMIT
        return total + LEDGER_BYTES if self.base else total
