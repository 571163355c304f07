"""The M25P80 as data: instruction codes, status bits, sizes, times, currents, contents.

Sections and tables are those of the Micron M25P80 datasheet, 09005aef84566560 Rev. I.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

READ: Final = "read"
STANDBY: Final = "standby"
DEEP_POWER_DOWN: Final = "deep power down"
PROGRAM: Final = "program"
ERASE: Final = "erase"

CURRENTS_A: Final = {
    STANDBY: 50e-6,  # ICC1, "DC Characteristics": maximum; no typical value is given
    DEEP_POWER_DOWN: 1e-6,  # ICC2: typical on page 1 ("Deep power-down: 1 µA")
    READ: 4e-3,  # ICC3, the low-clock row: maximum; our bus is far below its 33 MHz
    PROGRAM: 15e-3,  # ICC4 (PP) and ICC5 (WRSR): maximum
    ERASE: 15e-3,  # ICC6 (SE) and ICC7 (BE): maximum
}
"""Supply current by state [A]; maxima where the datasheet gives no typical value."""

RDID_BYTES: Final = bytes((0x20, 0x20, 0x14))
"""Manufacturer (Numonyx/Micron), memory type, capacity 2^20 bytes ("READ IDENTIFICATION")."""
RES_SIGNATURE: Final = 0x13
"""Electronic signature of "RELEASE from DEEP POWER-DOWN and READ ELECTRONIC SIGNATURE"."""

WRITE_INHIBIT_V: Final = 2.5
"""VWI: below it the chip is reset (table "Power-Up Timing and VWI Threshold": 1 V to 2.5 V)."""

PREPROGRAM_SHARE: Final = 0.3
"""Share of a sector erase in which a NOR array is first programmed to zero (assumed)."""


class Instruction(IntEnum):
    """Instruction codes (table "Command Set Codes")."""

    WRSR = 0x01
    PP = 0x02
    READ = 0x03
    WRDI = 0x04
    RDSR = 0x05
    WREN = 0x06
    FAST_READ = 0x0B
    RDID = 0x9F
    RES = 0xAB
    DP = 0xB9
    BE = 0xC7
    SE = 0xD8


class Status(IntEnum):
    """Bits of the status register (table "Status Register")."""

    WIP = 0x01
    WEL = 0x02
    BP = 0x1C
    SRWD = 0x80


KEPT: Final = Status.BP | Status.SRWD
"""The non-volatile bits of the status register."""


@dataclass(frozen=True, slots=True)
class FlashGeometry:
    """Sizes in bytes; the defaults are the M25P80's. Tests use small ones."""

    sector_count: int = 16
    sector_bytes: int = 65536
    page_bytes: int = 256

    @property
    def size_bytes(self) -> int:
        """Bytes of the whole chip."""
        return self.sector_count * self.sector_bytes

    @property
    def pages_per_sector(self) -> int:
        """Pages of a sector."""
        return self.sector_bytes // self.page_bytes


@dataclass(frozen=True, slots=True)
class FlashTiming:
    """Durations of the self-timed cycles [s]: typical values of "AC Characteristics"."""

    page_program_s: float = 0.64e-3  # tPP, 256 bytes
    sector_erase_s: float = 0.6  # tSE
    bulk_erase_s: float = 8.0  # tBE
    write_status_s: float = 1.3e-3  # tW
    deep_power_down_s: float = 3e-6  # tDP, maximum
    release_s: float = 30e-6  # tRES1 and tRES2, maximum
    power_up_write_s: float = 10e-3  # tPUW, maximum: before it nothing can be written
    power_up_select_s: float = 30e-6  # tVSL, minimum: before it the chip does not answer


@dataclass(slots=True)
class FlashImage:
    """What survives without power: the array, the status register's kept bits, the wear.

    Wear is no content of a real chip: it is what a laboratory would have counted.
    """

    memory: bytearray
    status: int = 0
    erase_counts: list[int] = field(default_factory=list)

    @classmethod
    def blank(cls, geometry: FlashGeometry) -> FlashImage:
        """Return the image of a chip as delivered: every bit one, nothing protected."""
        return cls(bytearray(b"\xff" * geometry.size_bytes), 0, [0] * geometry.sector_count)
