"""Targets that read wires and air, with more to promise than a form asks for."""

from __future__ import annotations

from navboard.drivers.gps18x import FixBuilder
from navboard.errors import SentenceError
from radio_802154 import fcs, mac, routing_messages, tinyos, tinyos_serial, xbee
from radio_802154 import messages as radio_messages
from radio_802154.errors import RadioError
from spi_bus import cobs, frame
from spi_bus.errors import SpiBusError
from spi_bus.link import Link, Role
from tools.fuzz.forms import Run


def fuzz_cobs(data: bytes) -> None:
    """COBS: what is encoded has no zero and comes back; all else is refused.

    A block is written in one way only; behind a full one (0xFF) an empty one may be left out.
    """
    stuffed = cobs.encode(data)
    assert b"\0" not in stuffed
    assert cobs.decode(stuffed) == data
    try:
        decoded = cobs.decode(data)
    except SpiBusError:
        return
    again = cobs.encode(decoded)
    assert cobs.decode(again) == decoded
    assert again == data or len(data) > cobs.LONGEST_RUN + 1


def fuzz_link(data: bytes) -> None:
    """Link frames: cuts change nothing, memory is bounded, a zero puts it in step; then a link."""
    whole, cut = frame.Decoder(), frame.Decoder()
    place = data[0] if data else 0
    bodies = whole.receive(data)
    assert cut.receive(data[:place]) + cut.receive(data[place:]) == bodies
    assert whole.buffered == cut.buffered <= frame.MAX_STUFFED_BYTES
    assert whole.errors == cut.errors
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


def fuzz_radio_messages(data: bytes) -> None:
    """Radio messages, the first octet their number: what is read is written and read again."""
    if not data:
        return
    try:
        message = radio_messages.decode(data[0], data[1:])
    except RadioError:
        return
    am_type, payload = radio_messages.encode(message)
    assert radio_messages.decode(am_type, payload) == message


def fuzz_routing_messages(data: bytes) -> None:
    """Messages of the network layer, the first octet their number: what is read is written."""
    if not data:
        return
    try:
        message, rest = routing_messages.read(data[0], data[1:])
    except RadioError:
        return
    assert routing_messages.write(message, rest) == (data[0], data[1:])


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


def fuzz_xbee(*, escaped: bool) -> Run:
    """XBee: cuts change nothing, frames go in again; mode 2 is in step at a 7E."""
    status = xbee.TxStatus(1, 0)
    told = xbee.encode(status, escaped=escaped)

    def run(data: bytes) -> None:
        whole, cut = xbee.Decoder(escaped=escaped), xbee.Decoder(escaped=escaped)
        place = data[0] if data else 0
        frames = whole.receive(data)
        assert cut.receive(data[:place]) + cut.receive(data[place:]) == frames
        assert whole.buffered <= xbee.MAX_FRAME_OCTETS + 4
        for found in frames:
            octets = xbee.encode(found, escaped=escaped)
            assert xbee.Decoder(escaped=escaped).receive(octets) == [found]
        if escaped:
            assert whole.receive(told) == [status]
        whole.idle()
        assert whole.receive(told) == [status]

    return run


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
