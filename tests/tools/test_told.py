"""What boards told one another: lost is told from refused, a reset from both, samples from none."""

from __future__ import annotations

import math

import pytest

from navboard.chips.gps18x import Gps18xConfig, metres_per_degree
from spi_bus.messages import (
    LINK_MESSAGES,
    BoardEvent,
    BoardEventCode,
    CommandApplied,
    GpsReport,
    SensorReport,
)
from tools.bench.board_clock import ClockFit
from tools.bench.told import Told

FIT = ClockFit(100.0, 0.0, 10.0, 10, 0.0, 0.0, 0.0)
"""The board's clock began at 100 s of ours."""


def report(number: int, stamp_s: float = 0.0, gyro: float | None = 0.5) -> SensorReport:
    values = (gyro, 0.0, 0.0, 9.8, 1.0, 1.0, 0.2, 7.4, 0.3, 18.0, None)
    return SensorReport(round(stamp_s * 1e6), number, *values)


def full(count: int) -> BoardEvent:
    return BoardEvent(0, BoardEventCode.QUEUE_FULL, count)


def told(*messages: object, keep: bool = True, gps: Gps18xConfig | None = None) -> Told:
    one = Told(gps or Gps18xConfig(), keep=keep)
    one.take_messages(
        [(10**15 * number, LINK_MESSAGES.encode(each)) for number, each in enumerate(messages)]
    )
    return one


CASES = {
    "all came": ((1, 2, 3), {"delivered": 3}),
    "numbers wrap": ((0xFFFE, 0xFFFF, 0, 1), {"delivered": 4}),
    "one is gone and nobody said so": ((1, 3), {"delivered": 2, "missing": 1, "lost": 1}),
    "the board had no room, and said so": (
        (1, full(3), 5),
        {"delivered": 2, "missing": 3, "refused": 3},
    ),
    "it said so of some": (
        (1, full(2), 5),
        {"delivered": 2, "missing": 3, "refused": 2, "lost": 1},
    ),
    "what it said holds for the next gap only": (
        (1, full(2), 2, 5),
        {"delivered": 3, "missing": 2, "refused": 2, "lost": 2},
    ),
    "one came twice": ((1, 2, 2, 3), {"delivered": 4, "repeated": 1}),
    "the board was reset": (
        (700, 701, BoardEvent(0, BoardEventCode.RESET, 3), 1, 2),
        {"delivered": 4},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_reports_are_counted(case: str) -> None:
    items, expected = CASES[case]
    messages = [report(each) if isinstance(each, int) else each for each in items]
    zeros = dict.fromkeys(("delivered", "backlog", "missing", "repeated", "refused", "lost"), 0)
    assert told(*messages).reports(None, 0.0) == zeros | expected


def test_what_was_made_before_the_link_was_up_is_backlog() -> None:
    stamps = ((1, 0.1), (2, 0.2), (7, 0.7), (8, 0.8), (10, 1.0))
    counted = told(*(report(number, at) for number, at in stamps)).reports(FIT, 100.5)
    assert counted["backlog"] == 2
    assert counted["missing"] == 1  # 9, and not 3 to 6, which no link was there for
    assert counted["lost"] == 5


def test_commands_are_matched_with_their_confirmations() -> None:
    one = told(CommandApplied(1, 0), CommandApplied(2, 0), CommandApplied(2, 0))
    one.take_beats([(0, (1, 0.1, 0.2, 0.9, 2.0)), (5, (2, 0.1, 0.2, 0.9, 2.0))])
    one.take_beats([(9, (3, 0.1, 0.2, 0.9, 2.0))])
    assert one.commands() == {"given": 3, "applied": 2, "surplus": 1}
    assert one.channels(None)["tail_bias_rad"].value.tolist() == [0.1, 0.1, 0.1]


def test_channels_are_at_the_times_of_measuring_and_without_gaps() -> None:
    one = told(report(1, 1.0), report(2, 2.0, gyro=None), report(3, 3.0), report(3, 2.5))
    gyro = one.channels(FIT)["gyro_z_rad_s"]
    assert gyro.time_s.tolist() == [101.0, 103.0]  # none at 102, and 102.5 came after 103
    assert gyro.value.tolist() == [0.5, 0.5]
    assert one.channels(FIT)["battery_v"].time_s.tolist() == [101.0, 102.0, 103.0]
    assert one.channels(None)["battery_v"].time_s.tolist() == [1.0, 2.0, 3.0]  # arrivals; 0 is out
    assert told(report(1, 1.0), keep=False).channels(FIT) == {}


@pytest.mark.parametrize("north_rad", [0.0, 1.5])
def test_gps_positions_are_in_the_tank(north_rad: float) -> None:
    """30 m east and 20 m north of the reference, by the metres in a degree."""
    gps = Gps18xConfig(north_rad=north_rad)
    north_m, east_m = metres_per_degree(gps.latitude_deg)
    fix = GpsReport(
        5_000_000, gps.latitude_deg + 20.0 / north_m, gps.longitude_deg + 30.0 / east_m,
        0.1, 0.0, 3600.0, 7,
    )  # fmt: skip
    blind = GpsReport(6_000_000, None, None, None, None, None, 0)
    found = told(fix, blind, gps=gps).channels(FIT)
    assert found["gps_x_m"].time_s.tolist() == [105.0]
    # East is a quarter turn clockwise from north.
    x_m = 20.0 * math.cos(north_rad) + 30.0 * math.cos(north_rad - math.pi / 2)
    y_m = 20.0 * math.sin(north_rad) + 30.0 * math.sin(north_rad - math.pi / 2)
    assert found["gps_x_m"].value[0] == pytest.approx(x_m, abs=0.02)
    assert found["gps_y_m"].value[0] == pytest.approx(y_m, abs=0.02)
