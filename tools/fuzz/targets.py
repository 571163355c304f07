"""What is fuzzed: one function a decoder, with what must hold whatever the octets.

A target takes octets and either returns or fails an assertion; any other exception is a finding.
Beyond not raising each checks what its decoder promises: that cuts change nothing, that what came
out goes in again, that nothing is kept beyond a bound. The seeds are inputs that get past the
first check, so that a short run reaches what lies behind it.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from navboard.drivers.gps18x import FixBuilder
from navboard.errors import SentenceError
from radio_802154 import fcs, mac, tinyos, tinyos_serial, xbee
from radio_802154 import messages as radio_messages
from radio_802154.errors import RadioError
from radio_802154.pcap import Capture, global_header, record
from spi_bus import cobs, frame
from spi_bus.errors import SpiBusError
from spi_bus.link import Link, Role
from spi_bus.messages import LINK_MESSAGES, Ping, TailBeat
from tools.decode import hexdump, pcap, recording, session, vcd
from tools.decode.files import FileKind
from tools.decode.items import Tally
from tools.decode.output import line, summary
from tools.errors import UserError

MOST_ITEMS_PER_OCTET: Final = 40
"""Findings of a file for each of its bytes: what is yielded must not grow faster than the file."""


def fuzz_cobs(data: bytes) -> None:
    """COBS: what is encoded has no zero and comes back; anything else is refused."""
    stuffed = cobs.encode(data)
    assert b"\0" not in stuffed
    assert cobs.decode(stuffed) == data
    try:
        decoded = cobs.decode(data)
    except SpiBusError:
        return
    assert cobs.decode(cobs.encode(decoded)) == decoded


def fuzz_link(data: bytes) -> None:
    """Link frames: cuts change nothing, memory is bounded, a zero puts it in step; then a link."""
    whole, cut = frame.Decoder(), frame.Decoder()
    place = data[0] if data else 0
    bodies = whole.receive(data)
    assert cut.receive(data[:place]) + cut.receive(data[place:]) == bodies
    assert whole.buffered <= frame.MAX_STUFFED_BYTES
    for body in bodies:
        parsed = frame.Frame.parse(body)
        assert parsed.body() == body
    sent = frame.Frame(frame.FrameType.DATA, 0x11, 1, 2, 0, 4, data[:20])
    whole.receive(b"\0")
    assert whole.receive(sent.encode()) == [sent.body()]
    link = Link(Role.MASTER, epoch=1)
    link.receive(data, 0)
    link.handle_timer(10_000_000)
    link.data_to_send(10_000_000)


def fuzz_messages(data: bytes) -> None:
    """Messages of both tables: what is read is written again, and read as the same."""
    try:
        message = LINK_MESSAGES.decode(data)
    except SpiBusError:
        pass
    else:
        assert LINK_MESSAGES.decode(LINK_MESSAGES.encode(message)) == message
    if data:
        try:
            message = radio_messages.decode(data[0], data[1:])
        except RadioError:
            return
        am_type, payload = radio_messages.encode(message)
        assert radio_messages.decode(am_type, payload) == message


def fuzz_tinyos(data: bytes) -> None:
    """TinyOS serial: cuts change nothing, packets go in again, a delimiter puts it in step."""
    whole, cut = tinyos_serial.Decoder(), tinyos_serial.Decoder()
    place = data[0] if data else 0
    packets = whole.receive(data)
    assert cut.receive(data[:place]) + cut.receive(data[place:]) == packets
    assert whole.buffered <= 2 * tinyos_serial.MAX_FRAME_OCTETS
    for packet in packets:
        assert tinyos_serial.Decoder().receive(tinyos_serial.encode(packet)) == [packet]
        try:
            am = tinyos_serial.decode_am(packet.body)
        except RadioError:
            continue
        assert tinyos_serial.encode_am(am) == packet.body
    ack = tinyos_serial.SerialPacket(tinyos_serial.PacketType.ACK, 7)
    assert whole.receive(b"\x7e" + tinyos_serial.encode(ack))[-1:] == [ack]


def fuzz_xbee(data: bytes) -> None:
    """XBee, both modes: cuts change nothing, frames go in again, mode 2 is in step at a 7E."""
    for escaped in (True, False):
        whole, cut = xbee.Decoder(escaped=escaped), xbee.Decoder(escaped=escaped)
        place = data[0] if data else 0
        frames = whole.receive(data)
        assert cut.receive(data[:place]) + cut.receive(data[place:]) == frames
        assert whole.buffered <= xbee.MAX_FRAME_OCTETS + 4
        for found in frames:
            octets = xbee.encode(found, escaped=escaped)
            assert xbee.Decoder(escaped=escaped).receive(octets) == [found]
        status = xbee.TxStatus(1, 0)
        if escaped:
            assert whole.receive(xbee.encode(status, escaped=True)) == [status]
        whole.idle()
        assert whole.receive(xbee.encode(status, escaped=escaped)) == [status]


def fuzz_mac(data: bytes) -> None:
    """802.15.4 frames: what is read is written again and read as the same."""
    try:
        found = mac.decode(data)
    except RadioError:
        return
    if len(data) <= mac.MAX_CONTENT_OCTETS:
        assert mac.decode(mac.encode(found)) == found
        assert fcs.strip_fcs(fcs.append_fcs(data)) == data
    try:
        packet = tinyos.from_frame(found)
        radio_messages.decode(packet.am_type, packet.payload)
    except RadioError:
        return


def fuzz_nmea(data: bytes) -> None:
    """The GPS driver's sentences: a fix, nothing, or `SentenceError`."""
    builder = FixBuilder()
    for sentence in data.split(b"\n"):
        for checked in (sentence, _with_checksum(sentence)):
            try:
                builder.sentence(checked)
            except SentenceError:
                continue


