"""The registers of an XBee 802.15.4 module: a table, and how values travel in both modes.

A register is a number of a fixed width. In API frames it is that many octets, big-endian; in
command mode hexadecimal digits without leading zeros, ended by a carriage return. What is set holds
until the supply goes, unless WR has written it. Only what radio, serial line and modes need is
here; other commands are answered as unknown. Source: Digi, "XBee/XBee-PRO RF Modules 802.15.4
Product Manual", chapter "Command reference tables".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from radio_802154.xbee import AtResult

BAUD_RATES: Final = (1_200, 2_400, 4_800, 9_600, 19_200, 38_400, 57_600, 115_200)
"""Of BD 0 to 7."""
POWER_DBM: Final = (-10.0, -6.0, -4.0, -2.0, 0.0)
"""Of PL 0 to 4, XBee (the PRO has others)."""
FIRMWARE: Final = 0x10EF
"""VR of the emulated module: a version of the 802.15.4 firmware (0x10xx)."""
HARDWARE: Final = 0x1746
"""HV: an XBee Series 1 (0x17xx); the revision is assumed."""

TRANSPARENT: Final = 0
"""AP: no API; what comes by the serial line goes out by radio."""
NO_SHORT_ADDRESS: Final = 0xFFFE
"""MY from here on: the module has its 64-bit address only."""


@dataclass(frozen=True, slots=True)
class Register:
    """One register: its two letters, width in octets, default and range."""

    name: str
    octets: int
    default: int
    least: int
    most: int
    summary: str
    read_only: bool = False


REGISTERS: Final = (
    Register("CH", 1, 0x0C, 0x0B, 0x1A, "channel"),
    Register("ID", 2, 0x3332, 0, 0xFFFF, "PAN identifier"),
    Register("DH", 4, 0, 0, 0xFFFF_FFFF, "high half of the destination in transparent mode"),
    Register("DL", 4, 0, 0, 0xFFFF_FFFF, "low half of it; to 0xFFFF with DH = 0 a 16-bit address"),
    Register("MY", 2, 0, 0, 0xFFFF, "own 16-bit address; from 0xFFFE on none"),
    Register("SH", 4, 0x0013_A200, 0, 0xFFFF_FFFF, "high half of the serial number", True),
    Register("SL", 4, 0x4000_0000, 0, 0xFFFF_FFFF, "low half of it", True),
    Register("CE", 1, 0, 0, 1, "coordinator: also takes data without a destination"),
    Register("A1", 1, 0, 0, 0, "association: none here"),
    Register("SM", 1, 0, 0, 0, "sleep mode: none here"),
    Register("RN", 1, 0, 0, 3, "back-off exponent of the first attempt (macMinBE)"),
    Register(
        "MM", 1, 0, 0, 3, "MAC: 0 Digi header, 1 plain without ACKs, 2 plain, 3 Digi, no ACKs"
    ),
    Register("PL", 1, 4, 0, 4, "power: −10, −6, −4, −2, 0 dBm"),
    Register("CA", 1, 0x2C, 0x24, 0x50, "CCA threshold, minus dBm"),
    Register("BD", 4, 3, 0, 7, "baud rate: 1200 to 115200"),
    Register("RO", 1, 3, 0, 0xFF, "character times of silence that end a packet, transparent mode"),
    Register("AP", 1, 0, 0, 2, "API: 0 off, 1 on, 2 with escapes"),
    Register("GT", 2, 1_000, 2, 0x0CE4, "silence before and after +++, milliseconds"),
    Register("CT", 2, 100, 2, 0xFFFF, "command mode ends after so many tenths of a second"),
    Register("CC", 1, 0x2B, 0, 0xFF, "the character of which three begin command mode"),
    Register("VR", 2, FIRMWARE, 0, 0xFFFF, "firmware version", True),
    Register("HV", 2, HARDWARE, 0, 0xFFFF, "hardware version", True),
    Register("DB", 1, 0, 0, 0xFF, "strength of the last packet, minus dBm", True),
    Register("EC", 2, 0, 0, 0xFFFF, "CCA failures"),
    Register("EA", 2, 0, 0, 0xFFFF, "packets without an acknowledgement"),
)
"""In the manual's order, roughly: addressing, MAC, RF, serial, command mode, diagnostics."""

BY_NAME: Final = {row.name: row for row in REGISTERS}
NODE_IDENTIFIER: Final = "NI"
"""The one register that is a text: a name, by default a space."""
MOST_NAME_OCTETS: Final = 20
VOLATILE: Final = frozenset(("DB", "EC", "EA"))
"""What WR does not write."""


class Registers:
    """Values in force, values that wait for AC, and what WR has written.

    Args:
        written: what an earlier WR left, by name; the defaults beside.

    Raises:
        ValueError: a name or value that no register has.

    """

    def __init__(self, written: dict[str, int] | None = None) -> None:
        self._fixed = {row.name: row.default for row in REGISTERS}
        self._written: dict[str, int] = {}
        for name, value in (written or {}).items():
            row = BY_NAME.get(name)
            if row is None or not row.least <= value <= row.most:
                raise ValueError(f"{name} = {value:#x}: no register has that")
            (self._fixed if row.read_only else self._written)[name] = value
        self._now = {**self._fixed, **self._written}
        self._queued: dict[str, int] = {}
        self._name = self._written_name = b" "

    def __getitem__(self, name: str) -> int:
        return self._now[name]

    def note(self, name: str, value: int) -> None:
        """Set what the module itself measures; it stays in the register's range."""
        self._now[name] = min(max(value, 0), BY_NAME[name].most)

    def get(self, name: str) -> bytes | None:
        """Return a register as octets; None where there is none of that name."""
        if name == NODE_IDENTIFIER:
            return self._name
        row = BY_NAME.get(name)
        return None if row is None else self._now[name].to_bytes(row.octets, "big")

    def rename(self, text: bytes) -> AtResult:
        """Set the node identifier: printable ASCII."""
        if len(text) > MOST_NAME_OCTETS or not all(0x20 <= octet < 0x7F for octet in text):
            return AtResult.INVALID_PARAMETER
        self._name = text
        return AtResult.OK

    def set(self, name: str, value: int, *, queued: bool = False) -> AtResult:
        """Set a register now, or with the next `apply`."""
        row = BY_NAME.get(name)
        if row is None:
            return AtResult.INVALID_COMMAND
        if row.read_only:
            return AtResult.ERROR
        if not row.least <= value <= row.most:
            return AtResult.INVALID_PARAMETER
        (self._queued if queued else self._now)[name] = value
        return AtResult.OK

    def apply(self) -> None:
        """Put what is queued in force (AC)."""
        self._now.update(self._queued)
        self._queued.clear()

    def write(self) -> None:
        """Keep what is in force over a loss of the supply (WR)."""
        self._written_name = self._name
        self._written = {
            name: value
            for name, value in self._now.items()
            if name not in VOLATILE and not BY_NAME[name].read_only
        }

    def restore(self) -> None:
        """Go back to the defaults, without writing them (RE)."""
        self._name = b" "
        self._now = dict(self._fixed)
        self._queued.clear()

    def reset(self) -> None:
        """Begin with what was written, as at power-on."""
        self._name = self._written_name
        self._now = {**self._fixed, **self._written}
        self._queued.clear()

    @property
    def serial_number(self) -> int:
        """The 64-bit address."""
        return self._now["SH"] << 32 | self._now["SL"]

    @property
    def baud(self) -> int:
        """Of the serial line."""
        return BAUD_RATES[self._now["BD"]]
