"""SPI waveforms (value change dumps): edges back into octets.

Wires are found by name: SCK or CLK, MOSI, MISO, CS. Mode 0: while chip select is low the levels of
both data wires count at every rising edge of the clock, most significant bit first. All changes of
one instant happen at once, as a logic analyser sees them. Levels that are neither 0 nor 1 count as
0: MISO floats while nobody drives it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, Final

from tools.decode.items import Item, Octets, What
from tools.errors import UserError

NAMES: Final = {
    "clock": ("SCK", "SCLK", "CLK", "CLOCK"),
    "mosi": ("MOSI", "SDO", "SIMO", "COPI", "DI"),
    "miso": ("MISO", "SDI", "SOMI", "CIPO", "DO"),
    "select": ("CS", "CSN", "CS#", "NSS", "SS", "NCS"),
}
"""Names that the wires go by, the last part of a path, in any case."""
MASTER, SLAVE = "master", "slave"
HEADER_WORDS: Final = (b"$comment", b"$date", b"$version", b"$timescale", b"$scope", b"$var")

_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}
LONGEST_LINE: Final = 4096
_MOST_WIRES: Final = 4096
_MOST_WORDS: Final = 16_384
"""Of a declaration, such as a comment, before its $end."""
_MOST_DIGITS: Final = 18
_BLOCK: Final = 8
"""Octets handed on together, at most: few, so that both directions keep their order."""


def read(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield what went over MOSI and MISO, and what is wrong with the file.

    Raises:
        UserError: no end of the header, no time scale, or wires that have none of the names.

    """
    wires: dict[str, str] = {}
    scale: float | None = None
    words: list[str] = []
    offset = 0
    ended = False
    while not ended:
        line = file.readline(LONGEST_LINE)
        offset += len(line)
        if not line:
            raise UserError(f"{name}: the waveform's header has no end ($enddefinitions)")
        words += line.decode("ascii", "replace").split()
        if len(words) > _MOST_WORDS:
            raise UserError(f"{name}: no waveform's header ends here ($end is missing)")
        while "$end" in words and not ended:
            end = words.index("$end")
            part, words = words[:end], words[end + 1 :]
            if part[:1] == ["$timescale"]:
                scale = _scale(part[1:])
            elif part[:1] == ["$var"] and len(part) >= 5 and len(wires) < _MOST_WIRES:
                wires.setdefault(part[4].rsplit(".", 1)[-1].upper(), part[3])
            ended = part[:1] == ["$enddefinitions"]
    if scale is None:
        raise UserError(f"{name}: the waveform has no $timescale that can be read")
    codes = {
        role: next((wires[n] for n in names if n in wires), None) for role, names in NAMES.items()
    }
    missing = [role for role in ("clock", "mosi", "miso") if codes[role] is None]
    if codes["clock"] is None or len(missing) > 1:
        wanted = ", ".join("/".join(NAMES[role][:2]) for role in missing)
        found = ", ".join(list(wires)[:8]) or "none"
        raise UserError(f"{name}: no wire is called {wanted}; there are {found}")
    return _Waveform(codes, scale).read(file, offset)


def _scale(words: list[str]) -> float | None:
    text = "".join(words)
    number = text.rstrip("smunpf")
    unit = _UNITS.get(text[len(number) :])
    return None if unit is None or number not in ("1", "10", "100") else int(number) * unit


