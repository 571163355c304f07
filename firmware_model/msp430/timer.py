"""Timer_A3 and Timer_B7 (SLAU049, chapters 11 and 12): counters that nobody ticks.

A timer counts ticks of its clock since a reference; the counter's value is computed from that when
somebody looks. Flags are lazy too: between two looks a compare has happened if its count lies
between them, so `_sync` sets CCIFG (and `_sync_overflow` TAIFG) when somebody could notice. Events
exist only for what must act at its time: an enabled interrupt, a DMA trigger, an output unit.

Position: `p` is the number of timer clocks since the reference. Up mode repeats after CCR0 + 1
positions, continuous mode after 2^16 (Timer_B: CNTLx), up/down mode after 2 CCR0; the counter's
value is a function of p modulo that, and so are the moments when it equals a compare value.

Output units act at CCRx and, for EQU0, where the counter rolls to zero: in up mode reset/set gives
a duty of CCRx / (CCR0 + 1), as in TI's examples. Not modelled: the compare-latch groups and
load modes of Timer_B (TBCLGRPx, CLLDx; TBCLx loads at once), external clocks TACLK, INCLK, TBCLK.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.errors import FirmwareError
from firmware_model.msp430.clocks import FOREVER_FS, GatedClock
from firmware_model.msp430.timer_block import (
    CAP,
    CCI,
    CCIE,
    CCIFG,
    CCIS_SHIFT,
    CM_SHIFT,
    COV,
    MC_CONTINUOUS,
    MC_STOP,
    MC_UP,
    MC_UPDOWN,
    OUT,
    OUTMOD,
    OUTMOD_SHIFT,
    SSEL_ACLK,
    SSEL_SMCLK,
    TCLR,
    TIE,
    TIFG,
    TIMER_B_LENGTHS,
    CaptureCompare,
    timer_registers,
)
from firmware_model.registers import RegisterBank
from firmware_model.scheduler import Event
from firmware_model.signals import Signal

if TYPE_CHECKING:
    from firmware_model.interrupts import InterruptLine
    from firmware_model.msp430.dma import Trigger
    from firmware_model.scheduler import Scheduler


class Timer:
    """One timer. `outputs[n]` are the output units, `capture_input` wires CCIxA and CCIxB."""

    def __init__(
        self,
        letter: str,
        channels: int,
        scheduler: Scheduler,
        aclk: GatedClock,
        smclk: GatedClock,
        line0: InterruptLine,
        line1: InterruptLine,
        triggers: list[Trigger | None],
        trigger_numbers: dict[int, int],
    ) -> None:
        self.name = f"T{letter}"
        self._scheduler = scheduler
        self._aclk, self._smclk = aclk, smclk
        self._clock = smclk
        self._line0, self._line1 = line0, line1
        self._triggers = triggers
        self._is_b = letter == "B"
        reads: dict[str, Callable[[], int]] = {
            f"{self.name}R": self.counter,
            f"{self.name}CTL": self._read_ctl,
            f"{self.name}IV": self._take_vector,
        }
        writes: dict[str, Callable[[int], None]] = {
            f"{self.name}R": self._write_counter,
            f"{self.name}CTL": self._write_ctl,
            f"{self.name}IV": lambda _value: self._clear_vector(),
        }
        for n in range(channels):
            reads[f"{self.name}CCTL{n}"] = self._cctl_reader(n)
            reads[f"{self.name}CCR{n}"] = self._ccr_reader(n)
            writes[f"{self.name}CCTL{n}"] = self._cctl_writer(n)
            writes[f"{self.name}CCR{n}"] = self._ccr_writer(n)
        self.bank = RegisterBank(timer_registers(letter, channels), on_read=reads, on_write=writes)
        self._ctl = self.bank[f"{self.name}CTL"]
        self._channels = tuple(
            CaptureCompare(self.name, n, self.bank, self._channel_due) for n in range(channels)
        )
        for n, number in trigger_numbers.items():
            self._channels[n].trigger_number = number
        self.outputs = tuple(channel.output for channel in self._channels)
        self._mode = 0
        self._divider = 1
        self._period = 1 << 16
        self._reference = 0  # tick of the clock at which the position was `_offset`
        self._offset = 0
        self._held = 0  # counter while stopped
        self._down = False
        self._seen = 0  # position up to which TAIFG is set
        self._running = False
        self._overflow_event: Event | None = None
        line0.on_accept = self._accept0
        for clock in (aclk, smclk):
            clock.watch(self._clock_changed)

    # --- wiring -----------------------------------------------------------------------

    def capture_input(self, channel: int, letter: str, source: Signal[bool] | GatedClock) -> None:
        """Wire CCIxA or CCIxB to a pin's signal or to a clock."""
        block, index = self._channels[channel], "AB".index(letter)
        block.inputs[index] = source
        if isinstance(source, Signal):
            source.watch(lambda level: self._input_changed(block, index, level))

    # --- counting ---------------------------------------------------------------------

    def _position(self) -> int:
        """Return the number of timer clocks since the reference."""
        ticks = self._clock.ticks(self._scheduler.now) - self._reference
        return self._offset + ticks // self._divider

    def _value_at(self, position: int) -> int:
        phase = position % self._period
        if self._mode == MC_UPDOWN:
            top = self._period // 2
            return phase if phase <= top else self._period - phase
        return phase

    def counter(self) -> int:
        """Return the counter as an instruction reads it."""
        return self._value_at(self._position()) if self._running else self._held

    def _time_of(self, position: int) -> int:
        return self._clock.edge(self._reference + (position - self._offset) * self._divider)

    def _hold(self) -> None:
        """Note flags and counter before anything about the counting changes."""
        if self._running:
            self._sync_all()
            position = self._position()
            self._held = self._value_at(position)
            self._down = self._mode == MC_UPDOWN and position % self._period > self._period // 2

    def _resume(self) -> None:
        """Count on from the held value under the present registers."""
        control = self._ctl.value
        self._mode = control & 0x0030
        select = control & 0x0300
        clock = self._aclk if select == SSEL_ACLK else self._smclk
        top = self._channels[0].ccr.value
        if self._mode == MC_UP:
            period = top + 1
        elif self._mode == MC_UPDOWN:
            period = 2 * top
        else:
            period = TIMER_B_LENGTHS[control >> 11 & 3] if self._is_b else 1 << 16
        # CCR0 = 0 stops up and up/down mode (SLAU049, section 11.2.3).
        running = self._mode != MC_STOP and (self._mode == MC_CONTINUOUS or top > 0)
        if running and select not in (SSEL_ACLK, SSEL_SMCLK):
            raise FirmwareError(f"{self.name}: external timer clocks are not modelled")
        if self._running:
            self._clock.users -= 1
        if running:
            clock.users += 1
        changed = clock is not self._clock or not self._running
        divider = 1 << (control >> 6 & 3)
        now_ticks = clock.ticks(self._scheduler.now)
        if changed or divider != self._divider:
            self._reference = now_ticks
        else:  # keep the phase of the input divider
            self._reference += (now_ticks - self._reference) // divider * divider
        self._clock, self._divider, self._period = clock, divider, period
        self._running = running
        if running:
            value = self._held
            if self._mode == MC_UPDOWN and self._down and 0 < value <= top:
                value = period - value
            elif self._mode == MC_UP and value > top:
                value = 0  # SLAU049, 11.2.3: it rolls to zero
            elif self._mode == MC_UPDOWN and value > top:
                value = top  # it begins to count down
            self._offset = self._seen = value % period
            for channel in self._channels:
                channel.seen = self._offset
        self._schedule_all()

    # --- lazy flags -------------------------------------------------------------------

    def _distance(self, compare: int, position: int) -> int:
        """Return how many timer clocks after `position` the counter next reaches a value.

        0 stands for never: compare values beyond the period.
        """
        period = self._period
        if self._mode != MC_UPDOWN:
            return 0 if compare >= period else (compare - position) % period or period
        if compare > period // 2:
            return 0
        rising, falling = (compare - position) % period, (-compare - position) % period
        return min(rising or period, falling or period)

    def _sync_all(self) -> None:
        for channel in self._channels:
            self._sync(channel)
        self._sync_overflow()

    def _sync(self, channel: CaptureCompare) -> None:
        """Set CCIFG if the counter has reached CCRx since the last look."""
        value = channel.cctl.value
        if value & CAP:
            self._sync_capture(channel)
        elif self._running:
            position = self._position()
            if not value & CCIFG:
                distance = self._distance(channel.ccr.value, channel.seen)
                if 0 < distance <= position - channel.seen:
                    channel.cctl.value = value | CCIFG
            channel.seen = position

    def _sync_overflow(self) -> None:
        """Set TAIFG if the counter has rolled over since the last look."""
        if self._running:
            position = self._position()
            if position // self._period > self._seen // self._period:
                self._ctl.value |= TIFG
            self._seen = position

    def _sync_capture(self, channel: CaptureCompare) -> None:
        """Catch up with the edges of a captured clock."""
        source = self._captured_clock(channel)
        if source is None:
            return
        # A clock's rising edges are its ticks; falling ones are not told apart.
        ticks = source.ticks(self._scheduler.now)
        fresh = ticks - channel.seen_ticks
        if fresh <= 0:
            return
        channel.seen_ticks = ticks
        if channel.cctl.value & CCIFG or fresh > 1:
            channel.cctl.value |= COV
        channel.cctl.value |= CCIFG
        channel.ccr.value = self._counter_at(source.edge(ticks))

    def _counter_at(self, time_fs: int) -> int:
        if not self._running:
            return self._held
        ticks = self._clock.ticks(time_fs) - self._reference
        return self._value_at(self._offset + ticks // self._divider)

    def _captured_clock(self, channel: CaptureCompare) -> GatedClock | None:
        value = channel.cctl.value
        if value & CAP and value >> CM_SHIFT and not value & 0x2000:
            source = channel.inputs[value >> CCIS_SHIFT & 1]
            if isinstance(source, GatedClock):
                return source
        return None

    # --- events -----------------------------------------------------------------------

    def _trigger_of(self, channel: CaptureCompare) -> Trigger | None:
        return None if channel.trigger_number is None else self._triggers[channel.trigger_number]

    def _schedule_all(self) -> None:
        for channel in self._channels:
            self._schedule(channel)
        self._schedule_overflow()

    def _schedule(self, channel: CaptureCompare) -> None:
        """Arm the next moment at which a channel must act, if there is one."""
        if channel.event is not None:
            self._scheduler.cancel(channel.event)
            channel.event = None
        value = channel.cctl.value
        if not value & (CCIE if value & CAP else CCIE | OUTMOD) and not self._trigger_of(channel):
            return
        if not value & CAP:
            if not self._running:
                return
            position = self._position()
            distance = self._distance(channel.ccr.value, position)
            if not distance:
                return
            channel.match = match = position + distance
            due = self._time_of(match)
        else:
            source = self._captured_clock(channel)
            if source is None:
                return
            due = source.edge(channel.seen_ticks + 1)
        if due < FOREVER_FS:
            now = self._scheduler.now
            channel.event = self._scheduler.at(max(now, due), channel.fire)

    def _schedule_overflow(self) -> None:
        if self._overflow_event is not None:
            self._scheduler.cancel(self._overflow_event)
            self._overflow_event = None
        if self._running and (self._ctl.value & TIE or self._needs_equ0()):
            position = self._position()
            due = self._time_of(position + self._distance(0, position))
            if due < FOREVER_FS:
                self._overflow_event = self._scheduler.at(due, self._overflow_due)

    def _needs_equ0(self) -> bool:
        """Whether some output unit has a mode with an action at EQU0."""
        return any(
            not c.cctl.value & CAP and c.cctl.value >> OUTMOD_SHIFT & 7 in (2, 3, 6, 7)
            for c in self._channels
        )

    def _channel_due(self, channel: CaptureCompare) -> None:
        channel.event = None
        value = channel.cctl.value
        if value & CAP:
            self._sync_capture(channel)
        else:
            channel.seen = channel.match
            channel.cctl.value = value | CCIFG
            if value & OUTMOD:
                channel.act(0)
        self._flag_rose(channel)
        self._schedule(channel)

    def _overflow_due(self) -> None:
        self._overflow_event = None
        self._seen = self._position()
        self._ctl.value |= TIFG
        for channel in self._channels:
            if channel.cctl.value & OUTMOD and not channel.cctl.value & CAP:
                channel.act(1)
        self._update_line1()
        self._schedule_overflow()

    def _flag_rose(self, channel: CaptureCompare) -> None:
        """Give the rising CCIFG to the interrupt, or to DMA, which clears it."""
        trigger = self._trigger_of(channel)
        if channel.cctl.value & CCIE:
            if channel.number == 0:
                self._line0.request()
            else:
                self._line1.request()
        elif trigger is not None:
            channel.cctl.value &= ~CCIFG
            trigger()

    def _input_changed(self, channel: CaptureCompare, index: int, level: bool) -> None:
        value = channel.cctl.value
        if value & CAP and not value & 0x2000 and value >> CCIS_SHIFT & 1 == index:
            self._capture(channel, level)

    def _capture(self, channel: CaptureCompare, level: bool) -> None:
        """Capture if the edge is one of those that CMx selects."""
        cctl = channel.cctl
        edges = cctl.value >> CM_SHIFT
        if not edges & (1 if level else 2):
            return
        if cctl.value & CCIFG:
            cctl.value |= COV
        cctl.value |= CCIFG
        channel.ccr.value = self.counter()
        self._flag_rose(channel)

    # --- registers --------------------------------------------------------------------

    def _read_ctl(self) -> int:
        self._sync_overflow()
        return self._ctl.value

    def _write_ctl(self, value: int) -> None:
        self._hold()
        if value & TCLR:
            self._held, self._down = 0, False
            if self._running:
                self._running = False
                self._clock.users -= 1
        self._ctl.value = value & ~TCLR
        self._resume()
        self._update_line1()

    def _write_counter(self, value: int) -> None:
        self._hold()
        self._held, self._down = value, False
        self._resume()

    def _level_of(self, channel: CaptureCompare) -> bool:
        select = channel.cctl.value >> CCIS_SHIFT & 3
        if select >= 2:
            return select == 3
        source = channel.inputs[select]
        return isinstance(source, Signal) and source.value

    def _cctl_reader(self, number: int) -> Callable[[], int]:
        def read() -> int:
            channel = self._channels[number]
            self._sync(channel)
            return channel.cctl.value & ~CCI | (CCI if self._level_of(channel) else 0)

        return read

    def _cctl_writer(self, number: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            channel = self._channels[number]
            self._sync(channel)
            before, level = channel.cctl.value, self._level_of(channel)
            channel.cctl.value = value & ~CCI
            if not value >> OUTMOD_SHIFT & 7:
                channel.output.set(bool(value & OUT))
            source = self._captured_clock(channel)
            if source is not None and (before ^ value) & (CAP | 0xF000):
                channel.seen_ticks = source.ticks(self._scheduler.now)
            if value & CAP and before & CAP and self._level_of(channel) != level:
                self._capture(channel, not level)  # software capture: CCIS between GND and VCC
            self._update_line(channel)
            self._schedule(channel)
            if (before ^ value) & OUTMOD:
                self._schedule_overflow()

        return write

    def _ccr_reader(self, number: int) -> Callable[[], int]:
        def read() -> int:
            channel = self._channels[number]
            if channel.cctl.value & CAP:
                self._sync_capture(channel)
            return channel.ccr.value

        return read

    def _ccr_writer(self, number: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            channel = self._channels[number]
            if number == 0 and self._mode in (MC_UP, MC_UPDOWN):
                self._hold()
                channel.ccr.value = value
                self._resume()
                return
            self._sync(channel)
            channel.ccr.value = value
            self._schedule(channel)

        return write

    # --- interrupts -------------------------------------------------------------------

    def _accept0(self) -> None:
        """Clear the flag, as taking the CCR0 interrupt does."""
        self._channels[0].cctl.value &= ~CCIFG
        self._line0.clear()

    def _update_line(self, channel: CaptureCompare) -> None:
        if channel.number == 0:
            self._line0.drive(channel.cctl.value & (CCIE | CCIFG) == CCIE | CCIFG)
        else:
            self._update_line1()

    def _update_line1(self) -> None:
        self._line1.drive(self._vector() != 0)

    def _vector(self) -> int:
        """Return the highest pending source: 2n for CCRn, then the overflow."""
        for channel in self._channels[1:]:
            if channel.cctl.value & (CCIE | CCIFG) == CCIE | CCIFG:
                return 2 * channel.number
        if self._ctl.value & (TIE | TIFG) == TIE | TIFG:
            return 14 if self._is_b else 10
        return 0

    def _take_vector(self) -> int:
        """Read TAIV or TBIV: it gives the highest pending source and clears its flag.

        Only enabled sources count, and these have events, so there is nothing to catch up with.
        """
        vector = self._vector()
        self._clear(vector)
        return vector

    def _clear_vector(self) -> None:
        self._clear(self._vector())

    def _clear(self, vector: int) -> None:
        if not vector:
            return
        if vector == (14 if self._is_b else 10):
            self._ctl.value &= ~TIFG
        else:
            self._channels[vector // 2].cctl.value &= ~CCIFG
        self._update_line1()

    # --- clocks and resets ------------------------------------------------------------

    def triggers_changed(self) -> None:
        """Look again at which compares somebody waits for: the DMA was set up anew."""
        for channel in self._channels:
            if channel.trigger_number is not None:
                self._sync(channel)
                self._schedule(channel)

    def _clock_changed(self) -> None:
        if self._running or any(c.event is not None for c in self._channels):
            self._schedule_all()

    def reset(self, por: bool) -> None:
        """All bits are rw-(0): only a POR stops a timer; a PUC leaves it counting."""
        if por:
            if self._running:
                self._running = False
                self._clock.users -= 1
            self.bank.reset()
            self._held, self._down, self._mode = 0, False, 0
            for channel in self._channels:
                channel.output.set(False)
            self._schedule_all()
        for channel in self._channels:
            self._update_line(channel)
