"""The table of robots about: whom it keeps, and what it makes of two poses."""

from __future__ import annotations

import pytest

from procboard.applications.surroundings import KEPT, Surroundings
from radio_802154.messages import Pose

OWN = (0.0, 0.0, 0.0)


def test_speed_is_of_two_exposures_and_age_of_the_last() -> None:
    about = Surroundings()
    about.take(2, Pose(1.0, 0.0, 0.5, 10_000), 5.0, OWN)
    assert about.seen(5.5)[2].speed_m_s == 0.0
    about.take(2, Pose(1.03, 0.04, 0.6, 11_000), 6.0, OWN)
    seen = about.seen(6.25)[2]
    assert (seen.x_m, seen.y_m, seen.heading_rad, seen.age_s) == (1.03, 0.04, 0.6, 0.25)
    assert seen.speed_m_s == pytest.approx(0.05)


def test_the_same_exposure_again_is_no_news() -> None:
    about = Surroundings()
    about.take(2, Pose(1.0, 0.0, 0.0, 10_000), 5.0, OWN)
    about.take(2, Pose(1.0, 0.0, 0.0, 10_000), 6.0, OWN)
    about.take(2, Pose(9.0, 0.0, 0.0, 9_000), 6.0, OWN)
    seen = about.seen(6.0)[2]
    assert (seen.x_m, seen.age_s) == (1.0, 1.0)


def test_exposures_far_apart_say_nothing_of_the_speed() -> None:
    about = Surroundings()
    about.take(2, Pose(1.0, 0.0, 0.0, 10_000), 5.0, OWN)
    about.take(2, Pose(2.0, 0.0, 0.0, 13_000), 8.0, OWN)
    assert about.seen(8.0)[2].speed_m_s == 0.0


def test_the_cameras_clock_wraps() -> None:
    about = Surroundings()
    about.take(2, Pose(1.0, 0.0, 0.0, (1 << 32) - 500), 5.0, OWN)
    about.take(2, Pose(1.03, 0.0, 0.0, 500), 6.0, OWN)
    assert about.seen(6.0)[2].speed_m_s == pytest.approx(0.03)


def test_a_full_table_keeps_the_nearest() -> None:
    about = Surroundings()
    for address in range(2, 2 + 2 * KEPT):
        about.take(address, Pose(0.1 * address, 0.0, 0.0, 1), 1.0, OWN)
    assert set(about.seen(1.0)) == set(range(2, 2 + KEPT))
    about.take(99, Pose(0.0, 0.1, 0.0, 1), 1.0, OWN)
    assert 99 in about.seen(1.0)
    assert KEPT + 1 not in about.seen(1.0)
    assert len(about.seen(1.0)) == KEPT
