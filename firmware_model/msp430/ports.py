"""Digital ports P1–P6 of the MSP430F1611 (SLAU049, chapter 9); P1 and P2 interrupt on edges.

Each pin is two signals: `output` is the level that the MCU drives (or the pin's resting level while
it is an input), `input` is the level that the board drives. Firmware reads the output back while
the pin is an output. With PxSEL set an output pin follows its peripheral function, where one is
connected (`module`); a timer's capture inputs listen to `input` directly.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.signals import Signal

# SLAS368, "peripheral file map": P1 and P2 have seven registers, P3–P6 four.
_BASES = {1: 0x20, 2: 0x28, 3: 0x18, 4: 0x1C, 5: 0x30, 6: 0x34}


def registers(number: int) -> tuple[RegisterSpec, ...]:
    """Return the register summary of a port."""
    base = _BASES[number]
    names: tuple[str, ...] = ("IN", "OUT", "DIR", "SEL")
    if number <= 2:
        names = ("IN", "OUT", "DIR", "IFG", "IES", "IE", "SEL")
    return tuple(
        RegisterSpec(f"P{number}{name}", base + i, 8, writable=0 if name == "IN" else 0xFF)
        for i, name in enumerate(names)
    )


class Pin:
    """One pin: `input` comes from the board, `output` goes to it."""

    __slots__ = ("input", "output", "resting")

    def __init__(self, name: str) -> None:
        self.input: Signal[bool] = Signal(f"{name}.in", False)
        self.output: Signal[bool] = Signal(f"{name}.out", False)
        self.resting = False

    def pull(self, level: bool) -> None:
        """Say what a resistor on the board makes of the pin while nobody drives it."""
        self.resting = level
        self.input.set(level)
        self.output.set(level)

    def follow(self, source: Signal[bool]) -> None:
        """Let a signal of the board drive the pin."""
        self.input.set(source.value)
        source.watch(self.input.set)


class Port:
    """One port; `pins[0]` … `pins[7]` are its pins."""

    def __init__(self, number: int, line: InterruptLine | None = None) -> None:
        self.number = number
        self.pins = tuple(Pin(f"P{number}.{bit}") for bit in range(8))
        self._line = line
        self._modules: list[Signal[bool] | None] = [None] * 8
        self._in = 0
        writes: dict[str, Callable[[int], None]] = {
            f"P{number}OUT": lambda value: self._write_level(f"P{number}OUT", value),
            f"P{number}DIR": lambda value: self._write_level(f"P{number}DIR", value),
            f"P{number}SEL": lambda value: self._write_level(f"P{number}SEL", value),
        }
        if line is not None:
            writes[f"P{number}IES"] = self._write_edges
            writes[f"P{number}IE"] = lambda value: self._write_interrupts("IE", value)
            writes[f"P{number}IFG"] = lambda value: self._write_interrupts("IFG", value)
        self.bank = RegisterBank(
            registers(number), on_read={f"P{number}IN": self._read}, on_write=writes
        )
        self._out = self.bank[f"P{number}OUT"]
        self._dir = self.bank[f"P{number}DIR"]
        self._sel = self.bank[f"P{number}SEL"]
        if line is not None:
            self._ifg = self.bank[f"P{number}IFG"]
            self._ies = self.bank[f"P{number}IES"]
            self._ie = self.bank[f"P{number}IE"]
        for bit, pin in enumerate(self.pins):
            pin.input.watch(self._input_watcher(bit))

    def module(self, bit: int, signal: Signal[bool]) -> None:
        """Connect a peripheral's output to a pin; it drives the pin while PxSEL selects it."""
        self._modules[bit] = signal
        signal.watch(lambda _level: self._drive_pin(bit))

    def reset(self, por: bool) -> None:
        """PxDIR, PxSEL, PxIFG and PxIE go to 0; PxOUT and PxIES keep their values."""
        if por:
            self.bank.reset()
        self._dir.value = self._sel.value = 0
        if self._line is not None:
            self._ifg.value = self._ie.value = 0
            self._line.clear()
        for bit in range(8):
            self._drive_pin(bit)

    def _read(self) -> int:
        value = 0
        direction = self._dir.value
        for bit, pin in enumerate(self.pins):
            source = pin.output if direction >> bit & 1 else pin.input
            if source.value:
                value |= 1 << bit
        return value

    def _write_level(self, name: str, value: int) -> None:
        register = self.bank[name]
        changed = register.value ^ value
        register.value = value
        while changed:
            bit = changed & -changed
            changed ^= bit
            self._drive_pin(bit.bit_length() - 1)

    def _drive_pin(self, bit: int) -> None:
        pin = self.pins[bit]
        if not self._dir.value >> bit & 1:
            pin.output.set(pin.resting)
            return
        module = self._modules[bit]
        if module is not None and self._sel.value >> bit & 1:
            level = module.value
        else:
            level = bool(self._out.value >> bit & 1)
        if level != pin.output.value:
            pin.output.set(level)
            if self._line is not None:
                self._edge(bit, level)

    def _input_watcher(self, bit: int) -> Callable[[bool], None]:
        mask = 1 << bit

        def changed(level: bool) -> None:
            if self._line is not None and not self._dir.value & mask:
                self._edge(bit, level)

        return changed

    def _edge(self, bit: int, level: bool) -> None:
        """Set PxIFG on the selected edge: PxIES 0 is low-to-high, 1 high-to-low."""
        mask = 1 << bit
        if bool(self._ies.value & mask) != level:
            self._ifg.value |= mask
            self._update_line()

    def _write_edges(self, value: int) -> None:
        """Take new edges, which can set flags: where the pin already stands past the new edge.

        SLAU049, section 9.2.6 lists 0 → 1 with PxIN = 0 and 1 → 0 with PxIN = 1 as "may be set";
        here they are, so that a driver which forgets to clear the flag shows it.
        """
        changed = self._ies.value ^ value
        self._ies.value = value
        level = self._read()
        self._ifg.value |= changed & (value ^ level)
        self._update_line()

    def _write_interrupts(self, name: str, value: int) -> None:
        self.bank[f"P{self.number}{name}"].value = value
        self._update_line()

    def _update_line(self) -> None:
        assert self._line is not None
        self._line.drive(bool(self._ifg.value & self._ie.value))
