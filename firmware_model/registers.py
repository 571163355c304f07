"""Registers as data: a peripheral lists its registers with datasheet names, addresses and resets.

The table is what a datasheet's register summary is; behaviour is attached to names, so a reader
can hold the table against the datasheet. A write keeps the bits that are not writable; a write
side effect receives the merged value and stores what it wants to keep.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from firmware_model.errors import RegisterError, WiringError


class RegisterSpec(NamedTuple):
    """One line of a register summary."""

    name: str
    address: int
    width: int = 16
    reset: int = 0
    writable: int = 0xFFFF


class Register:
    """One register: a value, and what reading or writing it sets off."""

    __slots__ = (
        "_kept",
        "_mask",
        "address",
        "name",
        "on_read",
        "on_write",
        "reset_value",
        "value",
        "width",
    )

    def __init__(
        self,
        spec: RegisterSpec,
        on_read: Callable[[], int] | None = None,
        on_write: Callable[[int], None] | None = None,
    ) -> None:
        if spec.width not in (8, 16):
            raise WiringError(f"{spec.name}: a register is 8 or 16 bits wide, not {spec.width}")
        self.name = spec.name
        self.address = spec.address
        self.width = spec.width
        self.reset_value = spec.reset
        self.value = spec.reset
        self.on_read = on_read
        self.on_write = on_write
        self._mask = spec.writable & ((1 << spec.width) - 1)
        self._kept = ~self._mask

    def read(self) -> int:
        """Read as firmware does, with side effects."""
        return self.value if self.on_read is None else self.on_read()

    def write(self, value: int) -> None:
        """Write as firmware does: read-only bits stay, side effects happen."""
        merged = (self.value & self._kept) | (value & self._mask)
        if self.on_write is None:
            self.value = merged
        else:
            self.on_write(merged)

    def set_bits(self, bits: int) -> None:
        """Read, OR, write: one BSET or BIS instruction."""
        self.write(self.value | bits)

    def clear_bits(self, bits: int) -> None:
        """Read, AND NOT, write: one BCLR or BIC instruction."""
        merged = self.value & ~(bits & self._mask)
        if self.on_write is None:
            self.value = merged
        else:
            self.on_write(merged)

    def __repr__(self) -> str:
        return f"{self.name}@{self.address:#06x}={self.value:#0{2 + self.width // 4}x}"


class RegisterBank:
    """The registers of one peripheral, by name."""

    __slots__ = ("_registers",)

    def __init__(
        self,
        specs: Iterable[RegisterSpec],
        on_read: Mapping[str, Callable[[], int]] | None = None,
        on_write: Mapping[str, Callable[[int], None]] | None = None,
        kinds: Mapping[str, type[Register]] = MappingProxyType({}),
    ) -> None:
        reads, writes = dict(on_read or {}), dict(on_write or {})
        self._registers = {
            spec.name: kinds.get(spec.name, Register)(
                spec, reads.pop(spec.name, None), writes.pop(spec.name, None)
            )
            for spec in specs
        }
        if unknown := [*reads, *writes]:
            raise WiringError(f"side effects for registers that do not exist: {unknown}")

    def __getitem__(self, name: str) -> Register:
        """Return the register of that datasheet name."""
        try:
            return self._registers[name]
        except KeyError:
            raise RegisterError(f"there is no register {name} here") from None

    def __iter__(self) -> Iterator[Register]:
        return iter(self._registers.values())

    def reset(self) -> None:
        """Put reset values back, without side effects."""
        for register in self._registers.values():
            register.value = register.reset_value


class AddressSpace:
    """All registers of an MCU by address, as an instruction sees them."""

    __slots__ = ("_by_address", "_by_name")

    def __init__(self, banks: Iterable[RegisterBank]) -> None:
        self._by_address: dict[int, Register] = {}
        self._by_name: dict[str, Register] = {}
        for bank in banks:
            for register in bank:
                other = self._by_address.get(register.address)
                if other is not None:
                    raise WiringError(f"{register.name} and {other.name} share an address")
                if register.name in self._by_name:
                    raise WiringError(f"two registers are called {register.name}")
                self._by_address[register.address] = register
                self._by_name[register.name] = register

    def __getitem__(self, name: str) -> Register:
        """Return the register of that datasheet name."""
        try:
            return self._by_name[name]
        except KeyError:
            raise RegisterError(f"there is no register {name}") from None

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def at(self, address: int) -> Register:
        """Return the register at an address."""
        try:
            return self._by_address[address]
        except KeyError:
            raise RegisterError(f"there is no register at {address:#06x}") from None

    def read8(self, address: int) -> int:
        """Read a byte: an 8-bit register, or half of a 16-bit one."""
        register = self._by_address.get(address)
        if register is None and address & 1:
            return self.at(address - 1).read() >> 8
        return self.at(address).read() & 0xFF

    def write8(self, address: int, value: int) -> None:
        """Write a byte; a byte write to a 16-bit register keeps the other half."""
        register = self._by_address.get(address)
        if register is None and address & 1:
            word = self.at(address - 1)
            word.write((word.value & 0xFF) | (value & 0xFF) << 8)
            return
        register = self.at(address)
        if register.width == 16:
            register.write((register.value & 0xFF00) | (value & 0xFF))
        else:
            register.write(value & 0xFF)

    def read16(self, address: int) -> int:
        """Read a word at an even address."""
        register = self.at(address & ~1)
        if register.width == 16:
            return register.read()
        return self.read8(address & ~1) | self.read8(address | 1) << 8

    def write16(self, address: int, value: int) -> None:
        """Write a word at an even address."""
        register = self.at(address & ~1)
        if register.width == 16:
            register.write(value & 0xFFFF)
        else:
            self.write8(address & ~1, value & 0xFF)
            self.write8(address | 1, value >> 8 & 0xFF)
