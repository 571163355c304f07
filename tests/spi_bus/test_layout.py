"""Declarative layouts: literal bytes, refusals, the message table row by row."""

import dataclasses
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.errors import FieldError, LayoutError, PayloadError, UnknownMessageError
from spi_bus.layout import I16, U8, U16, U48, Field, Layout, MessageRow, MessageTable
from spi_bus.messages import (
    LINK_MESSAGES,
    MASTER,
    SLAVE,
    GpsReport,
    Ping,
    Pong,
    SensorReport,
    SetReporting,
    TailBeat,
)


def value_of(row: Field) -> st.SearchStrategy:
    low, high = row.bounds
    if row.boolean:
        values: st.SearchStrategy = st.booleans()
    elif row.lsb_per_unit is None:
        values = st.integers(int(low), int(high))
    else:
        values = st.floats(low, high)
    return st.none() | values if row.optional else values


def message_of(layout: Layout) -> st.SearchStrategy:
    return st.builds(layout.message, *(value_of(row) for row in layout.rows))


any_row = st.sampled_from(LINK_MESSAGES.rows)


@given(st.data(), any_row)
def test_every_message_comes_back_within_half_a_bit(data, row):
    message = data.draw(message_of(row.layout))
    payload = LINK_MESSAGES.encode(message, row.sender)
    assert len(payload) == row.size <= 40
    back = LINK_MESSAGES.decode(payload, row.sender)
    assert type(back) is type(message)
    for field in row.layout.rows:
        sent, received = getattr(message, field.name), getattr(back, field.name)
        if sent is None or field.lsb_per_unit is None:
            assert received == sent
            assert type(received) is type(sent)
        else:
            error = received - sent
            if field.wraps:
                assert -math.pi <= received < math.pi
                error = math.remainder(error, 2 * math.pi)
            # Half an LSB, and what a double resolves of the largest angle that wraps.
            assert abs(error) <= 0.5 / field.lsb_per_unit * (1 + 1e-9) + 1e-9 * field.wraps
    # What was decoded is exact: it goes and comes without change.
    assert LINK_MESSAGES.encode(back) == payload


@given(st.binary(max_size=60))
def test_any_payload_is_a_message_or_a_payload_error(payload):
    try:
        message = LINK_MESSAGES.decode(payload)
    except PayloadError:
        return
    assert LINK_MESSAGES.encode(message) == payload


@given(st.data(), any_row)
def test_any_field_bytes_are_a_message_or_a_payload_error(data, row):
    fields = data.draw(st.binary(min_size=row.layout.size, max_size=row.layout.size))
    payload = bytes((row.kind,)) + fields
    try:
        message = LINK_MESSAGES.decode(payload)
    except PayloadError:
        return
    assert LINK_MESSAGES.encode(message) == payload


LITERAL = [
    (
        TailBeat(0x1234, -0.5, 0.25, 0.9, 5.0),
        "01 3412 f0d8 8813 8403 f401",
    ),
    (SetReporting(0.1, True), "02 6400 01"),
    (Ping(0xBEEF), "03 efbe"),
    (
        SensorReport(
            0x0102030405,
            7,
            -0.001,
            9.81,
            None,
            None,
            -math.pi,
            math.pi / 2,
            None,
            7.4,
            None,
            -1.5,
            12.3,
        ),
        "81 b306 050403020100 0700 feff aa07 0000 0000 0080 0040 0000 e81c 0000 6aff 7b00",
    ),
    (
        GpsReport(1_000_000, 42.7284, -84.4819, 0.05, None, 43_200.2, 9),
        "82 17 40420f000000 20d67719 c815a5cd 0500 0000 c82e9302 09",
    ),
]


