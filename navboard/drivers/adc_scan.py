"""One automatic scan of the converter a control tick, and nothing in between.

SSRC = 111 samples and converts by itself: firmware sets ASAM, the interrupt comes after the last
input, and its handler clears ASAM again (DS70046, section 18.10).
"""

from __future__ import annotations

from firmware_model.dspic30f.mcu import DsPic30F6014A
from firmware_model.registers import Register
from navboard import costs

ADC_ENABLE = 1 << 11  # ADIE, ADIF: IEC0, IFS0
_ASAM = 1 << 2
_CON1 = 0x80E0  # ADON, integer format, SSRC = 111
_CON3 = 31 << 8 | 19  # SAMC = 31 TAD = 21 µs for 10 kΩ sources; TAD = 20 TCY/2 = 678 ns


SELDOM_TICKS = 5
"""Of how many scans one has the slow inputs too: 10 Hz at a control rate of 50 Hz."""


class AdcScan:
    """Scans a set of inputs, some of them seldom; results come in the order of their numbers."""

    def __init__(
        self, mcu: DsPic30F6014A, often: tuple[int, ...], seldom: tuple[int, ...] = ()
    ) -> None:
        reg = mcu.reg
        self._con1 = reg["ADCON1"]
        self._con2 = reg["ADCON2"]
        self._select = reg["ADCSSL"]
        self._flags = reg["IFS0"]
        self.whole = False
        """Whether the scan that runs, or was the last, has the slow inputs too."""
        self._scans = -1
        plans = []
        for channels in (often, (*often, *seldom)):
            ordered = sorted(channels)
            mask = sum(1 << channel for channel in ordered)
            buffers = {channel: reg[f"ADCBUF{place:X}"] for place, channel in enumerate(ordered)}
            plans.append((mask, 1 << 10 | (len(ordered) - 1) << 2, buffers))  # CSCNA, SMPI
        self._plans = tuple(plans)
        self._arrange(whole=False)
        reg["ADPCFG"].write(~plans[True][0] & 0xFFFF)  # scanned pins analog, the others digital
        reg["ADCON3"].write(_CON3)
        self._con1.write(_CON1)
        reg["IEC0"].set_bits(ADC_ENABLE)

    def buffers(self, whole: bool) -> dict[int, Register]:
        """Return where a scan of a kind leaves the result of each input."""
        return self._plans[whole][2]

    def start(self) -> None:
        """Begin a scan."""
        self._scans += 1
        whole = self._scans % SELDOM_TICKS == 0
        if whole is not self.whole:
            self._arrange(whole)
        self._con1.write(_CON1 | _ASAM)

    def _arrange(self, whole: bool) -> None:
        self.whole = whole
        mask, con2, _ = self._plans[whole]
        self._select.write(mask)
        self._con2.write(con2)

    def finish(self) -> int:
        """Stop after a scan; called by the ADC handler, whose cycles it returns."""
        self._con1.write(_CON1)
        self._flags.clear_bits(ADC_ENABLE)
        return costs.ADC_ISR
