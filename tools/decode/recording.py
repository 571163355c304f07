"""Recordings of serial lines (`record:FILE:URL`), and raw octets as `cat /dev/ttyUSB0` keeps them.

The format is `spi_bus.transports.recording`'s. It stops at damage, because a replay must; here a
damaged line is an item with its offset, and the rest is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, Final

from spi_bus.transports.recording import HAPPENED, HEADER, RECEIVED, SENT, parse_line
from tools.decode.items import Item, Octets, What

LONGEST_LINE: Final = 1 << 18
_BLOCK: Final = 1 << 14
DIRECTIONS: Final = {SENT: "sent", RECEIVED: "received"}
FIRST_LINE: Final = HEADER.encode()


def read_log(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield what was sent and received, what happened to the line, and what cannot be read."""
    del name
    offset = len(file.readline(LONGEST_LINE))
    while raw := file.readline(LONGEST_LINE):
        here, offset = offset, offset + len(raw)
        if not raw.endswith(b"\n"):
            if len(raw) == LONGEST_LINE:
                yield _damaged(here, raw)
                while raw and not raw.endswith(b"\n"):
                    raw = file.readline(LONGEST_LINE)
                    offset += len(raw)
                continue
            text = "the last line has no end: the program that wrote it was stopped there"
            yield Item(What.ERROR, "truncated file", offset=here, text=text)
            return
        text = raw.decode("utf-8", "replace").rstrip("\r\n")
        if not text or text.startswith("#"):
            continue
        try:
            line = parse_line(text)
        except ValueError:
            yield _damaged(here, raw)
            continue
        time_s = line.time_us / 1e6
        if line.kind == HAPPENED:
            yield Item(What.LINE, line.text.split(":")[0], time_s, offset=here, text=line.text)
        else:
            yield Octets(line.data, DIRECTIONS[line.kind], time_s, here)


def read_raw(file: BinaryIO, name: str) -> Iterator[Octets | Item]:
    """Yield a file's bytes as they are."""
    del name
    offset = 0
    while data := file.read(_BLOCK):
        yield Octets(data, offset=offset, stride=1)
        offset += len(data)


def _damaged(offset: int, raw: bytes) -> Item:
    shown = raw[:40].decode("utf-8", "replace").strip()
    text = f"not a line of a recording: {shown!r}"
    return Item(What.ERROR, "damaged recording", offset=offset, text=text)
