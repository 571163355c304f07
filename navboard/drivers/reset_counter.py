"""A counter of resets in data EEPROM that a power cut cannot set back.

Two words hold the count and its inverse in turn: the newer valid one counts, the other is written
next. A cut in the middle of a write spoils only the word that was old anyway.
"""

from __future__ import annotations

from collections.abc import Generator

from firmware_model.dspic30f.eeprom import EEPROM_BASE
from firmware_model.dspic30f.mcu import DsPic30F6014A
from navboard.costs import EEPROM_POLL

_SLOTS = (0x7FF000, 0x7FF010)  # count, and its inverse in the word behind
_WR = 1 << 15
_ERASE, _WRITE = 0x4044, 0x4004


def keep_count(cells: bytearray, boots: int) -> None:
    """Write into the cells of a data EEPROM that there were so many boots: 1 to 65 535."""
    if not 1 <= boots <= 0xFFFF:
        raise ValueError(f"boots = {boots} is outside 1 to 65535")
    start = _SLOTS[0] - EEPROM_BASE
    cells[start : start + 2] = boots.to_bytes(2, "little")
    cells[start + 2 : start + 4] = (~boots & 0xFFFF).to_bytes(2, "little")


class ResetCounter:
    """Counts once a boot; values run from 1 to 65 535 and start again at 1."""

    def __init__(self, mcu: DsPic30F6014A) -> None:
        self._eeprom = mcu.eeprom
        self._control = mcu.reg["NVMCON"]
        self._key = mcu.reg["NVMKEY"]

    def next(self) -> int:
        """Return the number of this boot, before it is stored."""
        return self._count(self._latest()) % 0xFFFF + 1

    def store(self, count: int) -> Generator[int, None, None]:
        """Write the count into the slot that holds the older one, in about 8 ms."""
        slot = _SLOTS[1] if self._latest() == _SLOTS[0] else _SLOTS[0]
        for address, word in ((slot, count), (slot + 2, ~count & 0xFFFF)):
            for operation in (_ERASE, _WRITE):
                self._eeprom.table_write(address, word)
                self._control.write(operation)
                self._key.write(0x55)
                self._key.write(0xAA)
                self._control.set_bits(_WR)
                while self._control.read() & _WR:
                    yield EEPROM_POLL

    def _latest(self) -> int:
        """Return the slot with the newer count; 1 is newer than 65 535."""
        first, second = (self._count(slot) for slot in _SLOTS)
        if not second:
            return _SLOTS[0]
        if not first:
            return _SLOTS[1]
        return _SLOTS[0] if (first - second) & 0xFFFF < 0x8000 else _SLOTS[1]

    def _count(self, slot: int) -> int:
        count = self._eeprom.table_read(slot)
        valid = self._eeprom.table_read(slot + 2) == ~count & 0xFFFF
        return count if valid else 0
