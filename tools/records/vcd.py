"""spi.vcd: the wires between the boards as a waveform that any viewer and sigrok can read.

The emulation moves whole bytes, and a byte record holds all that its sixteen clock edges need: when
its first bit began, how long a bit is, and both bytes. Here they become edges again: SPI mode 0
(clock idle low, data change on the falling edge and are sampled on the rising one), most
significant bit first. Slow wires (chip select, data ready, other pins) are merged in by time.

One tick is 100 ns: a half bit at 262 kHz is 19 ticks, so every edge keeps its order and place,
while sigrok, which expands a file to one sample a tick, still reads a run in seconds. At 1 ns it
would need a hundred times longer for the same bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import TextIO

FS_PER_NS = 10**6
TICK_NS = 100

_BITS = tuple(tuple(byte >> (7 - place) & 1 for place in range(8)) for byte in range(256))

SCK, MOSI, MISO = "!", '"', "#"
_FIRST_CODE = ord("$")
_LAST_CODE = ord("~")


def _both(begin: int, half: int) -> tuple[int, int]:
    """Begin and middle of a bit."""
    return begin, begin + half


def _edge_texts(mosi: int, miso: int, last_out: int, last_back: int) -> tuple[str, ...]:
    """What changes at the begin and in the middle of each bit of a byte, and at its end."""
    texts = []
    clock = ""  # falls at the begin of every bit but the first
    for out, back in zip(_BITS[mosi], _BITS[miso], strict=True):
        text = clock
        if out != last_out:
            last_out = out
            text += f"{out}{MOSI}\n"
        if back != last_back:
            last_back = back
            text += f"{back}{MISO}\n"
        texts += [text, f"1{SCK}\n"]
        clock = f"0{SCK}\n"
    return (*texts, clock)


class VcdWriter:
    """Writes one VCD file from byte records and level changes, in order of time.

    Levels may be given ahead of bytes: they are held until a byte or `close` passes them. Bytes
    must come in order and must not overlap; a record that goes back in time raises `ValueError`.
    """

    def __init__(
        self, file: TextIO, wires: Iterable[tuple[str, int]], *, tick_ns: int = TICK_NS
    ) -> None:
        """`wires` are the slow wires with their level at time zero, such as ("CS", 1)."""
        if tick_ns not in (1, 10, 100):
            raise ValueError("a VCD tick is 1, 10 or 100 of a unit")
        self._file = file
        self._tick_fs = tick_ns * FS_PER_NS
        self._levels = dict(wires)
        self._codes: dict[str, str] = {}
        for number, name in enumerate(self._levels, _FIRST_CODE):
            if number > _LAST_CODE:
                raise ValueError("too many wires for one-letter codes")
            self._codes[name] = chr(number)
        self._held: deque[tuple[int, str, int]] = deque()  # by time
        self._new: list[tuple[int, str, int]] = []  # as they came
        self._texts: dict[int, tuple[str, ...]] = {}  # by bytes and the levels before them
        self._period_fs = 0
        self._offsets: list[int] = []
        self._now = 0  # the tick that the file has reached
        self._mosi = self._miso = 0
        self._header(tick_ns)

    def _header(self, tick_ns: int) -> None:
        out = [
            "$comment fishbed: SPI mode 0, most significant bit first $end",
            f"$timescale {tick_ns} ns $end",
            "$scope module robot $end",
            *(
                f"$var wire 1 {code} {name} $end"
                for name, code in (("SCK", SCK), ("MOSI", MOSI), ("MISO", MISO))
            ),
            *(f"$var wire 1 {code} {name} $end" for name, code in self._codes.items()),
            "$upscope $end",
            "$enddefinitions $end",
            "#0",
            "$dumpvars",
            f"0{SCK}",
            f"0{MOSI}",
            f"0{MISO}",
            *(f"{level}{self._codes[name]}" for name, level in self._levels.items()),
            "$end",
        ]
        self._file.write("\n".join(out) + "\n")

    def level(self, time_fs: int, wire: str, level: int) -> None:
        """A slow wire has this level from now on."""
        if wire not in self._codes:
            raise ValueError(f"no wire {wire!r}")
        self._new.append((time_fs // self._tick_fs, wire, 1 if level else 0))

    def byte(self, start_fs: int, bit_period_fs: int, mosi: int, miso: int) -> None:
        """Eight bits that begin at `start_fs`; the clock rises in the middle of each."""
        if bit_period_fs != self._period_fs:
            self._set_period(bit_period_fs)
        key = mosi << 10 | miso << 2 | self._mosi << 1 | self._miso
        texts = self._texts.get(key)
        if texts is None:
            texts = self._texts[key] = _edge_texts(mosi, miso, self._mosi, self._miso)
        self._mosi, self._miso = mosi & 1, miso & 1
        tick = self._tick_fs
        edges = [
            ((start_fs + offset) // tick, text)
            for offset, text in zip(self._offsets, texts, strict=True)
            if text
        ]
        if self._new:
            self._sort()
        held = self._held
        if held:
            # Not beyond the last edge: a chip select that rises with it comes after it.
            if held[0][0] <= edges[0][0]:
                self._pass(edges[0][0])
            end = edges[-1][0]
            if held and held[0][0] < end:
                while held and held[0][0] < end:
                    moment, wire, level = held.popleft()
                    if text := self._change(wire, level):
                        edges.append((moment, text))
                edges.sort(key=lambda edge: edge[0])
        self._emit(edges)

    def _set_period(self, bit_period_fs: int) -> None:
        """Work out how long after a byte's start its sixteen edges and its end come."""
        if bit_period_fs < 4 * self._tick_fs:
            raise ValueError("the clock is too fast for the file's tick")
        self._period_fs = bit_period_fs
        half = bit_period_fs // 2
        self._offsets = [
            offset for place in range(8) for offset in _both(place * bit_period_fs, half)
        ] + [8 * bit_period_fs]

    def _sort(self) -> None:
        """Merge levels that came since the last byte into those that are held, by time."""
        self._held = deque(sorted([*self._held, *self._new], key=lambda item: item[0]))
        self._new.clear()

    def close(self, end_fs: int) -> None:
        """Write what is held, and the end of the recording.

        A level lasts until the next time stamp, so the last one comes after the last change:
        without it sigrok never sees the chip select rise, and drops the last transfer.
        """
        end = end_fs // self._tick_fs
        self._sort()
        self._pass(max(end, self._held[-1][0] if self._held else 0))
        end = max(end, self._now + 1)
        self._file.write(f"#{end}\n")
        self._now = end

    def _pass(self, until: int) -> None:
        """Write held levels up to and including a tick."""
        held = self._held
        edges: list[tuple[int, str]] = []
        while held and held[0][0] <= until:
            moment, wire, level = held.popleft()
            if text := self._change(wire, level):
                edges.append((moment, text))
        self._emit(edges)

    def _change(self, wire: str, level: int) -> str:
        if self._levels[wire] == level:
            return ""
        self._levels[wire] = level
        return f"{level}{self._codes[wire]}\n"

    def _emit(self, edges: list[tuple[int, str]]) -> None:
        now, parts = self._now, []
        for moment, text in edges:
            if moment != now:
                if moment < now:
                    raise ValueError("a record goes back in time")
                parts.append(f"#{moment}\n")
                now = moment
            parts.append(text)
        self._file.write("".join(parts))
        self._now = now
