"""Clock edges against exact rational arithmetic."""

from __future__ import annotations

from fractions import Fraction
from math import floor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US, Clock, from_seconds, to_seconds

frequencies = st.one_of(
    st.integers(1, 10**9),
    st.fractions(min_value=Fraction(1, 10), max_value=10**8, max_denominator=10**6),
)
drifts_ppm = st.integers(-200_000_000, 200_000_000).map(lambda n: n / 10**6)
times_fs = st.integers(0, 10**20)


def period(frequency: Fraction | int, drift_ppm: float) -> Fraction:
    return FS_PER_S / (Fraction(frequency) * (1 + Fraction(round(drift_ppm * 10**6), 10**12)))


@given(frequencies, drifts_ppm, st.integers(0, 10**12), st.integers(0, 10**18))
def test_edge_is_the_exact_time_rounded_down(
    frequency: Fraction, drift: float, n: int, origin: int
) -> None:
    clock = Clock(frequency, drift, origin)
    assert clock.edge(n) == origin + floor(n * period(frequency, drift))


@given(frequencies, drifts_ppm, times_fs)
def test_ticks_is_the_last_edge_at_or_before(frequency: Fraction, drift: float, t: int) -> None:
    clock = Clock(frequency, drift)
    n = clock.ticks(t)
    assert clock.edge(n) <= t < clock.edge(n + 1)


@given(frequencies, st.integers(0, 10**10))
def test_every_edge_counts_at_its_own_time(frequency: Fraction, n: int) -> None:
    clock = Clock(frequency)
    assert clock.ticks(clock.edge(n)) == n


@given(frequencies, times_fs)
def test_next_edge_is_strictly_later(frequency: Fraction, t: int) -> None:
    clock = Clock(frequency)
    following = clock.next_edge(t)
    assert following > t
    assert clock.ticks(following) == clock.ticks(t) + 1


def test_watch_crystal_is_exact_over_an_hour() -> None:
    assert Clock(32_768).edge(3_600 * 32_768) == 3_600 * FS_PER_S


def test_drift_is_parts_per_million() -> None:
    # A clock that is 50 ppm fast has made 50 ticks too many after a nominal million.
    assert Clock(1_000_000, 50.0).ticks(FS_PER_S) == 1_000_050
    assert Clock(1_000_000, -50.0).ticks(FS_PER_S) == 999_950


@given(
    st.lists(st.tuples(st.integers(0, 10**12), st.integers(1_000, 10**9)), min_size=1, max_size=6)
)
def test_retuning_never_loses_or_invents_a_tick(steps: list[tuple[int, int]]) -> None:
    clock = Clock(32_768)
    now, count = 0, 0
    for delay, frequency in steps:
        now += delay
        before = clock.ticks(now)
        assert before >= count
        clock.retune(now, frequency)
        assert clock.ticks(now) == before
        assert clock.edge(before) <= now
        # From the retained edge on, the new period holds.
        gap = clock.edge(before + 1_000) - clock.edge(before)
        assert gap == 1_000 * FS_PER_S // frequency
        count = clock.ticks(now)


def test_retuning_keeps_the_phase() -> None:
    clock = Clock(1_000)
    clock.retune(FS_PER_MS * 7 // 2, 4_000)  # half of the fourth millisecond has passed
    assert clock.ticks(FS_PER_MS * 7 // 2) == 3
    assert clock.next_edge(FS_PER_MS * 7 // 2) == FS_PER_MS * 7 // 2 + FS_PER_MS // 8


def test_retune_can_change_drift() -> None:
    clock = Clock(1_000_000)
    clock.retune(0, 1_000_000, 100.0)
    assert clock.drift_ppm == 100.0
    assert clock.ticks(FS_PER_S) == 1_000_100


def test_span_does_not_depend_on_origin() -> None:
    assert Clock(3, origin_fs=12345).span(3) == FS_PER_S
    assert Clock(3).span(1) == FS_PER_S // 3


@pytest.mark.parametrize("frequency", [0, -1, Fraction(-1, 3)])
def test_a_clock_needs_a_positive_frequency(frequency: int | Fraction) -> None:
    with pytest.raises(ValueError, match="positive frequency"):
        Clock(frequency)
    with pytest.raises(ValueError, match="positive frequency"):
        Clock(1).retune(0, frequency)


def test_seconds_are_converted_exactly() -> None:
    assert from_seconds(0.25) == 250 * FS_PER_MS
    assert from_seconds(1e-6) == FS_PER_US
    assert to_seconds(1_500 * FS_PER_MS) == 1.5


@given(st.integers(0, 2**52))
def test_seconds_round_to_the_nearest_femtosecond(t: int) -> None:
    assert abs(from_seconds(to_seconds(t)) - t) <= max(1, t >> 51)
