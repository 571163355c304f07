"""Every row of all message tables, unasked: bounds, round trip, None, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.survey.items import SURVEY_ITEMS
from radio_802154.messages import AM_MESSAGES, TOSH_DATA_LENGTH
from radio_802154.routing_messages import MAX_ITEM_OCTETS, ROUTING_ENTRIES, ROUTING_MESSAGES
from spi_bus.errors import FieldError, PayloadError
from spi_bus.frame import MAX_PAYLOAD_BYTES
from spi_bus.layout import Field, MessageRow
from spi_bus.messages import LINK_MESSAGES
from spi_bus.plant_messages import PLANT_MESSAGES

ON_AIR = [*AM_MESSAGES, *ROUTING_MESSAGES]
ROWS = [
    *LINK_MESSAGES.rows,
    *PLANT_MESSAGES.rows,
    *ON_AIR,
    *ROUTING_ENTRIES,
    *SURVEY_ITEMS,
]
FIELDS = [(row, field) for row in ROWS for field in row.layout.rows]


def name(value: Any) -> str:
    return value.layout.name if isinstance(value, MessageRow) else getattr(value, "name", "")


def values(field: Field) -> st.SearchStrategy[Any]:
    low, high = field.bounds
    if field.boolean:
        numbers: st.SearchStrategy[Any] = st.booleans()
    elif field.lsb_per_unit is None:
        numbers = st.integers(int(low), int(high))
    else:
        numbers = st.floats(low, high)
    return st.none() | numbers if field.optional else numbers


def messages(row: MessageRow) -> st.SearchStrategy[Any]:
    return st.builds(row.layout.message, **{field.name: values(field) for field in row.layout.rows})


def plain(row: MessageRow) -> Any:
    """A message with a value in the middle of every range."""
    middle = {}
    for field in row.layout.rows:
        low, high = field.bounds
        number = (low + high) / 2 if field.lsb_per_unit is not None else int((low + high) // 2)
        middle[field.name] = bool(number) if field.boolean else number
    return row.layout.message(**middle)


def same(field: Field, sent: Any, received: Any) -> bool:
    """Whether a value came through, to half a least significant bit."""
    if sent is None or received is None:
        return sent is received
    if field.lsb_per_unit is None:
        return bool(sent == received)
    error = received - sent
    if field.wraps:
        error = math.remainder(error, 2 * math.pi)
        assert -math.pi <= received < math.pi + 1e-9
    return abs(error) <= 0.5 / field.lsb_per_unit * (1 + 1e-6) + 1e-12 * abs(sent)


@pytest.mark.parametrize("row", ROWS, ids=name)
@given(data=st.data())
def test_a_message_comes_through(row: MessageRow, data: st.DataObject) -> None:
    message = data.draw(messages(row))
    wire = row.layout.encode(message)
    assert len(wire) == row.layout.size
    received = row.layout.decode(wire)
    for field in row.layout.rows:
        sent_value, value = getattr(message, field.name), getattr(received, field.name)
        assert same(field, sent_value, value), field.name
    assert row.layout.encode(received) == wire, "a second trip changes it"


@pytest.mark.parametrize(("row", "field"), FIELDS, ids=name)
def test_bounds_are_taken_and_what_is_beyond_is_refused_by_name(
    row: MessageRow, field: Field
) -> None:
    low, high = field.bounds
    for bound in (low, high):
        value = bool(bound) if field.boolean else bound
        if field.lsb_per_unit is None:
            value = int(value)
        received = row.layout.decode(row.layout.encode(replace(plain(row), **{field.name: value})))
        assert same(field, value, getattr(received, field.name))
    step = 1 if field.lsb_per_unit is None else 1.0 / field.lsb_per_unit
    beyond = [low - step, high + step, "3", float("nan")]
    beyond = [
        int(v) if field.lsb_per_unit is None and v in (low - step, high + step) else v
        for v in beyond
    ]
    if not field.optional:
        beyond.append(None)
    for value in beyond:
        with pytest.raises(FieldError, match=field.name):
            row.layout.encode(replace(plain(row), **{field.name: value}))


@pytest.mark.parametrize(
    ("row", "field"), [(row, field) for row, field in FIELDS if field.optional], ids=name
)
def test_nothing_is_not_zero(row: MessageRow, field: Field) -> None:
    """None arrives as None, 0 as 0, and neither changes a field beside it."""
    with_none = replace(plain(row), **{field.name: None})
    zero = 0 if field.lsb_per_unit is None else 0.0
    with_zero = replace(plain(row), **{field.name: zero})
    for message, expected in ((with_none, None), (with_zero, zero)):
        received = row.layout.decode(row.layout.encode(message))
        assert getattr(received, field.name) == expected
        for other in row.layout.rows:
            if other is not field:
                assert same(other, getattr(message, other.name), getattr(received, other.name))
    assert row.layout.encode(with_none) != row.layout.encode(with_zero)


@pytest.mark.parametrize("row", ROWS, ids=name)
def test_another_length_is_refused(row: MessageRow) -> None:
    wire = row.layout.encode(plain(row))
    for damaged in (wire[:-1], wire + b"\0", b""):
        with pytest.raises(PayloadError):
            row.layout.decode(damaged)


@pytest.mark.parametrize("row", ROWS, ids=name)
def test_a_row_fits_its_carrier_and_says_what_it_is(row: MessageRow) -> None:
    assert row.summary
    assert row.layout.message.__doc__
    if row in (*ON_AIR, *ROUTING_ENTRIES):
        assert row.layout.size <= TOSH_DATA_LENGTH
    elif row in SURVEY_ITEMS:
        assert row.size <= MAX_ITEM_OCTETS
    else:
        assert row.size <= MAX_PAYLOAD_BYTES
    # A mote's C compiler sees the same offsets: fields follow each other without a gap.
    end = 0
    for offset, item in row.layout.offsets():
        assert offset == end
        end += item.wire.size if isinstance(item, Field) else item.size
    assert end == row.layout.size


def test_numbers_are_used_once() -> None:
    lines = [*LINK_MESSAGES.rows, *PLANT_MESSAGES.rows]  # one may be plugged in for the other
    for table in (lines, ON_AIR, SURVEY_ITEMS):
        kinds = [row.kind for row in table]
        assert len(set(kinds)) == len(kinds)
        assert all(0 <= kind <= 0xFF for kind in kinds)
