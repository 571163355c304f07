"""Special function registers: IE1, IE2, IFG1, IFG2, ME1, ME2 (SLAS368, "peripheral file map").

Enables and flags of the watchdog, the USARTs and NMI share these bytes. Each peripheral asks for
its bit once and gets a `SfrFlag` that it sets and clears; a flag drives its interrupt line while it
is enabled, and its rising edge may trigger DMA, also when firmware sets it by hand (which is how
drivers start a transfer that waits for UTXIFG).
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.interrupts import InterruptLine
from firmware_model.registers import Register, RegisterBank, RegisterSpec

# Bits of IE1/IFG1 and IE2/IFG2.
WDTIE = WDTIFG = 0x01
OFIE = OFIFG = 0x02
NMIIE = NMIIFG = 0x10
ACCVIE = 0x20
URXIE0 = URXIFG0 = 0x40
UTXIE0 = UTXIFG0 = 0x80
URXIE1 = URXIFG1 = 0x10
UTXIE1 = UTXIFG1 = 0x20
# Bits of ME1 and ME2: receiver (and SPI) and transmitter enables.
URXE0 = USPIE0 = 0x40
UTXE0 = 0x80
URXE1 = USPIE1 = 0x10
UTXE1 = 0x20

REGISTERS = (
    RegisterSpec("IE1", 0x0000, 8),
    RegisterSpec("IE2", 0x0001, 8),
    RegisterSpec("IFG1", 0x0002, 8, reset=0x82),  # UTXIFG0; OFIFG after POR
    RegisterSpec("IFG2", 0x0003, 8, reset=0x20),  # UTXIFG1
    RegisterSpec("ME1", 0x0004, 8),
    RegisterSpec("ME2", 0x0005, 8),
)


class SfrFlag:
    """One bit of IFGx with its enable in the same place of IEx."""

    __slots__ = ("bit", "enables", "flags", "line", "on_rise")

    def __init__(
        self,
        flags: Register,
        enables: Register,
        bit: int,
        line: InterruptLine,
        on_rise: Callable[[], None] | None = None,
    ) -> None:
        self.flags = flags
        self.enables = enables
        self.bit = bit
        self.line = line
        self.on_rise = on_rise

    def is_set(self) -> bool:
        """Return whether the flag stands."""
        return bool(self.flags.value & self.bit)

    def set(self) -> None:
        """Set the flag; a rising edge is heard by the interrupt line or, else, by DMA."""
        if not self.flags.value & self.bit:
            self.flags.value |= self.bit
            if self.enables.value & self.bit:
                self.line.request()
            elif self.on_rise is not None:
                self.on_rise()

    def clear(self) -> None:
        """Clear the flag."""
        if self.flags.value & self.bit:
            self.flags.value &= ~self.bit
            self.line.clear()

    def enable_changed(self) -> None:
        """Drive the line anew after a write to IEx."""
        self.line.drive(bool(self.flags.value & self.enables.value & self.bit))


class SpecialFunctions:
    """The six registers and the flags in them."""

    def __init__(self) -> None:
        self._sources: tuple[list[SfrFlag], list[SfrFlag]] = ([], [])
        self._watchers: list[Callable[[], None]] = []
        self.bank = RegisterBank(
            REGISTERS,
            on_write={
                "IE1": lambda value: self._write_enables(0, value),
                "IE2": lambda value: self._write_enables(1, value),
                "IFG1": lambda value: self._write_flags(0, value),
                "IFG2": lambda value: self._write_flags(1, value),
                "ME1": lambda value: self._write_modules("ME1", value),
                "ME2": lambda value: self._write_modules("ME2", value),
            },
        )
        self._ie = (self.bank["IE1"], self.bank["IE2"])
        self._ifg = (self.bank["IFG1"], self.bank["IFG2"])

    def flag(
        self,
        number: int,
        bit: int,
        line: InterruptLine,
        on_rise: Callable[[], None] | None = None,
    ) -> SfrFlag:
        """Return the flag at `bit` of IFG`number`."""
        flag = SfrFlag(self._ifg[number - 1], self._ie[number - 1], bit, line, on_rise)
        self._sources[number - 1].append(flag)
        return flag

    def watch(self, listener: Callable[[], None]) -> None:
        """Call `listener` after any write to IEx, IFGx or MEx by firmware."""
        self._watchers.append(listener)

    def raise_oscillator_fault(self) -> None:
        """Set OFIFG: a selected oscillator does not run."""
        self._ifg[0].value |= OFIFG
        self._tell()

    def reset(self, por: bool) -> None:
        """Put the registers back; a PUC keeps WDTIFG, OFIFG and NMIIFG (rw-(0) bits)."""
        kept = 0 if por else self._ifg[0].value & (WDTIFG | OFIFG | NMIIFG)
        self.bank.reset()
        if not por:
            self._ifg[0].value = UTXIFG0 | kept
        for sources in self._sources:
            for flag in sources:
                flag.enable_changed()

    def _write_flags(self, index: int, value: int) -> None:
        changed = value ^ self._ifg[index].value
        claimed = 0
        for flag in self._sources[index]:
            claimed |= flag.bit
            if changed & flag.bit:
                if value & flag.bit:
                    flag.set()
                else:
                    flag.clear()
        register = self._ifg[index]
        register.value = register.value & claimed | value & ~claimed
        self._tell()

    def _write_enables(self, index: int, value: int) -> None:
        self._ie[index].value = value
        for flag in self._sources[index]:
            flag.enable_changed()
        self._tell()

    def _write_modules(self, name: str, value: int) -> None:
        self.bank[name].value = value
        self._tell()

    def _tell(self) -> None:
        for listener in self._watchers:
            listener()
