"""docs/messages.md and the C headers, made from the message tables of the links and of the radio.

Offsets, types, units, scales, ranges and mask bits come from the rows that encode; the worked
examples are encoded by the same code on the way. An example is here and not in the tables, because
it says nothing about the protocol; a message without one is refused.

`python -m tools.message_reference` writes all files anew; tests fail while one of them is stale.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterable, Sequence
from enum import IntEnum, IntFlag
from pathlib import Path
from textwrap import dedent
from typing import Any, Final

from radio_802154 import fcs, tinyos
from radio_802154 import messages as radio
from radio_802154 import routing_messages as routing
from spi_bus.crc import CRC_BYTES, crc16
from spi_bus.frame import HEADER_BYTES, MAX_PAYLOAD_BYTES, Flag, Frame, FrameType
from spi_bus.layout import (
    TURN_LSB_PER_RAD,
    Field,
    MessageRow,
    MessageTable,
    WireType,
    raw_bounds,
)
from spi_bus.messages import (
    LINK_MESSAGES,
    SLAVE,
    BoardEvent,
    BoardEventCode,
    ClockReport,
    ClockRequest,
    CommandApplied,
    GpsReport,
    Ping,
    Pong,
    SensorReport,
    SetReporting,
    TailBeat,
)
from spi_bus.plant_messages import (
    PLANT_MESSAGES,
    PLANT_VERSION,
    STREAMED,
    BoardGreeting,
    BoardStatus,
    GpsPulse,
    HostGreeting,
    NmeaCharacters,
    RegisterWrite,
    SampleStatus,
    SensorSample,
    ServoPulse,
)
from tools.message_header import HEADERS
from tools.message_header import text as header_text

PAGE: Final = Path(__file__).resolve().parent.parent / "docs" / "messages.md"

EXAMPLES: Final[tuple[object, ...]] = (
    TailBeat(1, 0.0, 0.25, 0.9, 5.0),
    SetReporting(0.02, True),
    Ping(42),
    ClockReport(42, 8_123_456),
    SensorReport(
        2_000_000, 100, 0.5, 0.1, -0.2, 9.81, 1.0, 1.01, 0.25, 7.4, 0.33, 21.5, None
    ),
    GpsReport(3_000_000, 42.7245, -84.4805, 0.12, -1.5, 45_296.0, 7),
    CommandApplied(1, 1_234_567),
    BoardEvent(2_000, BoardEventCode.RESET, 3),
    Pong(42),
    HostGreeting(PLANT_VERSION, 10_000, 100_000),
    SensorSample.of(
        100, 1_000_000, SampleStatus.SUPPLY_ON | SampleStatus.ACCELEROMETER_NEW,
        {3: 1526, 4: 1526, 5: 868, 6: 3061, 7: 25, 8: 49},
        bytes.fromhex("0F 40 01 C0 FF 00 3F"), bytes.fromhex("00 C3 FF F6 FE 25 01"),
    ),
    NmeaCharacters.of(3_150_000, 4800, b"$GPRMC,120"),
    GpsPulse(4_000_000, 200_000),
    BoardGreeting(PLANT_VERSION, 200, 0x01F8, True),
    ServoPulse(50, 1_020_000, 0.0015, 100, 4_200),
    RegisterWrite(0x18, 0x20, 0x27),
    BoardStatus(5_000_000, 500, 1, 0, 0, 250, 480, 0),
    ClockRequest(42),
    radio.TailBeatCommand(1, -0.1, 0.25, 0.9, 0.0),
    radio.TargetCommand(2, 2.0, -1.5),
    radio.Pose(0.5, 1.25, -1.5, 60_000),
    radio.PoseBatch.of(
        [(1, radio.Pose(0.5, 1.25, -1.5, 60_000)), (2, radio.Pose(-0.5, 2.0, 1.5, 60_000))]
    ),
    radio.CommandReply(1, radio.CommandStatus.APPLIED),
    radio.Telemetry(
        60.0, 12, 0.5, -0.25, 0.1, 7.4, None, None, 1_000, 0, 1,
        radio.TelemetryFlag.HEADING_CONTROL | radio.TelemetryFlag.RESET,
    ),
)  # fmt: skip
"""A message of every kind, with values that show sign, scale and a missing reading."""

ROUTING_EXAMPLES: Final[tuple[tuple[object, list[Any] | bytes], ...]] = (
    (
        routing.Beacon(12, routing.BeaconFlag.PULL, 0xFFFF, 0xFFFF),
        [routing.LinkQuality(0, 255), routing.LinkQuality(2, 170)],
    ),
    (routing.CollectionData(1, 40, 2, 100_000, 0, 3), b"record"),
    (routing.CollectionAck(2, 0, 99_998, 0b101), b""),
    (routing.Versions(0x8B2FC1D4), [routing.Version(1, 12), routing.Version(2, 0)]),
    (routing.SharedItem(1, 12), b"item"),
    (routing.TimeMark(0, 9, 1_966_080), b""),
)
"""A message of every kind of the network layer, and what follows its fields."""

SEQUENCE: Final = 5
ACKNOWLEDGE: Final = 3
WINDOW: Final = 4
MASTER_EPOCH: Final = 1
SLAVE_EPOCH: Final = 2
BASE_ADDRESS: Final = 0
ROBOT_ADDRESS: Final = 1

_LINK_PART = f"""\
# Messages, byte by byte

