"""The 12-bit ADC: scans of inputs, one event a scan.

Three ways to end sampling are modelled (DS70046, section 18): by firmware (SSRC 000), by Timer3
(SSRC 010) and automatically after SAMC TAD (SSRC 111). In the automatic mode with ASAM set, the
SMPI + 1 conversions of a scan follow each other without a gap; the model looks at all their inputs
at the scan's end and puts the results into ADCBUF0… at once. A scan of eight inputs takes 0.2 ms,
in which what a fish's instruments measure moves by less than one count. In the other two modes each
input is looked at when its sampling ends.
"""

from __future__ import annotations

from firmware_model.dspic30f.errors import LimitError, UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Quantity, Signal, constant
from firmware_model.time import FS_PER_NS, Clock

ADON = 1 << 15
ASAM = 1 << 2
SAMP = 1 << 1
DONE = 1 << 0
SSRC_MANUAL, SSRC_TIMER3, SSRC_AUTO = 0, 2, 7
CSCNA = 1 << 10
BUFM_ALTS = 3
ADRC = 1 << 7

CHANNELS = 16
FULL_SCALE = 4096
CONVERSION_TAD = 14  # DS70143, table 23-40, parameter AD55
MIN_TAD_FS = 667 * FS_PER_NS  # the 100 ksps figure; later revisions allow 334 ns

# DS70143, table 19-2 (ADC register map).
ADC_REGISTERS = (
    *(RegisterSpec(f"ADCBUF{i:X}", 0x0280 + 2 * i, writable=0) for i in range(16)),
    RegisterSpec("ADCON1", 0x02A0, writable=0xA3E7),
    RegisterSpec("ADCON2", 0x02A2, writable=0xE43F),
    RegisterSpec("ADCON3", 0x02A4, writable=0x1FBF),
    RegisterSpec("ADCHS", 0x02A6, writable=0x1F1F),
    RegisterSpec("ADPCFG", 0x02A8),
    RegisterSpec("ADCSSL", 0x02AA),
)


