"""sigrok-cli decodes spi.vcd into exactly the bytes that went over the wires, errors included.

The waveform is drawn from byte records; sigrok takes it apart again edge by edge, transfer by
transfer. Both must agree with the trace, and the trace with what both links were given.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from spi_bus.errors import SpiBusError

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(shutil.which("sigrok-cli") is None, reason="sigrok-cli is not installed"),
]

WIRING = "spi:clk=SCK:mosi=MOSI:miso=MISO:cs=CS"


def transfers(vcd: Path, line: str) -> list[bytes]:
    """Every transfer of one line, from chip select to chip select."""
    done = subprocess.run(
        ["sigrok-cli", "-I", "vcd", "-i", str(vcd), "-P", WIRING, "-A", f"spi={line}-transfer"],
        capture_output=True,
        text=True,
        check=True,
    )
    return [
        bytes.fromhex(match[1])
        for match in re.finditer(r"^spi-1: ((?:[0-9A-F]{2} ?)+)$", done.stdout, re.MULTILINE)
    ]


def traced(run: Any, column: int) -> list[bytes]:
    """The same from the trace: runs of bytes between two selections."""
    levels = [time_fs for time_fs, level in run.channels["spi.cs"] if level == 0]
    result = [bytearray() for _ in levels]
    index = -1
    for time_fs, value in run.channels["spi.bytes"]:
        while index + 1 < len(levels) and levels[index + 1] <= time_fs:
            index += 1
        result[index] += value[column]
    return [bytes(transfer) for transfer in result if transfer]


@pytest.fixture(params=["0.0", "1e-3"], ids=["clean", "bit errors"])
def run(request: pytest.FixtureRequest, swim: Any) -> Any:
    return swim("swim-forward", f"link.bit_error_rate={request.param}", duration_s=3.0, keep=True)


@pytest.mark.parametrize(("line", "column"), [("mosi", 1), ("miso", 2)])
def test_sigrok_reads_the_bytes_that_were_on_the_wires(run: Any, line: str, column: int) -> None:
    read = transfers(run.folder / "spi.vcd", line)
    assert len(read) > 20
    assert read == traced(run, column)


def test_a_run_that_ends_amid_a_transfer_has_all_its_bytes(swim: Any) -> None:
    whole = swim("swim-forward", duration_s=1.0)
    start_fs, (period_fs, mosi, _) = next(
        record for record in reversed(whole.channels["spi.bytes"]) if len(record[1][1]) > 20
    )
    end_fs = start_fs + 10 * 8 * period_fs + period_fs  # in the eleventh byte
    run = swim("swim-forward", duration_s=round(end_fs / 1e6) / 1e9, keep=True)
    sent = b"".join(value[1] for value in run.values("spi.bytes"))
    assert sent.endswith(mosi[:10])
    command = ["sigrok-cli", "-I", "vcd", "-i", str(run.folder / "spi.vcd"), "-P", WIRING]
    done = subprocess.run(
        [*command, "-A", "spi=mosi-data"], capture_output=True, text=True, check=True
    )
    read = [int(line.split()[-1], 16) for line in done.stdout.splitlines() if line]
    assert bytes(read) == sent


def test_bit_errors_are_in_the_waveform(run: Any) -> None:
    errors = run.bench.robot.wires.bits_inverted
    assert bool(errors) == bool(run.config.link.bit_error_rate)
    damaged = run.data.metrics["spi_crc_errors"]
    assert bool(damaged) == bool(errors)


@pytest.mark.parametrize("line", ["mosi", "miso"])
def test_what_sigrok_reads_is_what_the_links_delivered(run: Any, line: str) -> None:
    """The frames in sigrok's bytes, in their order, are the messages that the link delivered."""
    from spi_bus.frame import Decoder, Frame, FrameType

    robot = run.bench.robot
    board = robot.nav if line == "mosi" else robot.proc
    frames = []
    for body in Decoder().receive(b"".join(transfers(run.folder / "spi.vcd", line))):
        with contextlib.suppress(SpiBusError):  # damaged
            frames.append(Frame.parse(body))
    expected = 0  # the number of the next message; go-back-N takes them in order only
    found = []
    for frame in frames:
        if frame.frame_type == FrameType.DATA and frame.sequence == expected % 256:
            expected += 1
            found.append(frame.payload)
    delivered = run.journal(board.links[0]).delivered
    assert len(delivered) > 2
    # The last frame may still wait for its board's attention when the run ends.
    assert found[: len(delivered)] == delivered
    assert len(found) - len(delivered) <= 1