Made by `python -m tools.message_reference` from the tables in `spi_bus/messages.py`,
`spi_bus/plant_messages.py`, `radio_802154/messages.py` and `radio_802154/routing_messages.py`:
change those and not this page. What happens around the messages is in [link.md](link.md),
[plant-in-the-loop.md](plant-in-the-loop.md), [radio.md](radio.md) and [network.md](network.md); as
C they are in `spi_bus/firmware_c/` ([firmware-c.md](firmware-c.md)).

A value is raw / scale; the sender rounds to the nearest raw value and refuses what is outside the
range. *turn* as scale is {TURN_LSB_PER_RAD:.9f} LSB per rad: 2^16 LSB are one turn, so the integer
wraps where the angle does, and any angle is taken. A field marked *opt. n* has a value only where
bit n of the mask in front is set (value 2^n); without it the field is zero, and a receiver refuses
anything else. Offsets count from the first byte of the payload.

## The link between the boards

Little-endian. Byte 0 of the payload is the message number; {MAX_PAYLOAD_BYTES} bytes are the most.
The examples are DATA frames of a session between epochs {MASTER_EPOCH} (master) and
{SLAVE_EPOCH} (slave), with sequence {SEQUENCE}, acknowledge {ACKNOWLEDGE}, window {WINDOW}.
*Frame* is header, payload and CRC before stuffing, *wire* what is sent: COBS code bytes instead of
zeros, and a zero at the end.
"""
_PLANT_PART = f"""\
## A plant in the loop

As on the link between the boards, with version {PLANT_VERSION} of this table. The master is the
host that computes the plant, the slave the navigation board. Messages that are called a stream go
in STREAM frames, all others in DATA frames.
"""
_RADIO_PART = """\
## The radio

Big-endian, as TinyOS `nx_struct`s. The message number is the AM type and not part of the payload.
The examples are whole MAC frames with FCS, DSN 5, PAN 0x0022, base station 0x0000, robot 0x0001,
acknowledgement requested.
"""
_ROUTING_PART = """\
## The network layer

