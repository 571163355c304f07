"""Simulated lines: a CAN frame's bits by the standard's own figures, and links that fill a line.

No time of this machine is in it: what is asserted is the same everywhere.
"""

from __future__ import annotations

from itertools import groupby

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.frame import MAX_PAYLOAD_BYTES
from tools.benchmarks.lines import crc15, frame_bits, stuffed
from tools.benchmarks.link import BEGIN_S, BLOCKS, LINES, LineCase, line

by_name = {case.name.strip(): case for case in LINES}


def test_crc_15_has_its_published_check_value():
    # CRC RevEng catalogue, CRC-15/CAN
    assert crc15("".join(f"{octet:08b}" for octet in b"123456789")) == 0x059E


@given(st.text("01", max_size=200))
def test_no_six_bits_of_a_kind_and_the_stuff_bits_come_out_again(bits):
    on_wire = stuffed(bits)
    assert max((len(list(run)) for _, run in groupby(on_wire)), default=0) <= 5
    out, last, run, skip = [], "", 0, False
    for bit in on_wire:
        if skip:
            assert bit != last
            last, run, skip = bit, 1, False
            continue
        run = run + 1 if bit == last else 1
        last = bit
        out.append(bit)
        skip = run == 5
    assert "".join(out) == bits


@given(st.binary(max_size=8), st.integers(0, 0x7FF))
def test_a_classic_frame_is_within_the_standards_bounds(data, identifier):
    # ISO 11898-1: 44 bits and the data, three of silence, a stuff bit in four of all but the end
    least = 44 + 3 + 8 * len(data)
    assert least <= frame_bits(identifier, data) <= least + (34 + 8 * len(data) - 1) // 4


def test_frames_counted_by_hand():
    # 0 10101010101 0 0 0 1000, data 55…, and its CRC: only the three zeros and more are stuffed
    plain = f"{0x555 << 7 | 8:019b}" + "01010101" * 8
    expected = len(stuffed(plain + f"{crc15(plain):015b}")) + 13
    assert frame_bits(0x555, b"\x55" * 8) == expected
    assert expected - 111 <= 6, "next to nothing to stuff"
    assert frame_bits(0, bytes(8)) > frame_bits(0x555, b"\x55" * 8) + 12
    # CAN FD, 64 bytes: 22 bits of head, 512 of data, 4 of stuff count, 21 of CRC, 7 fixed, 13
    assert frame_bits(0x555, b"\x55" * 64, fd=True) == 22 + 512 + 4 + 21 + 7 + 13
    assert frame_bits(0x555, b"\x55" * 16, fd=True) == 22 + 128 + 4 + 17 + 6 + 13


def test_the_blocks_are_the_largest_payload():
    assert {row.size for row in BLOCKS.rows} == {MAX_PAYLOAD_BYTES}


@pytest.mark.parametrize(
    ("name", "of_bytes"),
    [
        ("serial 921 600 baud, one way", 0.96),
        ("serial 921 600 baud, both ways", 0.96),
        ("serial 115 200 baud, both ways", 0.85),
        ("CAN 1 Mbit/s, both ways", 0.80),
        ("window 15, payload=512", 0.80),
        ("CAN FD 1 Mbit/s, both ways", 0.90),
    ],
)
def test_the_link_fills_the_line_and_most_of_it_with_payload(name, of_bytes):
    figures = line(by_name[name], BEGIN_S + 1.0)
    assert figures["busy"] > 0.99
    assert of_bytes < figures["of_bytes"] < 1.01 * 247 / 256  # a message may end within or without


def test_latency_is_bridged_by_the_window():
    figures = line(by_name["with 16 ms (USB adapter), window 15"], BEGIN_S + 0.5)
    assert figures["busy"] > 0.9
    assert figures["again"] == 0


def test_the_same_line_gives_the_same_figures():
    case = LineCase("x", 921_600, latency_s=1e-3)
    assert line(case, 0.7) == line(case, 0.7)
