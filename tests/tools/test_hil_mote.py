"""A mote in the loop, both sides of it: real processes on ptys, and hosts that share no code.

In the first half an emulated base station (process A, `hil --mote`) commands a robot that swims in
another process (B, `board base`), through the TinyOS protocol and a cable that is pulled once. In
the second half either process talks to a few lines written from TEP 113.

Nothing here asserts how long anything took: a busy machine is late, and says so.
"""

from __future__ import annotations

import binascii
import json
import os
import select
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.cable import Cable
from tests.tools.processes import PATIENCE_S, program, result, stopped, where
from tools.cli import main

COMMANDS = 14
BIAS_RAD = 0.3
USB = "the base station's USB port is"


# --- A and B ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Bridged:
    """What both said at their ends, and A's folder."""

    a: dict[str, Any]
    b: dict[str, Any]
    folder: Path


@pytest.fixture(scope="module")
def bridged(tmp_path_factory: pytest.TempPathFactory) -> Bridged:
    place = tmp_path_factory.mktemp("bridged")
    near = place / "near"
    beats = ", ".join(
        f"{{at_s={0.4 + 0.15 * n:g}, bias_rad={BIAS_RAD if n == COMMANDS - 1 else 0.01 * n:g}}}"
        for n in range(COMMANDS)
    )
    with program("board", "base", "--on", "pty:", "--json") as board:
        far = where(board, USB)
        cable = Cable(
            lambda: open_transport(f"pty:?link={near}", OpenContext()),
            lambda: open_transport(f"serial://{far}", OpenContext()),
        )
        done = threading.Event()
        talking = threading.Event()

        def carry() -> None:
            while not (talking.is_set() or done.is_set()):
                cable.run(0.02)
            cable.pull()  # commands come every 0.15 s
            time.sleep(0.6)
            cable.plug()
            while not done.is_set():
                cable.run(0.02)
            cable.pull()

        carrier = threading.Thread(target=carry)
        carrier.start()
        try:
            args = ("--emulate", "base", "--duration", "5", "--out", str(place / "run"), "--json")
            set_beats = ("--set", f"base_station.tail_beats=[{beats}]")
            with program("hil", "--mote", f"serial://{near}", *args, *set_beats) as hil:
                assert hil.stderr is not None
                assert "the mote is expected at serial" in hil.stderr.readline()
                begun = cable.carried
                # Telemetry flows while A warms up; commands and answers are more than that.
                limit_s = time.monotonic() + PATIENCE_S
                while hil.poll() is None and not (place / "go").exists():
                    time.sleep(0.02)
                    if cable.carried - begun > 500 or time.monotonic() > limit_s:
                        break
                talking.set()
                a = result(hil)
            b = stopped(board)
        finally:
            done.set()
            carrier.join()
    return Bridged(a, b, place / "run")


def test_commands_reach_the_other_processs_robot_and_telemetry_returns(bridged: Bridged) -> None:
    mote = bridged.a["hil"]["mote"]
    robot = mote["telemetry"]["1"]
    assert robot["received"] >= 3
    assert robot["repeated"] == 0
    assert robot["last"]["last_command_id"] == COMMANDS
    assert robot["last"]["tail_bias_rad"] == pytest.approx(BIAS_RAD, abs=1e-4)
    assert bridged.a["metrics"]["telemetry_received"] == robot["received"]
    assert mote["emulated"] == {"base": 0}
    assert mote["connected"]
    assert mote["diagnosis"] == ""
    for name in ("round_trip", "acknowledged", "to_air"):
        assert 0 < mote[name]["median_s"] <= mote[name]["maximum_s"]
    assert mote["to_air"]["count"] == mote["in"]["delivered"]


def test_counts_agree_and_nothing_acknowledged_is_lost(bridged: Bridged) -> None:
    mote, port = bridged.a["hil"]["mote"], bridged.b["base_port"]
    out, back, bridge = mote["out"], mote["in"], port["bridge"]
    assert mote["outages"]["outages"] == mote["outages"]["resumptions"] == 1
    assert mote["outages"]["down_s"] > 0
    # what A's gateway took is acknowledged, or waits; no attempt was used up while it was away
    assert out["taken"] == out["acknowledged"] + out["waiting"]
    assert out["dropped"] == {}
    assert out["taken"] >= COMMANDS
    # what the mote acknowledged is what it gave its radio, each once
    # (twice only where it came again after more than the second for which the mote remembers it)
    assert out["acknowledged"] <= bridge["from_host"] <= out["taken"] + out["sent_again"]
    assert bridge["from_host"] == bridge["on_air"] + bridge["unanswered"]
    assert bridge["unanswered"] == 0
    # upwards it is best effort, but what came was delivered to the base station
    assert back["packets"] <= bridge["to_host"]
    assert back["admitted"] == back["packets"]
    assert back["admitted"] == back["delivered"] + back["waiting"]
    assert back["dropped"] == {}
    assert port["uart"]["overruns"] == port["uart"]["garbled"] == 0


