"""One automatic scan of the converter a control tick, and nothing in between.

SSRC = 111 samples and converts by itself: firmware sets ASAM, the interrupt comes after the last
input, and its handler clears ASAM again (DS70046, section 18.10).
"""

from __future__ import annotations

from firmware_model.dspic30f.mcu import DsPic30F6014A
from navboard import costs

ADC_ENABLE = 1 << 11  # ADIE, ADIF: IEC0, IFS0
_ASAM = 1 << 2
_CON1 = 0x80E0  # ADON, integer format, SSRC = 111
_CON3 = 31 << 8 | 19  # SAMC = 31 TAD = 21 µs for 10 kΩ sources; TAD = 20 TCY/2 = 678 ns


class AdcScan:
    """Scans a set of inputs; results come in the order of their numbers."""

    def __init__(self, mcu: DsPic30F6014A, channels: tuple[int, ...]) -> None:
        reg = mcu.reg
        mask = 0
        for channel in channels:
            mask |= 1 << channel
        self._con1 = reg["ADCON1"]
        self._flags = reg["IFS0"]
        ordered = sorted(channels)
        self.buffers = {channel: reg[f"ADCBUF{ordered.index(channel):X}"] for channel in ordered}
        reg["ADPCFG"].write(~mask & 0xFFFF)  # scanned pins analog, the others digital
        reg["ADCSSL"].write(mask)
        reg["ADCON2"].write(1 << 10 | (len(channels) - 1) << 2)  # CSCNA, SMPI
        reg["ADCON3"].write(_CON3)
        self._con1.write(_CON1)
        reg["IEC0"].set_bits(ADC_ENABLE)

    def start(self) -> None:
        """Begin a scan."""
        self._con1.write(_CON1 | _ASAM)

    def finish(self) -> int:
        """Stop after a scan; called by the ADC handler, whose cycles it returns."""
        self._con1.write(_CON1)
        self._flags.clear_bits(ADC_ENABLE)
        return costs.ADC_ISR