class Adc:
    """The converter with its sixteen inputs; the reference is the analog supply (VCFG = 000)."""

    def __init__(
        self, scheduler: Scheduler, clock: Clock, line: InterruptLine, reference_v: Signal[float]
    ) -> None:
        self.bank = RegisterBank(
            ADC_REGISTERS,
            on_write={"ADCON1": self._write_control, "ADCON2": self._write_scan_control},
        )
        self._scheduler = scheduler
        self._clock = clock
        self._line = line
        self._reference_v = reference_v
        self._inputs: list[Quantity] = [constant(0.0)] * CHANNELS
        self._results = [self.bank[f"ADCBUF{i:X}"] for i in range(16)]
        self._con1 = self.bank["ADCON1"]
        self._con2 = self.bank["ADCON2"]
        self._con3 = self.bank["ADCON3"]
        self._select = self.bank["ADCHS"]
        self._scan = self.bank["ADCSSL"]
        self._event: Event | None = None
        self._filled = 0  # results since the last interrupt
        self._position = 0  # next input of the scan
        self._scan_mask = 0
        self._scan_channels: tuple[int, ...] = (0,)

    def connect(self, channel: int, volts: Quantity) -> None:
        """Wire a voltage to ANx."""
        self._inputs[channel] = volts

    def reset(self) -> None:
        """Stop; results are lost."""
        self._scheduler.cancel(self._event)
        self._event = None
        self._filled = self._position = 0
        self.bank.reset()

    @property
    def tad_fs(self) -> int:
        """The conversion clock's period: TCY (ADCS + 1) / 2 (DS70046, equation 18-1)."""
        return self._clock.span((self._con3.value & 0x3F) + 1) // 2

    def timer3_match(self) -> None:
        """Timer3 ended sampling (SSRC 010)."""
        control = self._con1.value
        if control & ADON and control >> 5 & 7 == SSRC_TIMER3 and control & (ASAM | SAMP):
            self._convert_one()

    # --- control ---------------------------------------------------------------------

    def _write_scan_control(self, value: int) -> None:
        if value & BUFM_ALTS or value >> 13:
            raise UnsupportedModeError("ADC: split buffers, alternate inputs and VREF± left out")
        self._con2.value = value
        self._filled = self._position = 0

    def _write_control(self, value: int) -> None:
        old = self._con1.value
        self._con1.value = value
        if not value & ADON:
            self._scheduler.cancel(self._event)
            self._event = None
            self._filled = self._position = 0
            return
        source = value >> 5 & 7
        if source not in (SSRC_MANUAL, SSRC_TIMER3, SSRC_AUTO):
            raise UnsupportedModeError(f"ADC: SSRC = {source} is left out")
        if not old & ADON:
            self._check_clock()
        if source == SSRC_AUTO:
            if value & ASAM and not old & ASAM:
                self._begin_scan()
            elif old & ASAM and not value & ASAM:
                # The scan that began by itself is abandoned: nobody would read it in order.
                self._scheduler.cancel(self._event)
                self._event = None
        elif source == SSRC_MANUAL and old & SAMP and not value & SAMP:
            self._convert_one()

    def _check_clock(self) -> None:
        if self._con3.value & ADRC:
            raise UnsupportedModeError("ADC: the internal RC clock is left out")
        if self.tad_fs < MIN_TAD_FS:
            raise LimitError(f"ADC: TAD = {self.tad_fs / FS_PER_NS:.0f} ns is below 667 ns")

    # --- converting ------------------------------------------------------------------

    def _begin_scan(self) -> None:
        self._con1.value = (self._con1.value | SAMP) & ~DONE
        self._filled = self._position = 0
        conversions = (self._con2.value >> 2 & 15) + 1
        # SAMC = 0 is allowed only with one conversion at a time (DS70046, 18.10.2).
        tads = conversions * ((self._con3.value >> 8 & 31) + CONVERSION_TAD)
        half_cycles = tads * ((self._con3.value & 0x3F) + 1)
        self._event = self._scheduler.after(self._clock.span(half_cycles) // 2, self._end_scan)

    def _end_scan(self) -> None:
        channels = self._channels()
        conversions = (self._con2.value >> 2 & 15) + 1
        now = self._scheduler.now
        results = self._results
        inputs = self._inputs
        reference = self._reference_v.value
        form = self._con1.value >> 8 & 3
        count = len(channels)
        for i in range(conversions):
            volts = inputs[channels[i % count]](now)
            # Plain integers, the usual format, are converted here: seven calls a scan less.
            code = int(volts / reference * FULL_SCALE) if reference > 0 else 0
            code = 0 if code < 0 else FULL_SCALE - 1 if code >= FULL_SCALE else code
            results[i].value = code if form == 0 else _formatted(code, form)
        self._con1.value |= DONE
        if self._con1.value & ASAM:
            self._begin_scan()
            self._con1.value |= DONE
        else:
            self._event = None
        self._line.request()

    def _convert_one(self) -> None:
        channels = self._channels()
        channel = channels[self._position % len(channels)]
        self._position = (self._position + 1) % len(channels)
        self._results[self._filled].value = self._convert(
            self._inputs[channel](self._scheduler.now)
        )
        self._con1.value &= ~(DONE | SAMP)
        self._filled += 1
        last = self._filled > self._con2.value >> 2 & 15
        if last:
            self._filled = self._position = 0
        self._event = self._scheduler.after(
            CONVERSION_TAD * self.tad_fs, self._finish if last else self._done
        )

    def _done(self) -> None:
        self._event = None
        self._con1.value |= DONE | (SAMP if self._con1.value & ASAM else 0)

    def _finish(self) -> None:
        self._done()
        self._line.request()

    def _channels(self) -> tuple[int, ...]:
        if self._con2.value & CSCNA:
            mask = self._scan.value
            if mask != self._scan_mask:
                self._scan_mask = mask
                self._scan_channels = tuple(i for i in range(CHANNELS) if mask >> i & 1) or (0,)
            return self._scan_channels
        return (self._select.value & 15,)

    def _convert(self, volts: float) -> int:
        """Return the result of one conversion in the format of FORM<1:0>."""
        reference = self._reference_v.value
        code = int(volts / reference * FULL_SCALE) if reference > 0 else 0
        code = 0 if code < 0 else FULL_SCALE - 1 if code >= FULL_SCALE else code
        return _formatted(code, self._con1.value >> 8 & 3)


def _formatted(code: int, form: int) -> int:
    """Return a code as FORM<1:0> wants it in the result buffer."""
    if form == 0:  # integer
        return code
    if form == 1:  # signed integer
        return (code - 2048) & 0xFFFF
    if form == 2:  # fractional
        return code << 4
    return (code - 2048) << 4 & 0xFFFF
