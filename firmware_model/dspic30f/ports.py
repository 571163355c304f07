"""Ports and external interrupts: TRISx, PORTx, LATx, and INT1 with its edge select.

A pin is a `Signal`. An output pin is driven when LATx or TRISx changes; PORTx reads the pins.
"""

from __future__ import annotations

from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.signals import Signal

INT1EP = 1 << 1

# DS70143, table 7-1 (port register map); bits that exist on the 80-pin part.
_PORTS = {
    "A": (0x02C0, 0xF6C0),
    "B": (0x02C6, 0xFFFF),
    "C": (0x02CC, 0xE01E),
    "D": (0x02D2, 0xFFFF),
    "F": (0x02DE, 0x01FF),
    "G": (0x02E4, 0xF3CF),
}
# DS70143, table 5-2: only INTCON2 is needed here.
INTERRUPT_CONTROL_REGISTERS = (
    RegisterSpec("INTCON1", 0x0080, writable=0x87FE),
    RegisterSpec("INTCON2", 0x0082, writable=0x801F),
)


class Port:
    """One port; `pin(bit)` is the wire at the package."""

    def __init__(self, letter: str) -> None:
        address, mask = _PORTS[letter]
        self.letter = letter
        self.bank = RegisterBank(
            (
                RegisterSpec(f"TRIS{letter}", address, reset=mask, writable=mask),
                RegisterSpec(f"PORT{letter}", address + 2, writable=mask),
                RegisterSpec(f"LAT{letter}", address + 4, writable=mask),
            ),
            on_read={f"PORT{letter}": self._read},
            on_write={
                f"TRIS{letter}": self._write_direction,
                f"PORT{letter}": self._write_latch,
                f"LAT{letter}": self._write_latch,
            },
        )
        self._mask = mask
        self._tris = self.bank[f"TRIS{letter}"]
        self._latch = self.bank[f"LAT{letter}"]
        self._pins = {bit: Signal(f"R{letter}{bit}", False) for bit in range(16) if mask >> bit & 1}

    def pin(self, bit: int) -> Signal[bool]:
        """Return the signal at Rxn."""
        return self._pins[bit]

    def reset(self) -> None:
        """Make every pin an input; what firmware drove falls to ground by its pull-down."""
        driven = ~self._tris.value & self._mask
        self.bank.reset()
        for bit, pin in self._pins.items():
            if driven >> bit & 1:
                pin.set(False)

    def _read(self) -> int:
        return sum(1 << bit for bit, pin in self._pins.items() if pin.value)

    def _write_direction(self, value: int) -> None:
        self._tris.value = value
        self._drive()

    def _write_latch(self, value: int) -> None:
        self._latch.value = value
        self._drive()

    def _drive(self) -> None:
        outputs = ~self._tris.value & self._mask
        latch = self._latch.value
        while outputs:
            bit = outputs & -outputs
            outputs ^= bit
            self._pins[bit.bit_length() - 1].set(bool(latch & bit))


class ExternalInterrupts:
    """INTCON1, INTCON2 and the edge detector of INT1 (DS70046, section 6.4)."""

    def __init__(self, int1: InterruptLine) -> None:
        self.bank = RegisterBank(INTERRUPT_CONTROL_REGISTERS)
        self._control = self.bank["INTCON2"]
        self._line = int1

    def reset(self) -> None:
        """Rising edges again."""
        self.bank.reset()

    def int1(self, level: bool) -> None:
        """Take the level of the INT1 pin."""
        falling = bool(self._control.value & INT1EP)
        if level != falling:
            self._line.request()
