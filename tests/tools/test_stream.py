"""Streamed files: whatever the blocks, the file is the same, and the oracles can read it."""

from __future__ import annotations

import random
import shutil
import subprocess
from pathlib import Path

import pytest

from firmware_model.trace import Trace
from radio_802154.fcs import append_fcs
from tools.errors import RunFolderError
from tools.records.folder import RunFolder
from tools.records.stream import StreamedFiles

BIT_FS = 3_814_697_265
US = 10**9
MS = 10**12


def play(folder: RunFolder, flush_every: int) -> list[tuple[int, int]]:
    """Record some traffic as the bench does; returns the bytes on the wires."""
    chance = random.Random(5)
    trace = Trace()
    spi, select, ready = (trace.channel(f"spi.{name}") for name in ("bytes", "cs", "ready"))
    radio, pin = trace.channel("radio"), trace.channel("wire.SERVO")
    sent = []
    with StreamedFiles(trace, folder):
        now = MS
        for number in range(400):
            pin.record(now, number % 2)
            select.record(now, 0)
            now += 5 * US
            for place in range(4):
                pair = (chance.randrange(256), chance.randrange(256))
                if place == 1:
                    ready.record(now + 3 * US, number % 2)
                spi.record(now, (BIT_FS, *pair))
                sent.append(pair)
                now += 8 * BIT_FS + 2 * US
            select.record(now, 1)
            now += MS
            if number % 40 == 0:
                data = append_fcs(bytes([0x61, 0x88, number % 256, 0x22, 0, 0, 0, 1, 0, 0x3F]))
                begin = now - MS
                radio.record(begin + 32 * US * (6 + len(data)), (begin, 26, "robot", 0.0, data))
            if number % flush_every == 0:
                trace.flush()
    return sent


def test_files_do_not_depend_on_blocks(tmp_path: Path) -> None:
    files = []
    for flush_every in (1, 7, 1000):
        with RunFolder(tmp_path / f"run{flush_every}") as folder:
            play(folder, flush_every)
            files.append([folder.file(name).read_bytes() for name in ("spi.vcd", "radio.pcap")])
    assert files[0] == files[1] == files[2]
    assert b" SERVO " in files[0][0]


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("sigrok-cli") is None, reason="sigrok-cli is not installed")
def test_sigrok_reads_the_bytes_that_were_streamed(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        sent = play(folder, 9)
        file = folder.file("spi.vcd")
        decoder = "spi:clk=SCK:mosi=MOSI:miso=MISO:cs=CS"
        command = ["sigrok-cli", "-I", "vcd", "-i", str(file), "-P", decoder]
        done = subprocess.run(
            [*command, "-A", "spi=miso-data"], check=True, capture_output=True, text=True
        )
    assert [int(line.split()[-1], 16) for line in done.stdout.split("\n") if line] == [
        miso for _, miso in sent
    ]


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")
def test_tshark_finds_every_fcs_right(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        play(folder, 9)
        command = ["tshark", "-r", str(folder.file("radio.pcap")), "-T", "fields"]
        done = subprocess.run(
            [*command, "-e", "wpan.fcs_ok"], check=True, capture_output=True, text=True
        )
    assert done.stdout.split() == ["1"] * 10 or done.stdout.split() == ["True"] * 10


def test_a_fault_during_the_run_is_not_hidden_by_the_files(tmp_path: Path) -> None:
    def fail() -> None:
        with RunFolder(tmp_path / "run") as folder, StreamedFiles(Trace(), folder):
            raise RuntimeError("the run failed")

    with pytest.raises(RuntimeError, match="the run failed"):
        fail()


def test_files_that_cannot_be_opened_are_the_users_to_mend(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        folder.file("spi.vcd").mkdir()
        with pytest.raises(RunFolderError, match="cannot be written"):
            StreamedFiles(Trace(), folder).__enter__()


def test_attaching_files_does_not_change_the_hash_of_the_trace(tmp_path: Path) -> None:
    bare, watched = Trace(), Trace()
    for trace in (bare, watched):
        trace.channel("spi.bytes").record(MS, (BIT_FS, 1, 2))
    with RunFolder(tmp_path / "run") as folder, StreamedFiles(watched, folder):
        pass
    assert watched.sha256() == bare.sha256()


def test_a_channel_that_comes_too_late_is_noticed(tmp_path: Path) -> None:
    trace = Trace()

    def late() -> None:
        with RunFolder(tmp_path / "run") as folder, StreamedFiles(trace, folder):
            trace.channel("spi.bytes").record(MS, (BIT_FS, 1, 2))

    with pytest.raises(RuntimeError, match="after the files"):
        late()
