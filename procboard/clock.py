"""Bringing the DCO to 4 MiHz: counted against the watch crystal at every boot, as TinyOS does.

Timer A counts SMCLK and captures its count at edges of ACLK. The eleven bits of RSEL, DCO and MOD
are tried from the top, each kept if the frequency stays at or below the target: the search of
TinyOS's Msp430ClockP, whose 4 MiHz has 128 DCO cycles a crystal period.
"""

from __future__ import annotations

from typing import Final

from firmware_model.msp430.mcu import Msp430F1611
from procboard.coroutines import Firmware

CPU_HZ: Final = 4 * 2**20
"""What the firmware believes of MCLK and SMCLK."""
CRYSTAL_HZ: Final = 32_768
_PERIODS: Final = 8
"""Crystal periods a measurement: 244 µs, resolution 1/1024 of the target."""
_WANTED: Final = _PERIODS * CPU_HZ // CRYSTAL_HZ
_STEP_CYCLES: Final = 60
"""Setting the DCO and judging a count: about 20 instructions of 3 cycles."""
_POLL_CYCLES: Final = 12
"""bit.w #CCIFG, &TACCTL2 and jz, twice over (SLAU049F, section 3.4.4)."""

# TACTL, TACCTL2 (SLAU049F, section 11.3).
_TASSEL_SMCLK: Final = 0x0200
_MC_CONTINUOUS: Final = 0x0020
_TACLR: Final = 0x0004
_CAPTURE_ACLK: Final = 0x4000 | 0x1000 | 0x0800 | 0x0100  # CM_1, CCIS_1, SCS, CAP
_CCIFG: Final = 0x0001
_XT2OFF: Final = 0x80


def calibrate_dco(mcu: Msp430F1611) -> Firmware[None]:
    """Set DCOCTL and BCSCTL1 to the highest frequency that is not above 4 MiHz."""
    reg = mcu.reg
    dcoctl, bcsctl1 = reg["DCOCTL"], reg["BCSCTL1"]
    control, capture = reg["TACTL"], reg["TACCTL2"]
    value = 0
    for bit in range(10, -1, -1):
        trial = value | 1 << bit
        bcsctl1.write(_XT2OFF | trial >> 8)
        dcoctl.write(trial & 0xFF)
        control.write(_TASSEL_SMCLK | _MC_CONTINUOUS | _TACLR)
        capture.write(_CAPTURE_ACLK)
        yield _STEP_CYCLES
        first = yield from _next_edge(mcu)
        last = first
        for _ in range(_PERIODS):
            last = yield from _next_edge(mcu)
        if (last - first) & 0xFFFF <= _WANTED:
            value = trial
    bcsctl1.write(_XT2OFF | value >> 8)
    dcoctl.write(value & 0xFF)
    capture.write(0)
    control.write(0)


def _next_edge(mcu: Msp430F1611) -> Firmware[int]:
    """Wait for the next capture and return it."""
    capture = mcu.reg["TACCTL2"]
    capture.clear_bits(_CCIFG)
    while not capture.read() & _CCIFG:
        yield _POLL_CYCLES
    return mcu.reg["TACCR2"].read()