Active messages as those above, from board to board. Board 0x0001 sends these examples, the second
and the third to 0x0000, the others to all. What follows a message's fields does so without a gap,
up to the end of the payload, which has 28 octets at most.
"""


def examples() -> dict[type, object]:
    """The example of every message, by class.

    Raises:
        ValueError: a message of a table has no example.

    """
    found: dict[type, object] = {type(example): example for example in EXAMPLES}
    for row in (*LINK_MESSAGES.rows, *PLANT_MESSAGES.rows, *radio.AM_MESSAGES):
        if row.layout.message not in found:
            raise ValueError(f"{row.layout.name} has no example in tools/message_reference.py")
    return found


def link_frame(row: MessageRow, message: object, table: MessageTable = LINK_MESSAGES) -> Frame:
    """The frame that carries an example on the link, or on the line of a plant in the loop."""
    ours, peers = (
        (SLAVE_EPOCH, MASTER_EPOCH) if row.sender == SLAVE else (MASTER_EPOCH, SLAVE_EPOCH)
    )
    return Frame(
        FrameType.STREAM if type(message) in STREAMED else FrameType.DATA,
        ours << 4 | peers,
        SEQUENCE,
        ACKNOWLEDGE,
        Flag.FROM_SLAVE if row.sender == SLAVE else 0,
        WINDOW,
        table.encode(message, row.sender),
    )


def radio_frame(row: MessageRow, message: object) -> bytes:
    """The MAC frame, with FCS, that carries an example in the air."""
    am_type, payload = radio.encode(message, row.sender)
    from_base = row.sender == radio.BASE
    packet = tinyos.AmPacket(
        destination=ROBOT_ADDRESS if from_base else BASE_ADDRESS,
        source=BASE_ADDRESS if from_base else ROBOT_ADDRESS,
        am_type=am_type,
        payload=payload,
        sequence=SEQUENCE,
    )
    return fcs.append_fcs(tinyos.encode(packet))


def routing_frame(message: object, rest: list[Any] | bytes) -> bytes:
    """The MAC frame, with FCS, that carries an example of the network layer in the air."""
    am_type, payload = routing.write(message, rest)
    to_one = am_type in (routing.DATA_AM, routing.ACK_AM)
    packet = tinyos.AmPacket(
        destination=BASE_ADDRESS if to_one else tinyos.AM_BROADCAST,
        source=ROBOT_ADDRESS,
        am_type=am_type,
        payload=payload,
        sequence=SEQUENCE,
    )
    return fcs.append_fcs(tinyos.encode(packet))


def page() -> str:
    """Return the text of docs/messages.md."""
    found = examples()
    parts = [_LINK_PART, *_line(LINK_MESSAGES), _codes(BoardEventCode)]
    parts += [_PLANT_PART, *_line(PLANT_MESSAGES), _codes(SampleStatus)]
    parts += [_RADIO_PART, _overview(radio.AM_MESSAGES, "AM type")]
    for row in radio.AM_MESSAGES:
        message = found[row.layout.message]
        payload = row.layout.encode(message)
        parts.append(_message(row, 0, message, payload))
        parts.append(
            _fenced(("payload", payload.hex(" ")), ("frame", radio_frame(row, message).hex(" ")))
        )
    parts += [_codes(radio.CommandStatus), _codes(radio.TelemetryFlag)]
    parts += [_ROUTING_PART, _overview(routing.ROUTING_MESSAGES, "AM type")]
    for row, (message, rest) in zip(routing.ROUTING_MESSAGES, ROUTING_EXAMPLES, strict=True):
        payload = routing.write(message, rest)[1]
        parts.append(_message(row, 0, message, payload))
        for entry in routing.ROUTING_ENTRIES:
            if entry.kind == row.kind and not isinstance(rest, bytes):
                parts.append(_message(entry, 0, rest[0], entry.layout.encode(rest[0])))
        frame = routing_frame(message, rest).hex(" ")
        parts.append(_fenced(("payload", payload.hex(" ")), ("frame", frame)))
    parts.append(_codes(routing.BeaconFlag))
    return "\n".join(parts)


def _line(table: MessageTable) -> list[str]:
    """Overview and messages of a table that a link carries."""
    found = examples()
    parts = [_overview(table.rows, "No.")]
    for row in table.rows:
        frame = link_frame(row, found[row.layout.message], table)
        wire = frame.encode()
        body = frame.body()
        head = body[:HEADER_BYTES].hex(" ")
        parts.append(_message(row, 1, found[row.layout.message], frame.payload))
        parts.append(
            _fenced(
                ("payload", frame.payload.hex(" ")),
                ("frame", f"{head} | {frame.payload.hex(' ')} | {_crc(body)}"),
                ("wire", wire.hex(" ")),
            )
        )
    return parts


def _crc(body: bytes) -> str:
    """Hexadecimal CRC of a frame, as sent."""
    return crc16(body).to_bytes(CRC_BYTES, "big").hex(" ")


def _overview(rows: Iterable[MessageRow], number: str) -> str:
    lines = [f"| {number} | Message | From | Bytes | What |", "|---|---|---|---|---|"]
    for row in rows:
        size = row.layout.size if number == "AM type" else row.size
        more = "" if not row.tail else " + n" if row.tail == 1 else f" + {row.tail} n"
        name = row.layout.name
        lines.append(
            f"| 0x{row.kind:02X} | [{name}](#{name.lower()}) | {row.sender} | {size}{more} "
            f"| {row.summary} |"
        )
    return "\n".join([*lines, ""])


def _message(row: MessageRow, start: int, example: object, payload: bytes) -> str:
    layout = row.layout
    lines = [f"### {layout.name}", "", _summary(layout.message), ""]
    lines += [
        f"0x{row.kind:02X}, from the {row.sender}."
        if row not in routing.ROUTING_ENTRIES
        else f"An entry: {row.summary}.",
        "",
        "| Offset | Type | Field | Unit | Scale | Range | Meaning | Example | Bytes |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    if start:
        lines.append(f"| 0 | u8 | number | | | | | 0x{row.kind:02X} | `{row.kind:02x}` |")
    bit = 0
    for offset, item in layout.offsets():
        at = start + offset
        wire = item if isinstance(item, WireType) else item.wire
        octets = payload[at : at + wire.size]
        raw = int.from_bytes(octets, layout.byte_order, signed=wire.signed)
        if isinstance(item, WireType):
            optional = sum(field.optional for field in layout.rows)
            cells = [
                "mask", "", "", f"0x0 to 0x{(1 << optional) - 1:X}", "which fields have a value",
                f"0x{raw:X}",
            ]  # fmt: skip
        else:
            cells = _cells(item, bit, getattr(example, item.name))
            bit += item.optional
            if item.lsb_per_unit is not None:
                cells[-1] += f" → {raw}".replace("-", "−")
        text = " | ".join([str(at), wire.name, *cells, f"`{octets.hex(' ')}`"])
        lines.append(f"| {text} |".replace("|  |", "| |").replace("|  |", "| |"))
    return "\n".join([*lines, ""])


def _cells(field: Field, bit: int, value: Any) -> list[str]:
    """Field, unit, scale, range, meaning and example of a row."""
    low, high = raw_bounds(field)
    if field.lsb_per_unit is None:
        scale, bounds = "", "0 or 1" if field.boolean else f"{low} to {high}"
    elif field.wraps:
        scale, bounds = "turn", "−π to π"
    else:
        scale = (
            f"{field.lsb_per_unit:g}" if field.lsb_per_unit < 1e6 else f"{field.lsb_per_unit:.0f}"
        )
        bounds = f"{low / field.lsb_per_unit:.10g} to {high / field.lsb_per_unit:.10g}"
    name = f"`{field.name}`" + (f" opt. {bit}" if field.optional else "")
    unit = "" if field.unit == "1" else field.unit
    shown = (
        "none" if value is None else str(int(value)) if field.lsb_per_unit is None else str(value)
    )
    return [name, unit, scale, bounds.replace("-", "−"), field.summary, shown.replace("-", "−")]


def _summary(message: type) -> str:
    text = inspect.getdoc(message) or ""
    return " ".join(text.split())


def _fenced(*lines: tuple[str, str]) -> str:
    width = max(len(name) for name, _ in lines)
    return "\n".join(["```", *(f"{name:<{width}}  {text}" for name, text in lines), "```", ""])


def _codes(codes: type[IntEnum] | type[IntFlag]) -> str:
    """Members with the text that stands under each in the source."""
    body: Sequence[ast.stmt] = ast.parse(dedent(inspect.getsource(codes))).body[0].body  # type: ignore[attr-defined]
    meanings: dict[str, str] = {}
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if not (isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)):
            continue
        text = ""
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            text = " ".join(str(following.value.value).split())
        meanings[statement.targets[0].id] = text
    flags = issubclass(codes, IntFlag)
    lines = [f"### {codes.__name__}", "", _summary(codes), ""]
    lines += [f"| {'Bit' if flags else 'Value'} | Name | Meaning |", "|---|---|---|"]
    for code in codes:
        number = f"0x{code.value:02X}" if flags else str(code.value)
        lines.append(f"| {number} | {code.name} | {meanings[str(code.name)]} |")
    return "\n".join([*lines, ""])


def main() -> int:
    """Write the page and the C headers."""
    PAGE.write_text(page(), encoding="utf-8")
    for header in HEADERS:
        header.path.write_text(header_text(header), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