class _Waveform:
    """Levels of four wires as time goes on."""

    def __init__(self, codes: dict[str, str | None], scale: float) -> None:
        def code(role: str) -> bytes:
            return (codes[role] or "").encode()  # no change ever has an empty code

        self._clock_code, self._select_code = code("clock"), code("select")
        self._mosi_code, self._miso_code = code("mosi"), code("miso")
        self._scale = scale
        self._clock = self._mosi = self._miso = 0
        self._select = 1 if codes["select"] else 0
        self._out = self._back = self._bits = 0
        self._begin = 0.0
        self._octets: list[tuple[float, int, int]] = []
        self._offset = 0

    def read(self, file: BinaryIO, offset: int) -> Iterator[Octets | Item]:
        now = 0
        clock, select = self._clock_code, self._select_code
        mosi, miso = self._mosi_code, self._miso_code
        old_clock, old_select = 0, self._select
        block_offset = offset
        while line := file.readline(LONGEST_LINE):
            here, offset = offset, offset + len(line)
            if not line.endswith(b"\n") and len(line) == LONGEST_LINE:
                yield Item(What.ERROR, "damaged waveform", offset=here, text="a line has no end")
                while line and not line.endswith(b"\n"):
                    line = file.readline(LONGEST_LINE)
                    offset += len(line)
                continue
            for word in line.split():
                first = word[0]
                if first == 0x23:  # '#': all changes of the instant before are known
                    # edges of the instant that ends here
                    if self._select != old_select:
                        yield from self._selected(block_offset, now)
                        old_select = self._select
                    if self._clock != old_clock:
                        old_clock = self._clock
                        if old_clock and not self._select:
                            self._sample(now)
                            if len(self._octets) >= _BLOCK:
                                yield from self._block(block_offset)
                                block_offset = here
                    if not self._octets:
                        block_offset = here
                    digits = word[1:]
                    if not digits.isdigit() or len(digits) > _MOST_DIGITS:
                        yield self._damaged(here, now, f"no time: {_shown(word)}")
                    elif int(digits) < now:
                        yield self._damaged(here, now, f"time goes back to {_shown(word)}")
                    else:
                        now = int(digits)
                elif first in b"01xXzZ":
                    code = word[1:]
                    level = 1 if first == 0x31 else 0
                    if code == clock:
                        self._clock = level
                    elif code == mosi:
                        self._mosi = level
                    elif code == miso:
                        self._miso = level
                    elif code == select:
                        self._select = level
                elif first not in b"$bBrR" and not self._is_code(word):
                    yield self._damaged(here, now, f"neither a time nor a level: {_shown(word)}")
        if self._select != old_select:
            yield from self._selected(block_offset, now)
        if self._clock and not old_clock and not self._select:
            self._sample(now)
        yield from self._block(block_offset)
        if self._bits:
            yield self._odd(offset, now)

    def _is_code(self, word: bytes) -> bool:
        """Whether a word may be the code after a vector or real value."""
        return len(word) <= 4 and all(0x21 <= octet <= 0x7E for octet in word)

    def _selected(self, offset: int, now: int) -> Iterator[Octets | Item]:
        yield from self._block(offset)
        if self._bits:
            yield self._odd(offset, now)
        self._bits = self._out = self._back = 0

    def _damaged(self, offset: int, now: int, text: str) -> Item:
        time_s = now * self._scale
        return Item(What.ERROR, "damaged waveform", time_s, offset=offset, text=text)

    def _odd(self, offset: int, now: int) -> Item:
        text = f"{self._bits} bits and then the chip select rose"
        return Item(What.ERROR, "broken octet", now * self._scale, offset=offset, text=text)

    def _sample(self, now: int) -> None:
        if not self._bits:
            self._begin = now * self._scale
        self._out = self._out << 1 | self._mosi
        self._back = self._back << 1 | self._miso
        self._bits += 1
        if self._bits == 8:
            self._octets.append((self._begin, self._out, self._back))
            self._bits = self._out = self._back = 0

    def _block(self, offset: int) -> Iterator[Octets]:
        if not self._octets:
            return
        times, out, back = zip(*self._octets, strict=True)
        self._octets.clear()
        if self._mosi_code:
            yield Octets(bytes(out), MASTER, times[0], offset, times_s=times)
        if self._miso_code:
            yield Octets(bytes(back), SLAVE, times[0], offset, times_s=times)


def _shown(word: bytes) -> str:
    return repr(word[:24].decode("ascii", "replace"))
