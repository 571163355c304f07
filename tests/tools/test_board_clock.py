"""A board's clock from stamps and arrivals: offset and drift that were put in come out."""

from __future__ import annotations

import random

import pytest

from tools.bench.board_clock import BoardClock


def arrivals(
    drift_ppm: float, offset_s: float, count: int, seed: int, *, least_s: float = 0.002
) -> list[tuple[float, float]]:
    """Stamps every 0.1 s of a clock with this drift; delays are exponential over the least one."""
    rng = random.Random(seed)
    pairs = []
    for number in range(count):
        stamp_s = 0.1 * number
        made_s = offset_s + stamp_s / (1.0 + 1e-6 * drift_ppm)
        pairs.append((stamp_s, made_s + least_s + rng.expovariate(1 / 0.004)))
    return pairs


@pytest.mark.parametrize("drift_ppm", [-200.0, -12.0, 0.0, 12.0, 3000.0])
def test_drift_and_offset_come_out(drift_ppm: float) -> None:
    clock = BoardClock()
    for board_s, host_s in arrivals(drift_ppm, 3.25, 6000, seed=5):
        clock.note(board_s, host_s)
    fit = clock.fit()
    assert fit is not None
    assert fit.drift_ppm == pytest.approx(drift_ppm, abs=1.0 + 1e-5 * drift_ppm**2)
    assert fit.offset_s == pytest.approx(3.252, abs=2e-4)
    assert fit.delay_median_s == pytest.approx(0.0028, rel=0.1)  # ln 2 · 4 ms


def test_late_reports_pull_at_nothing() -> None:
    quiet, rough = BoardClock(), BoardClock()
    rng = random.Random(9)
    for board_s, host_s in arrivals(50.0, 0.0, 3000, seed=1):
        quiet.note(board_s, host_s)
        rough.note(board_s, host_s + (2.0 if rng.random() < 0.3 else 0.0))
    one, other = quiet.fit(), rough.fit()
    assert one is not None
    assert other is not None
    assert other.drift_ppm == pytest.approx(one.drift_ppm, abs=1.0)
    assert other.delay_p99_s > 1.0 > one.delay_p99_s


def test_what_waited_for_the_link_is_no_delay() -> None:
    clock = BoardClock()
    for number in range(100):
        clock.note(0.1 * number, max(0.1 * number, 5.0) + 1e-4 * (number % 3))
    fit = clock.fit(since_s=5.0)
    assert fit is not None
    assert fit.delay_p99_s < 1e-3


def test_a_reset_begins_anew() -> None:
    clock = BoardClock()
    for start_s in (0.0, 100.0):
        for board_s, host_s in arrivals(0.0, start_s, 50, seed=3):
            clock.note(board_s, host_s)
    fit = clock.fit()
    assert fit is not None
    assert clock.resets == 1
    assert fit.reports == 50
    assert fit.offset_s == pytest.approx(100.002, abs=2e-3)


def test_too_few_reports_say_nothing() -> None:
    clock = BoardClock()
    assert clock.fit() is None
    for _ in range(5):
        clock.note(1.0, 2.0)  # the same stamp: no slope
    assert clock.fit() is None
