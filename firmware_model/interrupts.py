"""Interrupt controllers decide which request the CPU takes next.

Both families share one idea, a line that is pending or not, and differ in what decides among
pending lines. The dsPIC30F has a flag (IFSx), an enable (IECx) and a programmable priority (IPCx)
for each source, and nests by priority. The MSP430 keeps flags and enables inside its peripherals,
has fixed priorities, and one global enable (GIE) that is cleared on entry, so it does not nest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from firmware_model.errors import WiringError
from firmware_model.registers import Register, RegisterBank, RegisterSpec


class InterruptLine:
    """A source as the CPU sees it: a name, a place in the natural order, a priority, a state."""

    __slots__ = ("_changed", "_place", "name", "number", "on_accept", "pending", "priority")

    def __init__(
        self,
        name: str,
        number: int,
        priority: int,
        changed: Callable[[InterruptLine], None],
        on_accept: Callable[[], None] | None = None,
    ) -> None:
        self.name = name
        self.number = number
        self.priority = priority
        self.pending = False
        self.on_accept = on_accept
        self._changed = changed
        self._place: tuple[Register, Register, int] | None = None  # its controller's own

    def request(self) -> None:
        """Assert the request."""
        if not self.pending:
            self.pending = True
            self._changed(self)

    def clear(self) -> None:
        """Withdraw the request."""
        if self.pending:
            self.pending = False
            self._changed(self)

    def drive(self, level: bool) -> None:
        """Assert or withdraw, for a source that is a level."""
        if level != self.pending:
            self.pending = level
            self._changed(self)

    def __repr__(self) -> str:
        return f"InterruptLine({self.name}, {'pending' if self.pending else 'idle'})"


class InterruptController(Protocol):
    """What a CPU needs of its controller."""

    notify: Callable[[], None]
    """Called when a request may have become acceptable; the CPU sets it."""

    def next(self, level: int) -> InterruptLine | None:
        """Return the line to take while running at `level`, or None."""

    def accept(self, line: InterruptLine) -> None:
        """Note that the CPU fetches the vector of `line`."""

    def reset(self) -> None:
        """Forget every request, as a reset does."""


def _nobody() -> None:
    """Stand in for the CPU until it is connected."""


class DspicSource(NamedTuple):
    """Where a source of the dsPIC30F sits: vector number = bit of IFS/IEC, slot of IPC."""

    name: str
    number: int


class _FlagRegister(Register):
    """IFSx. Clearing one flag, what every handler does, has a short way of its own."""

    __slots__ = ("active", "lines")

    active: list[InterruptLine]
    lines: dict[int, InterruptLine]

    def clear_bits(self, bits: int) -> None:
        """Clear flags, as BCLR does."""
        line = self.lines.get(bits)
        if line is None:
            super().clear_bits(bits)
        elif line.pending:
            line.pending = False
            self.value &= ~bits
            if line in self.active:
                self.active.remove(line)


class DspicInterrupts:
    """IFSx, IECx and IPCx of the dsPIC30F (DS70046, section 6): priorities 0–7, nesting.

    Vector number n has its flag in IFS(n // 16) bit n % 16, its enable in the same place of IECx,
    its priority in IPC(n // 4), field n % 4. Priority 0 disables a source; equal priorities are
    taken in natural order (lower vector number first). Handlers clear their own flag.
    """

    def __init__(self, sources: Iterable[DspicSource], bank_count: int = 3) -> None:
        self.notify: Callable[[], None] = _nobody
        self._lines = {
            s.name: InterruptLine(s.name, s.number, 4, self._line_changed) for s in sources
        }
        self._by_number = {line.number: line for line in self._lines.values()}
        if len(self._by_number) != len(self._lines):
            raise WiringError("two dsPIC interrupt sources share a vector number")
        self._ipc_count = 4 * bank_count - 1
        # DS70141, table 5-2: IFS0 0x084, IEC0 0x08C, IPC0 0x094; IPC resets to 4 in every field.
        specs = [RegisterSpec(f"IFS{i}", 0x0084 + 2 * i) for i in range(bank_count)]
        specs += [RegisterSpec(f"IEC{i}", 0x008C + 2 * i) for i in range(bank_count)]
        specs += [
            RegisterSpec(f"IPC{i}", 0x0094 + 2 * i, reset=0x4444, writable=0x7777)
            for i in range(self._ipc_count)
        ]
        writes: dict[str, Callable[[int], None]] = {}
        for i in range(bank_count):
            writes[f"IFS{i}"] = lambda value, i=i: self._write_flags(i, value)  # type: ignore[misc]
            writes[f"IEC{i}"] = lambda value, i=i: self._write_enables(i, value)  # type: ignore[misc]
        for i in range(self._ipc_count):
            writes[f"IPC{i}"] = lambda value, i=i: self._write_priorities(i, value)  # type: ignore[misc]
        kinds = {f"IFS{i}": _FlagRegister for i in range(bank_count)}
        self.bank = RegisterBank(specs, on_write=writes, kinds=kinds)
        self._ifs = [self.bank[f"IFS{i}"] for i in range(bank_count)]
        self._iec = [self.bank[f"IEC{i}"] for i in range(bank_count)]
        self._active: list[InterruptLine] = []  # pending and enabled
        for line in self._lines.values():
            bank, bit = divmod(line.number, 16)
            line._place = (self._ifs[bank], self._iec[bank], 1 << bit)
        for bank, register in enumerate(self._ifs):
            assert isinstance(register, _FlagRegister)
            register.active = self._active
            register.lines = {
                1 << line.number % 16: line
                for line in self._lines.values()
                if line.number // 16 == bank
            }

    def line(self, name: str) -> InterruptLine:
        """Return the line of a source, for the peripheral that drives it."""
        try:
            return self._lines[name]
        except KeyError:
            raise WiringError(f"the dsPIC has no interrupt source {name}") from None

    def names(self) -> tuple[str, ...]:
        """Return the names of all sources in natural order."""
        return tuple(sorted(self._lines, key=lambda name: self._lines[name].number))

    def next(self, level: int) -> InterruptLine | None:
        """Return the enabled pending line of highest priority above `level`."""
        active = self._active
        if not active:
            return None
        best: InterruptLine | None = None
        for line in active:
            if line.priority > level and (
                best is None
                or line.priority > best.priority
                or (line.priority == best.priority and line.number < best.number)
            ):
                best = line
        return best

    def accept(self, line: InterruptLine) -> None:
        """Nothing: the flag stays until the handler clears it."""

    def reset(self) -> None:
        """Clear flags and enables, priorities back to 4."""
        self._active.clear()
        self.bank.reset()
        for line in self._lines.values():
            line.pending = False
            line.priority = 4

    def _line_changed(self, line: InterruptLine) -> None:
        assert line._place is not None
        flags, enables, mask = line._place
        if line.pending:
            flags.value |= mask
            if enables.value & mask:
                self._active.append(line)
                self.notify()
        else:
            flags.value &= ~mask
            if line in self._active:
                self._active.remove(line)

    def _write_flags(self, bank: int, value: int) -> None:
        register = self._ifs[bank]
        changed = value ^ register.value
        register.value = value
        while changed:
            bit = changed & -changed
            changed ^= bit
            line = self._by_number.get(bank * 16 + bit.bit_length() - 1)
            if line is not None:
                line.drive(bool(value & bit))

    def _write_enables(self, bank: int, value: int) -> None:
        self._iec[bank].value = value
        self._rebuild()

    def _write_priorities(self, index: int, value: int) -> None:
        register: Register = self.bank[f"IPC{index}"]
        register.value = value
        for field in range(4):
            line = self._by_number.get(index * 4 + field)
            if line is not None:
                line.priority = value >> 4 * field & 7
        self._rebuild()

    def _rebuild(self) -> None:
        self._active[:] = [
            line
            for line in self._lines.values()
            if line.pending and self._iec[line.number // 16].value >> line.number % 16 & 1
        ]
        if self._active:
            self.notify()


_NMI = 14


class Msp430Interrupts:
    """Fixed priorities and GIE of the MSP430x1xx (SLAU049, section 2.2).

    A line's `number` is its place in the vector table: 15 is reset, 0 the lowest priority; 14 is
    NMI, which needs no GIE and interrupts handlers too (priority 2; all others have 1).
    A peripheral asserts its line while (flag AND enable); a single-source flag is cleared by the
    hardware on acceptance, which the peripheral does in `on_accept`.
    """

    def __init__(self) -> None:
        self.notify: Callable[[], None] = _nobody
        self._gie = False
        self._active: list[InterruptLine] = []
        self._lines: dict[str, InterruptLine] = {}

    def line(
        self, name: str, number: int, on_accept: Callable[[], None] | None = None
    ) -> InterruptLine:
        """Add a source at a place of the vector table (0xFFE0 + 2 × number)."""
        if name in self._lines or any(x.number == number for x in self._lines.values()):
            raise WiringError(f"MSP430 interrupt {name} or vector {number} is taken")
        priority = 2 if number == _NMI else 1
        line = InterruptLine(name, number, priority, self._line_changed, on_accept)
        self._lines[name] = line
        return line

    def names(self) -> tuple[str, ...]:
        """Return the names of all sources, highest priority first."""
        return tuple(sorted(self._lines, key=lambda name: -self._lines[name].number))

    @property
    def gie(self) -> bool:
        """General interrupt enable of the status register."""
        return self._gie

    @gie.setter
    def gie(self, enabled: bool) -> None:
        self._gie = enabled
        if enabled and self._active:
            self.notify()

    def next(self, level: int) -> InterruptLine | None:
        """Return the pending line of highest vector; inside a handler or without GIE only NMI."""
        best: InterruptLine | None = None
        for line in self._active:
            if (
                line.priority > level
                and (self._gie or line.priority == 2)
                and (best is None or line.number > best.number)
            ):
                best = line
        return best

    def accept(self, line: InterruptLine) -> None:
        """Let a single-source peripheral clear its flag."""
        if line.on_accept is not None:
            line.on_accept()

    def reset(self) -> None:
        """Forget every request and clear GIE."""
        self._gie = False
        self._active.clear()
        for line in self._lines.values():
            line.pending = False

    def _line_changed(self, line: InterruptLine) -> None:
        if line.pending:
            self._active.append(line)
            if self._gie or line.priority == 2:
                self.notify()
        else:
            self._active.remove(line)
