"""C encoders and decoders against the table: same bytes, same refusals, for any raw values.

The oracle is neither codec: bytes put together by hand from raw integers at the table's offsets.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radio_802154 import messages as radio
from radio_802154 import routing_messages as routing
from radio_802154.errors import RadioError
from spi_bus.errors import PayloadError
from spi_bus.layout import Field, MessageRow, MessageTable, WireType, raw_bounds
from spi_bus.messages import LINK_MESSAGES
from tests.spi_bus.firmware_c.conftest import senders
from tools.message_header import HEADERS, Header, text

LINK, RADIO, ROUTING, _ = HEADERS
ROWS = [(header, row) for header in HEADERS for row in header.rows]
each_message = pytest.mark.parametrize(
    ("header", "row"), ROWS, ids=[row.layout.name for _, row in ROWS]
)
each_header = pytest.mark.parametrize("header", HEADERS, ids=[header.file for header in HEADERS])


def size_of(header: Header, row: MessageRow) -> int:
    return header.first + row.layout.size


def raw_values(wire: WireType, low: int, high: int) -> st.SearchStrategy[int]:
    near = [wire.minimum, low - 1, low, 0, high, high + 1, wire.maximum]
    edges = [value for value in near if wire.minimum <= value <= wire.maximum]
    inside = st.integers(low, high)
    return inside | inside | st.sampled_from(edges) | st.integers(wire.minimum, wire.maximum)


@dataclass
class Raw:
    """Raw integers in the order of the wire, the mask first, and their payload."""

    values: list[int]
    payload: bytes


@st.composite
def raws(draw, header: Header, row: MessageRow) -> Raw:
    values = []
    payload = bytes((row.kind,)) if header.numbered else b""
    mask, bit = 0, 1
    for _, item in row.layout.offsets():
        wire = item.wire if isinstance(item, Field) else item
        if isinstance(item, Field):
            value = draw(raw_values(wire, *raw_bounds(item)))
            if item.optional:
                if not mask & bit:
                    value = 0
                bit <<= 1
        else:
            optional = sum(field.optional for field in row.layout.rows)
            value = mask = draw(raw_values(wire, 0, (1 << optional) - 1))
        values.append(value)
        payload += value.to_bytes(wire.size, row.layout.byte_order, signed=wire.signed)
    return Raw(values, payload)


def array(values: list[int]) -> ctypes.Array:
    return (ctypes.c_int64 * len(values))(*values)


def python_takes(header: Header, row: MessageRow, payload: bytes) -> bool:
    try:
        if header.numbered:
            table = MessageTable(header.rows)
            again = table.encode(table.decode(payload, row.sender))
        elif header is ROUTING:
            again = routing.write(*routing.read(row.kind, payload))[1]
        else:
            again = radio.encode(radio.decode(row.kind, payload))[1]
    except (PayloadError, RadioError):
        return False
    assert again == payload
    return True


@each_header
def test_the_header_is_up_to_date(header):
    made = text(header)
    assert header.path.read_text(encoding="utf-8") == made, "python -m tools.message_reference"


@each_message
@given(data=st.data())
def test_c_encodes_and_decodes_what_python_does_and_refuses_the_rest(messages, header, row, data):
    library = messages(header)
    raw = data.draw(raws(header, row))
    takes = python_takes(header, row, raw.payload)
    out = ctypes.create_string_buffer(b"\xee" * 96)
    size = library.shim_encode(row.kind, array(raw.values), out)
    assert size == (size_of(header, row) if takes else 0)
    assert out.raw[:size] == raw.payload[:size]
    assert out.raw[size:96] == b"\xee" * (96 - size), "written beyond the message"
    values = array([0] * len(raw.values))
    decoded = library.shim_decode(row.kind, values, raw.payload, len(raw.payload))
    assert decoded == takes
    if takes:
        assert list(values) == raw.values
    for index, sender in enumerate(senders(header)):
        said = library.shim_from(index, row.kind, raw.payload, len(raw.payload))
        assert said == (takes and sender == row.sender)


@each_message
def test_every_bound_is_the_last_that_is_taken(messages, header, row):
    library = messages(header)
    items = list(row.layout.offsets())
    mask = (1 << sum(field.optional for field in row.layout.rows)) - 1
    plain = [max(0, raw_bounds(item)[0]) if isinstance(item, Field) else mask for _, item in items]
    for index, (offset, item) in enumerate(items):
        wire = item.wire if isinstance(item, Field) else item
        low, high = raw_bounds(item) if isinstance(item, Field) else (0, mask)
        for value in (low - 1, low, high, high + 1):
            if not wire.minimum <= value <= wire.maximum:
                continue
            values = [*plain[:index], value, *plain[index + 1 :]]
            if not isinstance(item, Field) and value == 0:
                continue  # without a bit in the mask nothing has a value: all zeros, as they are
            out = ctypes.create_string_buffer(96)
            size = library.shim_encode(row.kind, array(values), out)
            assert size == (size_of(header, row) if low <= value <= high else 0), (index, value)
            assert python_takes(header, row, out.raw[:size]) if size else True
            if size:
                octets = value.to_bytes(wire.size, row.layout.byte_order, signed=wire.signed)
                start = header.first + offset
                assert out.raw[start : start + wire.size] == octets


@given(st.binary(max_size=40), st.sampled_from([row.kind for row in LINK.rows] + [0, 0x7F]))
def test_any_payload_is_taken_by_both_or_by_none(messages, rest, kind):
    library = messages(LINK)
    payload = bytes((kind,)) + rest
    for index, sender in enumerate(senders(LINK)):
        try:
            LINK_MESSAGES.decode(payload, sender)
            takes = True
        except PayloadError:
            takes = False
        assert library.shim_from(index, kind, payload, len(payload)) == takes
        assert not library.shim_from(index, 0, b"", 0)


@each_message
def test_another_length_is_no_message(messages, header, row):
    who = senders(header).index(row.sender)
    size = size_of(header, row)
    for length in range(size - 1, size + 2 * row.tail + 2):
        zeros = (bytes((row.kind,)) if header.numbered else b"") + bytes(96)
        taken = messages(header).shim_from(who, row.kind, zeros[:length], length)
        more = length - size
        if more:
            assert taken == (more > 0 and row.tail > 0 and more % row.tail == 0)


def test_a_radio_message_of_no_type_of_the_table_is_refused(messages):
    for index in range(len(senders(RADIO))):
        assert not messages(RADIO).shim_from(index, 0x7F, bytes(28), 28)
