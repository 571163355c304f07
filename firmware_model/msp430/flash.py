"""Flash controller of the MSP430x1xx (SLAU049, chapter 5): keys, timing generator, AND semantics.

Programming can only clear bits; erasing sets a segment, the main memory, or everything to ones.
Operations take the timing generator's periods of SLAU049 section 5.3, during which a CPU that runs
from flash is held. Contents persist over every reset and over loss of power; an operation that is
cut short by it leaves what a real one may leave: a word half programmed, a segment half erased.

Not modelled: block write (BLKWRT, which needs code in RAM), the limit on cumulative programming
time, endurance, and disturb. Choosing BLKWRT is an access violation here.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.time import FS_PER_S

if TYPE_CHECKING:
    from firmware_model.cpu import Cpu
    from firmware_model.msp430.clocks import BasicClock
    from firmware_model.scheduler import Scheduler

FWKEY = 0xA500
_READ_KEY = 0x9600
# FCTL1.
ERASE, MERAS, WRT, BLKWRT = 0x0002, 0x0004, 0x0040, 0x0080
# FCTL3.
BUSY, KEYV, ACCVIFG, WAIT, LOCK, EMEX = 0x0001, 0x0002, 0x0004, 0x0008, 0x0010, 0x0020

# SLAS368, "flash memory": periods of the flash timing generator.
WORD_PROGRAM_PERIODS = 35
SEGMENT_ERASE_PERIODS = 4_819
MASS_ERASE_PERIODS = 5_297
FTG_MIN_HZ, FTG_MAX_HZ = 257_000, 476_000
"""f(FTG), SLAS368."""

MAIN_START, MAIN_END, MAIN_SEGMENT = 0x4000, 0x10000, 512
INFO_START, INFO_END, INFO_SEGMENT = 0x1000, 0x1100, 128

REGISTERS = (
    RegisterSpec("FCTL1", 0x0128),
    RegisterSpec("FCTL2", 0x012A, reset=0x0042),
    RegisterSpec("FCTL3", 0x012C, reset=0x0018),
)


def segment_of(address: int) -> tuple[int, int]:
    """Return start and end of the segment that holds an address of flash."""
    if INFO_START <= address < INFO_END:
        start = address - (address - INFO_START) % INFO_SEGMENT
        return start, start + INFO_SEGMENT
    start = address - (address - MAIN_START) % MAIN_SEGMENT
    return start, start + MAIN_SEGMENT


class FlashController:
    """FCTL1–FCTL3 over the flash part of `memory`.

    `on_reset(cause)` asks for a PUC, `on_violation()` reports ACCVIFG, `cpu` is set by the MCU.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        clocks: BasicClock,
        memory: bytearray,
        on_reset: Callable[[str], None],
        on_violation: Callable[[], None],
    ) -> None:
        self.cpu: Cpu
        self.erase_counts: dict[int, int] = {}
        """Erasures by segment start, for wear."""
        self._scheduler = scheduler
        self._clocks = clocks
        self._memory = memory
        self._on_reset, self._on_violation = on_reset, on_violation
        self._busy_until_fs = 0
        self._undo: tuple[int, bytes] | None = None  # what stood where the operation works
        self.bank = RegisterBank(
            REGISTERS,
            on_read={
                "FCTL1": lambda: _READ_KEY | self._fctl1.value & 0xFF,
                "FCTL2": lambda: _READ_KEY | self._fctl2.value & 0xFF,
                "FCTL3": self._read_fctl3,
            },
            on_write={
                "FCTL1": self._write_fctl1,
                "FCTL2": self._write_fctl2,
                "FCTL3": self._write_fctl3,
            },
        )
        self._fctl1, self._fctl2 = self.bank["FCTL1"], self.bank["FCTL2"]
        self._fctl3 = self.bank["FCTL3"]

    @property
    def busy(self) -> bool:
        """Whether an erase or write is under way."""
        return self._scheduler.now < self._busy_until_fs

    @property
    def violated(self) -> bool:
        """ACCVIFG."""
        return bool(self._fctl3.value & ACCVIFG)

    def clear_violation(self) -> None:
        """Clear ACCVIFG."""
        self._fctl3.value &= ~ACCVIFG

    @property
    def generator_hz(self) -> Fraction:
        """Frequency of the flash timing generator: FSSELx / (FNx + 1)."""
        value = self._fctl2.value
        clocks = self._clocks
        source = (clocks.aclk, clocks.mclk, clocks.smclk, clocks.smclk)[value >> 6 & 3]
        return source.frequency_hz / ((value & 0x3F) + 1)

    def reset(self, por: bool) -> None:
        """Restore the registers and lock; a PUC keeps KEYV and ACCVIFG (rw-(0))."""
        kept = 0 if por else self._fctl3.value & (KEYV | ACCVIFG)
        self.bank.reset()
        self._fctl3.value |= kept
        self._busy_until_fs = 0
        self._undo = None

    def power_off(self) -> None:
        """Cut an operation that is under way: its odd bytes keep what they were."""
        if self.busy and self._undo is not None:
            start, before = self._undo
            for offset in range(1, len(before), 2):
                self._memory[start + offset] = before[offset]
        self._busy_until_fs = 0
        self._undo = None

    def before_read(self) -> None:
        """Report a read of flash while it is busy: an access violation."""
        if self.busy:
            self._violate()

    def write(self, address: int, data: bytes) -> None:
        """Take a write to flash: program a byte or word, or start the erase that FCTL1 asks for."""
        control = self._fctl1.value
        locked = self._fctl3.value & LOCK
        if self.busy or control & BLKWRT:
            self._violate()
        elif control & (ERASE | MERAS) and not control & WRT:
            if not locked:
                self._erase(address, control)
        elif control & WRT and not control & (ERASE | MERAS):
            if not locked:
                end = address + len(data)
                before = bytes(self._memory[address:end])
                self._memory[address:end] = bytes(a & b for a, b in zip(before, data, strict=True))
                self._begin(WORD_PROGRAM_PERIODS, address, before)
        else:
            self._violate()

    def _erase(self, address: int, control: int) -> None:
        if control & MERAS:
            start, end = MAIN_START, MAIN_END
            periods = MASS_ERASE_PERIODS
            if control & ERASE:  # all of it: information memory too
                self._fill(INFO_START, INFO_END)
        else:
            start, end = segment_of(address)
            periods = SEGMENT_ERASE_PERIODS
        before = bytes(self._memory[start:end])
        self._fill(start, end)
        self._begin(periods, start, before)

    def _fill(self, start: int, end: int) -> None:
        self._memory[start:end] = b"\xff" * (end - start)
        address = start
        while address < end:
            self.erase_counts[address] = self.erase_counts.get(address, 0) + 1
            address = segment_of(address)[1]

    def _begin(self, periods: int, start: int, before: bytes) -> None:
        """Be busy; a CPU that executes from flash is held until the end."""
        duration = int(periods * FS_PER_S / self.generator_hz)
        self._busy_until_fs = self._scheduler.now + duration
        self._undo = (start, before)
        self.cpu.hold(ceil(duration * self._clocks.mclk.frequency_hz / FS_PER_S))

    def _violate(self) -> None:
        self._fctl3.value |= ACCVIFG
        self._on_violation()

    def _key(self, value: int) -> bool:
        if value & 0xFF00 == FWKEY:
            return True
        self._fctl3.value |= KEYV
        self._on_reset("flash key")
        return False

    def _write_fctl1(self, value: int) -> None:
        if self._key(value):
            if self.busy:
                self._violate()
            else:
                self._fctl1.value = value & 0xFF

    def _write_fctl2(self, value: int) -> None:
        if self._key(value):
            if self.busy:
                self._violate()
            else:
                self._fctl2.value = value & 0xFF

    def _write_fctl3(self, value: int) -> None:
        if self._key(value):
            if value & EMEX and self.busy:  # emergency exit: stop the operation where it is
                self.power_off()
                self._fctl3.value |= LOCK
                return
            self._fctl3.value = value & (KEYV | ACCVIFG | LOCK)
            if not value & ACCVIFG:
                self._on_violation()

    def _read_fctl3(self) -> int:
        busy = self.busy
        return _READ_KEY | self._fctl3.value & 0xFF & ~(BUSY | WAIT) | (BUSY if busy else WAIT)
