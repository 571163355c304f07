"""Hardware multiplier of the MSP430x16x (SLAU049, chapter 7): the address of OP1 is the operation.

Writing OP1 to MPY, MPYS, MAC or MACS chooses unsigned or signed, multiply or accumulate; writing
OP2 starts it, and the result is there before the next instruction can look. SUMEXT holds what
table 7-2 says: 0, the sign, or the carry.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.registers import RegisterBank, RegisterSpec

if TYPE_CHECKING:
    from firmware_model.msp430.dma import Trigger

REGISTERS = (
    RegisterSpec("MPY", 0x0130),
    RegisterSpec("MPYS", 0x0132),
    RegisterSpec("MAC", 0x0134),
    RegisterSpec("MACS", 0x0136),
    RegisterSpec("OP2", 0x0138),
    RegisterSpec("RESLO", 0x013A),
    RegisterSpec("RESHI", 0x013C),
    RegisterSpec("SUMEXT", 0x013E, writable=0),
)

_OPERATIONS = ("MPY", "MPYS", "MAC", "MACS")


def _signed(word: int) -> int:
    return word - 0x10000 if word & 0x8000 else word


class Multiplier:
    """OP1, OP2 and the result registers."""

    def __init__(self, triggers: list[Trigger | None], ready_trigger: int) -> None:
        self._triggers = triggers
        self._ready_trigger = ready_trigger
        self._operation = "MPY"
        self._first = 0
        writes: dict[str, Callable[[int], None]] = {
            name: self._operand_writer(name) for name in _OPERATIONS
        }
        writes["OP2"] = self._multiply
        # All four addresses are one OP1 register.
        reads: dict[str, Callable[[], int]] = {name: lambda: self._first for name in _OPERATIONS}
        self.bank = RegisterBank(REGISTERS, on_read=reads, on_write=writes)
        self._op2 = self.bank["OP2"]
        self._low, self._high = self.bank["RESLO"], self.bank["RESHI"]
        self._extension = self.bank["SUMEXT"]

    def reset(self, por: bool) -> None:
        """Nothing: the registers are undefined after a PUC and keep their contents (SLAU049)."""

    def _operand_writer(self, name: str) -> Callable[[int], None]:
        def write(value: int) -> None:
            self._operation = name
            self._first = value

        return write

    def _multiply(self, second: int) -> None:
        self._op2.value = second
        operation, first = self._operation, self._first
        signed = operation.endswith("S")
        product = _signed(first) * _signed(second) if signed else first * second
        carry = 0
        if operation.startswith("MAC"):
            total = (self._low.value | self._high.value << 16) + (product & 0xFFFF_FFFF)
            carry = total >> 32
            product = total
        result = product & 0xFFFF_FFFF
        self._low.value, self._high.value = result & 0xFFFF, result >> 16
        if signed:
            self._extension.value = 0xFFFF if result & 0x8000_0000 else 0
        else:
            self._extension.value = carry
        trigger = self._triggers[self._ready_trigger]
        if trigger is not None:
            trigger()
