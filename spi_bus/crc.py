"""The frame check sequence: CRC-16/GENIBUS, polynomial 0x1021 with start value and inversion.

Polynomial x^16 + x^12 + x^5 + 1 (0x1021), start value 0xFFFF, no reflection, all bits inverted at
the end; the check value of "123456789" is 0xD64E (CRC RevEng catalogue, entry CRC-16/GENIBUS).

Why this one: it detects every burst of up to 16 bits and every 1-, 2- and 3-bit error in a frame of
up to 4093 bytes (Hamming distance 4 up to 32751 bits). That holds of the frame as it is checked,
behind COBS: a wrong bit in a code byte of the stuffing changes more, and passes with the odds of
random damage or better (tests/spi_bus/test_crc_odds.py). Zero is the byte that an idle SPI master
clocks, so zeros must not slip by at either end. XMODEM starts at zero: zeros added or lost at the
front leave its CRC unchanged. CCITT-FALSE mends that, but without the inversion a frame with its
CRC leaves a zero remainder, which further zeros keep: one damaged bit in a frame's closing zero
would lengthen the frame by a zero, unnoticed. With the inversion the CRC of a whole frame, its own
CRC behind it, is a constant (RESIDUE), and zeros appended destroy it. It is not reflected: sent
high byte first, a receiver on a small MCU needs no second buffer, only one comparison at the end.

`binascii.crc_hqx` computes it: the same division in C, told where to start, one call without a
Python function around it, which is what 8-byte frames spend a third of their time on with crcmod.
The tests hold it against crcmod-plus, the division bit by bit, and the catalogue's check value.
"""

from binascii import crc_hqx
from typing import Final

__all__ = ["CRC_BYTES", "INVERTED", "POLYNOMIAL", "RESIDUE", "START", "crc16"]

POLYNOMIAL: Final = 0x11021  # with its leading x^16
START: Final = 0xFFFF
INVERTED: Final = 0xFFFF
"""What is XORed to the result."""
RESIDUE: Final = 0xE2F0
"""CRC of anything that has its own CRC behind it: 0x1D0F, inverted."""
CRC_BYTES: Final = 2


def crc16(data: bytes) -> int:
    """CRC-16/GENIBUS of some bytes; RESIDUE where the last two are their CRC, high byte first."""
    return crc_hqx(data, START) ^ INVERTED
