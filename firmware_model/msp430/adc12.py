"""ADC12 of the MSP430x15x/16x (SLAU049, chapter 17): sixteen memories, sequences, timer triggers.

A conversion is two events: when the sample-and-hold closes, the input's quantity is looked at; when
the conversion is over, the memory and its flag change. Times follow section 17.2.5: SHI is
synchronised to ADC12CLK, the sample period is that of SHTx, the conversion takes 13 cycles.

Not modelled: settling of the reference (17 ms) and errors of the converter (offset, gain, INL),
extended sample mode by a level of SHI (SHP = 0), and ADC12OSC's spread between devices.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.errors import FirmwareError
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.signals import Quantity, Signal, constant
from firmware_model.time import Clock

if TYPE_CHECKING:
    from firmware_model.interrupts import InterruptLine
    from firmware_model.msp430.clocks import BasicClock
    from firmware_model.msp430.dma import Trigger
    from firmware_model.power import Rail
    from firmware_model.scheduler import Event, Scheduler

# ADC12CTL0.
ADC12SC, ENC, ADC12TOVIE, ADC12OVIE = 0x0001, 0x0002, 0x0004, 0x0008
ADC12ON, REFON, REF2_5V, MSC = 0x0010, 0x0020, 0x0040, 0x0080
SHT0_SHIFT, SHT1_SHIFT = 8, 12
# ADC12CTL1.
ADC12BUSY, CONSEQ_SHIFT, SSEL_SHIFT, DIV_SHIFT = 0x0001, 1, 3, 5
ISSH, SHP, SHS_SHIFT, CSTART_SHIFT = 0x0100, 0x0200, 10, 12
# ADC12MCTLx.
EOS, SREF_SHIFT = 0x80, 4

_SAMPLE_CYCLES = (4, 8, 16, 32, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1024, 1024, 1024)
_CONVERSION_CYCLES = 13
_SYNC_CYCLES = 1
ADC12OSC_HZ = 5_000_000
"""SLAS368: 3.7…6.3 MHz; the middle."""
# SLAS368, "temperature sensor": V = 3.55 mV/°C × T + 986 mV.
TEMPERATURE_V_PER_C, TEMPERATURE_V_AT_0_C = 3.55e-3, 0.986
CHANNEL_TEMPERATURE, CHANNEL_SUPPLY = 10, 11

REGISTERS = (
    *(RegisterSpec(f"ADC12MCTL{n}", 0x0080 + n, 8) for n in range(16)),
    *(RegisterSpec(f"ADC12MEM{n}", 0x0140 + 2 * n) for n in range(16)),
    RegisterSpec("ADC12CTL0", 0x01A0),
    RegisterSpec("ADC12CTL1", 0x01A2, writable=0xFFFE),
    RegisterSpec("ADC12IFG", 0x01A4),
    RegisterSpec("ADC12IE", 0x01A6),
    RegisterSpec("ADC12IV", 0x01A8, writable=0),
)

# Fields of ADC12CTL0 and ADC12CTL1 that can change only while ENC = 0.
_LOCKED0, _LOCKED1 = 0xFFF0, 0xFFF8


class Adc12:
    """The converter. `inputs[n]` is the voltage at An; `celsius` the die's temperature."""

    def __init__(
        self,
        scheduler: Scheduler,
        clocks: BasicClock,
        rail: Rail,
        line: InterruptLine,
        triggers: list[Trigger | None],
        trigger_number: int,
    ) -> None:
        self.inputs: list[Quantity] = [constant(0.0)] * 8
        self.celsius: Quantity = constant(25.0)
        self.external_reference: Quantity = constant(0.0)
        """Voltage at VeREF+."""
        self._scheduler = scheduler
        self._clocks = clocks
        self._rail = rail
        self._line = line
        self._triggers, self._trigger_number = triggers, trigger_number
        self._oscillator = Clock(ADC12OSC_HZ)
        reads: dict[str, Callable[[], int]] = {
            "ADC12CTL1": self._read_ctl1,
            "ADC12IV": self._take_vector,
        }
        writes: dict[str, Callable[[int], None]] = {
            "ADC12CTL0": self._write_ctl0,
            "ADC12CTL1": self._write_ctl1,
            "ADC12IFG": lambda value: self._write_interrupts("ADC12IFG", value),
            "ADC12IE": lambda value: self._write_interrupts("ADC12IE", value),
        }
        for n in range(16):
            reads[f"ADC12MEM{n}"] = self._memory_reader(n)
            writes[f"ADC12MCTL{n}"] = self._control_writer(n)
        self.bank = RegisterBank(REGISTERS, on_read=reads, on_write=writes)
        self._ctl0, self._ctl1 = self.bank["ADC12CTL0"], self.bank["ADC12CTL1"]
        self._ifg, self._ie = self.bank["ADC12IFG"], self.bank["ADC12IE"]
        self._memories = tuple(self.bank[f"ADC12MEM{n}"] for n in range(16))
        self._controls = tuple(self.bank[f"ADC12MCTL{n}"] for n in range(16))
        self._event: Event | None = None
        self._index = 0
        self._code = 0
        self._due_tick = 0
        self._overflow = self._time_overflow = False

    def connect_timers(self, *outputs: Signal[bool]) -> None:
        """Wire SHI sources 1…3: TA.OUT1, TB.OUT0, TB.OUT1."""
        for number, output in enumerate(outputs, start=1):
            output.watch(self._shi_watcher(number))

    def reset(self, por: bool) -> None:
        """All bits are rw-(0): only a POR reaches the converter."""
        if por:
            self._scheduler.cancel(self._event)
            self._event = None
            self.bank.reset()
            self._overflow = self._time_overflow = False
        self._update_line()

    # --- converting -------------------------------------------------------------------

    def _clock(self) -> Clock:
        clocks = self._clocks
        sources = (self._oscillator, clocks.aclk, clocks.mclk, clocks.smclk)
        return sources[self._ctl1.value >> SSEL_SHIFT & 3]

    def _mode(self) -> int:
        return self._ctl1.value >> CONSEQ_SHIFT & 3

    def _shi_watcher(self, number: int) -> Callable[[bool], None]:
        def changed(level: bool) -> None:
            if level and self._ctl1.value >> SHS_SHIFT & 3 == number:
                self._trigger()

        return changed

    def _trigger(self) -> None:
        """Rising edge of SHI: start a conversion if the converter is enabled and waits."""
        if self._ctl0.value & (ENC | ADC12ON) != ENC | ADC12ON:
            return
        if self._event is not None:
            self._time_overflow = True  # SLAU049, 17.2.8: another sample was asked for too early
            self._update_line()
            return
        clock = self._clock()
        self._convert(clock.ticks(self._scheduler.now) + _SYNC_CYCLES)

    def _convert(self, start_tick: int) -> None:
        """Sample and convert the channel of the present memory from a tick of ADC12CLK on."""
        if not self._ctl1.value & SHP:
            raise FirmwareError("ADC12: extended sample mode (SHP = 0) is not modelled")
        divider = (self._ctl1.value >> DIV_SHIFT & 7) + 1
        shift = SHT0_SHIFT if self._index < 8 else SHT1_SHIFT
        sample = _SAMPLE_CYCLES[self._ctl0.value >> shift & 15] * divider
        clock = self._clock()
        self._due_tick = start_tick + sample + _CONVERSION_CYCLES * divider
        due = max(clock.edge(start_tick + sample), self._scheduler.now)
        self._event = self._scheduler.at(due, self._sampled)

    def _sampled(self) -> None:
        """Hold the input: from here on it takes 13 ADC12CLK cycles."""
        self._code = self._quantise(self._scheduler.now)
        due = max(self._clock().edge(self._due_tick), self._scheduler.now)
        self._event = self._scheduler.at(due, self._converted)

    def _volts(self, channel: int, time_fs: int) -> float:
        if channel < 8:
            return self.inputs[channel](time_fs)
        if channel == CHANNEL_TEMPERATURE:
            return TEMPERATURE_V_AT_0_C + TEMPERATURE_V_PER_C * self.celsius(time_fs)
        if channel in (8, 9):
            return self.external_reference(time_fs) if channel == 8 else 0.0
        return self._rail.volts.value / 2

    def _reference_volts(self, select: int, time_fs: int) -> float:
        """V(R+) by SREFx; V(R−) is AVSS or the grounded VeREF−."""
        if select & 3 == 0:
            return self._rail.volts.value
        if select & 3 == 1:
            if not self._ctl0.value & REFON:
                return 0.0
            return 2.5 if self._ctl0.value & REF2_5V else 1.5
        return self.external_reference(time_fs)

    def _quantise(self, time_fs: int) -> int:
        control = self._controls[self._index].value
        reference = self._reference_volts(control >> SREF_SHIFT & 7, time_fs)
        if reference <= 0.0:
            return 0xFFF
        # SLAU049, equation in 17.2.1: N = 4095 × (Vin − VR−) / (VR+ − VR−).
        code = round(4095 * self._volts(control & 15, time_fs) / reference)
        return min(max(code, 0), 0xFFF)

    def _converted(self) -> None:
        self._event = None
        index, bit = self._index, 1 << self._index
        if self._ifg.value & bit:
            self._overflow = True
        self._memories[index].value = self._code
        self._ifg.value |= bit
        mode = self._mode()
        last = not mode & 1 or bool(self._controls[index].value & EOS)
        self._index = self._start_index() if last else (index + 1) & 15
        repeat = mode & 2
        if not self._ctl0.value & ENC:
            going_on = mode == 1 and not last  # clearing ENC lets a single sequence finish
        else:
            going_on = not last or bool(repeat)
        if going_on and self._ctl0.value & MSC:
            self._convert(self._due_tick)
        # SLAU049, 8.2.4: the DMA trigger is the flag of a single conversion or of the last one.
        trigger = self._triggers[self._trigger_number]
        if last and trigger is not None and not self._ie.value & bit:
            self._ifg.value &= ~bit
            trigger()
        self._update_line()

    def _start_index(self) -> int:
        return self._ctl1.value >> CSTART_SHIFT

    # --- registers --------------------------------------------------------------------

    def _write_ctl0(self, value: int) -> None:
        before = self._ctl0.value
        if before & ENC:  # SLAU049: most fields can be changed only with ENC = 0
            value = before & _LOCKED0 | value & ~_LOCKED0
        self._ctl0.value = value & ~ADC12SC
        if value & ENC and not before & ENC:
            self._index = self._start_index()
        elif before & ENC and not value & ENC and self._mode() == 0 and not before & ADC12SC:
            # SLAU049, 17.2.7: a single conversion is stopped at once.
            self._scheduler.cancel(self._event)
            self._event = None
        if value & ADC12SC and not self._ctl1.value >> SHS_SHIFT & 3:
            self._trigger()
        self._update_line()

    def _write_ctl1(self, value: int) -> None:
        if self._ctl0.value & ENC:
            value = self._ctl1.value & _LOCKED1 | value & ~_LOCKED1
        self._ctl1.value = value

    def _read_ctl1(self) -> int:
        return self._ctl1.value & ~ADC12BUSY | (ADC12BUSY if self._event is not None else 0)

    def _control_writer(self, number: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            if not self._ctl0.value & ENC:
                self._controls[number].value = value

        return write

    def _memory_reader(self, number: int) -> Callable[[], int]:
        def read() -> int:
            if self._ifg.value >> number & 1:
                self._ifg.value &= ~(1 << number)  # reading ADC12MEMx clears its flag
                self._update_line()
            return self._memories[number].value

        return read

    def _write_interrupts(self, name: str, value: int) -> None:
        self.bank[name].value = value
        self._update_line()

    # --- interrupts -------------------------------------------------------------------

    def _vector(self) -> int:
        """Return ADC12IV: overflow 2, time overflow 4, then 6 + 2n for memory n."""
        if self._overflow and self._ctl0.value & ADC12OVIE:
            return 2
        if self._time_overflow and self._ctl0.value & ADC12TOVIE:
            return 4
        pending = self._ifg.value & self._ie.value
        return 4 + 2 * (pending & -pending).bit_length() if pending else 0

    def _take_vector(self) -> int:
        """Read ADC12IV: it clears the overflow flags; ADC12IFGx stay until the memory is read."""
        vector = self._vector()
        if vector == 2:
            self._overflow = False
        elif vector == 4:
            self._time_overflow = False
        self._update_line()
        return vector

    def _update_line(self) -> None:
        self._line.drive(self._vector() != 0)
