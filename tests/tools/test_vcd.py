"""The waveform: every edge in its place, and sigrok reads the very bytes that were written."""

from __future__ import annotations

import io
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.records.vcd import VcdWriter

BIT_FS = 3_814_697_265  # 1/262144 s
WIRES = (("CS", 1), ("READY", 0))


def write(frames: list[list[tuple[int, int]]], gap_fs: int = 5 * 10**9) -> tuple[str, int]:
    """Frames of bytes with chip select around each; returns the file and its end."""
    file = io.StringIO()
    writer = VcdWriter(file, WIRES)
    now = 10**12
    for frame in frames:
        writer.level(now, "CS", 0)
        now += 4 * 10**9
        for mosi, miso in frame:
            writer.byte(now, BIT_FS, mosi, miso)
            now += 8 * BIT_FS + gap_fs
        writer.level(now, "CS", 1)
        now += 10**12
    writer.close(now)
    return file.getvalue(), now


def changes(text: str) -> list[tuple[int, str, int]]:
    """(tick, wire, level) of every change after the initial values."""
    names = {}
    found = []
    tick = 0
    for line in text.splitlines():
        if line.startswith("$var"):
            names[line.split()[3]] = line.split()[4]
        elif line.startswith("#"):
            tick = int(line[1:])
        elif line and line[0] in "01" and tick:
            found.append((tick, names[line[1]], int(line[0])))
    return found


def decode(text: str) -> list[tuple[int, int]]:
    """Bytes by sampling at rising clock edges, as SPI mode 0 says."""
    level = {"MOSI": 0, "MISO": 0}
    bits: list[tuple[int, int]] = []
    for _, wire, value in changes(text):
        if wire in level:
            level[wire] = value
        elif wire == "SCK" and value:
            bits.append((level["MOSI"], level["MISO"]))
    octets = [bits[start : start + 8] for start in range(0, len(bits), 8)]
    return [
        (
            sum(bit[0] << (7 - place) for place, bit in enumerate(octet)),
            sum(bit[1] << (7 - place) for place, bit in enumerate(octet)),
        )
        for octet in octets
    ]


octets = st.integers(0, 255)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(st.tuples(octets, octets), max_size=12), max_size=4))
def test_bytes_come_back_from_the_edges(frames: list[list[tuple[int, int]]]) -> None:
    text, _ = write(frames)
    assert decode(text) == [pair for frame in frames for pair in frame]


def test_edges_of_a_byte_are_half_a_bit_apart_and_data_is_still_at_rising_edges() -> None:
    text, _ = write([[(0xA5, 0x3C)]])
    clock = [tick for tick, wire, _ in changes(text) if wire == "SCK"]
    assert len(clock) == 16
    assert {b - a for a, b in pairwise(clock)} <= {19, 20}
    start = (10**12 + 4 * 10**9) // 10**8
    assert clock[0] == (10**12 + 4 * 10**9 + BIT_FS // 2) // 10**8
    data = [tick for tick, wire, _ in changes(text) if wire in ("MOSI", "MISO")]
    assert data[0] == start
    assert not set(data) & set(clock[::2])


def test_levels_during_a_byte_are_merged_in_order_of_time() -> None:
    file = io.StringIO()
    writer = VcdWriter(file, WIRES)
    writer.level(2 * BIT_FS + 10**9, "READY", 1)
    writer.level(10**12, "READY", 0)
    writer.byte(10**9, BIT_FS, 0xFF, 0x00)
    writer.close(2 * 10**12)
    ticks = [tick for tick, _, _ in changes(file.getvalue())]
    assert ticks == sorted(ticks)
    ready = [change for change in changes(file.getvalue()) if change[1] == "READY"]
    assert ready == [((2 * BIT_FS + 10**9) // 10**8, "READY", 1), (10**4, "READY", 0)]


def test_what_cannot_be_drawn_is_refused() -> None:
    writer = VcdWriter(io.StringIO(), WIRES)
    with pytest.raises(ValueError, match="no wire"):
        writer.level(0, "SDA", 1)
    with pytest.raises(ValueError, match="too fast"):
        writer.byte(10**9, 10**8, 0, 0)
    writer.byte(10**12, BIT_FS, 1, 1)
    with pytest.raises(ValueError, match="back in time"):
        writer.byte(10**9, BIT_FS, 1, 1)


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("sigrok-cli") is None, reason="sigrok-cli is not installed")
def test_sigrok_decodes_the_same_bytes(tmp_path: Path) -> None:
    frames = [[(n * 7 % 256, 255 - n) for n in range(40)], [(0, 0), (0xFF, 0x81)]]
    file = tmp_path / "spi.vcd"
    file.write_text(write(frames)[0], encoding="ascii")
    decoder = "spi:clk=SCK:mosi=MOSI:miso=MISO:cs=CS"
    for wanted, place in (("mosi-data", 0), ("miso-data", 1)):
        command = ["sigrok-cli", "-I", "vcd", "-i", str(file), "-P", decoder]
        done = subprocess.run(
            [*command, "-A", f"spi={wanted}"], check=True, capture_output=True, text=True
        )
        decoded = [int(line.split()[-1], 16) for line in done.stdout.split("\n") if line]
        assert decoded == [pair[place] for frame in frames for pair in frame]
