"""docs/messages.md says what the tables say, and its examples are what goes over the wire.

The examples stand here once more, as literals: a change of a layout, a scale or a frame shows as a
changed byte, and not only as a page to be made anew.
"""

from __future__ import annotations

import binascii
import struct

import pytest

from radio_802154 import fcs, tinyos
from radio_802154 import messages as radio
from radio_802154 import routing_messages as routing
from spi_bus.frame import Decoder, Frame, FrameType
from spi_bus.layout import Field
from spi_bus.messages import LINK_MESSAGES
from spi_bus.plant_messages import PLANT_MESSAGES, STREAMED
from tools import message_reference
from tools.message_reference import (
    PAGE,
    ROUTING_EXAMPLES,
    examples,
    link_frame,
    page,
    radio_frame,
    routing_frame,
)

# fmt: off
LINK = {
    "TailBeat": "08 12 12 05 03 04 01 01 01 01 09 88 13 84 03 f4 01 b4 2b 00",
    "SetReporting": "08 12 12 05 03 04 02 14 04 01 9c ad 00",
    "Ping": "08 12 12 05 03 04 03 2a 03 fc 14 00",
    "ClockReport": "08 12 12 05 03 04 04 2a 04 40 f4 7b 01 01 03 d7 6d 00",
    "SensorReport": (
        "0c 12 21 05 03 14 81 ff 03 80 84 1e 01 01 02 64 04 e8 03 14 11 d8 ff aa 07 be 28 "
        "27 29 c4 09 e8 1c 4a 01 66 08 01 03 26 6f 00"
    ),
    "GpsReport": (
        "0b 12 21 05 03 14 82 1f c0 c6 2d 01 01 0a c8 3d 77 19 78 4c a5 cd 0c 0a e2 c2 80 "
        "29 b3 02 07 01 0d 00"
    ),
    "CommandApplied": "08 12 21 05 03 14 83 01 04 87 d6 12 01 01 03 84 bf 00",
    "BoardEvent": "09 12 21 05 03 14 84 d0 07 01 01 01 03 01 03 03 4a 05 00",
    "Pong": "08 12 21 05 03 14 85 2a 03 ef 46 00",
    "ClockRequest": "08 12 21 05 03 14 86 2a 03 b6 16 00",
}
PLANT = {
    "HostGreeting": "0a 12 12 05 03 04 21 01 10 27 01 04 a0 86 01 03 31 9c 00",
    "SensorSample": (
        "0a 14 12 05 03 04 22 f8 01 64 01 01 04 40 42 0f 01 01 02 03 01 01 01 01 01 0a f6 "
        "05 f6 05 64 03 f5 0b 19 02 31 01 01 01 01 01 01 01 01 01 01 01 01 01 01 06 0f 40 "
        "01 c0 ff 02 3f 09 c3 ff f6 fe 25 01 48 84 00"
    ),
    "NmeaCharacters": (
        "0a 12 12 05 03 04 23 b0 10 30 01 01 0e c0 12 0a 24 47 50 52 4d 43 2c 31 32 30 01 "
        "01 01 01 01 03 cd fc 00"
    ),
    "GpsPulse": "07 12 12 05 03 04 24 03 09 3d 01 01 04 40 0d 03 03 e1 b7 00",
    "BoardGreeting": "09 12 21 05 03 14 a1 01 c8 06 f8 01 01 85 da 00",
    "ServoPulse": (
        "08 14 21 05 03 14 a2 32 01 01 04 60 90 0f 01 01 04 98 3a 64 01 01 03 68 10 01 03 "
        "34 10 00"
    ),
    "RegisterWrite": "0c 12 21 05 03 14 a3 18 20 27 bd bf 00",
    "BoardStatus": (
        "0a 12 21 05 03 14 a4 40 4b 4c 01 01 03 f4 01 01 02 01 01 01 01 01 01 01 01 01 02 "
        "fa 01 01 03 e0 01 01 01 01 01 01 03 69 1b 00"
    ),
}
RADIO = {
    "TailBeatCommand": "61 88 05 22 00 01 00 00 00 3f 10 00 01 f8 30 13 88 03 84 00 00 93 e4",
    "TargetCommand": "61 88 05 22 00 01 00 00 00 3f 11 00 02 07 d0 fa 24 eb b5",
    "Pose": "61 88 05 22 00 01 00 00 00 3f 12 01 f4 04 e2 c2 e2 00 00 ea 60 5b 11",
    "PoseBatch": (
        "61 88 05 22 00 01 00 00 00 3f 13 00 00 ea 60 00 01 01 f4 04 e2 c2 e2 00 02 fe 0c 07 d0 "
        "3d 1e ff ff 00 00 00 00 00 00 1a a7"
    ),
    "CommandReply": "61 88 05 22 00 00 00 01 00 3f 20 00 01 01 81 1c",
    "Telemetry": (
        "61 88 05 22 00 00 00 01 00 3f 21 0f 00 00 ea 60 00 0c 14 5f fe 0c 07 d0 1c e8 00 "
        "00 00 00 00 00 03 e8 00 00 01 42 6e 76"
    ),
}
ROUTING = {
    "Beacon": (
        "41 88 05 22 00 ff ff 01 00 3f 30 0c 01 ff ff ff ff 00 00 ff 00 02 aa e7 e9"
    ),
    "CollectionData": (
        "61 88 05 22 00 00 00 01 00 3f 31 01 00 28 00 02 00 01 86 a0 00 03 72 65 63 6f 72 64 e4 8d"
    ),
    "CollectionAck": "61 88 05 22 00 00 00 01 00 3f 32 00 02 00 00 01 86 9e 05 c1 0f",
    "Versions": "41 88 05 22 00 ff ff 01 00 3f 33 8b 2f c1 d4 00 01 00 0c 00 02 00 00 14 1c",
    "SharedItem": "41 88 05 22 00 ff ff 01 00 3f 34 00 01 00 0c 69 74 65 6d 59 e8",
    "TimeMark": "41 88 05 22 00 ff ff 01 00 3f 35 00 00 09 00 1e 00 00 64 c3",
}
# fmt: on


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python -m tools.message_reference"


