"""Order within an instant, cancellation, inline advance, lateness in real time."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.errors import SchedulingError
from firmware_model.histogram import DurationHistogram
from firmware_model.scheduler import Event, Priority, RealTimeScheduler, Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S


@given(st.lists(st.tuples(st.integers(0, 5), st.sampled_from(list(Priority))), max_size=40))
def test_order_is_time_then_priority_then_sequence(plan: list[tuple[int, Priority]]) -> None:
    scheduler = Scheduler()
    seen: list[tuple[int, int, int]] = []
    for number, (time, priority) in enumerate(plan):
        key = (time, int(priority), number)
        scheduler.at(time, lambda key=key: seen.append(key), priority)  # type: ignore[misc]
    scheduler.run(10)
    assert seen == sorted(seen)
    assert len(seen) == len(plan)


def test_what_an_event_schedules_for_its_own_instant_still_runs_in_it() -> None:
    scheduler = Scheduler()
    seen: list[str] = []

    def peripheral() -> None:
        seen.append("peripheral")
        scheduler.at(scheduler.now, lambda: seen.append("wire"), Priority.WIRE)

    scheduler.at(5, peripheral)
    scheduler.at(5, lambda: seen.append("cpu"), Priority.CPU)
    scheduler.run(5)
    assert seen == ["peripheral", "wire", "cpu"]
    assert scheduler.now == 5


def test_run_includes_its_end_and_stops_there() -> None:
    scheduler = Scheduler()
    seen: list[int] = []
    for time in (1, 2, 3):
        scheduler.at(time, lambda time=time: seen.append(time))  # type: ignore[misc]
    scheduler.run(2)
    assert (seen, scheduler.now) == ([1, 2], 2)
    assert scheduler.next_time() == 3
    scheduler.run(10)
    assert (seen, scheduler.now) == ([1, 2, 3], 10)
    assert scheduler.next_time() is None


def test_the_past_is_closed() -> None:
    scheduler = Scheduler()
    scheduler.run(10)
    with pytest.raises(SchedulingError, match="already 10 fs"):
        scheduler.at(9, lambda: None)
    with pytest.raises(ValueError, match="already 10 fs"):
        scheduler.after(-1, lambda: None)


@given(st.lists(st.booleans(), max_size=300))
def test_cancelled_events_never_run_and_others_keep_their_order(cancelled: list[bool]) -> None:
    scheduler = Scheduler()
    seen: list[int] = []
    events: list[Event] = [
        scheduler.at(7, lambda n=n: seen.append(n))  # type: ignore[misc]
        for n in range(len(cancelled))
    ]
    for event, drop in zip(events, cancelled, strict=True):
        if drop:
            scheduler.cancel(event)
            scheduler.cancel(event)  # twice is harmless
    scheduler.run(7)
    assert seen == [n for n, drop in enumerate(cancelled) if not drop]


def test_cancelling_after_the_fact_or_nothing_is_harmless() -> None:
    scheduler = Scheduler()
    event = scheduler.at(1, lambda: None)
    scheduler.run(1)
    scheduler.cancel(event)
    scheduler.cancel(None)
    assert scheduler.next_time() is None


def test_cancelling_in_a_loop_does_not_fill_the_heap() -> None:
    scheduler = Scheduler()
    for _ in range(10_000):
        scheduler.cancel(scheduler.at(1_000, lambda: None))
    assert len(scheduler._heap) < 200


def test_an_event_may_cancel_its_neighbour_in_the_same_instant() -> None:
    scheduler = Scheduler()
    seen: list[str] = []
    victim: list[Event] = []
    scheduler.at(3, lambda: scheduler.cancel(victim[0]))
    victim.append(scheduler.at(3, lambda: seen.append("victim")))
    scheduler.run(5)
    assert seen == []


def test_advance_moves_time_only_through_emptiness() -> None:
    scheduler = Scheduler()
    results: list[tuple[bool, int]] = []

    def mover() -> None:
        results.extend((scheduler.advance(t), scheduler.now) for t in (150, 200, 199, 900))

    scheduler.at(100, mover)
    blocked = scheduler.at(170, lambda: None)
    scheduler.cancel(blocked)
    scheduler.at(200, lambda: None)
    scheduler.run(500)
    # 150 is free; at 200 something is due; 199 is free though a cancelled event stood before it;
    # 900 is beyond what the run may reach.
    assert results == [(True, 150), (False, 150), (True, 199), (False, 199)]


def test_advance_outside_a_run_is_refused() -> None:
    assert not Scheduler().advance(1)


class HostClock:
    """A host whose clock moves when it sleeps, or when an event burns time."""

    def __init__(self, oversleep: float = 0.0) -> None:
        self.now = 1_000.0
        self.oversleep = oversleep

    def read(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds + self.oversleep

    def burn(self, seconds: float) -> Callable[[], None]:
        def work() -> None:
            self.now += seconds

        return work


def real_time(host: HostClock, **options: float) -> RealTimeScheduler:
    return RealTimeScheduler(clock=host.read, sleep=host.sleep, **options)


def test_real_time_holds_events_back() -> None:
    host = HostClock()
    scheduler = real_time(host)
    starts: list[float] = []
    for ms in (10, 20, 35):
        scheduler.at(ms * FS_PER_MS, lambda: starts.append(host.now - 1_000.0))
    scheduler.run(FS_PER_S)
    assert starts == pytest.approx([0.010, 0.020, 0.035])
    assert host.now == pytest.approx(1_001.0)
    assert scheduler.lateness_s.maximum_s == pytest.approx(0.0, abs=1e-9)
    assert scheduler.missed == 0


def test_speed_scales_the_wait() -> None:
    host = HostClock()
    scheduler = real_time(host, speed=4.0)
    scheduler.run(FS_PER_S)
    assert host.now == pytest.approx(1_000.25)


def test_lateness_is_measured_and_deadlines_are_counted() -> None:
    host = HostClock()
    scheduler = real_time(host, deadline_s=0.010)
    each: list[float] = []

    class Journal(DurationHistogram):
        def record(self, duration_s: float) -> None:
            each.append(duration_s)
            super().record(duration_s)

    scheduler.lateness_s = Journal()
    scheduler.at(10 * FS_PER_MS, host.burn(0.025))  # keeps the host busy up to 35 ms
    scheduler.at(20 * FS_PER_MS, lambda: None)  # 15 ms late
    scheduler.at(30 * FS_PER_MS, lambda: None)  # 5 ms late
    scheduler.at(50 * FS_PER_MS, lambda: None)
    scheduler.run(60 * FS_PER_MS)
    assert each == pytest.approx([0.0, 0.015, 0.005, 0.0, 0.0], abs=1e-9)
    late = scheduler.lateness_s
    assert (late.count, late.maximum_s) == (5, pytest.approx(0.015))
    assert late.total_s == pytest.approx(0.020)
    assert scheduler.missed == 1


def test_oversleeping_counts_as_lateness() -> None:
    host = HostClock(oversleep=0.002)
    scheduler = real_time(host, deadline_s=0.001)
    scheduler.at(10 * FS_PER_MS, lambda: None)
    scheduler.run(10 * FS_PER_MS)
    assert scheduler.lateness_s.minimum_s == pytest.approx(0.002)
    assert scheduler.lateness_s.maximum_s == pytest.approx(0.002)
    assert scheduler.missed >= 1


def test_real_time_runs_the_same_events_in_the_same_order() -> None:
    def record(scheduler: Scheduler) -> list[tuple[int, int]]:
        seen: list[tuple[int, int]] = []

        def tick(number: int) -> None:
            seen.append((scheduler.now, number))
            if len(seen) < 50:
                scheduler.after(number * FS_PER_MS, lambda: tick(number % 7 + 1), number % 4)

        for n in range(1, 4):
            scheduler.at(n, lambda n=n: tick(n))  # type: ignore[misc]
        scheduler.run(FS_PER_S)
        return seen

    assert record(Scheduler()) == record(real_time(HostClock()))


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_speed_must_be_positive(speed: float) -> None:
    with pytest.raises(ValueError, match="speed"):
        RealTimeScheduler(speed=speed)
