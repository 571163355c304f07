"""The two ends of the collection tree, with everything between them that a network may do."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.routing.delivery import (
    FIRST_WAIT_MS,
    LEDGER_LIMIT,
    LONGEST_WAIT_MS,
    WINDOW,
    Ledger,
    Origin,
    Taken,
)
from tests.procboard.routing.air import chance


def origin_with(count: int) -> Origin:
    origin = Origin(chance(1))
    for number in range(count):
        origin.stored(number)
    return origin


@given(st.integers(0, 60), st.lists(st.integers(0, 2**16), max_size=300), st.integers(0, 30))
def test_any_network_delivers_each_record_once(count: int, whims: list[int], given_up: int) -> None:
    """Packets and acknowledgements are lost, repeated, reordered and late; then all goes well."""
    origin, ledger = origin_with(count), Ledger()
    forward: list[tuple[int, int]] = []
    backward: list[tuple[int, int]] = []
    delivered: list[int] = []
    gone = 0
    now = 0

    def arrive(packet: tuple[int, int]) -> None:
        nonlocal gone
        taken = ledger.take(1, *packet)
        assert taken is not None
        gone += taken.gone
        if taken.new:
            delivered.append(packet[0])
        backward.append(ledger.entries[1])

    for step, whim in enumerate([*whims, *([0, 1, 2] * (count + 20))]):
        now += 1 + whim % 7_000 if step < len(whims) else LONGEST_WAIT_MS
        origin.expire(now)
        number = origin.wanted()
        if number is not None:
            origin.sent(number, now)
            forward.append((number, number - origin.oldest))
        if step == len(whims) // 2:  # the flash is full and overwrites
            origin.forgotten(min(given_up, count))
        kind = whim % 3 if step < len(whims) else 2
        if forward and kind == 1:
            arrive(forward[whim % len(forward)])  # a copy; the packet itself comes later, or never
        elif forward and kind == 2:
            arrive(forward.pop(whim % len(forward)))
        elif forward and whim % 5 == 0 and step < len(whims):
            forward.pop(whim % len(forward))
        while backward and (step >= len(whims) or whim % 4 == 0):
            assert origin.acknowledge(*backward.pop(whim % len(backward)), now)
    for _ in range(3 * count + 30):
        now += 2 * LONGEST_WAIT_MS
        origin.expire(now)
        number = origin.wanted()
        if number is not None:
            origin.sent(number, now)
            arrive((number, number - origin.oldest))
            origin.acknowledge(*backward.pop(), now)
    assert origin.oldest == origin.newest + 1  # all is acknowledged or given up
    assert len(delivered) == len(set(delivered))
    never = set(range(count)) - set(delivered)
    assert never <= set(range(min(given_up, count)))  # only what the flash gave up
    if delivered and max(delivered) >= given_up:
        assert gone <= given_up
        assert gone == len([n for n in never if n >= min(delivered)]) or min(delivered) > 0


def test_what_the_base_has_octet_by_octet() -> None:
    ledger = Ledger()
    assert ledger.take(5, 10, 0) == Taken(True, 0)  # first met at its record 10
    assert ledger.take(5, 13, 2) == Taken(True, 0)
    assert ledger.entries[5] == (11, 0b10)
    assert ledger.take(5, 13, 2) == Taken(False, 0)
    assert ledger.take(5, 11, 0) == Taken(True, 0)
    assert ledger.entries[5] == (12, 0b1)
    assert ledger.take(5, 12, 0) == Taken(True, 0)
    assert ledger.entries[5] == (14, 0)
    assert ledger.take(5, 3, 0) == Taken(False, 0)


def test_records_that_the_flash_gave_up_are_counted_once() -> None:
    ledger = Ledger()
    ledger.take(5, 0, 0)
    ledger.take(5, 3, 2)  # 1 and 2 are missing, 3 is there
    assert ledger.take(5, 10, 0) == Taken(True, 2 + 6)  # 1, 2 and 4 to 9
    assert ledger.entries[5] == (11, 0)
    assert ledger.take(5, 2, 0) == Taken(False, 0)  # too late: it is counted


def test_a_full_ledger_takes_no_further_origin_and_acknowledges_none() -> None:
    ledger = Ledger()
    for origin in range(LEDGER_LIMIT):
        assert ledger.take(origin, 0, 0) == Taken(True, 0)
    assert ledger.take(LEDGER_LIMIT, 0, 0) is None
    assert LEDGER_LIMIT not in ledger.entries
    assert ledger.take(3, 1, 0) == Taken(True, 0)


def test_a_base_that_kept_its_ledger_delivers_nothing_twice() -> None:
    ledger = Ledger()
    for number in (0, 1, 3):
        ledger.take(5, number, 0 if number < 2 else 1)
    reborn = Ledger(ledger.entries)
    assert [reborn.take(5, n, 0) for n in (0, 1)] == [Taken(False, 0)] * 2
    assert reborn.take(5, 3, 1) == Taken(False, 0)
    assert reborn.take(5, 2, 0) == Taken(True, 0)


def test_the_window_and_the_timer() -> None:
    origin = origin_with(20)
    for number in range(WINDOW):
        assert origin.wanted() == number
        origin.sent(number, 0)
    assert origin.wanted() is None
    deadline = origin.deadline_ms
    assert deadline is not None
    assert FIRST_WAIT_MS <= deadline < FIRST_WAIT_MS * 5 // 4
    assert origin.acknowledge(2, 0b10, 100)  # 0, 1 and 4
    assert origin.oldest == 2
    assert origin.wanted() == 8
    origin.expire(10**6)
    assert (origin.wanted(), origin.repeat) == (2, 1)
    origin.sent(2, 10**6)
    origin.sent(3, 10**6)
    assert origin.wanted() == 5  # 4 has come
    waits = []
    for _ in range(8):
        now = origin.deadline_ms or 0
        origin.expire(now)
        origin.sent(2, now)
        waits.append((origin.deadline_ms or 0) - now)
    assert origin.wanted() is None  # halved down to one
    assert LONGEST_WAIT_MS <= waits[-1] < LONGEST_WAIT_MS * 5 // 4


def test_what_is_acknowledged_moves_with_the_window() -> None:
    origin = origin_with(20)
    for number in range(WINDOW):
        origin.sent(number, 0)
    origin.acknowledge(1, 0b1, 0)  # 0 and 2
    origin.acknowledge(3, 0, 0)
    origin.expire(10**6)
    assert origin.wanted() == 3
    origin.sent(3, 10**6)
    assert origin.wanted() == 4


def test_numbers_without_gaps_only() -> None:
    origin = origin_with(2)
    with pytest.raises(ValueError, match="record 3 after 1"):
        origin.stored(3)


def test_an_acknowledgement_of_another_life_is_refused() -> None:
    origin = origin_with(2)
    assert not origin.acknowledge(3, 0, 0)
    assert not origin.acknowledge(0, 0b10, 0)
    assert origin.oldest == 0
    assert origin.acknowledge(0, 0b1, 0)  # record 1 is there
    assert origin.acknowledge(1, 0, 0)
