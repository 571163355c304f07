"""Stalls: found, told apart by their cause; what has no deadline is done while there is time."""

from __future__ import annotations

import gc

import pytest

from firmware_model.time import FS_PER_MS
from spi_bus.link import Role
from spi_bus.transports.bridge import FrameLine
from tests.tools.far_side import Clock, FarSide
from tools.bench.lateness import StallLog
from tools.bench.pace import LineScheduler


class Host:
    """A machine whose clock and processor time a test moves: work takes both, waiting one."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.own_s = 0.0
        line = FrameLine(FarSide(Role.SLAVE, self.clock, 1.0), self.clock)
        self.scheduler = LineScheduler(line, clock=self.clock)
        self.scheduler.stalls = StallLog(lambda: self.own_s)

    def work(self, seconds: float) -> None:
        self.clock.now_s += seconds
        self.own_s += seconds

    def away(self, seconds: float) -> None:
        self.clock.now_s += seconds


def busy(host: Host) -> None:
    host.work(0.040)


@pytest.fixture
def host() -> Host:
    return Host()


def ticks(host: Host, count: int) -> None:
    for number in range(1, count + 1):
        host.scheduler.at(number * 10 * FS_PER_MS, lambda: None)


def test_a_long_step_of_ours_is_named(host: Host) -> None:
    ticks(host, 20)

    def slow_step() -> None:
        busy(host)

    host.scheduler.at(95 * FS_PER_MS, slow_step)
    host.scheduler.run(200 * FS_PER_MS)
    (stall,) = host.scheduler.stalls.worst()
    assert stall.late_s == pytest.approx(0.035, abs=1e-4)
    assert stall.at_s == pytest.approx(0.100)
    assert stall.longest.endswith("slow_step")
    assert stall.longest_s == pytest.approx(0.040, abs=1e-4)
    assert stall.own_s == pytest.approx(0.040, abs=1e-4)
    assert stall.away_s < 1e-4
    assert "slow_step took 40.0 ms" in stall.words()
    assert host.scheduler.stalls.count == 1


def test_a_first_event_that_is_late_counts_from_the_start(host: Host) -> None:
    host.scheduler.at(0, lambda: host.work(0.030))
    host.scheduler.at(0, lambda: None)
    host.scheduler.at(1, lambda: None)
    host.scheduler.run(10 * FS_PER_MS)
    (stall,) = host.scheduler.stalls.worst()
    assert stall.late_s == pytest.approx(0.030, abs=1e-4)
    assert stall.away_s < 1e-4


def test_a_machine_that_was_elsewhere_is_told_apart(host: Host) -> None:
    ticks(host, 20)
    host.scheduler.at(95 * FS_PER_MS, lambda: host.away(0.030))
    host.scheduler.run(200 * FS_PER_MS)
    (stall,) = host.scheduler.stalls.worst()
    assert stall.own_s == 0.0
    assert stall.away_s == pytest.approx(0.030, abs=1e-4)
    assert "the machine was busy elsewhere" in stall.words()


def test_oversleeping_counts_from_when_it_should_have_woken(host: Host) -> None:
    ticks(host, 3)
    wait = host.scheduler.line.wait

    def oversleep(timeout_s: float) -> None:
        wait(timeout_s)
        if 0.0195 < host.clock.now_s - 1000.0 < 0.021:
            host.away(0.005)

    host.scheduler.line.wait = oversleep  # type: ignore[method-assign]
    host.scheduler.run(40 * FS_PER_MS)
    (stall,) = host.scheduler.stalls.worst()
    assert stall.late_s == pytest.approx(0.005, abs=1e-3)
    assert stall.away_s == pytest.approx(stall.late_s, abs=1e-3)  # not the sleep that was wanted


def test_the_worst_are_kept_and_the_others_counted(host: Host) -> None:
    log = StallLog(lambda: 0.0, kept=3)
    for number in range(1, 11):
        log.in_time(float(number))
        log.late(number + 0.5, float(number), 0.01 * number)
        log.late(number + 0.6, float(number), 0.002)  # it recovers, and is not in time yet
    log.in_time(20.0)
    assert log.count == 10
    assert [round(100 * stall.late_s) for stall in log.worst()] == [10, 9, 8]


def test_garbage_collection_is_timed() -> None:
    log = StallLog(lambda: 0.0)
    before = list(gc.callbacks)
    with log.collections():
        gc.collect()
        log.late(1.0, 1.0, 0.05)
    assert log.worst()[0].collecting_s > 0.0
    assert gc.callbacks == before


def test_spare_work_is_done_while_there_is_time_and_not_else(host: Host) -> None:
    ticks(host, 10)
    done: list[float] = []

    def spare() -> bool:
        done.append(host.clock.now_s - 1000.0)
        host.work(0.001)
        return True

    host.scheduler.spare = spare
    host.scheduler.run(100 * FS_PER_MS)
    assert len(done) > 50
    assert host.scheduler.lateness_s.maximum_s < 1e-4
    assert all(
        10_000 - round(at * 1e6) % 10_000 > 1_990 for at in done
    )  # 2 ms before an event none begins
