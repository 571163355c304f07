"""Registers and capture/compare blocks of Timer_A3 and Timer_B7 (SLAU049, chapters 11 and 12).

What is the same in every block of both timers stands here; `timer.py` has what they do together.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.msp430.clocks import GatedClock
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event
from firmware_model.signals import Signal

# TxCTL.
TIFG, TIE, TCLR = 0x0001, 0x0002, 0x0004
MC_STOP, MC_UP, MC_CONTINUOUS, MC_UPDOWN = 0x0000, 0x0010, 0x0020, 0x0030
SSEL_ACLK, SSEL_SMCLK = 0x0100, 0x0200
# TxCCTLx.
CCIFG, COV, OUT, CCI, CCIE = 0x0001, 0x0002, 0x0004, 0x0008, 0x0010
OUTMOD, OUTMOD_SHIFT, CAP, SCCI, SCS = 0x00E0, 5, 0x0100, 0x0400, 0x0800
CCIS_SHIFT, CM_SHIFT = 12, 14
CCIS_A, CCIS_B, CCIS_GND, CCIS_VCC = 0x0000, 0x1000, 0x2000, 0x3000
CM_RISING, CM_FALLING, CM_BOTH = 0x4000, 0x8000, 0xC000

TIMER_B_LENGTHS = (1 << 16, 1 << 12, 1 << 10, 1 << 8)  # CNTLx

# OUTMODx: what EQUx and EQU0 do to the output ("s"et, "r"eset, "t"oggle, "-" nothing).
OUTPUT_MODES = ("--", "s-", "tr", "sr", "t-", "r-", "ts", "rs")


def timer_registers(letter: str, channels: int) -> tuple[RegisterSpec, ...]:
    """Return the register summary of Timer_A or Timer_B (SLAS368, "peripheral file map")."""
    base = 0x0160 if letter == "A" else 0x0180
    return (
        RegisterSpec(f"T{letter}CTL", base),
        *(RegisterSpec(f"T{letter}CCTL{n}", base + 2 + 2 * n) for n in range(channels)),
        RegisterSpec(f"T{letter}R", base + 0x10),
        *(RegisterSpec(f"T{letter}CCR{n}", base + 0x12 + 2 * n) for n in range(channels)),
        RegisterSpec(f"T{letter}IV", 0x012E if letter == "A" else 0x011E),
    )


class CaptureCompare:
    """One block: its registers, its output unit, and what the timer remembers of it."""

    __slots__ = (
        "ccr",
        "cctl",
        "event",
        "fire",
        "inputs",
        "match",
        "number",
        "output",
        "seen",
        "seen_ticks",
        "trigger_number",
    )

    def __init__(
        self, timer: str, number: int, bank: RegisterBank, due: Callable[[CaptureCompare], None]
    ) -> None:
        self.number = number
        self.cctl = bank[f"{timer}CCTL{number}"]
        self.ccr = bank[f"{timer}CCR{number}"]
        self.output: Signal[bool] = Signal(f"{timer}.OUT{number}", False)
        self.event: Event | None = None
        self.fire: Callable[[], None] = lambda: due(self)
        self.inputs: list[Signal[bool] | GatedClock | None] = [None, None]
        self.seen_ticks = 0  # of a clock that is being captured
        self.trigger_number: int | None = None
        self.seen = 0  # position up to which CCIFG is set
        self.match = 0  # position of the next compare, where an event waits for it

    def act(self, moment: int) -> None:
        """Do to the output what OUTMODx says for EQUx (moment 0) or EQU0 (moment 1)."""
        action = OUTPUT_MODES[self.cctl.value >> OUTMOD_SHIFT & 7][moment]
        if action == "s":
            self.output.set(True)
        elif action == "r":
            self.output.set(False)
        elif action == "t":
            self.output.set(not self.output.value)
