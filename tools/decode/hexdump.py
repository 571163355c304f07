"""Hex dumps: `xxd`, `hexdump -C`, and plain hexadecimal, a line at a time.

In the first two each line says its offset, so that what is missing shows as a gap. A `*` of
`hexdump -C` stands for lines like the one before; where it would stand for more than 16 MiB it is
reported as a gap. In plain hexadecimal octets may be parted by blanks, commas, colons, or 0x; a
line is also taken as a whole frame by protocols that need one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import BinaryIO, Final

from tools.decode.items import Item, Octets, What

LONGEST_LINE: Final = 1 << 16
MOST_REPEATED: Final = 1 << 24
_BLOCK: Final = 4096
# Every octet is one turn of the inner group, so that no line takes more than linear time.
XXD: Final = re.compile(rb"([0-9a-fA-F]{4,16}): ((?:[0-9a-fA-F]{2} ?)+)(?: .*)?")
CANONICAL: Final = re.compile(rb"([0-9a-fA-F]{4,16})(?:  ((?:[0-9a-fA-F]{2} {0,2})+))?")
WORDS: Final = re.compile(rb"[0-9a-f]{7}(?: [0-9a-f]{4}){1,8}")
"""`hexdump` without -C: numbers of two octets in the machine's order."""
_SEPARATORS: Final = re.compile(rb"[\s,:;]+|0[xX]")
_HEX: Final = re.compile(rb"(?:[0-9a-fA-F]{2})+")


def plain(line: bytes) -> bytes | None:
    """Return the octets of a line of plain hexadecimal; None if it is none."""
    text = _SEPARATORS.sub(b"", line)
    return bytes.fromhex(text.decode("ascii")) if _HEX.fullmatch(text) else None


def with_offset(line: bytes) -> tuple[int, bytes] | None:
    """Return offset and octets of a line of `xxd` or `hexdump -C`; None if it is neither."""
    line = line.rstrip()
    match = XXD.fullmatch(line)
    if match is None:
        head, bar, _ = line.partition(b"|")
        match = CANONICAL.fullmatch(head.rstrip() if bar else line)
    if match is None:
        return None
    return int(match[1], 16), bytes.fromhex((match[2] or b"").decode("ascii"))


def _lines(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while line := file.readline(LONGEST_LINE):
        yield offset, line
        offset += len(line)


def read_plain(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield the octets of each line of plain hexadecimal."""
    del name
    for offset, line in _lines(file):
        if not line.strip() or line.startswith(b"#"):
            continue
        data = plain(line)
        if data is None:
            yield _damaged(offset, line)
        else:
            yield Octets(data, offset=offset)


def read_with_offsets(
    file: BinaryIO, name: str, most_repeated: int = MOST_REPEATED
) -> Iterator[Octets | Item]:
    """Yield the octets of each line of `xxd` or `hexdump -C`, and what is missing between them."""
    del name
    expected: int | None = None
    last = b""
    repeat = False
    for offset, line in _lines(file):
        if not line.strip():
            continue
        if line.strip() == b"*":
            repeat = True
            continue
        found = with_offset(line)
        if found is None:
            yield _damaged(offset, line)
            continue
        address, data = found
        missing = 0 if expected is None else address - expected
        if repeat and last and 0 < missing <= most_repeated and missing % len(last) == 0:
            for start in range(0, missing, _BLOCK):
                lines = -(-min(_BLOCK, missing - start) // len(last))
                yield Octets((last * lines)[: missing - start], offset=offset)
        elif missing:
            verb = "are missing" if missing > 0 else "come a second time"
            text = f"{abs(missing)} octets before address 0x{address:x} {verb}"
            yield Item(What.GAP, "octets missing", offset=offset, text=text)
        repeat = False
        expected = address + len(data)
        if data:
            last = data
            yield Octets(data, offset=offset)


def _damaged(offset: int, line: bytes) -> Item:
    shown = line[:32].decode("ascii", "replace").strip()
    return Item(What.ERROR, "damaged dump", offset=offset, text=f"no line of a dump: {shown!r}")
