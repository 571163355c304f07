"""Captures of blocks: literal bytes in both orders, the words of a pcap, damage, refusals."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from radio_802154 import fcs, tinyos
from radio_802154 import messages as radio
from radio_802154.pcap import Capture, global_header, record
from tools.cli import main

AM, PAYLOAD = radio.encode(radio.TargetCommand(7, 0.5, -0.5))


def mpdu(number: int) -> bytes:
    return tinyos.encode(tinyos.AmPacket(1, 0, AM, PAYLOAD, sequence=number))


def block(order: str, kind: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", 12 + len(body))
    return struct.pack(order + "I", kind) + length + body + length


def section(order: str) -> bytes:
    return block(order, 0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1))


def interface(order: str, link_type: int = 230, options: bytes = b"") -> bytes:
    return block(order, 1, struct.pack(order + "HHI", link_type, 0, 256) + options)


def packet(order: str, time: int, data: bytes, number: int = 0, cut: int = 0) -> bytes:
    head = struct.pack(
        order + "IIIII", number, time >> 32, time & 0xFFFFFFFF, len(data), len(data) + cut
    )
    return block(order, 6, head + data + bytes(-len(data) % 4))


def nanoseconds(order: str) -> bytes:
    return struct.pack(order + "HHB3x", 9, 1, 9) + struct.pack(order + "HH", 0, 0)


def said(path: Path, capsys: pytest.CaptureFixture[str], *more: str) -> list[str]:
    code = main(["decode", str(path), *more])
    assert code == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_units_of_time_and_blocks_that_say_nothing(
    order: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x"
    path.write_bytes(
        section(order)
        + interface(order)
        + interface(order, options=nanoseconds(order))
        + block(order, 5, bytes(40))  # statistics
        + packet(order, 2_500_000, mpdu(1))
        + packet(order, 3_250_000_001, mpdu(2), 1)
        + block(order, 3, struct.pack(order + "I", len(mpdu(3))) + mpdu(3))  # simple: no time
        + packet(order, 5_000_000, mpdu(5), cut=3)
    )
    lines = said(path, capsys)
    assert lines[0].endswith("packet capture (pcapng), 802.15.4")
    assert [line.split()[0] for line in lines[1:3]] == ["2.500000", "3.250000"]
    assert lines[3].split()[0].startswith("@"), "a simple packet has no time"
    assert sum("TargetCommand" in line and "number" in line for line in lines) == 4
    assert any("1 of 0x0000 before number 5" in line for line in lines)
    assert any("of its" in line and "cut frame" in line for line in lines)


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("editcap") is None, reason="absent: editcap")
def test_what_editcap_makes_of_a_pcap_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = tmp_path / "old.pcap", tmp_path / "new.pcapng"
    captures = (
        Capture(
            number * 10**15, number * 10**15 + 10**12, 26, -40.0, fcs.append_fcs(mpdu(number)), 100
        )
        for number in (1, 2, 2, 6)
    )
    old.write_bytes(global_header() + b"".join(map(record, captures)))
    subprocess.run(["editcap", "-F", "pcapng", old, new], check=True, capture_output=True)
    assert new.read_bytes()[:4] == b"\x0a\x0d\x0d\x0a"
    told = [[re.sub(r"@\d+", "", line) for line in said(path, capsys)] for path in (old, new)]
    assert told[0][1:] == told[1][1:]
    assert any("6.000000" in line for line in told[0])


def test_damage_is_left_out_and_told_and_the_rest_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = [packet("<", number, mpdu(number)) for number in range(4)]
    hurt = bytearray(good[1])
    hurt[4] ^= 0x40  # its length
    path = tmp_path / "x"
    head = section("<") + interface("<")
    path.write_bytes(head + good[0] + bytes(hurt) + good[2] + good[3][:-5])
    lines = said(path, capsys)
    assert sum("TargetCommand" in line and "number" in line for line in lines) == 2
    place = f"@{len(head) + len(good[0])}"
    assert any(place in line and f"{len(hurt)} bytes are no block" in line for line in lines)
    assert any("begin of a block whose end is missing" in line for line in lines)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (section("<"), "without an interface"),
        (section("<") + interface("<", 1), "link type 1 is not IEEE 802.15.4"),
    ],
)
def test_a_capture_of_something_else_is_one_line_and_2(
    data: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x"
    path.write_bytes(data)
    assert main(["decode", str(path)]) == 2
    out, err = capsys.readouterr()
    assert words in err
    assert not out
    assert err.count("\n") == 1


def test_a_protocol_that_was_asked_for_and_is_not_there_is_told_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.bin"
    path.write_bytes(bytes.fromhex("7e 43 26 3b 1c 7e") * 3)
    assert main(["decode", str(path), "--protocol", "tinyos"]) == 0
    assert capsys.readouterr().err == ""
    for more in ([], ["--json"], ["--summary"]):
        assert main(["decode", str(path), "--protocol", "link", *more]) == 1
        out, err = capsys.readouterr()
        assert out
        assert "no intact frame of link in 18 octets" in err
        assert err.count("\n") == 1
