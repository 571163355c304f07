"""How much a shoal says: the bounds that docs/network.md states, with all protocols together."""

from __future__ import annotations

from procboard.routing.neighbours import BEACONS
from procboard.routing.time_sync import PERIOD_MS
from tests.procboard.routing.traffic import measure, scattered

QUIET_BEACONS = 60_000 / BEACONS.maximum_ms


def test_two_boards() -> None:
    traffic = measure(scattered(2, 0.1, 1), 1, 60)
    assert traffic.total < 35
    assert (traffic.undelivered, traffic.unshared) == (0, 0)


def test_twenty_boards() -> None:
    traffic = measure(scattered(20, 0.3, 1), 1, 30)
    assert traffic.total < 110
    assert traffic.frames["beacons"] < 2 * QUIET_BEACONS
    assert traffic.frames["time"] <= 1.2 * 60_000 / PERIOD_MS
    assert traffic.airtime < 0.04
    assert (traffic.undelivered, traffic.unshared) == (0, 0)
