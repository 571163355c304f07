"""C encoders and decoders against the table: same bytes, same refusals, for any raw values.

The oracle is neither codec: bytes put together by hand from raw integers at the table's offsets.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.errors import PayloadError
from spi_bus.layout import Field, MessageRow, WireType, raw_bounds
from spi_bus.messages import LINK_MESSAGES, MASTER, SLAVE
from spi_bus.plant_messages import PLANT_MESSAGES
from tools.message_header import HEADER, PLANT_HEADER, header, plant_header

TABLES = {"shim_from": LINK_MESSAGES, "shim_plant_from": PLANT_MESSAGES}
ROWS = [row for table in TABLES.values() for row in table.rows]


def name(row: MessageRow) -> str:
    return row.layout.name


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
def raws(draw, row: MessageRow) -> Raw:
    values = []
    payload = bytes((row.kind,))
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
        payload += value.to_bytes(wire.size, "little", signed=wire.signed)
    return Raw(values, payload)


def array(values: list[int]) -> ctypes.Array:
    return (ctypes.c_int64 * len(values))(*values)


def validator(row: MessageRow) -> str:
    return next(name for name, table in TABLES.items() if row in table.rows)


def python_takes(row: MessageRow, payload: bytes) -> bool:
    table = TABLES[validator(row)]
    try:
        message = table.decode(payload, row.sender)
    except PayloadError:
        return False
    assert table.encode(message) == payload
    return True


def test_the_header_is_up_to_date():
    assert HEADER.read_text(encoding="utf-8") == header(), "run: python -m tools.message_reference"
    assert PLANT_HEADER.read_text(encoding="utf-8") == plant_header(), "the same command"


@pytest.mark.parametrize("row", ROWS, ids=name)
@given(data=st.data())
def test_c_encodes_and_decodes_what_python_does_and_refuses_the_rest(messages, row, data):
    raw = data.draw(raws(row))
    takes = python_takes(row, raw.payload)
    out = ctypes.create_string_buffer(b"\xee" * 96)
    size = messages.shim_encode(row.kind, array(raw.values), out)
    assert size == (row.size if takes else 0)
    assert out.raw[:size] == raw.payload[:size]
    assert out.raw[size:96] == b"\xee" * (96 - size), "written beyond the message"
    values = array([0] * len(raw.values))
    decoded = messages.shim_decode(row.kind, values, raw.payload, len(raw.payload))
    assert decoded == takes
    if takes:
        assert list(values) == raw.values
    comes_from = getattr(messages, validator(row))
    assert comes_from(row.sender == SLAVE, raw.payload, len(raw.payload)) == takes
    assert comes_from(row.sender == MASTER, raw.payload, len(raw.payload)) == 0


@pytest.mark.parametrize("row", ROWS, ids=name)
def test_every_bound_is_the_last_that_is_taken(messages, row):
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
            size = messages.shim_encode(row.kind, array(values), out)
            assert size == (row.size if low <= value <= high else 0), (index, value)
            assert python_takes(row, out.raw[:size]) if size else True
            if size:
                octets = value.to_bytes(wire.size, "little", signed=wire.signed)
                assert out.raw[1 + offset : 1 + offset + wire.size] == octets


@given(st.binary(max_size=70), st.sampled_from([row.kind for row in ROWS] + [0, 0x7F]))
def test_any_payload_is_taken_by_both_or_by_none(messages, rest, kind):
    payload = bytes((kind,)) + rest
    for comes_from, table in TABLES.items():
        for sender in (MASTER, SLAVE):
            try:
                table.decode(payload, sender)
                takes = True
            except PayloadError:
                takes = False
            assert getattr(messages, comes_from)(sender == SLAVE, payload, len(payload)) == takes
    for row in ROWS:
        for length in (row.size - 1, row.size + 1):
            wrong = bytes((row.kind,)) + bytes(length - 1)
            assert not getattr(messages, validator(row))(row.sender == SLAVE, wrong, length)
    assert not messages.shim_from(0, b"", 0)
