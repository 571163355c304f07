"""What kind of file it is, by its content and never by its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from tools.decode import hexdump, pcap, pcapng, recording, vcd
from tools.decode.items import Item, Octets
from tools.errors import UserError

LOOK: Final = 4096
"""Bytes of a file that tell what it is."""

Reader = Callable[[BinaryIO, str], Iterator[Octets | Item]]


@dataclass(frozen=True, slots=True)
class FileKind:
    """A row of the table: a name, and the reader."""

    name: str
    read: Reader
    whole_frames: bool = False
    """A capture of frames, with nothing but 802.15.4 in it."""


CAPTURE: Final = FileKind("packet capture", pcap.read, whole_frames=True)
NEW_CAPTURE: Final = FileKind("packet capture (pcapng)", pcapng.read, whole_frames=True)
RECORDING: Final = FileKind("recording", recording.read_log)
WAVEFORM: Final = FileKind("SPI waveform", vcd.read)
DUMP: Final = FileKind("hex dump", hexdump.read_with_offsets)
PLAIN: Final = FileKind("plain hex", hexdump.read_plain)
RAW: Final = FileKind("raw octets", recording.read_raw)

_PACKED: Final = {b"\x1f\x8b": "gunzip", b"BZh": "bunzip2", b"\xfd7zXZ": "unxz", b"PK": "unzip"}


def detect(head: bytes, name: str) -> FileKind:
    """Return what a file that begins so is.

    Raises:
        UserError: it is empty, or nothing that is read here, with what to do.

    """
    if not head:
        raise UserError(f"{name} is empty")
    if head[:4] in pcap.MAGICS:
        return CAPTURE
    if head[:4] == pcapng.MAGIC:
        return NEW_CAPTURE
    for magic, program in _PACKED.items():
        if head.startswith(magic):
            raise UserError(f"{name} is compressed: {program} it first")
    if head.startswith(recording.FIRST_LINE):
        return RECORDING
    if head.lstrip().startswith(vcd.HEADER_WORDS):
        return WAVEFORM
    if not _is_text(head):
        return RAW
    lines = [line for line in head.splitlines() if line.strip() and not line.startswith(b"#")]
    first = lines[0] if lines else b""
    found = hexdump.with_offset(first)
    if found is not None and found[1]:
        return DUMP
    if hexdump.WORDS.fullmatch(first.rstrip()):
        raise UserError(f"{name} is a dump of words, each with its octets swapped: hexdump -C")
    if hexdump.plain(first) is not None or (len(lines) == 1 and hexdump.plain(first[:-1])):
        return PLAIN
    shown = first[:40].decode("utf-8", "ignore").strip()
    raise UserError(
        f"{name} is text, and neither a recording, a VCD nor a hex dump (of xxd or hexdump -C); "
        f"it begins {shown!r}"
    )


def _is_text(head: bytes) -> bool:
    """Whether it is UTF-8 without control characters; its last one may be cut."""
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 3 or not error.start:
            return False
        text = head[: error.start].decode("utf-8")
    return all(letter.isprintable() or letter in "\t\n\r\f" for letter in text)


def paths(names: list[str]) -> list[Path]:
    """Return the files meant: a run folder stands for its waveform and its capture.

    Raises:
        UserError: no such file, or a folder without either.

    """
    found = []
    for name in names:
        path = Path(name)
        if not path.is_dir():
            found.append(path)
            continue
        inside = [path / part for part in ("spi.vcd", "radio.pcap") if (path / part).is_file()]
        if not inside:
            raise UserError(f"{name} is a folder without spi.vcd and radio.pcap: name a file")
        found += inside
    return found


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading.

    Raises:
        UserError: it cannot be read.

    """
    try:
        return path.open("rb")
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror}): is the path right?") from None