def test_what_the_robot_told_is_in_the_channels(bridged: Bridged) -> None:
    table = (bridged.folder / "channels.csv").read_text(encoding="utf-8").splitlines()
    names = table[0].split(",")
    for name in ("tail_bias_rad", "battery_v", "gyro_z_rad_s", "temperature_c"):
        column = names.index(name)
        values = [row.split(",")[column] for row in table[1:] if row.split(",")[column]]
        assert len(values) >= 3, name
    assert (bridged.folder / "truth.csv").read_text(encoding="utf-8").count("\n") == 1
    report = (bridged.folder / "report.html").read_text(encoding="utf-8")
    assert "from the mote" in report
    assert main(["replay", str(bridged.folder)]) == 2


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")
def test_tshark_finds_every_fcs_right_and_acknowledgements_paired(bridged: Bridged) -> None:
    """Of A's air: commands to a robot that is not there, answered by the gateway; its telemetry."""
    fields = ("wpan.fcs_ok", "wpan.fcf", "wpan.src16", "wpan.ack_to", "wpan.ack_in", "wpan.seq_no")
    options = [option for name in fields for option in ("-e", name)]
    read = subprocess.run(
        ["tshark", "-2", "-o", "wpan.802154_ack_tracking:TRUE", "-r",
         str(bridged.folder / "radio.pcap"), "-T", "fields", *options],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    frames = [line.split("\t") for line in read.stdout.splitlines()]
    out, back = bridged.a["hil"]["mote"]["out"], bridged.a["hil"]["mote"]["in"]
    assert {frame[0] for frame in frames} == {"1"}
    data = [frame for frame in frames if frame[1] == "0x8861"]
    acks = [frame for frame in frames if frame[1] == "0x0002"]
    assert len(data) + len(acks) == len(frames)
    by_source = {source: [f for f in data if f[2] == source] for source in ("0x0000", "0x0001")}
    assert len(by_source["0x0000"]) >= out["heard"] >= COMMANDS
    assert len(by_source["0x0001"]) >= back["delivered"] > 0
    answered = [frame for frame in data if frame[4]]
    assert len(answered) == len(acks)
    assert all(ack[3] for ack in acks)
    # all that was heard was taken, so all was answered; the last may not have been in time
    assert len(acks) >= out["heard"] + back["delivered"] - 1
    inward = {int(frame[5], 0) for frame in by_source["0x0001"] if frame[4]}
    assert len(inward) == back["delivered"]  # a number of its own each


# --- a host of a few lines, and a mote ----------------------------------------------------


class Line:
    """The serial protocol as TEP 113 and RFC 1662 have it, on a descriptor."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.partial = b""
        self.waiting: list[bytes] = []

    def write(self, content: bytes) -> None:
        octets = content + struct.pack("<H", binascii.crc_hqx(content, 0))
        stuffed = octets.replace(b"}", b"}]").replace(b"~", b"}^")
        os.write(self.descriptor, b"~" + stuffed + b"~")

    def read(self, wanted: bytes) -> bytes:
        """Return the next content that begins so; others are dropped."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            while self.waiting:
                content = self.waiting.pop(0)
                if content.startswith(wanted):
                    return content
            if select.select([self.descriptor], [], [], 0.5)[0]:
                self.partial += os.read(self.descriptor, 4096)
            *pieces, self.partial = self.partial.split(b"~")
            for piece in filter(None, pieces):
                content = piece.replace(b"}^", b"~").replace(b"}]", b"}")
                if binascii.crc_hqx(content[:-2], 0) == struct.unpack("<H", content[-2:])[0]:
                    self.waiting.append(content[:-2])
        raise AssertionError(f"nothing that begins with {wanted.hex()} came")


def test_a_host_from_the_text_of_tep_113_commands_the_emulated_robot() -> None:
    with program("board", "base", "--on", "pty:", "--json") as board:
        descriptor = os.open(where(board, USB), os.O_RDWR | os.O_NOCTTY)
        try:
            host = Line(descriptor)
            # 45, dispatch 0, to 0, from 1, 27 octets, group 22, AM 21: Telemetry
            first = host.read(bytes.fromhex("45 00 0000 0001 1b 22 21"))
            assert len(first) == 2 + 7 + 27
            # the literal packet of hardware that anybody may send, and its acknowledgement
            os.write(descriptor, bytes.fromhex("7e4426 00ffff0000042206 7d5e7d5d0102 187b 7e"))
            assert host.read(b"\x43") == b"\x43\x26"
            # TailBeatCommand 513: bias 0.25, amplitude 0.2 (1/20000 rad), 1.5 Hz, until the next
            beat = struct.pack(">HhhHH", 513, 5000, 4000, 1500, 0)
            host.write(bytes.fromhex("44 27 00 0001 0000 0a 22 10") + beat)
            assert host.read(b"\x43") == b"\x43\x27"
            # CommandReply of 513: ACCEPTED or APPLIED
            reply = host.read(bytes.fromhex("45 00 0000 0001 03 22 20"))
            assert reply[-3:-1] == struct.pack(">H", 513)
            assert reply[-1] in (0, 1)
            while True:
                telemetry = host.read(bytes.fromhex("45 00 0000 0001 1b 22 21"))
                if struct.unpack(">H", telemetry[-3:-1])[0] == 513:  # last_command_id
                    break
        finally:
            os.close(descriptor)
        told = stopped(board)
    assert told["base_port"]["bridge"]["from_host"] == 2
    assert told["base_port"]["bridge"]["on_air"] == 2


def test_only_the_robot_is_emulated_and_the_mote_is_a_few_lines(tmp_path: Path) -> None:
    """The test is a BaseStation with a real base station on its air."""
    ours, theirs = os.openpty()
    try:
        import tty

        tty.setraw(theirs)
        mote = Line(ours)
        args = ("--emulate", "robot", "--duration", "4", "--out", str(tmp_path / "run"), "--json")
        with program("hil", "--mote", f"serial://{os.ttyname(theirs)}", *args) as hil:
            first = mote.read(b"\x44")  # Telemetry from 1 to 0, an acknowledgement wanted
            assert first[2:10] == bytes.fromhex("00 0000 0001 1b 22 21")
            again = mote.read(b"\x44")
            assert again == first  # not acknowledged, so it comes again
            beat = struct.pack(">HhhHH", 77, 5000, 4000, 1500, 0)
            mote.write(bytes.fromhex("45 00 0001 0000 0a 22 10") + beat)
            mote.write(bytes.fromhex("45 00 0009 0000 0a 22 10") + beat)  # overheard
            mote.write(bytes.fromhex("45 00 0001 0000 0a 23 10") + beat)  # another group
            mote.write(bytes.fromhex("45 00 0000 0001 01 22 10 00"))  # its own voice
            content = first
            while content[9] != 0x20 or content[10:12] != struct.pack(">H", 77):  # CommandReply
                mote.write(bytes((0x43, content[1])))
                content = mote.read(b"\x44")
            told: dict[str, Any] = {}
            answering = threading.Event()

            def answer() -> None:
                while not answering.is_set():
                    mote.write(bytes((0x43, content[1])))
                    if select.select([ours], [], [], 0.05)[0]:
                        mote.partial += os.read(ours, 4096)

            acknowledger = threading.Thread(target=answer)
            acknowledger.start()
            try:
                told = result(hil)
            finally:
                answering.set()
                acknowledger.join()
    finally:
        os.close(ours)
        os.close(theirs)
    inward = told["hil"]["mote"]["in"]
    assert inward["packets"] == 4
    assert (inward["admitted"], inward["delivered"]) == (1, 1)
    assert sorted(inward["dropped"].values()) == [1, 1, 1]
    assert told["hil"]["mote"]["out"]["sent_again"] >= 1
    assert told["metrics"]["path_length_m"] > 0  # it swims, in our water
    assert told["metrics"]["telemetry_received"] == 0  # the base station is elsewhere


# --- mistakes -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (
            ["hil", "--mote", "serial:///dev/no-such-port"],
            "--mote: serial:///dev/no-such-port: no port",
        ),
        (["hil", "--mote", "pty:", "--emulate", "nobody"], "--emulate"),
        (["hil", "--nav", "pty:", "--emulate", "base"], "--emulate: must not be base"),
        (["hil", "--proc", "pty:", "--mote", "pty:", "--emulate", "robot"], "--emulate: must not"),
        (["board", "base", "--on", "pty:", "--emulate", "robot"], "hil.radio_nodes"),
        (["board", "base", "--on", "tty:"], "no transport is called 'tty'"),
        (["board", "nav", "--on", "pty:", "--promiscuous"], "board base"),
        (["run", "--set", "hil.mote='pty:'", "--speed", "5"], "5 times as fast"),
        (["run", "--set", "hil.radio_nodes='base'"], "hil.radio_nodes"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, complaint: Callable[[list[str]], str]
) -> None:
    assert says in complaint(args)


def test_a_mote_that_says_nothing_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["hil", "--mote", "pty:", "--duration", "1.2", "--out", str(out), "--quiet"]) == 2
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2  # where it is expected, and that it did not come
    assert "acknowledged none of" in err[1]
    told = json.loads((out / "summary.json").read_text(encoding="utf-8"))["hil"]
    assert told["diagnosis"]
    assert told["mote"]["out"]["acknowledged"] == 0