def _with_checksum(body: bytes) -> bytes:
    """A sentence with a right checksum: a fuzzer does not find those."""
    checksum = 0
    for octet in body:
        checksum ^= octet
    return b"$" + body + b"*%02X\r\n" % checksum


def _read(kind: FileKind, variant: session.Variant, data: bytes) -> None:
    try:
        parts = kind.read(io.BytesIO(data), "fuzz")
    except UserError:
        return
    _drain(session.Session(Path("fuzz"), kind, variant, parts, io.BytesIO()), len(data))


def _drain(running: session.Session, length: int) -> None:
    count = 0
    for item in running.items():
        count += 1
        assert line(item).isprintable()
        assert 0 <= item.offset <= length
    assert count <= MOST_ITEMS_PER_OCTET * (1 + length)
    assert summary(running.tally)
    running.tally.as_dict()


def fuzz_pcap(data: bytes) -> None:
    """Captures: the octets as the file, and as the records of files of each link type."""
    kind = FileKind("capture", pcap.read)
    if data[:4] in pcap.MAGICS:
        _read(kind, session.VARIANTS[-1], data)
    for link_type in (pcap.WITH_FCS, pcap.WITHOUT_FCS, pcap.TAP):
        header = global_header()[:20] + link_type.to_bytes(4, "little")
        _read(kind, session.VARIANTS[-1], header + data)


def fuzz_vcd(data: bytes) -> None:
    """Waveforms: the octets as the file, and as the changes of four wires."""
    kind = FileKind("waveform", vcd.read)
    _read(kind, session.VARIANTS[0], data)
    _read(kind, session.VARIANTS[0], VCD_HEADER + data)


def _few_repeats(file: Any, name: str) -> Any:
    return hexdump.read_with_offsets(file, name, most_repeated=256)


def fuzz_hexdump(data: bytes) -> None:
    """Hex dumps with and without offsets."""
    _read(FileKind("dump", _few_repeats), session.VARIANTS[0], data)
    _read(FileKind("plain", hexdump.read_plain), session.VARIANTS[1], data)


def fuzz_recording(data: bytes) -> None:
    """Recordings of lines, through each protocol."""
    kind = FileKind("recording", recording.read_log)
    for variant in session.VARIANTS:
        _read(kind, variant, recording.FIRST_LINE + b"\n" + data)


def fuzz_file(data: bytes) -> None:
    """Any file: recognised by its content and decoded, or refused in one line."""
    try:
        running = session.from_file(Path("fuzz"), io.BytesIO(data), session.AUTO)
    except UserError as error:
        _one_line(error)
        return
    for variant in session.VARIANTS:
        variant.make(Tally())
    for _ in running.items():
        pass


def _one_line(error: UserError) -> None:
    assert "\n" not in str(error)


