"""`fishbed decode` against other programs: sigrok's bytes, tshark's frames, xxd's and hexdump's."""

from __future__ import annotations

import io
import shutil
import struct
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radio_802154 import mac
from radio_802154.fcs import append_fcs
from tools.decode.files import CAPTURE, DUMP, PLAIN, WAVEFORM, detect
from tools.decode.items import Octets
from tools.decode.session import AUTO, from_file
from tools.records.vcd import VcdWriter

pytestmark = pytest.mark.oracle


def needs(program: str) -> pytest.MarkDecorator:
    absent = shutil.which(program) is None
    return pytest.mark.skipif(absent, reason=f"{program} is not installed")


def said(*command: str, feed: bytes = b"") -> bytes:
    return subprocess.run(command, input=feed, capture_output=True, check=True).stdout


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(("xxd",), marks=needs("xxd")),
        pytest.param(("xxd", "-g1", "-c", "24"), marks=needs("xxd")),
        pytest.param(("xxd", "-p"), marks=needs("xxd")),
        pytest.param(("hexdump", "-C"), marks=needs("hexdump")),
    ],
    ids=lambda command: " ".join(command),
)
@settings(max_examples=15, deadline=None)
@given(data=st.binary(min_size=1, max_size=90) | st.integers(1, 90).map(bytes))
def test_dumps_of_the_real_programs(command: tuple[str, ...], data: bytes) -> None:
    dump = said(*command, feed=data)
    kind = detect(dump, "f")
    assert kind is (PLAIN if "-p" in command else DUMP)
    parts = list(kind.read(io.BytesIO(dump), "f"))
    assert all(isinstance(part, Octets) for part in parts)
    assert b"".join(part.data for part in parts if isinstance(part, Octets)) == data


@needs("sigrok-cli")
@pytest.mark.parametrize(("line", "direction"), [("mosi", "master"), ("miso", "slave")])
def test_sigrok_reads_the_same_octets(line: str, direction: str, tmp_path: Path) -> None:
    path = tmp_path / "x.vcd"
    with path.open("w") as file:
        writer = VcdWriter(file, [("CS", 1)])
        writer.level(10**9, "CS", 0)
        for index in range(64):
            out, back = 37 * index & 0xFF, 91 * index & 0xFF
            writer.byte(2 * 10**9 + index * 40 * 10**9, 4 * 10**9, out, back)
        writer.level(3 * 10**12, "CS", 1)
        writer.close(4 * 10**12)
    wiring = "spi:clk=SCK:mosi=MOSI:miso=MISO:cs=CS"
    text = said("sigrok-cli", "-I", "vcd", "-i", str(path), "-P", wiring, "-A", f"spi={line}-data")
    theirs = bytes(int(row.split()[-1], 16) for row in text.splitlines())
    with path.open("rb") as binary:
        parts = list(WAVEFORM.read(binary, "f"))
    ours = b"".join(p.data for p in parts if isinstance(p, Octets) and p.direction == direction)
    assert len(ours) == 64
    assert ours == theirs


@needs("tshark")
@pytest.mark.parametrize("link_type", [195, 230])
def test_tshark_reads_the_same_frames(link_type: int, tmp_path: Path) -> None:
    frames = [
        mac.encode(mac.data_frame(n, mac.Address(0x22, 1), mac.Address(0x22, n), bytes(n)))
        for n in range(2, 8)
    ]
    if link_type == 195:
        frames = [append_fcs(frame) for frame in frames]
        frames[2] = frames[2][:-1] + bytes((frames[2][-1] ^ 1,))
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link_type)
    for frame in frames:
        data += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    path = tmp_path / "x.pcap"
    path.write_bytes(data)
    names = ("wpan.seq_no", "wpan.src16", "wpan.fcs_ok")
    fields = [word for name in names for word in ("-e", name)]
    rows = [
        r.split() for r in said("tshark", "-r", str(path), "-T", "fields", *fields).splitlines()
    ]
    good = [row for row in rows if row[2:] not in ([b"0"], [b"False"])]
    theirs = [(int(row[0]), int(row[1], 16)) for row in good]
    session = from_file(path, io.BytesIO(data), AUTO)
    assert session.kind is CAPTURE
    items = [item for item in session.items() if item.name == "data"]
    ours = [(item.header["sequence"], int(item.text.split()[0], 16)) for item in items]
    assert ours == theirs
    assert len(ours) == (5 if link_type == 195 else 6)
    assert session.tally.crc_errors == 6 - len(ours)
