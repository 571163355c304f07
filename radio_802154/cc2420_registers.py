"""The CC2420's registers, strobes, memory map, states and levels, as data (SWRS041B).

Reset values are those of the register descriptions (section 37), as far as public models of the
chip agree on them; docs/radio.md says which figures are yet to be confirmed. Test registers hold a
value and do nothing. Nothing here knows time or wires.
"""

from __future__ import annotations

from enum import IntEnum
from itertools import pairwise
from typing import Final

# --- Configuration registers: name, address, reset value, writable bits (section 37) -------------

REGISTERS: Final[tuple[tuple[str, int, int, int], ...]] = (
    ("MAIN", 0x10, 0xF800, 0xF801),
    ("MDMCTRL0", 0x11, 0x0AE2, 0x3FFF),
    ("MDMCTRL1", 0x12, 0x0500, 0x07FF),  # CORR_THR 20; first silicon had 0
    ("RSSI", 0x13, 0xE080, 0xFF00),  # RSSI_VAL (low octet) is a status
    ("SYNCWORD", 0x14, 0xA70F, 0xFFFF),
    ("TXCTRL", 0x15, 0xA0FF, 0xFFFF),
    ("RXCTRL0", 0x16, 0x12E5, 0x3FFF),
    ("RXCTRL1", 0x17, 0x0A56, 0x3FFF),
    ("FSCTRL", 0x18, 0x4165, 0xC3FF),  # CAL_DONE … LOCK_STATUS are statuses
    ("SECCTRL0", 0x19, 0x03C4, 0x03FF),
    ("SECCTRL1", 0x1A, 0x0000, 0x7F7F),
    ("BATTMON", 0x1B, 0x0000, 0x003F),  # BATTMON_OK is a status
    ("IOCFG0", 0x1C, 0x0040, 0x0FFF),
    ("IOCFG1", 0x1D, 0x0000, 0x1FFF),
    ("MANFIDL", 0x1E, 0x233D, 0x0000),  # part number 2, manufacturer 0x33D (Chipcon)
    ("MANFIDH", 0x1F, 0x3000, 0x0000),  # version 3
    ("FSMTC", 0x20, 0x7A94, 0xFFFF),
    ("MANAND", 0x21, 0xFFFF, 0xFFFF),
    ("MANOR", 0x22, 0x0000, 0xFFFF),
    ("AGCCTRL", 0x23, 0x07F0, 0x0FFC),
    ("AGCTST0", 0x24, 0x3649, 0xFFFF),
    ("AGCTST1", 0x25, 0x0860, 0x7FFF),
    ("AGCTST2", 0x26, 0x012A, 0x03FF),
    ("FSTST0", 0x27, 0x0200, 0xFFFF),
    ("FSTST1", 0x28, 0x5002, 0xFFFF),
    ("FSTST2", 0x29, 0x0600, 0x7FFF),
    ("FSTST3", 0x2A, 0x81DD, 0xFFFF),
    ("RXBPFTST", 0x2B, 0x0000, 0x7FFF),
    ("FSMSTATE", 0x2C, 0x0000, 0x0000),  # a status
    ("ADCTST", 0x2D, 0x0000, 0x8000),
    ("DACTST", 0x2E, 0x0000, 0x7FFF),
    ("TOPTST", 0x2F, 0x0010, 0x00FF),
    ("RESERVED", 0x30, 0x0000, 0xFFFF),
)

MAIN: Final = 0x10
MDMCTRL0: Final = 0x11
RSSI: Final = 0x13
TXCTRL: Final = 0x15
FSCTRL: Final = 0x18
BATTMON: Final = 0x1B
IOCFG0: Final = 0x1C
IOCFG1: Final = 0x1D
FSMSTATE: Final = 0x2C
TXFIFO: Final = 0x3E
RXFIFO: Final = 0x3F

# --- Command strobes (section 37, Table 11) ------------------------------------------------------

SNOP: Final = 0x00
SXOSCON: Final = 0x01
STXCAL: Final = 0x02
SRXON: Final = 0x03
STXON: Final = 0x04
STXONCCA: Final = 0x05
SRFOFF: Final = 0x06
SXOSCOFF: Final = 0x07
SFLUSHRX: Final = 0x08
SFLUSHTX: Final = 0x09
SACK: Final = 0x0A
SACKPEND: Final = 0x0B
SRXDEC: Final = 0x0C
STXENC: Final = 0x0D
SAES: Final = 0x0E
LAST_STROBE: Final = 0x0F

# --- SPI (section 13) ----------------------------------------------------------------------------

ADDRESS_RAM: Final = 0x80
"""First octet: RAM access."""
ADDRESS_READ: Final = 0x40
"""First octet: register read."""
ADDRESS_MASK: Final = 0x3F
RAM_READ_ONLY: Final = 0x20
"""Second octet of a RAM access: read without writing."""

STATUS_XOSC16M_STABLE: Final = 1 << 6
STATUS_TX_UNDERFLOW: Final = 1 << 5
STATUS_TX_ACTIVE: Final = 1 << 3
STATUS_LOCK: Final = 1 << 2
STATUS_RSSI_VALID: Final = 1 << 1

# --- Bits ----------------------------------------------------------------------------------------

