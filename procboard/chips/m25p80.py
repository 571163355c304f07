"""The serial flash ST/Micron M25P80: 8 Mbit, 256-byte pages, 64 KiB sectors, SPI modes 0 and 3.

The chip is a byte machine between falling and rising chip select: the first byte is the
instruction, what follows depends on it, and the instructions that modify run when chip select
rises. A program or erase cycle costs one event, at its end. What a supply that fails in the middle
of a cycle leaves behind is worked out at that moment, from the share of the cycle that had passed,
so a run without power cuts pays nothing for the possibility.

Contents outlive the chip's supply, so they are an object of their own (`FlashImage`).
Sections and tables are those of the Micron M25P80 datasheet, 09005aef84566560 Rev. I.
"""

from __future__ import annotations

import random
from collections.abc import Callable

from firmware_model.power import OFF, Rail
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import from_seconds
from procboard.chips.m25p80_data import (
    CURRENTS_A,
    DEEP_POWER_DOWN,
    ERASE,
    KEPT,
    PREPROGRAM_SHARE,
    PROGRAM,
    RDID_BYTES,
    READ,
    RES_SIGNATURE,
    STANDBY,
    WRITE_INHIBIT_V,
    FlashGeometry,
    FlashImage,
    FlashTiming,
    Instruction,
    Status,
)

__all__ = ["M25P80", "FlashGeometry", "FlashImage", "FlashTiming"]


def _no_cycle(_span_fs: int) -> None:
    """Stand in where nobody watches."""


