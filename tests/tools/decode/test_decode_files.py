"""Readers: literal files of every kind, damaged ones, and what each is recognised as."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radio_802154.fcs import append_fcs
from radio_802154.pcap import Capture, global_header, record
from tools.decode import hexdump, pcap, recording, vcd
from tools.decode.files import (
    CAPTURE,
    DUMP,
    NEW_CAPTURE,
    PLAIN,
    RAW,
    RECORDING,
    WAVEFORM,
    FileKind,
    detect,
)
from tools.decode.items import Item, Octets, What
from tools.errors import UserError
from tools.records.vcd import VcdWriter

FRAME = append_fcs(bytes.fromhex("61 88 07 22 00 01 00 02 00 3f 06 aa"))


def octets(kind: FileKind, data: bytes) -> list[Octets]:
    return [p for p in kind.read(io.BytesIO(data), "f") if isinstance(p, Octets)]


def findings(kind: FileKind, data: bytes) -> list[Item]:
    return [p for p in kind.read(io.BytesIO(data), "f") if isinstance(p, Item)]


# --- what it is --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (global_header(), CAPTURE),
        (b"\xa1\xb2\xc3\xd4" + bytes(20), CAPTURE),
        (b"fishbed-transport-log 1\n# x\n", RECORDING),
        (b"\n$date today $end", WAVEFORM),
        (b"00000000: 0003 1110  ....\n", DUMP),
        (b"00000000  00 03 11 10  |....|\n", DUMP),
        (b"7e 44 00 ff 9d df 7e\n", PLAIN),
        (b"7E44 00FF,0x9D:DF\n7e\n", PLAIN),
        (b"00031110\n", PLAIN),
        (b"\x7e\x44\x00", RAW),
        (b"\x0a\x0d\x0d\x0a", NEW_CAPTURE),
    ],
)
def test_a_file_is_recognised_by_its_content(head: bytes, kind: FileKind) -> None:
    assert detect(head, "f") is kind


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"", "is empty"),
        (b"0000000 0300 7011 0301 0744\n", "hexdump -C"),
        (b"\x1f\x8b\x08\x00", "gunzip"),
        (b"$GPRMC,1,2\n", "neither a recording"),
        (b"123\n45\n", "neither a recording"),
        ("# Wörter\n\nand words: −0.1 m\n".encode()[:-5], "begins 'and words"),
    ],
)
def test_what_is_not_read_is_said_in_one_line(head: bytes, words: str) -> None:
    with pytest.raises(UserError, match=words):
        detect(head, "f")


# --- captures ------------------------------------------------------------------------------------


def classic(
    link_type: int, frames: list[bytes], order: str = "<", magic: int = 0xA1B2C3D4
) -> bytes:
    out = struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65535, link_type)
    for index, frame in enumerate(frames):
        out += struct.pack(order + "IIII", 100 + index, 250_000, len(frame), len(frame)) + frame
    return out


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("link_type", [195, 230])
def test_plain_link_types(link_type: int, order: str) -> None:
    (found,) = octets(CAPTURE, classic(link_type, [FRAME], order))
    assert found.data == FRAME
    assert found.time_s == 100.25
    assert found.has_fcs == (link_type == 195)
    assert found.offset == 24


def test_tap_is_taken_apart() -> None:
    data = global_header() + record(Capture(2 * 10**15, 3 * 10**15, 26, -40.0, FRAME, 99))
    (found,) = octets(CAPTURE, data)
    assert (found.data, found.time_s, found.has_fcs) == (FRAME, 2.0, True)
    assert found.note == "-40 dBm, channel 26"


def test_tap_without_fcs_type_has_no_fcs() -> None:
    (found,) = octets(CAPTURE, classic(283, [struct.pack("<BBH", 0, 0, 4) + FRAME[:-2]]))
    assert not found.has_fcs


def test_other_link_types_and_cut_headers_are_refused() -> None:
    with pytest.raises(UserError, match="link type 1 is not"):
        pcap.read(io.BytesIO(classic(1, [])), "f")
    with pytest.raises(UserError, match="cut off"):
        pcap.read(io.BytesIO(global_header()[:20]), "f")


def test_a_damaged_record_is_skipped_and_told_with_its_offset() -> None:
    data = bytearray(classic(195, [FRAME] * 4))
    size = 16 + len(FRAME)
    second = 24 + size
    data[second + 8 : second + 12] = b"\xff\xff\xff\xff"
    assert len(octets(CAPTURE, bytes(data))) == 3
    (error,) = findings(CAPTURE, bytes(data))
    assert (error.what, error.offset) == (What.ERROR, second)
    assert str(size) in error.text


def test_a_truncated_capture_is_told() -> None:
    data = classic(195, [FRAME] * 2)[:-3]
    assert len(octets(CAPTURE, data)) == 1
    assert findings(CAPTURE, data)[0].name == "truncated file"


# --- waveforms -----------------------------------------------------------------------------------

# One octet by hand: 0xA5 from the master, 0x3C from the slave; 1 µs ticks, CLK for SCK.
HEADER = (
    "$timescale 1 us $end\n$scope module top $end\n$var wire 1 a CLK $end\n"
    "$var wire 1 b mosi $end $var wire 1 c MISO $end\n$var wire 1 d cs $end\n"
    "$upscope $end\n$enddefinitions $end\n#0\n$dumpvars\n0a 0b xc 1d\n$end\n"
)


def by_hand(out: int, back: int) -> str:
    lines = ["#10", "0d"]
    time = 10
    for place in range(7, -1, -1):
        lines += [f"#{time + 1}", f"{out >> place & 1}b", f"{back >> place & 1}c"]
        lines += [f"#{time + 2}", "1a", f"#{time + 3}", "0a"]
        time += 4
    return "\n".join([*lines, f"#{time + 5}", "1d", ""])


def test_a_waveform_written_by_hand() -> None:
    master, slave = octets(WAVEFORM, (HEADER + by_hand(0xA5, 0x3C)).encode())
    assert (master.direction, master.data, slave.data) == ("master", b"\xa5", b"\x3c")
    assert master.time_s == pytest.approx(12e-6)


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255)), max_size=20))
def test_our_own_waveforms(sent: list[tuple[int, int]]) -> None:
    text = io.StringIO()
    writer = VcdWriter(text, [("CS", 1), ("READY", 0)])
    writer.level(10**9, "CS", 0)
    for index, (out, back) in enumerate(sent):
        writer.byte(2 * 10**9 + index * 32 * 10**9, 4 * 10**9, out, back)
    writer.level(10**12, "CS", 1)
    writer.close(2 * 10**12)
    found = octets(WAVEFORM, text.getvalue().encode())
    for column, direction in enumerate(("master", "slave")):
        data = b"".join(part.data for part in found if part.direction == direction)
        assert data == bytes(pair[column] for pair in sent)


def test_clocks_without_chip_select_are_not_for_this_slave() -> None:
    text = HEADER + by_hand(0xA5, 0x3C).replace("0d", "1d")
    assert octets(WAVEFORM, text.encode()) == []


def test_an_octet_cut_by_chip_select_is_told() -> None:
    text = HEADER + by_hand(0xFF, 0)[: by_hand(0xFF, 0).index("#25")] + "#90\n1d\n#91\n"
    (error,) = findings(WAVEFORM, text.encode())
    assert error.name == "broken octet"
    assert error.text.startswith("4 bits")


def test_damage_in_a_waveform_is_told_and_passed() -> None:
    text = HEADER + "#7\n#5\n?junk?\n#x\n" + by_hand(0xA5, 0x3C)
    assert [part.data for part in octets(WAVEFORM, text.encode())] == [b"\xa5", b"\x3c"]
    found = findings(WAVEFORM, text.encode())
    assert len(found) == 3
    assert all(item.offset >= len(HEADER) for item in found)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("$timescale 1 us $end\n", "no end"),
        ("$enddefinitions $end\n", "timescale"),
        ("$timescale 1 us $end $var wire 1 a X $end $enddefinitions $end\n", "there are X"),
    ],
)
def test_waveforms_that_are_no_spi_are_refused(text: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        vcd.read(io.BytesIO(text.encode()), "f")


# --- hex dumps -----------------------------------------------------------------------------------

CONTENT = bytes(range(0x30, 0x45))
# `xxd` and `hexdump -C` of CONTENT, as Debian's programs print them
XXD = b"""00000000: 3031 3233 3435 3637 3839 3a3b 3c3d 3e3f  0123456789:;<=>?
00000010: 4041 4243 44                             @ABCD
"""
CANONICAL = b"""00000000  30 31 32 33 34 35 36 37  38 39 3a 3b 3c 3d 3e 3f  |0123456789:;<=>?|
00000010  40 41 42 43 44                                    |@ABCD|
00000015
"""


@pytest.mark.parametrize("dump", [XXD, CANONICAL], ids=["xxd", "hexdump -C"])
def test_dumps_with_offsets(dump: bytes) -> None:
    assert b"".join(part.data for part in octets(DUMP, dump)) == CONTENT
    assert findings(DUMP, dump) == []


def test_a_star_repeats_the_line_before() -> None:
    dump = (
        b"00000000  00 00 00 00 00 00 00 00  00 00 00 00 00 00 00 00  |................|\n"
        b"*\n00000040  41                                                |A|\n00000041\n"
    )
    assert b"".join(part.data for part in octets(DUMP, dump)) == bytes(64) + b"A"


def test_a_star_for_the_whole_world_is_a_gap() -> None:
    dump = b"00000000  00 00  |..|\n*\nfffffffffffffff0  41  |A|\n"
    assert sum(len(part.data) for part in octets(DUMP, dump)) == 3
    assert findings(DUMP, dump)[0].what is What.GAP


def test_missing_and_damaged_lines_are_told() -> None:
    dump = XXD.replace(b"00000010", b"00000020") + b"oops\n"
    gap, error = findings(DUMP, dump)
    assert (gap.what, gap.offset) == (What.GAP, XXD.index(b"\n") + 1)
    assert "16 octets" in gap.text
    assert (error.what, error.offset) == (What.ERROR, len(XXD))


def test_plain_hex_in_any_dress() -> None:
    dump = b"# remark\n7e4400\n0x7E, 0x44\n7e:44\nnot hex\n"
    assert [part.data for part in octets(PLAIN, dump)] == [b"\x7eD\0", b"\x7eD", b"\x7eD"]
    assert findings(PLAIN, dump)[0].offset == dump.index(b"not")


@given(st.binary(max_size=400).filter(lambda data: b"\n" not in data))
def test_any_line_takes_little_time(data: bytes) -> None:
    hexdump.with_offset(b"00000000: " + data * 20)
    hexdump.with_offset(b"00000000  " + data * 20)


# --- recordings ----------------------------------------------------------------------------------


def test_a_recording_with_damage_and_a_torn_end() -> None:
    text = (
        b"fishbed-transport-log 1\n# serial\n0.000000 > 00 01\n0.5 > 00\n1.000000 < zz\n"
        b"1.730201 ! down: serial: gone\n2.000000 < ff\n3.000000 < aa"
    )
    found = octets(RECORDING, text)
    assert [(part.time_s, part.direction, part.data) for part in found] == [
        (0.0, "sent", b"\0\x01"),
        (2.0, "received", b"\xff"),
    ]
    names = [item.name for item in findings(RECORDING, text)]
    assert names == ["damaged recording", "damaged recording", "down", "truncated file"]
    assert findings(RECORDING, text)[0].offset == text.index(b"0.5")


def test_recordings_are_those_of_the_recorder(tmp_path: Path) -> None:
    from spi_bus.transports import OpenContext, open_transport
    from spi_bus.transports.recording import read_log

    path = tmp_path / "x.log"
    context = OpenContext()
    other = open_transport("pair:a", context)
    line = open_transport(f"record:{path}:pair:a", context)
    line.write(b"\x01\x02")
    other.write(b"\x03")
    assert line.read() == b"\x03"
    line.close()
    other.close()
    ours = octets(RECORDING, path.read_bytes())
    assert [part.data for part in ours] == [entry.data for entry in read_log(path)]
    assert [part.direction for part in ours] == ["sent", "received"]


def test_lines_without_end_take_no_memory() -> None:
    text = recording.FIRST_LINE + b"\n0.000000 > " + b"00 " * 400_000 + b"\n1.000000 < 01\n"
    assert [part.data for part in octets(RECORDING, text)] == [b"\x01"]
