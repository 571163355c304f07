"""The frame check sequence: CRC-16/IBM-3740, better known as CCITT-FALSE.

Polynomial x^16 + x^12 + x^5 + 1 (0x1021), start value 0xFFFF, no reflection, no final inversion;
the check value of "123456789" is 0x29B1 (CRC RevEng catalogue, entry CRC-16/IBM-3740).

Why this one: it detects every burst of up to 16 bits and every 1-, 2- and 3-bit error in a frame of
up to 4093 bytes (Hamming distance 4 up to 32751 bits). XMODEM has the same polynomial but starts at
zero, so zero bytes added or lost at the front of a frame leave its CRC unchanged, and zero is the
byte that an idle SPI master clocks. It is not reflected: the CRC, sent high byte first behind the
data, makes the CRC of the whole zero, so a receiver on a small MCU needs no second buffer and no
comparison.

The table-driven C code of crcmod-plus computes it.
"""

from collections.abc import Callable
from typing import Final

from crcmod.crcmod import mkCrcFun

__all__ = ["CRC_BYTES", "INITIAL", "POLYNOMIAL", "crc16"]

POLYNOMIAL: Final = 0x11021  # crcmod writes the leading x^16
INITIAL: Final = 0xFFFF
CRC_BYTES: Final = 2

crc16: Final[Callable[[bytes], int]] = mkCrcFun(POLYNOMIAL, initCrc=INITIAL, rev=False, xorOut=0)
"""CRC-16/IBM-3740 of some bytes; zero where the last two are the CRC, high byte first."""