def test_every_message_has_its_literal() -> None:
    assert list(LINK) == [row.layout.name for row in LINK_MESSAGES.rows]
    assert list(PLANT) == [row.layout.name for row in PLANT_MESSAGES.rows]
    assert list(RADIO) == [row.layout.name for row in radio.AM_MESSAGES]
    assert list(ROUTING) == [row.layout.name for row in routing.ROUTING_MESSAGES]


@pytest.mark.parametrize("row", LINK_MESSAGES.rows, ids=lambda row: row.layout.name)
def test_link_example(row) -> None:
    message = examples()[row.layout.message]
    wire = bytes.fromhex(LINK[row.layout.name])
    assert link_frame(row, message).encode().hex(" ") == wire.hex(" ")
    assert f"wire     {LINK[row.layout.name]}\n" in page()
    (body,) = Decoder().receive(wire)
    unstuffed = next(
        line
        for line in page().split("\n")
        if line.startswith(f"frame    {body[:5].hex(' ')} | {body[5:].hex(' ')} | ")
    )
    crc = int(unstuffed.rpartition("|")[2].replace(" ", ""), 16)
    assert crc == binascii.crc_hqx(body, 0xFFFF) ^ 0xFFFF
    received = LINK_MESSAGES.decode(Frame.parse(body).payload, row.sender)
    close(row, message, received)


@pytest.mark.parametrize("row", PLANT_MESSAGES.rows, ids=lambda row: row.layout.name)
def test_plant_example(row) -> None:
    message = examples()[row.layout.message]
    wire = bytes.fromhex(PLANT[row.layout.name])
    assert link_frame(row, message, PLANT_MESSAGES).encode().hex(" ") == wire.hex(" ")
    assert f"wire     {PLANT[row.layout.name]}\n" in page()
    (body,) = Decoder().receive(wire)
    frame = Frame.parse(body)
    streamed = row.layout.message in STREAMED
    assert frame.frame_type == (FrameType.STREAM if streamed else FrameType.DATA)
    assert "a stream" in row.summary or not streamed
    close(row, message, PLANT_MESSAGES.decode(frame.payload, row.sender))


@pytest.mark.parametrize("row", radio.AM_MESSAGES, ids=lambda row: row.layout.name)
def test_radio_example(row) -> None:
    message = examples()[row.layout.message]
    mpdu = bytes.fromhex(RADIO[row.layout.name])
    assert radio_frame(row, message).hex(" ") == mpdu.hex(" ")
    assert f"frame    {RADIO[row.layout.name]}\n" in page()
    packet = tinyos.decode(fcs.strip_fcs(mpdu))
    close(row, message, radio.decode(packet.am_type, packet.payload, row.sender))


@pytest.mark.parametrize("example", ROUTING_EXAMPLES, ids=lambda e: type(e[0]).__name__)
def test_example_of_the_network_layer(example) -> None:
    mpdu = bytes.fromhex(ROUTING[type(example[0]).__name__])
    assert routing_frame(*example).hex(" ") == mpdu.hex(" ")
    assert f"frame    {mpdu.hex(' ')}\n" in page()
    packet = tinyos.decode(fcs.strip_fcs(mpdu))
    assert routing.read(packet.am_type, packet.payload) == example


def close(row, sent: object, received: object) -> None:
    for field in row.layout.rows:
        value, got = getattr(sent, field.name), getattr(received, field.name)
        if field.lsb_per_unit is None or value is None:
            assert got == value
        else:
            assert abs(got - value) <= 0.51 / field.lsb_per_unit


def test_offsets_on_the_page_are_those_of_a_struct_without_padding() -> None:
    """Read back from the page by itself: types in order give the offsets and the size."""
    codes = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u48": "6s"}
    on_air = (*radio.AM_MESSAGES, *routing.ROUTING_MESSAGES, *routing.ROUTING_ENTRIES)
    for row in (*LINK_MESSAGES.rows, *PLANT_MESSAGES.rows, *on_air):
        section = page().partition(f"### {row.layout.name}\n")[2].partition("\n### ")[0]
        lines = [line.split(" | ") for line in section.split("\n") if line[:3] != "| O"]
        cells = [cell for cell in lines if cell[0][2:].isdigit() and len(cell) > 5]
        at = 0
        for offset, kind, *_ in cells:
            assert int(offset[2:]) == at
            at += struct.calcsize("<" + codes[kind])
        assert at == (row.layout.size if row in on_air else row.size)
        names = [cell[2].split("`")[1] for cell in cells if "`" in cell[2]]
        assert names == [item.name for _, item in row.layout.offsets() if isinstance(item, Field)]


def test_a_message_without_an_example_is_refused(monkeypatch) -> None:
    monkeypatch.setattr(message_reference, "EXAMPLES", message_reference.EXAMPLES[1:])
    with pytest.raises(ValueError, match="TailBeat has no example"):
        examples()