VCD_HEADER: Final = (
    b'$timescale 100 ns $end $var wire 1 ! SCK $end $var wire 1 " MOSI $end '
    b"$var wire 1 # MISO $end $var wire 1 $ CS $end $enddefinitions $end\n"
)
_LINK_FRAME: Final = frame.Frame(
    frame.FrameType.DATA, 0x11, 0, 0, 0, 4, LINK_MESSAGES.encode(Ping(7))
).encode()
_AM: Final = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")
_XBEE: Final = bytes.fromhex("7E 00 0B 81 12 34 5E 01 54 78 44 61 74 61 93")
_TELL: Final = radio_messages.encode(radio_messages.TargetCommand(1, 0.5, 0.5))
_AIR: Final = tinyos.encode(tinyos.AmPacket(1, 0, _TELL[0], _TELL[1]))
_RMC: Final = b"GPRMC,002454,A,3553.5295,N,13938.6570,E,0.0,43.1,180700,7.1,W,A"
_GGA: Final = b"GPGGA,002454,3553.5295,N,13938.6570,E,1,05,2.2,18.3,M,39.0,M,,"
_CAPTURE: Final = record(Capture(0, 10**9, 26, -40.0, fcs.append_fcs(_AIR), 100))
_CHANGES: Final = b'#1\n0$\n#2\n1!\n1"\n#3\n0!\n#4\n1!\n#5\n0!\n#6\n1$\n'
_DUMP: Final = b"00000000: 0003 1110 0104  ......\n00000006: 4401                 D.\n"
_CANONICAL: Final = b"00000000  00 03 11 10 01 04 44 01  00 |......D..|\n*\n00000020\n"
_LOG: Final = b"0.000000 > " + _LINK_FRAME.hex(" ").encode() + b"\n0.1 ! down: x\n"
_LOG_2: Final = b"1.730201 ! down: gone\n1.800000 < " + _AM.hex(" ").encode() + b"\n"


@dataclass(frozen=True, slots=True)
class Target:
    """A row of the table."""

    name: str
    run: Callable[[bytes], None]
    seeds: tuple[bytes, ...]
    longest: int = 640
    """Bytes of an input: two of the longest frames; files need more."""


FILE: Final = 2048
"""Longest input of a target that reads files."""

TARGETS: Final = (
    Target("cobs", fuzz_cobs, (_LINK_FRAME[:-1], b"\x01\x01", bytes(300), bytes([5]) * 300)),
    Target("link", fuzz_link, (_LINK_FRAME, b"\0" + 2 * _LINK_FRAME)),
    Target(
        "messages",
        fuzz_messages,
        (
            LINK_MESSAGES.encode(Ping(7)),
            LINK_MESSAGES.encode(TailBeat(1, 0.1, 0.2, 0.9, 2.0)),
            bytes((_TELL[0],)) + _TELL[1],
            *(bytes((row.kind,)) + bytes(row.layout.size) for row in radio_messages.AM_MESSAGES),
            *(bytes((number,)) + bytes(40) for number in (0x81, 0x82, 0x84)),
        ),
    ),
    Target("tinyos", fuzz_tinyos, (_AM, bytes.fromhex("7e 43 26 3b 1c 7e"))),
    Target("xbee", fuzz_xbee, (_XBEE, bytes.fromhex("7E 00 02 23 7D 31 CB"))),
    Target("mac", fuzz_mac, (_AIR, b"\x02\x00\x05", b"\x23\xc8\x01\xff\xff\xff\xff" + bytes(9))),
    Target("nmea", fuzz_nmea, (_RMC + b"\n" + _GGA, b"$" + _GGA + b"*4F\r\n")),
    Target("pcap", fuzz_pcap, (_CAPTURE, global_header() + _CAPTURE, 2 * _CAPTURE), FILE),
    Target("vcd", fuzz_vcd, (_CHANGES, VCD_HEADER + _CHANGES), FILE),
    Target("hexdump", fuzz_hexdump, (_DUMP, _CANONICAL, _AM.hex().encode())),
    Target("recording", fuzz_recording, (_LOG, _LOG_2), FILE),
    Target(
        "file",
        fuzz_file,
        (
            _DUMP,
            global_header() + _CAPTURE,
            VCD_HEADER + _CHANGES,
            _LINK_FRAME,
            _AM,
            _XBEE,
            recording.FIRST_LINE + b"\n" + _LOG,
        ),
        FILE,
    ),
)
"""Every decoder that reads what others wrote."""
