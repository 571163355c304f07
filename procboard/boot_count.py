"""The boot counter in information flash: every start has a number of its own, the link's epoch.

Two segments of 64 words are filled word by word with rising numbers; the largest that is found is
the last. A word that a power cut left half programmed has more ones than it should, so it reads as
a larger number: the count jumps, and never repeats. A full segment is erased only when the other
one holds a larger number.
"""

from __future__ import annotations

from typing import Final

from firmware_model.msp430.mcu import Msp430F1611
from procboard.coroutines import Firmware

_SEGMENTS: Final = (0x1080, 0x1000)  # A, B (SLAU049F, section 5.2.1)
_WORDS: Final = 64
_ERASED: Final = 0xFFFF
_LAST: Final = 0xFFF0
"""Beyond it the count begins again at 1."""

SCAN_CYCLES: Final = 2 * _WORDS * 10
"""cmp @Rn+ and a jump for each word, about 10 cycles with the loop."""

# FCTL1–FCTL3 (SLAU049F, section 5.4).
_KEY: Final = 0xA500
_ERASE, _WRT, _LOCK = 0x0002, 0x0040, 0x0010
_MCLK_BY_11: Final = 0x0040 | 10
"""FSSEL_1 (MCLK), FN = 10: 4 MiHz / 11 = 381 kHz, within 257…476 kHz (SLAS368)."""


def keep_count(mcu: Msp430F1611, boots: int) -> None:
    """Write into the information flash that there were so many boots: 1 to 65 520."""
    if not 1 <= boots <= _LAST:
        raise ValueError(f"boots = {boots} is outside 1 to {_LAST}")
    mcu.memory[_SEGMENTS[0] : _SEGMENTS[0] + 2] = boots.to_bytes(2, "little")


def count_boot(mcu: Msp430F1611) -> Firmware[int]:
    """Note another boot; return its number, 1 to 65520."""
    space = mcu.reg
    yield SCAN_CYCLES
    words = {
        address: space.read16(address)
        for start in _SEGMENTS
        for address in range(start, start + 2 * _WORDS, 2)
    }
    used = {address: value for address, value in words.items() if value != _ERASED}
    last = max(used.values(), default=0)
    number = last + 1
    flash = mcu.reg
    flash["FCTL2"].write(_KEY | _MCLK_BY_11)
    flash["FCTL3"].write(_KEY)
    if number > _LAST:
        for start in _SEGMENTS:
            yield from _erase(mcu, start)
        number, used = 1, {}
    free = [address for address in words if address not in used]
    if not free:
        where = next(address for address, value in used.items() if value == last)
        start = next(s for s in _SEGMENTS if not s <= where < s + 2 * _WORDS)
        yield from _erase(mcu, start)
        free = [start]
    flash["FCTL1"].write(_KEY | _WRT)
    space.write16(free[0], number)
    yield 10
    flash["FCTL1"].write(_KEY)
    flash["FCTL3"].write(_KEY | _LOCK)
    return number


def _erase(mcu: Msp430F1611, start: int) -> Firmware[None]:
    mcu.reg["FCTL1"].write(_KEY | _ERASE)
    mcu.reg.write16(start, 0)  # any write to the segment starts the erase
    yield 10
    mcu.reg["FCTL1"].write(_KEY)
