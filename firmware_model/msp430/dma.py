"""DMA controller of the MSP430x15x/16x (SLAU049, chapter 8): three channels between any addresses.

A peripheral whose flag rises looks into `triggers` at the number of its source and calls what it
finds: the transfer happens in that instant, without an event. When a channel is enabled, the kind
of its transfer is worked out once; the two that carry every SPI and UART block, register → RAM and
RAM → register a byte at a time, get a path of a few Python operations.

Time: a single transfer takes four MCLK cycles (table 8-3), about 1 µs, which is not modelled as
a delay; the two in which the CPU is held are charged to a running CPU. A block transfer moves its
data at once, holds the CPU for 2 × DMAxSZ cycles and sets DMAIFG when these are over.

Not modelled: the tie between channels that are triggered in the same instant (ROUNDROBIN decides
nothing, since transfers take no time), DMAONFETCH, and ENNMI.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.interrupts import InterruptLine
from firmware_model.registers import Register, RegisterBank, RegisterSpec

if TYPE_CHECKING:
    from firmware_model.cpu import Cpu
    from firmware_model.msp430.memory import Msp430AddressSpace
    from firmware_model.scheduler import Scheduler
    from firmware_model.time import Clock

# DMAxTSELx (SLAU049, DMACTL0; "triggers" in the data sheet).
DMAREQ_TRIGGER = 0
TACCR2_TRIGGER = 1
TBCCR2_TRIGGER = 2
URXIFG0_TRIGGER = 3
UTXIFG0_TRIGGER = 4
DAC12_TRIGGER = 5
ADC12_TRIGGER = 6
TACCR0_TRIGGER = 7
TBCCR0_TRIGGER = 8
URXIFG1_TRIGGER = 9
UTXIFG1_TRIGGER = 10
MULTIPLIER_TRIGGER = 11
CHAIN_TRIGGER = 14  # DMA0IFG → channel 1, DMA1IFG → 2, DMA2IFG → 0
EXTERNAL_TRIGGER = 15  # DMAE0

# DMAxCTL.
DMAREQ = 0x0001
DMAABORT = 0x0002
DMAIE = 0x0004
DMAIFG = 0x0008
DMAEN = 0x0010
DMALEVEL = 0x0020
DMASRCBYTE = 0x0040
DMADSTBYTE = 0x0080
DMASRCINCR_3 = 0x0300
DMADSTINCR_3 = 0x0C00
DMADT_SINGLE, DMADT_BLOCK, DMADT_BURST = 0x0000, 0x1000, 0x2000
DMADT_REPEATED = 0x4000

# SLAU049, section 8.2.3: the CPU is held for two MCLK cycles a transfer; in burst-block mode it
# runs for two cycles after every four transfers.
CYCLES_PER_TRANSFER = 2
_BURST = 4
_BURST_GAP_CYCLES = 2

_RAM_START, _RAM_END = 0x1100, 0x3900

REGISTERS = (
    RegisterSpec("DMACTL0", 0x0122, writable=0x0FFF),
    RegisterSpec("DMACTL1", 0x0124, writable=0x0007),
    *(
        RegisterSpec(f"DMA{n}{suffix}", 0x01E0 + 8 * n + offset)
        for n in range(3)
        for offset, suffix in ((0, "CTL"), (2, "SA"), (4, "DA"), (6, "SZ"))
    ),
)

_TIMER_TRIGGERS = (TACCR0_TRIGGER, TACCR2_TRIGGER, TBCCR0_TRIGGER, TBCCR2_TRIGGER)

Trigger = Callable[[], None]


class DmaChannel:
    """One channel: its four registers and its temporary copies of them."""

    __slots__ = (
        "_control",
        "_count",
        "_destination",
        "_dma",
        "_dst",
        "_dst_step",
        "_read",
        "_reload",
        "_size",
        "_source",
        "_src",
        "_src_step",
        "_write",
        "number",
        "on_touch",
        "selected",
        "step",
        "transfers",
    )

    def __init__(self, dma: DmaController, number: int) -> None:
        bank = dma.bank
        self.number = number
        self.selected = 0
        self.transfers = 0
        self.step: Trigger | None = None
        self.on_touch: Trigger | None = None
        """Called before anybody looks at a channel whose block a USART is streaming."""
        self._dma = dma
        self._control: Register = bank[f"DMA{number}CTL"]
        self._source: Register = bank[f"DMA{number}SA"]
        self._destination: Register = bank[f"DMA{number}DA"]
        self._size: Register = bank[f"DMA{number}SZ"]
        self._src = self._dst = self._src_step = self._dst_step = 0
        self._count = self._reload = 0
        self._read: Callable[[], int] = int
        self._write: Callable[[int], None] = _discard

    def read_size(self) -> int:
        """DMAxSZ counts down while the channel is enabled."""
        if self.on_touch is not None:
            self.on_touch()
        return self._count if self.step is not None else self._size.value

    def write_control(self, value: int) -> None:
        """Enable, disable, request or abort; DMAREQ reads back as 0."""
        if self.on_touch is not None:
            self.on_touch()
        before = self._control.value
        self._control.value = value & ~DMAREQ
        if value & DMAEN:
            if not before & DMAEN or self.step is None:
                self._enable(value)
        elif before & DMAEN:
            self._size.value = self._count
            self.disable()
        self._dma.update_line()
        if value & DMAREQ and self.selected == DMAREQ_TRIGGER and self.step is not None:
            self.step()

    # --- streams: a USART moves the block itself ----------------------------------------

    def streams_in(self, register: Register) -> bool:
        """Return whether each trigger moves a byte of `register` to the next address of RAM."""
        return (
            self.step == self._register_to_ram
            and self._dst_step == 1
            and self._source.value == register.address
        )

    def streams_out(self, register: Register) -> bool:
        """Return whether each trigger moves a byte from the next address of RAM to `register`.

        A channel that interrupts is left alone: its interrupt is due a byte before the end.
        """
        return (
            self.step == self._ram_to_register
            and self._src_step == 1
            and self._destination.value == register.address
            and not self._control.value & DMAIE
        )

    @property
    def left(self) -> int:
        """Transfers to go."""
        return self._count

    @property
    def place(self) -> int:
        """Address in RAM of the next transfer."""
        return self._src if self._dst_step == 0 else self._dst

    @property
    def hold(self) -> Callable[[int], None]:
        """What takes bus cycles from the CPU."""
        return self._dma.cpu.hold

    def moved(self, count: int) -> None:
        """Note that `count` bytes were moved; the last one finishes the channel."""
        self._count -= count
        if not self._count:
            self._finish()
        elif self._dst_step:
            self._dst += count
        else:
            self._src += count

    def disable(self) -> None:
        """Listen to no trigger any more."""
        self.step = None
        self._dma.route()

    def _enable(self, control: int) -> None:
        self._reload = self._count = self._size.value
        self._load_addresses()
        if not self._count:  # SLAU049: with DMAxSZ = 0 nothing is transferred
            self.step = None
        elif control >> 12 & 3:
            self.step = self._block
        else:
            self.step = self._select_step(control)
        self._dma.route()

    def _load_addresses(self) -> None:
        control = self._control.value
        self._src, self._dst = self._source.value, self._destination.value
        width = 1 if control & DMASRCBYTE else 2
        self._src_step = (0, 0, -width, width)[control >> 8 & 3]
        width = 1 if control & DMADSTBYTE else 2
        self._dst_step = (0, 0, -width, width)[control >> 10 & 3]

    def _select_step(self, control: int) -> Trigger:
        """Choose the path for single transfers: what can be known now is looked up now."""
        space = self._dma.space
        both_bytes = control & (DMASRCBYTE | DMADSTBYTE) == DMASRCBYTE | DMADSTBYTE
        if both_bytes and self._src < 0x100 and self._src_step == 0:
            # register → RAM; the block must lie inside RAM, so that no step needs to check.
            if self._fits_ram(self._dst, self._dst_step):
                source = space.at(self._src)
                self._read = source.read if source.on_read is None else source.on_read
                return self._register_to_ram
        elif (
            both_bytes
            and self._dst < 0x100
            and self._dst_step == 0
            and self._fits_ram(self._src, self._src_step)
        ):
            register = space.at(self._dst)
            self._write = register.write if register.on_write is None else register.on_write
            return self._ram_to_register
        return self._any_to_any

    def _fits_ram(self, start: int, step: int) -> bool:
        last = start + step * (self._count - 1)
        return min(start, last) >= _RAM_START and max(start, last) < _RAM_END

    def _register_to_ram(self) -> None:
        self._dma.cpu.hold(CYCLES_PER_TRANSFER)
        self._dma.space.memory[self._dst] = self._read()
        self._dst += self._dst_step
        self._count -= 1
        if not self._count:
            self._finish()

    def _ram_to_register(self) -> None:
        self._dma.cpu.hold(CYCLES_PER_TRANSFER)
        # Count first: the write may start a transfer that triggers this channel again.
        byte = self._dma.space.memory[self._src]
        self._src += self._src_step
        self._count -= 1
        if not self._count:
            self._finish()
        self._write(byte)

    def _any_to_any(self) -> None:
        self._dma.cpu.hold(CYCLES_PER_TRANSFER)
        count = self._count - 1
        self._count = count
        self._move()
        if not count:
            self._finish()

    def _move(self) -> None:
        space = self._dma.space
        control = self._control.value
        # SLAU049, section 8.2.1: byte → word clears the high byte; word → byte drops it.
        value = space.read8(self._src) if control & DMASRCBYTE else space.read16(self._src)
        source, destination = self._src, self._dst
        self._src = (source + self._src_step) & 0xFFFF
        self._dst = (destination + self._dst_step) & 0xFFFF
        if control & DMADSTBYTE:
            space.write8(destination, value & 0xFF)
        else:
            space.write16(destination, value)

    def _block(self) -> None:
        """Move a whole block; DMAIFG follows when its cycles are over."""
        count, self._count = self._count, 0
        if not count:
            return  # the block before is still under way
        cycles = CYCLES_PER_TRANSFER * count
        self._dma.cpu.hold(cycles)
        if self._control.value & 0x2000:
            cycles += _BURST_GAP_CYCLES * (count // _BURST)
        for _ in range(count):
            self._move()
        self._dma.later(cycles, self._block_over)

    def _block_over(self) -> None:
        if self.step is not None:
            self._finish()

    def _finish(self) -> None:
        """Reload, set DMAIFG, and disable the channel unless it repeats."""
        control = self._control
        self.transfers += 1
        self._count = self._reload
        self._size.value = self._reload
        self._load_addresses()
        if control.value & DMADT_REPEATED:
            control.value |= DMAIFG
            if control.value & 0x2000:  # SLAU049, 8.2.2: repeated burst-block goes on by itself
                self._dma.later(_BURST_GAP_CYCLES, self._block)
        else:
            control.value = control.value & ~DMAEN | DMAIFG
            self.disable()
        self._dma.update_line()
        chained = self._dma.chain[(self.number + 1) % 3]
        if chained is not None:
            chained()


def _discard(_value: int) -> None:
    """Stand for the destination of a channel that was never enabled."""


class DmaController:
    """DMACTL0, DMACTL1 and the channels.

    `triggers[n]` is what to call when source n rises, or None. `space`, `cpu` and `clock` are set
    by the MCU once they exist.
    """

    def __init__(self, scheduler: Scheduler, line: InterruptLine) -> None:
        self.triggers: list[Trigger | None] = [None] * 16
        self.chain: list[Trigger | None] = [None] * 3
        self.space: Msp430AddressSpace
        self.cpu: Cpu
        self.clock: Clock
        self._scheduler = scheduler
        self._line = line
        self._channels: tuple[DmaChannel, ...] = ()
        self._listeners: tuple[Trigger, ...] = ()
        writes: dict[str, Callable[[int], None]] = {"DMACTL0": self._select}
        reads: dict[str, Callable[[], int]] = {}
        for n in range(3):
            writes[f"DMA{n}CTL"] = self._writer(n)
            reads[f"DMA{n}SZ"] = self._reader(n)
        self.bank = RegisterBank(REGISTERS, on_read=reads, on_write=writes)
        self._channels = tuple(DmaChannel(self, n) for n in range(3))
        self._controls = tuple(self.bank[f"DMA{n}CTL"] for n in range(3))

    @property
    def channels(self) -> tuple[DmaChannel, ...]:
        """The three channels."""
        return self._channels

    def watch_timers(self, listener: Trigger) -> None:
        """Call `listener` when channels begin or cease to wait for a timer."""
        self._listeners = (*self._listeners, listener)

    def external_trigger(self, level: bool) -> None:
        """Take the level of DMAE0; its rising edge is the trigger."""
        trigger = self.triggers[EXTERNAL_TRIGGER]
        if level and trigger is not None:
            trigger()

    def reset(self, por: bool) -> None:
        """Only a POR reaches the DMA: all of its bits are rw-(0)."""
        if por:
            for channel in self._channels:
                if channel.on_touch is not None:
                    channel.on_touch()
            self.bank.reset()
            for channel in self._channels:
                channel.step = None
                channel.selected = 0
            self.route()
        self.update_line()

    def route(self) -> None:
        """Work out anew who listens to which trigger."""
        triggers: list[Trigger | None] = [None] * 16
        chain: list[Trigger | None] = [None] * 3
        for channel in self._channels:
            step = channel.step
            if step is None or channel.selected == DMAREQ_TRIGGER:
                continue
            if channel.selected == CHAIN_TRIGGER:
                chain[channel.number] = step
                continue
            other = triggers[channel.selected]
            triggers[channel.selected] = step if other is None else _both(other, step)
        timers_before = [self.triggers[n] is not None for n in _TIMER_TRIGGERS]
        self.triggers[:] = triggers
        self.chain = chain
        if timers_before != [triggers[n] is not None for n in _TIMER_TRIGGERS]:
            for listener in self._listeners:
                listener()

    def update_line(self) -> None:
        """Drive the interrupt line: some DMAIFG with its DMAIE."""
        self._line.drive(any(c.value & (DMAIE | DMAIFG) == DMAIE | DMAIFG for c in self._controls))

    def later(self, cycles: int, action: Trigger) -> None:
        """Do something when as many MCLK cycles are over."""
        self._scheduler.after(self.clock.span(cycles), action)

    def _select(self, value: int) -> None:
        self.bank["DMACTL0"].value = value
        for channel in self._channels:
            channel.selected = value >> 4 * channel.number & 15
        self.route()

    def _writer(self, number: int) -> Callable[[int], None]:
        return lambda value: self._channels[number].write_control(value)

    def _reader(self, number: int) -> Callable[[], int]:
        return lambda: self._channels[number].read_size()


def _both(first: Trigger, second: Trigger) -> Trigger:
    def trigger() -> None:
        first()
        second()

    return trigger