class M25P80:
    """The chip: an `SpiTarget` with a hold pin, a supply and contents that outlive it."""

    def __init__(
        self,
        scheduler: Scheduler,
        rail: Rail,
        rng: random.Random,
        image: FlashImage | None = None,
        geometry: FlashGeometry | None = None,
        timing: FlashTiming | None = None,
        name: str = "M25P80",
    ) -> None:
        self.geometry = geometry or FlashGeometry()
        self.image = image or FlashImage.blank(self.geometry)
        if len(self.image.memory) != self.geometry.size_bytes:
            raise ValueError(
                f"flash image of {len(self.image.memory)} bytes: "
                f"this chip has {self.geometry.size_bytes}"
            )
        if not self.image.erase_counts:
            self.image.erase_counts = [0] * self.geometry.sector_count
        self.programs = 0
        """Page program cycles started since the start of the emulation."""
        self.on_cycle: Callable[[int], None] = _no_cycle
        """Called with its length in fs when a program, erase or write-status cycle begins."""
        self._scheduler = scheduler
        self._rng = rng
        self._timing = timing or FlashTiming()
        self._consumer = rail.consumer(name, CURRENTS_A)
        self._memory = self.image.memory
        self._powered = False
        self._selected = False
        self._held = False
        self._wel = False
        self._deep = False
        self._ready_fs = 0  # when the chip answers again after power-up, DP or RES
        self._writable_fs = 0
        self._count = 0  # bytes since select
        self._instruction = -1  # -1: ignore what comes
        self._address = 0
        self._out = 0xFF
        self._page = bytearray(self.geometry.page_bytes)
        self._page_filled = 0
        self._cycle: Event | None = None
        self._cycle_instruction = Instruction.WRDI
        self._cycle_address = 0
        self._cycle_start_fs = 0
        self._cycle_span_fs = 1
        self._cycle_data = b""
        rail.volts.watch(self._supply)
        self._supply(rail.volts.value)

    # --- wires ------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """Whether a program, erase or write-status cycle is running (WIP)."""
        return self._cycle is not None

    @property
    def write_enabled(self) -> bool:
        """The write enable latch (WEL)."""
        return self._wel

    def hold(self, held: bool) -> None:
        """Drive the hold pin: while held the clock is not looked at and Q is not driven."""
        self._held = held

    def select(self, selected: bool) -> None:
        """Chip select fell (True) or rose (False)."""
        if not self._powered or selected == self._selected:
            self._selected = selected and self._powered
            return
        self._selected = selected
        if selected:
            self._count = 0
            self._instruction = -1
            self._out = 0xFF
            if self._cycle is None:
                self._consumer.enter(READ)
        else:
            if self._count and self._instruction >= 0:
                self._execute()
            if self._cycle is None:
                self._consumer.enter(DEEP_POWER_DOWN if self._deep else STANDBY)

    def begin(self) -> int:
        """First clock edge of a byte: return what Q shifts out; 0xFF where it floats."""
        return self._out if self._selected and not self._held else 0xFF

    def end(self, mosi: int) -> None:
        """Last clock edge of a byte: take what D shifted in."""
        if not self._selected or self._held:
            return
        count = self._count
        self._count = count + 1
        instruction = self._instruction
        if count == 0:
            self._begin_instruction(mosi)
        elif instruction < 0:
            return
        elif instruction == Instruction.READ:
            if count < 3:
                self._address = (self._address << 8) | mosi
            else:
                if count == 3:
                    self._address = ((self._address << 8) | mosi) % len(self._memory)
                address = self._address
                self._out = self._memory[address]
                self._address = address + 1 if address + 1 < len(self._memory) else 0
        elif instruction == Instruction.PP:
            if count <= 3:
                self._address = (self._address << 8) | mosi
            else:
                # Beyond a page the addresses wrap, so only the last page's worth is kept.
                offset = (self._address + self._page_filled) % len(self._page)
                self._page[offset] = mosi
                self._page_filled += 1
        else:
            self._other_byte(instruction, count, mosi)

    def exchange(self, mosi: bytes) -> bytes:
        """Exchange bytes at once, as `begin` and `end` for each of them would."""
        out = bytearray()
        for i, byte in enumerate(mosi):
            if self._count > 3 and self._selected and not self._held:
                if self._instruction == Instruction.READ:
                    return bytes(out + self._read_on(len(mosi) - i))
                if self._instruction == Instruction.PP:
                    return bytes(out + self._fill_page(mosi[i:]))
            out.append(self.begin())
            self.end(byte)
        return bytes(out)

    def _read_on(self, count: int) -> bytes:
        """Return the next bytes of a READ: the one in the shift register, then from the array."""
        memory, address = self._memory, self._address
        data = memory[address : address + count]
        while len(data) < count:  # on around the end
            data += memory[: count - len(data)]
        answer = bytes((self._out,)) + data[:-1]
        self._out = data[-1]
        self._address = (address + count) % len(memory)
        self._count += count
        return answer

    def _fill_page(self, data: bytes) -> bytes:
        """Take bytes of a PP into the page buffer."""
        size = len(self._page)
        position = 0
        while position < len(data):
            offset = (self._address + self._page_filled) % size
            chunk = data[position : position + size - offset]
            self._page[offset : offset + len(chunk)] = chunk
            self._page_filled += len(chunk)
            position += len(chunk)
        self._count += len(data)
        return b"\xff" * len(data)

    def _begin_instruction(self, code: int) -> None:
        now = self._scheduler.now
        if now < self._ready_fs or (self._deep and code != Instruction.RES):
            return
        if self._cycle is not None and code != Instruction.RDSR:
            return  # "all attempts to access the memory array during a cycle are ignored"
        self._instruction = code
        self._address = 0
        if code == Instruction.RDSR:
            self._out = self._status()
        elif code == Instruction.RDID:
            self._out = RDID_BYTES[0]
        elif code == Instruction.PP:
            self._page_filled = 0

    def _other_byte(self, instruction: int, count: int, mosi: int) -> None:
        """Take a byte of the instructions that are no bulk transfer."""
        if instruction == Instruction.RDSR:
            self._out = self._status()
        elif instruction == Instruction.FAST_READ:
            if count <= 3:
                self._address = (self._address << 8) | mosi
            if count >= 4:  # byte 4 is the dummy byte
                address = self._address % len(self._memory)
                self._out = self._memory[address]
                self._address = address + 1
        elif instruction == Instruction.SE:
            if count <= 3:
                self._address = (self._address << 8) | mosi
        elif instruction == Instruction.RES:
            if count >= 3:
                self._out = RES_SIGNATURE
        elif instruction == Instruction.RDID:
            # 16 bytes of CFI content, announced by their number, are all zero unless ordered so.
            tail = 0x10 if count == 3 else 0
            self._out = RDID_BYTES[count] if count < len(RDID_BYTES) else tail
        elif instruction == Instruction.WRSR:
            self._address = mosi

    def _status(self) -> int:
        value = self.image.status
        if self._cycle is not None:
            value |= Status.WIP
        if self._wel:
            value |= Status.WEL
        return value

    # --- instructions that run at the rising edge of chip select --------------------------

    def _execute(self) -> None:
        instruction, count = self._instruction, self._count
        now = self._scheduler.now
        if instruction in (Instruction.READ, Instruction.RDSR):
            return
        if instruction == Instruction.WREN:
            if count == 1 and now >= self._writable_fs:
                self._wel = True
        elif instruction == Instruction.WRDI:
            if count == 1:
                self._wel = False
        elif instruction == Instruction.DP:
            if count == 1:
                self._deep = True
                self._ready_fs = now + from_seconds(self._timing.deep_power_down_s)
        elif instruction == Instruction.RES:
            if self._deep:
                self._deep = False
                self._ready_fs = now + from_seconds(self._timing.release_s)
        elif self._wel:
            self._execute_write(instruction, count)

    def _execute_write(self, instruction: int, count: int) -> None:
        timing = self._timing
        if instruction == Instruction.PP and count > 4:
            if not self._protected(self._address):
                self._program()
        elif instruction == Instruction.SE and count == 4:
            if not self._protected(self._address):
                self._start(Instruction.SE, timing.sector_erase_s, ERASE)
        elif instruction == Instruction.BE and count == 1:
            if not self.image.status & Status.BP:
                self._start(Instruction.BE, timing.bulk_erase_s, ERASE)
        elif instruction == Instruction.WRSR and count == 2:
            self._start(Instruction.WRSR, timing.write_status_s, PROGRAM)

    def _protected(self, address: int) -> bool:
        """Table "Protected Area Sizes": BP = 1 protects the top 1/16, 2 the top 1/8 … 5 all."""
        level = (self.image.status & Status.BP) >> 2
        if not level:
            return False
        sectors = self.geometry.sector_count
        protected = min(sectors, max(1, sectors >> 4) << (level - 1))
        sector = address % len(self._memory) // self.geometry.sector_bytes
        return sector >= sectors - protected

    def _program(self) -> None:
        """Start a page program cycle of the bytes that came in, wrapped within the page."""
        size = len(self._page)
        filled = min(self._page_filled, size)
        last = (self._address + self._page_filled) % size
        first = (last - filled) % size
        page = bytearray(b"\xff" * size)
        for i in range(filled):
            offset = (first + i) % size
            page[offset] = self._page[offset]
        self._cycle_data = bytes(page)
        self.programs += 1
        # Table "AC Characteristics", note: n bytes take int(n/8) × 0.02 ms, at most the full cycle.
        span_s = self._timing.page_program_s * max(1, (filled + 7) // 8) / (size // 8)
        self._start(Instruction.PP, span_s, PROGRAM)

    def _start(self, instruction: Instruction, span_s: float, state: str) -> None:
        scheduler = self._scheduler
        self._cycle_instruction = instruction
        self._cycle_address = self._address  # RDSR during the cycle uses the other one
        self._cycle_start_fs = scheduler.now
        self._cycle_span_fs = max(1, from_seconds(span_s))
        self._consumer.enter(state)
        self._cycle = scheduler.after(self._cycle_span_fs, self._finish)
        self.on_cycle(self._cycle_span_fs)

    def _finish(self) -> None:
        """A cycle is complete: its effect is in the array, WIP and WEL are clear."""
        self._cycle = None
        self._wel = False
        instruction = self._cycle_instruction
        if instruction == Instruction.PP:
            self._clear_bits(self._cycle_data)
        elif instruction == Instruction.SE:
            self._erase(self._cycle_address % len(self._memory) // self.geometry.sector_bytes)
        elif instruction == Instruction.BE:
            for sector in range(self.geometry.sector_count):
                self._erase(sector)
        else:
            self.image.status = self._cycle_address & KEPT
        self._consumer.enter(READ if self._selected else STANDBY)

    def _clear_bits(self, page: bytes) -> None:
        """Programming only clears bits."""
        size = len(page)
        start = self._cycle_address % len(self._memory) // size * size
        old = int.from_bytes(self._memory[start : start + size], "little")
        new = old & int.from_bytes(page, "little")
        self._memory[start : start + size] = new.to_bytes(size, "little")

    def _erase(self, sector: int) -> None:
        size = self.geometry.sector_bytes
        self._memory[sector * size : (sector + 1) * size] = b"\xff" * size
        self.image.erase_counts[sector] += 1

    # --- supply -----------------------------------------------------------------------

    def _supply(self, volts: float) -> None:
        """Follow the supply: a chip below VWI is reset, whatever it was doing."""
        powered = volts >= WRITE_INHIBIT_V
        if powered == self._powered:
            return
        now = self._scheduler.now
        if powered:
            self._ready_fs = now + from_seconds(self._timing.power_up_select_s)
            self._writable_fs = now + from_seconds(self._timing.power_up_write_s)
            self._consumer.enter(STANDBY)
        else:
            if self._cycle is not None:
                self._scheduler.cancel(self._cycle)
                self._cycle = None
                self._interrupt_cycle((now - self._cycle_start_fs) / self._cycle_span_fs)
            self._consumer.enter(OFF)
        self._powered = powered
        self._selected = False
        self._wel = False  # "WEL is reset upon power-up"
        self._deep = False
        self._instruction = -1
        self._out = 0xFF

    def _interrupt_cycle(self, share: float) -> None:
        """Leave the array as a cycle leaves it of which only a share was done."""
        instruction = self._cycle_instruction
        if instruction == Instruction.PP:
            # Each bit to be cleared has been cleared with a probability that grows with time.
            size = len(self._cycle_data)
            missed = self._bits(size, 1.0 - share)
            self._clear_bits(
                (int.from_bytes(self._cycle_data, "little") | missed).to_bytes(size, "little")
            )
        elif instruction == Instruction.SE:
            self._erase_partly(
                self._cycle_address % len(self._memory) // self.geometry.sector_bytes, share
            )
        elif instruction == Instruction.BE:
            for sector in range(self.geometry.sector_count):
                self._erase_partly(sector, share)
        elif self._rng.random() < share:  # the few bits of WRSR: done or not
            self.image.status = self._cycle_address & KEPT

    def _erase_partly(self, sector: int, share: float) -> None:
        """First all bits go to zero, then all to one; the share says how far that came."""
        size = self.geometry.sector_bytes
        window = slice(sector * size, (sector + 1) * size)
        if share < PREPROGRAM_SHARE:
            kept = self._bits(size, 1.0 - share / PREPROGRAM_SHARE)
            value = int.from_bytes(self._memory[window], "little") & kept
        else:
            value = self._bits(size, (share - PREPROGRAM_SHARE) / (1.0 - PREPROGRAM_SHARE))
        self._memory[window] = value.to_bytes(size, "little")
        self.image.erase_counts[sector] += 1

    def _bits(self, size: int, probability: float) -> int:
        """Return random bits, each one with a probability given to a resolution of 1/256."""
        level = min(256, max(0, round(probability * 256)))
        if level == 256:
            return (1 << (8 * size)) - 1
        value = 0
        for bit in range(8):  # least significant first: OR raises, AND lowers the probability
            noise = self._rng.getrandbits(8 * size)
            value = value | noise if level >> bit & 1 else value & noise
        return value
