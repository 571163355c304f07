"""What is fuzzed: a row a decoder, with inputs that get past its first check.

A target takes octets and either returns or fails an assertion; any other exception is a finding.
Beyond not raising each checks what its decoder promises: that cuts change nothing, that what came
out goes in again, that nothing is kept beyond a bound. Most decoders fit one of the forms
(`tools.fuzz.forms`); a new one is three lines here:

    Target("name", stream(Decoder, longest=64, write=encode), (b"an input that it takes",)),
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from radio_802154 import fcs, tinyos
from radio_802154 import messages as radio_messages
from radio_802154.pcap import Capture, global_header, record
from radio_802154.routing_messages import ROUTING_MESSAGES
from spi_bus import frame
from spi_bus.errors import SpiBusError
from spi_bus.messages import LINK_MESSAGES, Ping, TailBeat
from spi_bus.plant_messages import PLANT_MESSAGES
from tools.decode import recording
from tools.errors import UserError
from tools.fuzz import machines, recorded, wires
from tools.fuzz.forms import Run, later, one_of, parser, stream

_LINK_FRAME: Final = frame.Frame(
    frame.FrameType.DATA, 0x11, 0, 0, 0, 4, LINK_MESSAGES.encode(Ping(7))
).encode()
_AM: Final = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")
_XBEE: Final = bytes.fromhex("7E 00 0B 81 12 34 5E 01 54 78 44 61 74 61 93")
_TELL: Final = radio_messages.encode(radio_messages.TargetCommand(1, 0.5, 0.5))
_AIR: Final = tinyos.encode(tinyos.AmPacket(1, 0, _TELL[0], _TELL[1]))
_POSE: Final = b'{"time_s": 1.5, "x_m": 0.5, "y_m": 0.2, "heading_rad": 0.1}\n'
_RMC: Final = b"GPRMC,002454,A,3553.5295,N,13938.6570,E,0.0,43.1,180700,7.1,W,A"
_GGA: Final = b"GPGGA,002454,3553.5295,N,13938.6570,E,1,05,2.2,18.3,M,39.0,M,,"
_CAPTURE: Final = record(Capture(0, 10**9, 26, -40.0, fcs.append_fcs(_AIR), 100))
_DESCRIBED: Final = bytes.fromhex("0100000014000000e60000000001000014000000")
_BLOCK: Final = bytes.fromhex(
    "060000002400000000000000000000004025260003000000030000000200050024000000"
)
_CHANGES: Final = b'#1\n0$\n#2\n1!\n1"\n#3\n0!\n#4\n1!\n#5\n0!\n#6\n1$\n'
_DUMP: Final = b"00000000: 0003 1110 0104  ......\n00000006: 4401                 D.\n"
_CANONICAL: Final = b"00000000  00 03 11 10 01 04 44 01  00 |......D..|\n*\n00000020\n"
_LOG: Final = b"0.000000 > " + _LINK_FRAME.hex(" ").encode() + b"\n0.1 ! down: x\n"
_LOG_2: Final = b"1.730201 ! down: gone\n1.800000 < " + _AM.hex(" ").encode() + b"\n"


@dataclass(frozen=True, slots=True)
class Target:
    """A row of the table."""

    name: str
    run: Run
    seeds: tuple[bytes, ...]
    longest: int = 640
    """Bytes of an input: two of the longest frames; files need more."""
    usual: int = 96
    """Bytes of the inputs that most executions have: short ones are fast, and mostly enough."""


FILE: Final = 2048
"""Longest input of a target that reads files."""
USUAL_FILE: Final = 384


def _chosen(count: int, *seeds: bytes) -> tuple[bytes, ...]:
    """Seeds for `one_of` so many targets: each for each."""
    return tuple(bytes((number,)) + seed for number in range(count) for seed in seeds)


def _tracker() -> Run:
    from tools.bench.tracker_lines import MAX_LINE_BYTES, LineReader, Refused, TrackerPose

    read: TrackerPose | Refused = TrackerPose(1.5, 0.5, 0.2, 0.1)
    return stream(LineReader, MAX_LINE_BYTES, in_step=(b"\n" + _POSE, read))


def _joystick() -> Run:
    from tools.teleop.joystick import EVENT, EventDecoder

    return stream(EventDecoder, EVENT.size - 1, kept=lambda decoder: len(decoder._buffer))


def _keys() -> Run:
    from tools.teleop.keyboard import KeyDecoder

    return stream(
        KeyDecoder, 16, in_step=(b"\x1b[A", "up"), kept=lambda decoder: len(decoder._pending)
    )


def _script() -> Run:
    from tools.teleop.script import parse

    return parser(lambda data: parse(data.decode("utf-8", "replace")), UserError)


TARGETS: Final = (
    Target("cobs", wires.fuzz_cobs, (_LINK_FRAME[:-1], b"\x01\x01", bytes(300), bytes([5]) * 300)),
    Target("link", wires.fuzz_link, (_LINK_FRAME, b"\0" + 2 * _LINK_FRAME)),
    Target(
        "messages",
        parser(LINK_MESSAGES.decode, SpiBusError, LINK_MESSAGES.encode),
        (
            LINK_MESSAGES.encode(Ping(7)),
            LINK_MESSAGES.encode(TailBeat(1, 0.1, 0.2, 0.9, 2.0)),
            *(bytes((row.kind,)) + bytes(row.layout.size) for row in LINK_MESSAGES.rows),
        ),
    ),
    Target(
        "plant",
        parser(PLANT_MESSAGES.decode, SpiBusError, PLANT_MESSAGES.encode),
        tuple(bytes((row.kind,)) + bytes(row.layout.size) for row in PLANT_MESSAGES.rows),
    ),
    Target(
        "radio",
        wires.fuzz_radio_messages,
        (
            bytes((_TELL[0],)) + _TELL[1],
            *(bytes((row.kind,)) + bytes(row.layout.size) for row in radio_messages.AM_MESSAGES),
        ),
    ),
    Target(
        "routing",
        wires.fuzz_routing_messages,
        tuple(
            bytes((row.kind,)) + bytes(row.layout.size + 2 * row.tail) for row in ROUTING_MESSAGES
        ),
    ),
    Target("tinyos", wires.fuzz_tinyos, (_AM, bytes.fromhex("7e 43 26 3b 1c 7e"))),
    Target(
        "xbee",
        one_of(wires.fuzz_xbee(escaped=True), wires.fuzz_xbee(escaped=False)),
        _chosen(2, _XBEE, bytes.fromhex("7E 00 02 23 7D 31 CB")),
    ),
    Target(
        "mac", wires.fuzz_mac, (_AIR, b"\x02\x00\x05", b"\x23\xc8\x01\xff\xff\xff\xff" + bytes(9))
    ),
    Target("nmea", wires.fuzz_nmea, (_RMC + b"\n" + _GGA, b"$" + _GGA + b"*4F\r\n"), usual=160),
    Target(
        "tracker",
        later(_tracker),
        (_POSE, b'{"time_s": 1.5, "x": 1}\r\n' + _POSE[:20], b"\xef\xbb\xbf[NaN]\n"),
    ),
    Target("joystick", later(_joystick), (bytes.fromhex("01000000ff7f0201 0200000001000180"),)),
    Target("keys", later(_keys), (b"wa\x1b[A\x1bOB\x1b[1;5C q", b"\x1b\x1b[", b"\x04")),
    Target("script", later(_script), (b"0 frequency_hz=1\n1.5 stop # x\n2 end\n",)),
    Target("bridge", machines.fuzz_bridge, (_AM + b"\x7e" + _AIR, _AIR)),
    Target(
        "xbee-module",
        one_of(*map(machines.xbee_module, (0, 1, 2))),
        _chosen(3, _XBEE, bytes.fromhex("7E 00 04 08 52 44 4C 15"), b"+++ATDL1,WR\r"),
    ),
    Target(
        "pcap",
        recorded.fuzz_pcap,
        (b"\0" + global_header() + _CAPTURE, *_chosen(4, _CAPTURE, 2 * _CAPTURE)),
        FILE,
        USUAL_FILE,
    ),
    Target(
        "pcapng",
        recorded.fuzz_pcapng,
        (b"\1" + _DESCRIBED + _BLOCK, b"\2" + 2 * _BLOCK),
        FILE,
        USUAL_FILE,
    ),
    Target(
        "vcd",
        recorded.fuzz_vcd,
        (b"\0" + recorded.VCD_HEADER + _CHANGES, b"\1" + _CHANGES),
        FILE,
        USUAL_FILE,
    ),
    Target("hexdump", recorded.fuzz_hexdump, (_DUMP, _CANONICAL, _AM.hex().encode())),
    Target("recording", recorded.fuzz_recording, _chosen(5, _LOG, _LOG_2), FILE, USUAL_FILE),
    Target(
        "file",
        recorded.fuzz_file,
        (
            _DUMP,
            global_header() + _CAPTURE,
            recorded.VCD_HEADER + _CHANGES,
            _LINK_FRAME,
            _AM,
            _XBEE,
            recording.FIRST_LINE + b"\n" + _LOG,
        ),
        FILE,
        USUAL_FILE,
    ),
)
"""Every decoder that reads what others wrote."""