MAIN_RESETN: Final = 1 << 15
MDMCTRL0_RESERVED_FRAME_MODE: Final = 1 << 13
MDMCTRL0_PAN_COORDINATOR: Final = 1 << 12
MDMCTRL0_ADR_DECODE: Final = 1 << 11
MDMCTRL0_CCA_HYST_SHIFT: Final = 8
MDMCTRL0_CCA_MODE_SHIFT: Final = 6
MDMCTRL0_AUTOCRC: Final = 1 << 5
MDMCTRL0_AUTOACK: Final = 1 << 4
MDMCTRL0_PREAMBLE_LENGTH: Final = 0x000F
TXCTRL_TX_TURNAROUND: Final = 1 << 13
TXCTRL_PA_LEVEL: Final = 0x001F
FSCTRL_CAL_DONE: Final = 1 << 13
FSCTRL_CAL_RUNNING: Final = 1 << 12
FSCTRL_LOCK_STATUS: Final = 1 << 10
FSCTRL_FREQ: Final = 0x03FF
FSCTRL_FREQ_OFFSET_MHZ: Final = 2048
"""F_C = 2048 + FREQ MHz (section 26)."""
BATTMON_OK: Final = 1 << 6
BATTMON_EN: Final = 1 << 5
BATTMON_VOLTAGE: Final = 0x001F
IOCFG0_BCN_ACCEPT: Final = 1 << 11
IOCFG0_FIFO_POLARITY: Final = 1 << 10
IOCFG0_FIFOP_POLARITY: Final = 1 << 9
IOCFG0_SFD_POLARITY: Final = 1 << 8
IOCFG0_CCA_POLARITY: Final = 1 << 7
IOCFG0_FIFOP_THR: Final = 0x007F
IOCFG1_CCAMUX: Final = 0x001F
CCAMUX_CCA: Final = 0
CCAMUX_XOSC16M_STABLE: Final = 24

CRC_OK: Final = 1 << 7
"""In the last octet of a frame in the RXFIFO (Figure 21); below it the correlation value."""

# --- RAM (section 13.5, Table 6) -----------------------------------------------------------------

RAM_TXFIFO: Final = 0x000
RAM_RXFIFO: Final = 0x080
RAM_IEEEADR: Final = 0x160
RAM_PANID: Final = 0x168
RAM_SHORTADR: Final = 0x16A
RAM_OCTETS: Final = 0x170
"""Two FIFOs of 128 octets and a security bank of 112."""
FIFO_OCTETS: Final = 128

# --- States (section 20, Figure 25) --------------------------------------------------------------


class State(IntEnum):
    """States of the radio control state machine; the value is what FSMSTATE reads."""

    VREG_OFF = -1
    POWER_DOWN = 0
    IDLE = 1
    RX_CALIBRATE = 2
    RX_SFD_SEARCH = 3
    RX_WAIT = 14
    RX_FRAME = 16
    RX_OVERFLOW = 17
    TX_CALIBRATE = 32
    TX_PREAMBLE = 34
    TX_FRAME = 37
    TX_ACK_CALIBRATE = 48
    TX_ACK_PREAMBLE = 49
    TX_ACK = 52
    TX_UNDERFLOW = 56


# --- Electrical figures --------------------------------------------------------------------------

SUPPLY_MINIMUM_V: Final = 2.1
"""Lowest voltage of the regulator's input (section 5); below it the chip is taken as reset."""

VREG_START_US: Final = 300
"""Voltage regulator start-up, typical (section 6.9: 0.3 typ, 0.6 ms max)."""

XOSC_START_US: Final = 860
"""Crystal oscillator start-up, typical with 16 pF load (section 6.6: 0.86 ms)."""

CURRENTS_A: Final = {
    "vreg_off": 0.02e-6,
    "power_down": 20e-6,
    "idle": 426e-6,
    "rx": 18.8e-3,
    "tx": 17.4e-3,
}
"""Current by state (section 6.2); "tx" is at 0 dBm, other levels in `PA_LEVELS`."""

PA_LEVELS: Final = (
    (3, -25.0, 8.5e-3),
    (7, -15.0, 9.9e-3),
    (11, -10.0, 11.2e-3),
    (15, -7.0, 12.5e-3),
    (19, -5.0, 13.9e-3),
    (23, -3.0, 15.2e-3),
    (27, -1.0, 16.5e-3),
    (31, 0.0, 17.4e-3),
)
"""PA_LEVEL, output power [dBm], current [A] (section 28, Table 9; inner currents unconfirmed)."""

RSSI_OFFSET_DB: Final = -45
"""P = RSSI_VAL + RSSI_OFFSET [dBm] (section 23)."""

RSSI_INVALID: Final = 0x80
"""RSSI_VAL before it is valid: −128 (reset value)."""

CORRELATION_BEST: Final = 110
"""Correlation value of a frame of best quality (section 24)."""

CORRELATION_WORST: Final = 50
"""Correlation value of the worst frames that are still detectable (section 24)."""


def pa_level(level: int) -> tuple[float, float]:
    """Return output power [dBm] and current [A] of a PA_LEVEL.

    Levels between the documented ones are interpolated, those below extrapolated (assumed).
    """
    lower, upper = PA_LEVELS[0], PA_LEVELS[1]
    for first, second in pairwise(PA_LEVELS):
        lower, upper = first, second
        if level <= upper[0]:
            break
    share = (level - lower[0]) / (upper[0] - lower[0])
    return (
        lower[1] + share * (upper[1] - lower[1]),
        lower[2] + share * (upper[2] - lower[2]),
    )


def battmon_toggle_v(setting: int) -> float:
    """Return the battery monitor's threshold: 1.25 V · (72 − setting) / 27 (section 27)."""
    return 1.25 * (72 - setting) / 27
