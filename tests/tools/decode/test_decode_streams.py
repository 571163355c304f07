"""Protocols over files: what is counted, what is told, and how the protocol is found."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest

from radio_802154 import mac, tinyos, xbee
from radio_802154 import messages as radio_messages
from radio_802154.fcs import append_fcs
from radio_802154.tinyos_serial import AmMessage, PacketType, SerialPacket, encode, encode_am
from spi_bus.frame import Frame, FrameType
from spi_bus.messages import LINK_MESSAGES, Ping, SensorReport
from spi_bus.plant_messages import PLANT_MESSAGES, RegisterWrite, SensorSample, ServoPulse
from tools.decode.framing import Numbers
from tools.decode.items import Item, Tally, What
from tools.decode.output import line
from tools.decode.session import AUTO, PROTOCOLS, Session, from_file
from tools.errors import UserError


def log(*lines: tuple[str, bytes]) -> bytes:
    """A recording, a second a line."""
    text = "".join(f"{i}.000000 {kind} {data.hex(' ')}\n" for i, (kind, data) in enumerate(lines))
    return b"fishbed-transport-log 1\n" + text.encode()


def pcap_of(*frames: bytes) -> bytes:
    out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 195)
    for frame in frames:
        out += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    return out


def run(data: bytes, protocol: str = AUTO) -> tuple[Session, list[Item]]:
    session = from_file(Path("f"), io.BytesIO(data), protocol)
    return session, list(session.items())


def ping(number: int, token: int = 7) -> bytes:
    payload = LINK_MESSAGES.encode(Ping(token))
    return Frame(FrameType.DATA, 0x11, number, 0, 0, 4, payload).encode()


def test_link_messages_gaps_repetitions_and_damage() -> None:
    damaged = bytearray(ping(1))
    damaged[6] ^= 0x10
    lines = [ping(0), bytes(damaged), ping(2), ping(1), ping(2), ping(5)]
    session, items = run(log(*((">", line) for line in lines)))
    assert session.variant.name == "link"
    assert [item.what for item in items] == [
        What.MESSAGE,
        What.ERROR,
        What.GAP,
        What.MESSAGE,
        What.MESSAGE,
        What.AGAIN,
        What.GAP,
        What.MESSAGE,
    ]
    tally = session.tally
    assert (tally.frames, tally.crc_errors, tally.retransmissions, tally.lost) == (6, 1, 1, 2)
    assert tally.messages == {"Ping": 4}
    assert items[0].fields["token"] == 7
    assert items[2].time_s == 2.0
    assert items[0].direction == "sent"


def test_a_message_s_own_sequence_is_not_the_frame_s() -> None:
    report = SensorReport(2_000_000, 100, *[None] * 11)
    payload = LINK_MESSAGES.encode(report)
    _, (item,) = run(Frame(FrameType.DATA, 0x21, 5, 3, 0x10, 4, payload).encode())
    assert item.header == {"sequence": 5, "acknowledge": 3}
    assert item.fields == {"time_us": 2_000_000, "sequence": 100}
    assert line(item).endswith("number 5  time_us=2000000 sequence=100")


def test_a_link_stream_cut_anywhere_is_the_same() -> None:
    stream = b"\0" + ping(0) + ping(1)
    cut = run(log(*((">", bytes((octet,))) for octet in stream)))[0].tally
    assert cut.messages == run(stream)[0].tally.messages == {"Ping": 2}


def test_numbers() -> None:
    numbers = Numbers()
    assert [numbers.heard(n) for n in (254, 255, 0, 3, 1, 3, 2)] == [0, 0, 0, 2, 0, 0, 0]
    assert numbers.missing == 0
    numbers.heard(5)
    numbers.restart()
    assert (numbers.lost, numbers.missing) == (1, 0)
    assert numbers.heard(200) == 0


def test_a_number_that_is_missed_for_a_whole_round_is_lost() -> None:
    numbers = Numbers()
    for number in (*range(10), *range(11, 256), *range(20)):
        numbers.heard(number)
    assert (numbers.lost, numbers.missing) == (1, 0)


def test_tinyos_conversation() -> None:
    kind, body = radio_messages.encode(radio_messages.TargetCommand(3, 0.5, 0.25))
    command = encode(SerialPacket(PacketType.DATA_ACK, 9, 0, encode_am(AmMessage(1, kind, body))))
    ack = encode(SerialPacket(PacketType.ACK, 9))
    other = encode(SerialPacket(PacketType.DATA, None, 0, encode_am(AmMessage(0, 6, b"\x01"))))
    session, items = run(
        log((">", command), (">", command), ("<", ack + other), ("<", b"\x7e\x45\x00\x01\x02\x7e"))
    )
    assert session.variant.name == "tinyos"
    assert [item.name for item in items] == ["TargetCommand"] * 2 + ["ack", "AM 0x06", "crc"]
    assert items[0].fields["x_m"] == 0.5
    assert items[1].what is What.AGAIN
    assert session.tally.crc_errors == 1


@pytest.mark.parametrize(("escaped", "name"), [(True, "xbee (AP 2)"), (False, "xbee (AP 1)")])
def test_xbee_mode_is_found(escaped: bool, name: str) -> None:
    frames = [xbee.TxRequest16(1, 0x7E11, 0, b"\x7e\x7d\x13"), xbee.TxStatus(1, 0)]
    session, items = run(b"".join(xbee.encode(frame, escaped=escaped) for frame in frames))
    assert session.variant.name == name
    assert [item.name for item in items] == ["TxRequest16", "TxStatus"]
    assert items[0].fields["destination"] == 0x7E11


def air(sequence: int, source: int = 1) -> bytes:
    kind, body = radio_messages.encode(radio_messages.CommandReply(1, 1))
    return append_fcs(tinyos.encode(tinyos.AmPacket(0, source, kind, body, sequence)))


def test_frames_on_the_air() -> None:
    ack = append_fcs(mac.encode(mac.ack_frame(4)))
    wrong = air(5)[:-1] + b"\0"
    session, items = run(pcap_of(air(4), air(4), ack, wrong, air(7), air(4, source=2)))
    assert [item.what for item in items] == [
        What.MESSAGE,
        What.AGAIN,
        What.CONTROL,
        What.ERROR,
        What.GAP,
        What.MESSAGE,
        What.MESSAGE,
    ]
    tally = session.tally
    assert tally.messages == {"CommandReply": 3}
    assert (tally.crc_errors, tally.lost, tally.retransmissions) == (1, 2, 1)


def test_frames_of_the_air_in_plain_hex() -> None:
    text = "\n".join(frame.hex(" ") for frame in (air(1), air(2)))
    session, items = run(text.encode() + b"\n")
    assert session.variant.name == "802.15.4"
    assert len(items) == 2


def test_what_is_no_protocol_is_said() -> None:
    with pytest.raises(UserError, match="wrong baud rate"):
        run(bytes(range(128, 256)) * 20)
    with pytest.raises(UserError, match="not of tinyos"):
        run(pcap_of(air(1)), "tinyos")


def test_a_protocol_that_is_given_is_believed() -> None:
    session, items = run(bytes(range(128, 256)) * 20, "link")
    assert session.tally.messages.total() == 0
    assert items


def test_the_command_knows_the_protocols() -> None:
    from tools.commands.decode import PROTOCOLS as OFFERED

    assert OFFERED == PROTOCOLS


def test_a_tally_is_json() -> None:
    assert Tally().as_dict()["lost_sequence_numbers"] == 0


def test_a_plant_in_the_loop_is_told_by_its_numbers() -> None:
    """Samples and pulses are streams: they have no sequence, and leave none missing."""
    sample = SensorSample.of(7, 10_000, 1, {3: 1526}, bytes(7), bytes(7))
    pulse = ServoPulse(3, 12_000, 0.0015, 7, 1_500)
    write = RegisterWrite(0x18, 0x20, 0x27)
    frames = [
        Frame(FrameType.STREAM, 0x12, 5, 0, 0, 4, PLANT_MESSAGES.encode(sample)),
        Frame(FrameType.STREAM, 0x21, 0, 5, 0x10, 4, PLANT_MESSAGES.encode(pulse)),
        Frame(FrameType.DATA, 0x21, 0, 5, 0x10, 4, PLANT_MESSAGES.encode(write)),
        Frame(FrameType.STREAM, 0x12, 5, 1, 0, 4, PLANT_MESSAGES.encode(sample)),
        Frame(FrameType.STREAM, 0x12, 5, 1, 0, 4, b"\xff"),
    ]
    ways = "><<>>"
    lines = [(way, frame.encode()) for way, frame in zip(ways, frames, strict=True)]
    session, items = run(log(*lines))
    assert [(item.what, item.name) for item in items] == [
        (What.MESSAGE, "SensorSample"),
        (What.MESSAGE, "ServoPulse"),
        (What.MESSAGE, "RegisterWrite"),
        (What.MESSAGE, "SensorSample"),
        (What.ERROR, "payload"),
    ]
    assert items[0].fields["an3"] == 1526
    assert items[1].fields["width_s"] == 0.0015
    assert session.tally.lost == 0


def test_messages_of_the_network_layer_are_told_with_what_follows_their_fields() -> None:
    """As they stand, octet by octet, on docs/messages.md."""
    beacon = "41 88 05 22 00 ff ff 01 00 3f 30 0c 01 ff ff ff ff 00 00 ff 00 02 aa e7 e9"
    item = "41 88 06 22 00 ff ff 01 00 3f 34 00 01 00 0c 69 74 65 6d"
    foreign = "41 88 07 22 00 ff ff 01 00 3f 30 0c 01 ff ff ff ff 00"  # no whole entry
    frames = [bytes.fromhex(beacon), *(append_fcs(bytes.fromhex(one)) for one in (item, foreign))]
    _, items = run(pcap_of(*frames))
    assert [(item.name, item.fields) for item in items] == [
        (
            "Beacon",
            {
                "sequence": 12, "flags": 1, "parent": 0xFFFF, "etx": 0xFFFF,
                "entries": [{"neighbour": 0, "inbound": 255}, {"neighbour": 2, "inbound": 170}],
            },
        ),
        ("SharedItem", {"origin": 1, "number": 12, "data": "69 74 65 6d"}),
        ("AM 0x30", {"data": "0c 01 ff ff ff ff 00"}),
    ]  # fmt: skip
    assert "entries=[{'neighbour': 0" in line(items[0])
