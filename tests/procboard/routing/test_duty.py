"""Duty cycle: whatever one board sends, every other hears, if both know the time well enough."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import ProcConfigError
from procboard.routing.duty import (
    ERROR_LIMIT_TICKS,
    EXCHANGE_TICKS,
    WAKE_TICKS,
    Duty,
    DutyConfig,
    error_bound,
)

ERRORS = st.integers(-ERROR_LIMIT_TICKS, ERROR_LIMIT_TICKS)
TIMES = st.integers(0, 2**32 - 1)
CONFIGS = st.builds(
    DutyConfig,
    st.sampled_from([1 << 14, 1 << 16, 1 << 18]),
    st.integers(EXCHANGE_TICKS + 1, 1 << 13),
    st.sampled_from([1, 8, 32]),
)


@settings(max_examples=400)
@given(CONFIGS, TIMES, ERRORS, ERRORS, st.sampled_from([0, EXCHANGE_TICKS]), st.data())
def test_who_sends_is_heard_to_the_end(
    config: DutyConfig, true: int, mine: int, yours: int, later: int, data: st.DataObject
) -> None:
    sender, listener = Duty(data.draw(st.integers(0, 99)), config), Duty(7, config)
    closes = config.window_ticks - EXCHANGE_TICKS
    edge = data.draw(st.sampled_from([None, 0, closes, config.period_ticks]))
    if edge is not None:  # most times mean nothing
        near = data.draw(st.integers(-3 * ERROR_LIMIT_TICKS, 3 * ERROR_LIMIT_TICKS))
        true += edge + near - true % config.period_ticks
    if sender.state(true + mine & 0xFFFFFFFF, ERROR_LIMIT_TICKS).sending:
        during = true + later
        for before in (0, WAKE_TICKS):
            at = during + yours - before & 0xFFFFFFFF
            assert listener.state(at, ERROR_LIMIT_TICKS).listening


@given(CONFIGS, TIMES, st.integers(0, 99))
def test_a_state_holds_as_long_as_it_says(config: DutyConfig, time: int, address: int) -> None:
    duty = Duty(address, config)
    state = duty.state(time, 0)
    assert state.ticks > 0
    last = duty.state(time + state.ticks - 1 & 0xFFFFFFFF, 0)
    assert (last.listening, last.sending) == (state.listening, state.sending)


@given(CONFIGS, TIMES)
def test_the_next_window_is_where_messages_may_go(config: DutyConfig, time: int) -> None:
    duty = Duty(1, config)
    wait = duty.next_window(time)
    assert duty.state(time + wait & 0xFFFFFFFF, 0).sending
    assert wait == 0 or not duty.state(time + wait - 1 & 0xFFFFFFFF, 0).sending


@pytest.mark.parametrize("error", [None, ERROR_LIMIT_TICKS + 1])
def test_who_does_not_know_the_time_is_always_on(error: int | None) -> None:
    duty = Duty(1)
    for time in range(0, 1 << 16, 1 << 11):
        state = duty.state(time, error)
        assert (state.listening, state.sending) == (True, True)


def on_ticks(duty: Duty, start: int, ticks: int) -> int:
    time, on = start, 0
    while time < start + ticks:
        state = duty.state(time & 0xFFFFFFFF, 0)
        on += state.listening * min(state.ticks, start + ticks - time)
        time += state.ticks
    return on


def test_the_share_of_time_is_as_stated() -> None:
    config = DutyConfig()
    cycle = config.period_ticks * config.discovery_periods
    # On the wrap of the shared time too; a window beside the discovery has one guard less.
    for start in (0, 2**32 - cycle // 2):
        assert on_ticks(Duty(5), start, cycle) / cycle == pytest.approx(config.share, abs=1e-4)
    assert config.share == pytest.approx(0.1556, abs=1e-4)


@given(st.integers(0, 99), st.integers(0, 99), st.integers(0, (1 << 16) - 1))
def test_groups_with_other_windows_hear_each_other_within_a_minute(
    one: int, other: int, apart: int
) -> None:
    """Every time of the period is listened to once in 32 periods, so also the others' window."""
    config = DutyConfig()
    listener = Duty(one, config)
    heard = 0
    for period in range(config.discovery_periods + 1):
        opens = period * config.period_ticks + apart  # the others' window, by our time
        heard += listener.state(opens, 0).listening
    assert heard >= 1


def test_an_error_grows_with_the_time_since_the_last_pair() -> None:
    assert error_bound(0, 0) < ERROR_LIMIT_TICKS
    assert error_bound(0, 40 * 32_768) <= ERROR_LIMIT_TICKS
    assert error_bound(0, 60 * 32_768) > ERROR_LIMIT_TICKS


@pytest.mark.parametrize(
    ("period", "window", "discovery"),
    [(65_000, 8192, 32), (0, 8192, 32), (1 << 16, 1_311, 32), (1 << 13, 1 << 13, 32),
     (1 << 16, 8192, 0), (1 << 16, 8192, 3)],
)  # fmt: skip
def test_cycles_that_cannot_be(period: int, window: int, discovery: int) -> None:
    with pytest.raises(ProcConfigError):
        DutyConfig(period, window, discovery)
