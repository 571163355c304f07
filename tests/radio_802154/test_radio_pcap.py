"""The pcap: its octets by hand, and what Wireshark makes of a conversation of two chips."""

from __future__ import annotations

import io
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from radio_802154 import cc2420_registers as r
from radio_802154 import pcap, tinyos
from radio_802154.pcap import Capture
from radio_802154.tinyos import AmPacket

ACK = Capture(1_500_000_000_000_000, 1_500_352_000_000_000, 26, -40.5, bytes.fromhex("02006ae479"))


def test_file_header() -> None:
    assert pcap.global_header() == bytes.fromhex(
        "4d3cb2a1 0200 0400 00000000 00000000 ffff0000 1b010000"
    )


def test_record_octet_by_octet() -> None:
    expected = bytes.fromhex(
        "01000000 0065cd1d 41000000 41000000"  # 1.5 s; 60 octets of TAP header and 5 of MPDU
        "00 00 3c00"  # version, reserved, length
        "0000 0100 01000000"  # FCS type: 16 bit
        "0100 0400 000022c2"  # RSS −40.5 dBm
        "0300 0300 1a00 00 00"  # channel 26, page 0
        "0500 0800 002f685900000000"  # start of frame 1.5e9 ns
        "0600 0800 008e6d5900000000"  # end of frame
        "0a00 0100 ff000000"  # link quality
        "02006ae479"
    )
    ack = Capture(ACK.start_fs, ACK.end_fs, ACK.channel, ACK.rss_dbm, ACK.mpdu, lqi=255)
    assert pcap.record(ack) == expected


def test_frames_are_written_in_order_of_their_start() -> None:
    later = Capture(ACK.start_fs + 10**12, ACK.end_fs + 10**12, 11, 0.0, ACK.mpdu)
    file = io.BytesIO()
    assert pcap.write(file, [later, ACK]) == 2
    data = file.getvalue()[24:]
    (length,) = struct.unpack_from("<I", data, 8)
    assert data[: 16 + length] == pcap.record(ACK)


def conversation(world: Any, path: Path) -> int:
    """Five exchanges; the third frame goes to nobody."""
    a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2)
    for sequence in range(5):
        destination = 3 if sequence == 2 else 2
        message = AmPacket(destination, 1, 6, bytes(sequence * 10), sequence + 1)
        a.load(tinyos.encode(message))
        a.strobe(r.STXONCCA)
        world.run_us(8000)
        a.strobe(r.SFLUSHRX)
        b.strobe(r.SFLUSHRX)
    frames = [
        Capture(start, end, channel, power, octets)
        for end, (start, channel, _, power, octets) in world.air()
    ]
    with path.open("wb") as file:
        return pcap.write(file, frames)


@pytest.mark.oracle
def test_wireshark_pairs_acknowledgements_at_the_right_times(world: Any, tmp_path: Path) -> None:
    if shutil.which("tshark") is None:
        pytest.skip("tshark (Debian package tshark) is not installed")
    path = tmp_path / "radio.pcap"
    assert conversation(world, path) == 9
    fields = (
        *("wpan.fcs_ok", "wpan.frame_type", "wpan.seq_no", "wpan.ack_to", "wpan.ack_time"),
        *("wpan-tap.ch_num", "wpan-tap.rss"),
    )
    options = ["-E", "separator=;"]
    options += [part for name in fields for part in ("-e", name)]
    output = subprocess.run(
        ["tshark", "-o", "wpan.802154_ack_tracking:TRUE", "-T", "fields", *options, "-r", path],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    rows = [dict(zip(fields, line.split(";"), strict=True)) for line in output.splitlines()]
    assert [row["wpan.fcs_ok"] for row in rows] == ["1"] * 9
    kinds = [int(row["wpan.frame_type"], 16) for row in rows]
    assert kinds == [1, 2, 1, 2, 1, 1, 2, 1, 2]
    assert [row["wpan.seq_no"] for row in rows] == list("112234455")
    assert {row["wpan-tap.ch_num"] for row in rows} == {"11"}
    pairs = {row["wpan.ack_to"]: row["wpan.ack_time"] for row in rows if row["wpan.ack_to"]}
    # from start to start: airtime of the frame (6 + 11 + payload + 2 octets) and 192 µs
    expected = {}
    for frame, payload in ((1, 0), (3, 10), (6, 30), (8, 40)):
        expected[str(frame)] = (6 + 13 + payload) * 32e-6 + 192e-6
    assert pairs.keys() == expected.keys()
    for frame, seconds in expected.items():
        assert float(pairs[frame]) == pytest.approx(seconds, abs=1e-9)