@pytest.mark.parametrize(("message", "payload"), LITERAL)
def test_literal_payloads(message, payload):
    assert LINK_MESSAGES.encode(message).hex() == payload.replace(" ", "")
    assert LINK_MESSAGES.decode(bytes.fromhex(payload)) == message


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (TailBeat(1, 1.7, 0, 0.9, 1), r"TailBeat.bias_rad = 1.7 is outside -1.6 to 1.6 rad"),
        (TailBeat(1, math.nan, 0, 0.9, 1), "bias_rad = nan"),
        (TailBeat(1, 0, math.inf, 0.9, 1), "amplitude_rad = inf"),
        (TailBeat(70_000, 0, 0, 0.9, 1), "command_id = 70000 is outside 0 to 65535"),
        (TailBeat(1.5, 0, 0, 0.9, 1), "command_id = 1.5 is no integer"),
        (TailBeat(1, None, 0, 0.9, 1), "bias_rad = None is no number"),
        (TailBeat(1, "0", 0, 0.9, 1), "bias_rad = '0' is no number"),
        (SetReporting(0.1, 2), "gps_enabled = 2"),
        (GpsReport(1 << 48, None, None, None, None, None, 0), "time_us"),
        (GpsReport(0, None, None, None, math.inf, None, 0), "course_rad"),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(message, complaint):
    with pytest.raises(FieldError, match=complaint):
        LINK_MESSAGES.encode(message)


@pytest.mark.parametrize(
    ("payload", "complaint"),
    [
        (b"", "absent"),
        (b"\x77", "number 119"),
        (bytes.fromhex("03ef"), "2 bytes, not 1"),
        (bytes.fromhex("03efbe00"), "2 bytes, not 3"),
        (bytes.fromhex("02640002"), "gps_enabled"),
        (bytes.fromhex("8280" + "00" * 6 + "00" * 17), "mask"),
        (bytes.fromhex("8200" + "00" * 6 + "01" + "00" * 16), "mask bit"),
    ],
)
def test_a_payload_that_no_encoder_makes_is_refused(payload, complaint):
    with pytest.raises(PayloadError, match=complaint):
        LINK_MESSAGES.decode(payload)


def test_each_side_speaks_and_hears_its_own_messages():
    with pytest.raises(UnknownMessageError, match="sent by the slave"):
        LINK_MESSAGES.encode(Pong(1), MASTER)
    with pytest.raises(UnknownMessageError, match="int is no message"):
        LINK_MESSAGES.encode(3)
    with pytest.raises(PayloadError, match="slave"):
        LINK_MESSAGES.decode(LINK_MESSAGES.encode(Ping(1)), SLAVE)


@dataclasses.dataclass(frozen=True, slots=True)
class Sample:
    count: int
    level: float


def test_big_endian_and_48_bits():
    layout = Layout(Sample, (Field("count", U48), Field("level", I16, "V", 100)), "big")
    assert layout.encode(Sample(0x010203, -1.0)).hex() == "000000010203ff9c"
    assert layout.decode(bytes.fromhex("ff000000010203ff9c"), 1) == Sample(0x010203, -1.0)


def test_offsets_add_up_to_what_struct_says():
    for row in LINK_MESSAGES.rows:
        *_, (offset, last) = row.layout.offsets()
        size = last.wire.size if isinstance(last, Field) else last.size
        assert offset + size == row.layout.size
    offset_of = {
        field.name: offset
        for offset, field in next(
            row.layout for row in LINK_MESSAGES.rows if row.layout.message is SensorReport
        ).offsets()
    }
    assert offset_of["battery_v"] == struct.calcsize("<H6sH7h")


@pytest.mark.parametrize(
    "rows",
    [
        (Field("count", U8),),
        (Field("level", I16, "V", 100), Field("count", U8)),
        (Field("count", U8, maximum=256), Field("level", I16, "V", 100)),
        (Field("count", U8, minimum=-1), Field("level", I16, "V", 100)),
        (Field("count", U8), Field("level", I16, "V", 100, 0, 400)),
        (Field("count", U8), Field("level", I16, "V", 0)),
        (Field("count", U8), Field("level", U16, "rad", 10_000, wraps=True)),
        (Field("count", U8), Field("level", I16, "V", 100, boolean=True)),
    ],
)
def test_a_table_that_contradicts_itself_is_refused(rows):
    with pytest.raises(LayoutError):
        Layout(Sample, rows)


def test_a_number_or_class_twice_is_refused():
    layout = Layout(Ping, (Field("token", U16),))
    other = Layout(Pong, (Field("token", U16),))
    with pytest.raises(LayoutError, match="twice"):
        MessageTable((MessageRow(1, MASTER, layout, ""), MessageRow(1, SLAVE, other, "")))
    with pytest.raises(LayoutError, match="twice"):
        MessageTable((MessageRow(1, MASTER, layout, ""), MessageRow(2, SLAVE, layout, "")))
