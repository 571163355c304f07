"""The 64 KiB address space of the MSP430F1611: peripheral file, RAM, information and main flash.

RAM and flash are one `bytearray` indexed by address, which is what DMA and a machine-code CPU want;
the peripheral file below 0x0200 is registers. `Ram` hands out addresses to Python firmware, so
that drivers name real buffers to the DMA as C code would.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from firmware_model.errors import FirmwareError, RegisterError
from firmware_model.registers import AddressSpace, RegisterBank

if TYPE_CHECKING:
    from firmware_model.msp430.flash import FlashController

# SLAS368, "memory organization" of the F1611.
RAM_START, RAM_END = 0x1100, 0x3900
RAM_MIRROR_START, RAM_MIRROR_END = 0x0200, 0x0A00  # mirrors 0x1100–0x18FF
BOOT_START, BOOT_END = 0x0C00, 0x1000
INFO_START, INFO_END = 0x1000, 0x1100
MAIN_START, MAIN_END = 0x4000, 0x10000
PERIPHERALS_END = 0x0200
_MIRROR_OFFSET = RAM_START - RAM_MIRROR_START


class Ram:
    """The 10 KiB of RAM, with an allocator in the place of a linker."""

    __slots__ = ("_memory", "_next")

    def __init__(self, memory: bytearray) -> None:
        self._memory = memory
        self._next = RAM_START

    def allocate(self, size: int) -> int:
        """Return the address of `size` fresh bytes, at an even address."""
        address = self._next
        if address + size > RAM_END:
            raise FirmwareError(f"RAM is full: {size} bytes wanted, {RAM_END - address} left")
        self._next = address + size + (size & 1)
        return address

    @property
    def free(self) -> int:
        """Bytes not yet allocated."""
        return RAM_END - self._next

    def load(self, address: int, size: int) -> bytes:
        """Return bytes of RAM."""
        return bytes(self._memory[address : address + size])

    def store(self, address: int, data: bytes) -> None:
        """Put bytes into RAM."""
        if not (address >= RAM_START and address + len(data) <= RAM_END):
            raise FirmwareError(f"{len(data)} bytes at {address:#06x} are not in RAM")
        self._memory[address : address + len(data)] = data

    def release(self) -> None:
        """Forget all allocations, as a new start of the program does; contents stay."""
        self._next = RAM_START

    def lose_power(self) -> None:
        """Lose the contents. What real cells wake up with is arbitrary; here it is 0xA5."""
        self._memory[RAM_START:RAM_END] = b"\xa5" * (RAM_END - RAM_START)


class Msp430AddressSpace(AddressSpace):
    """Registers by name and address, and memory by address."""

    __slots__ = ("_flash", "memory")

    def __init__(
        self, banks: Iterable[RegisterBank], memory: bytearray, flash: FlashController
    ) -> None:
        super().__init__(banks)
        self.memory = memory
        self._flash = flash

    def _locate(self, address: int) -> int:
        """Return the index into memory, or raise where there is none."""
        if RAM_START <= address < RAM_END or MAIN_START <= address < MAIN_END:
            return address
        if INFO_START <= address < INFO_END:
            return address
        if RAM_MIRROR_START <= address < RAM_MIRROR_END:
            return address + _MIRROR_OFFSET
        raise RegisterError(f"there is no memory at {address:#06x}")

    def read8(self, address: int) -> int:
        """Read a byte of a register, RAM or flash."""
        if address < PERIPHERALS_END:
            return super().read8(address)
        index = self._locate(address)
        if not RAM_START <= index < RAM_END:
            self._flash.before_read()
        return self.memory[index]

    def read16(self, address: int) -> int:
        """Read a word; bit 0 of the address is ignored, as the CPU does."""
        address &= 0xFFFE
        if address < PERIPHERALS_END:
            return super().read16(address)
        index = self._locate(address)
        if not RAM_START <= index < RAM_END:
            self._flash.before_read()
        return self.memory[index] | self.memory[index + 1] << 8

    def write8(self, address: int, value: int) -> None:
        """Write a byte to a register, RAM or, through its controller, flash."""
        if address < PERIPHERALS_END:
            super().write8(address, value)
            return
        index = self._locate(address)
        if RAM_START <= index < RAM_END:
            self.memory[index] = value & 0xFF
        else:
            self._flash.write(index, bytes((value & 0xFF,)))

    def write16(self, address: int, value: int) -> None:
        """Write a word; bit 0 of the address is ignored."""
        address &= 0xFFFE
        if address < PERIPHERALS_END:
            super().write16(address, value)
            return
        index = self._locate(address)
        if RAM_START <= index < RAM_END:
            self.memory[index] = value & 0xFF
            self.memory[index + 1] = value >> 8 & 0xFF
        else:
            self._flash.write(index, bytes((value & 0xFF, value >> 8 & 0xFF)))
