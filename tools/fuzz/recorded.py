"""Targets that read files, as `fishbed decode` does: without a file, from memory."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

from radio_802154.pcap import global_header
from tools.decode import hexdump, pcap, pcapng, recording, session, vcd
from tools.decode.files import FileKind, Reader
from tools.decode.items import Tally
from tools.decode.output import line, summary
from tools.errors import UserError
from tools.fuzz.forms import Run, all_of, one_of

MOST_ITEMS_PER_OCTET: Final = 40
"""Findings of a file for each of its bytes: what is yielded must not grow faster than the file."""

VCD_HEADER: Final = (
    b'$timescale 100 ns $end $var wire 1 ! SCK $end $var wire 1 " MOSI $end '
    b"$var wire 1 # MISO $end $var wire 1 $ CS $end $enddefinitions $end\n"
)
_NOWHERE: Final = Path("fuzz")


def reader(read: Reader, variant: session.Variant, head: bytes = b"") -> Run:
    """The octets behind `head`, read by one reader and decoded by one protocol's decoder."""
    kind = FileKind("fuzz", read)

    def run(data: bytes) -> None:
        octets = head + data
        try:
            parts = read(io.BytesIO(octets), "fuzz")
        except UserError as error:
            _one_line(error)
            return
        running = session.Session(_NOWHERE, kind, variant, parts, io.BytesIO())
        _drain(running, len(octets))

    return run


def _drain(running: session.Session, length: int) -> None:
    count = 0
    for item in running.items():
        count += 1
        assert line(item).isprintable()
        assert 0 <= item.offset <= length
    assert count <= MOST_ITEMS_PER_OCTET * (1 + length)
    assert summary(running.tally)
    running.tally.as_dict()


def _whole_capture(data: bytes) -> None:
    if data[:4] in pcap.MAGICS:
        reader(pcap.read, session.VARIANTS[-1])(data)


def _few_repeats(file: Any, name: str) -> Any:
    return hexdump.read_with_offsets(file, name, most_repeated=256)


fuzz_pcap: Final = one_of(
    _whole_capture,
    *(
        reader(pcap.read, session.VARIANTS[-1], global_header()[:20] + kind.to_bytes(4, "little"))
        for kind in (pcap.WITH_FCS, pcap.WITHOUT_FCS, pcap.TAP)
    ),
)
"""Captures: the octets as the file, or as the records of a file of each link type."""

_SECTION: Final = bytes.fromhex("0a0d0d0a1c0000004d3c2b1a01000000ffffffffffffffff1c000000")
_INTERFACE: Final = bytes.fromhex("0100000014000000e60000000001000014000000")

fuzz_pcapng: Final = one_of(
    reader(pcapng.read, session.VARIANTS[-1]),
    reader(pcapng.read, session.VARIANTS[-1], _SECTION),
    reader(pcapng.read, session.VARIANTS[-1], _SECTION + _INTERFACE),
)
"""The newer captures: the octets as the file, behind its first block, or as its packets."""

fuzz_vcd: Final = one_of(
    reader(vcd.read, session.VARIANTS[0]), reader(vcd.read, session.VARIANTS[0], VCD_HEADER)
)
"""Waveforms: the octets as the file, or as the changes of four wires."""

fuzz_hexdump: Final = all_of(
    reader(_few_repeats, session.VARIANTS[0]), reader(hexdump.read_plain, session.VARIANTS[1])
)
"""Hex dumps with and without offsets."""

fuzz_recording: Final = one_of(
    *(
        reader(recording.read_log, variant, recording.FIRST_LINE + b"\n")
        for variant in session.VARIANTS
    )
)
"""Recordings of lines, through one of the protocols."""


def fuzz_file(data: bytes) -> None:
    """Any file: recognised by its content and decoded, or refused in one line."""
    try:
        running = session.from_file(_NOWHERE, io.BytesIO(data), session.AUTO)
    except UserError as error:
        _one_line(error)
        return
    for variant in session.VARIANTS:
        variant.make(Tally())
    for _ in running.items():
        pass


def _one_line(error: UserError) -> None:
    assert "\n" not in str(error)
