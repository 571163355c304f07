"""Data EEPROM: 4 KiB that survive power loss, erased and written a word at a time.

Firmware loads a latch with a table write, unlocks with 55, AA in NVMKEY and sets WR; an erase or a
write takes 2 ms, during which the CPU runs on (DS70143, section 7; parameter D122: 2 ms typical).
Power lost in between leaves the word erased. The cells live in a `bytearray` that the board keeps.
"""

from __future__ import annotations

from firmware_model.dspic30f.errors import LimitError, UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_MS

EEPROM_BASE = 0x7FF000
EEPROM_BYTES = 4096
WR = 1 << 15
WREN = 1 << 14
ERASE_WORD = 0x44
WRITE_WORD = 0x04
WRITE_FS = 2 * FS_PER_MS

# DS70143, table 6-1 (NVM register map).
NVM_REGISTERS = (
    RegisterSpec("NVMCON", 0x0760, writable=0xE07F),
    RegisterSpec("NVMADR", 0x0762),
    RegisterSpec("NVMADRU", 0x0764, writable=0x00FF),
    RegisterSpec("NVMKEY", 0x0766, writable=0x00FF),
)


def blank_eeprom() -> bytearray:
    """Return erased cells."""
    return bytearray(b"\xff" * EEPROM_BYTES)


class DataEeprom:
    """The NVM controller, for data EEPROM words only."""

    def __init__(self, scheduler: Scheduler, line: InterruptLine, cells: bytearray) -> None:
        if len(cells) != EEPROM_BYTES:
            raise LimitError(f"data EEPROM has {EEPROM_BYTES} bytes, not {len(cells)}")
        self.cells = cells
        self.bank = RegisterBank(
            NVM_REGISTERS,
            on_write={"NVMCON": self._write_control, "NVMKEY": self._write_key},
        )
        self._scheduler = scheduler
        self._line = line
        self._control = self.bank["NVMCON"]
        self._address = self.bank["NVMADR"]
        self._upper = self.bank["NVMADRU"]
        self._latch = 0xFFFF
        self._keys = 0  # 1 after 55, 2 after 55 AA
        self._event: Event | None = None

    def reset(self) -> None:
        """Abandon a write under way: the word stays erased."""
        self._scheduler.cancel(self._event)
        self._event = None
        self._keys = 0
        self.bank.reset()

    def table_read(self, address: int) -> int:
        """Read a word as TBLRDL does."""
        at = self._index(address)
        return self.cells[at] | self.cells[at + 1] << 8

    def table_write(self, address: int, word: int) -> None:
        """Load the write latch as TBLWTL does; it also fills NVMADR and NVMADRU."""
        self._index(address)
        self._address.value = address & 0xFFFF
        self._upper.value = address >> 16
        self._latch = word & 0xFFFF

    @staticmethod
    def _index(address: int) -> int:
        if address & 1 or not EEPROM_BASE <= address < EEPROM_BASE + EEPROM_BYTES:
            raise LimitError(f"{address:#08x} is no word of the data EEPROM")
        return address - EEPROM_BASE

    def _write_key(self, value: int) -> None:
        self._keys = 1 if value == 0x55 else 2 if value == 0xAA and self._keys == 1 else 0

    def _write_control(self, value: int) -> None:
        started = value & WR and not self._control.value & WR
        unlocked, self._keys = self._keys == 2, 0
        if not started:
            self._control.value = value | (self._control.value & WR)
            return
        if not unlocked or not value & WREN:
            self._control.value = value & ~WR
            return
        operation = value & 0x7F
        if operation not in (ERASE_WORD, WRITE_WORD):
            raise UnsupportedModeError(f"NVMCON: operation {operation:#x} is left out")
        self._control.value = value
        at = self._index(self._upper.value << 16 | self._address.value)
        if operation == ERASE_WORD:
            self.cells[at : at + 2] = b"\xff\xff"
        self._event = self._scheduler.after(WRITE_FS, lambda: self._finish(operation, at))

    def _finish(self, operation: int, at: int) -> None:
        self._event = None
        if operation == WRITE_WORD:  # writing only clears bits
            self.cells[at] &= self._latch & 0xFF
            self.cells[at + 1] &= self._latch >> 8
        self._control.value &= ~WR
        self._line.request()
