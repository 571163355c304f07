"""A trace's hash depends on its records alone: not on blocks, sinks or the order of channels."""

from __future__ import annotations

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model import trace as trace_module
from firmware_model.trace import Record, Trace, Value

values: st.SearchStrategy[Value] = st.recursive(
    st.one_of(
        st.integers(), st.floats(allow_nan=False), st.binary(max_size=8), st.text(max_size=8)
    ),
    lambda inner: st.tuples(inner, inner),
    max_leaves=4,
)
records = st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 10**18), values), max_size=60)


def fill(plan: list[tuple[str, int, Value]]) -> Trace:
    trace = Trace()
    for name, time, value in plan:
        trace.channel(name).record(time, value)
    return trace


@given(records, st.integers(1, 7))
def test_the_hash_does_not_depend_on_block_size(
    plan: list[tuple[str, int, Value]], block: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trace_module, "_BLOCK", block)
        small = fill(plan).sha256()
    assert small == fill(plan).sha256()


@given(records)
def test_the_hash_does_not_depend_on_how_channels_interleave(
    plan: list[tuple[str, int, Value]],
) -> None:
    regrouped = sorted(plan, key=lambda record: record[0])  # stable: order inside a channel stays
    assert fill(plan).sha256() == fill(regrouped).sha256()


@given(records.filter(bool), st.integers(0, 59))
def test_the_hash_sees_every_record(plan: list[tuple[str, int, Value]], index: int) -> None:
    index %= len(plan)
    name, time, value = plan[index]
    changed = [*plan[:index], (name, time + 1, value), *plan[index + 1 :]]
    assert fill(plan).sha256() != fill(changed).sha256()


def test_looking_at_the_hash_changes_nothing() -> None:
    looked, plain = Trace(), Trace()
    for n in range(10):
        looked.channel("x").record(n, n)
        looked.sha256()
        plain.channel("x").record(n, n)
    assert looked.sha256() == plain.sha256()


def test_the_hash_is_what_its_description_says() -> None:
    trace = Trace()
    trace.channel("b").record(5, b"\x00")
    trace.channel("a").record(1, 0.5)
    # Marshal, version 2, written by hand: a tuple of two, a 32-bit integer, a double, one octet.
    half = bytes.fromhex("000000000000e03f")
    inner = {
        "a": hashlib.sha256(b"(\2\0\0\0i\1\0\0\0g" + half).digest(),
        "b": hashlib.sha256(b"(\2\0\0\0i\5\0\0\0s\1\0\0\0\0").digest(),
    }
    total = hashlib.sha256(b"a\0" + inner["a"] + b"b\0" + inner["b"])
    assert trace.sha256() == total.hexdigest()


def test_sinks_see_every_record_after_they_came_once_and_in_order() -> None:
    trace = Trace()
    channel = trace.channel("x")
    channel.record(0, "before")
    got: list[Record] = []
    channel.sink(got.extend)
    for n in range(5_000):
        channel.record(n, n)
    trace.flush()
    assert got == [(n, n) for n in range(5_000)]
    assert channel.count == 5_001


def test_channels_are_made_once() -> None:
    trace = Trace()
    assert trace.channel("x") is trace.channel("x")
    trace.channel("a")
    assert trace.names() == ("a", "x")


@given(records, st.integers(1, 5), st.lists(st.integers(0, 3), max_size=30))
def test_pieces_come_in_order_and_change_nothing(
    plan: list[tuple[str, int, Value]], most: int, moments: list[int]
) -> None:
    whole, pieces = fill(plan), Trace()
    got: dict[str, list[Record]] = {name: [] for name in "abc"}
    for name in "abc":
        pieces.channel(name).sink(got[name].extend)
    for index, (name, time, value) in enumerate(plan):
        pieces.channel(name).record(time, value)
        for _ in range(moments[index] if index < len(moments) else 0):
            pieces.flush_some(most)
    while pieces.flush_some(most):
        pass
    for name in "abc":
        assert got[name] == [(time, value) for each, time, value in plan if each == name]
        assert not pieces.channel(name).waiting
        whole.channel(name)
    assert pieces.sha256() == whole.sha256()


def test_a_piece_is_no_larger_than_asked_for_and_every_channel_has_its_turn() -> None:
    trace = Trace()
    sizes: list[tuple[str, int]] = []
    for name in "ab":
        trace.channel(name).sink(lambda block, name=name: sizes.append((name, len(block))))  # type: ignore[misc]
        for n in range(5):
            trace.channel(name).record(n, n)
    while trace.flush_some(2):
        pass
    assert sorted(sizes) == [("a", 1), ("a", 2), ("a", 2), ("b", 1), ("b", 2), ("b", 2)]
    assert [name for name, _ in sizes[:2]] in (["a", "b"], ["b", "a"])
