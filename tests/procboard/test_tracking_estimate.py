"""Poses and headings of a robot that moves by a formula: what is estimated is known exactly."""

import math

import pytest

from procboard.applications.tracking_estimate import PoseTrack, nearest_m

BEAT = 1.0
YAW = math.radians(5)  # of the beat, as at 15° and 1 Hz
TARGET = (1.0, 0.5)


def heading(t, rate):
    return 0.3 + rate * t + YAW * math.sin(2 * math.pi * t + 0.7)


def place(t, rate, speed=0.03, drift=0.004):
    """A point that goes with surge and sway in the heading without the beat's yaw."""
    psi = 0.3 + rate * t
    if rate == 0:
        x = t * (speed * math.cos(psi) - drift * math.sin(psi))
        return x, t * (speed * math.sin(psi) + drift * math.cos(psi))
    along = (math.sin(psi) - math.sin(0.3)) / rate
    across = (math.cos(0.3) - math.cos(psi)) / rate
    return speed * along - drift * across, speed * across + drift * along


def swum(rate, beats=4, offset=2.0, compass=True, every=1):
    """A track after so many beats; the compass is off, and the camera's clock is another."""
    track = PoseTrack(BEAT, 5.0)
    for tenth in range(10 * beats + 1):
        t = tenth / 10
        if compass:
            track.take_heading(t, math.remainder(heading(t, rate) + offset, 2 * math.pi))
        if tenth % (10 * every) == 0:
            psi = math.remainder(heading(t, rate), 2 * math.pi)
            assert track.take_pose(t, *place(t, rate), psi, 7_000 + round(1e3 * t))
    return track


@pytest.mark.parametrize("rate", [0.0, 0.15, -0.2])
def test_velocities_are_means_over_the_beat(rate):
    motion = swum(rate).motion(TARGET)
    assert motion.surge_m_s == pytest.approx(0.03, abs=3e-4)
    assert motion.sway_m_s == pytest.approx(0.004, abs=3e-4)
    assert motion.yaw_rate_rad_s == pytest.approx(rate, abs=1e-9)
    x, y = place(4.0, rate)
    bearing = math.atan2(TARGET[1] - y, TARGET[0] - x)
    assert motion.distance_m == pytest.approx(math.hypot(TARGET[0] - x, TARGET[1] - y))
    # The yaw of the beat is taken out: a pose alone would be off by its phase, 3.2°.
    assert motion.error_rad == pytest.approx(0.3 + 4 * rate - bearing, abs=2e-3)


def test_poses_alone_must_do_where_the_other_board_is_silent():
    motion = swum(0.15, compass=False).motion(TARGET)
    assert motion.yaw_rate_rad_s == pytest.approx(0.15, abs=1e-9)
    assert motion.surge_m_s == pytest.approx(0.03, abs=1e-3)
    x, y = place(4.0, 0.15)
    seen = heading(4.0, 0.15) - math.atan2(TARGET[1] - y, TARGET[0] - x)
    assert motion.error_rad == pytest.approx(seen)


def test_headings_of_two_boots_are_not_mixed():
    track = swum(0.15)
    track.forget_headings()
    track.take_heading(4.05, -1.0)
    track.take_pose(5.0, *place(5.0, 0.15), heading(5.0, 0.15), 12_000)
    assert track.motion(TARGET).yaw_rate_rad_s == pytest.approx(0.15, abs=1e-9)


def test_the_first_pose_knows_no_velocity():
    track = PoseTrack(BEAT, 5.0)
    assert track.motion(TARGET) is None
    assert track.passed_m(TARGET) == math.inf
    track.take_pose(0.0, 1.0, 0.0, math.pi / 2, 0)
    assert track.motion(TARGET) == (0.5, 0.0, 0.0, 0.0, 0.0)


def test_an_old_pose_is_no_news():
    track = swum(0.0)
    before = track.motion(TARGET)
    assert not track.take_pose(4.5, 9.0, 9.0, 0.0, 11_000)  # the same exposure again
    assert not track.take_pose(4.5, 9.0, 9.0, 0.0, 10_000)  # an earlier one
    assert track.motion(TARGET) == before
    assert track.pose_s == 4.0


def test_a_base_station_that_was_started_anew_is_believed_after_a_while():
    track = swum(0.0)
    assert not track.take_pose(8.9, 0.2, 0.1, 0.0, 50)
    assert track.take_pose(9.1, 0.2, 0.1, 0.0, 250)
    assert track.motion(TARGET).surge_m_s == 0.0  # the poses before say nothing of now


def test_the_cameras_clock_may_wrap():
    track = PoseTrack(BEAT, 5.0)
    assert track.take_pose(0.0, 0.0, 0.0, 0.0, (1 << 32) - 500)
    assert track.take_pose(1.0, 0.03, 0.0, 0.0, 500)
    assert track.motion((1.0, 0.0)).surge_m_s == pytest.approx(0.03)


def test_times_between_poses_are_the_cameras_not_the_radios():
    track = PoseTrack(BEAT, 5.0)
    track.take_pose(0.0, 0.0, 0.0, 0.0, 1_000)
    track.take_pose(1.3, 0.03, 0.0, 0.0, 2_000)  # delayed by retries
    assert track.motion((1.0, 0.0)).surge_m_s == pytest.approx(0.03)


def test_where_poses_stop_the_place_is_carried_on():
    track = swum(0.15)
    for tenth in range(41, 71):
        track.take_heading(tenth / 10, heading(tenth / 10, 0.15) + 2.0)
        if tenth % 10 == 0:
            track.carry_on(tenth / 10)
    x, y = place(7.0, 0.15)
    motion = track.motion(TARGET)
    assert motion.distance_m == pytest.approx(math.hypot(TARGET[0] - x, TARGET[1] - y), abs=2e-3)
    bearing = math.atan2(TARGET[1] - y, TARGET[0] - x)
    assert motion.error_rad == pytest.approx(0.3 + 7 * 0.15 - bearing, abs=0.01)


def test_poses_more_often_than_once_a_beat_give_the_same_means():
    track = PoseTrack(BEAT, 5.0)
    for tenth in range(41):
        t = tenth / 10
        track.take_heading(t, heading(t, 0.15))
        if tenth % 2 == 0:
            track.take_pose(t, *place(t, 0.15), heading(t, 0.15), round(1e3 * t))
    motion = track.motion(TARGET)
    assert motion.surge_m_s == pytest.approx(0.03, abs=3e-4)
    assert motion.yaw_rate_rad_s == pytest.approx(0.15, abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "target", "distance"),
    [
        ((0, 0), (1, 0), (0.5, 0.3), 0.3),
        ((0, 0), (1, 0), (-0.3, 0.4), 0.5),
        ((0, 0), (1, 0), (1.3, -0.4), 0.5),
        ((0, 0), (0, 0), (3, 4), 5.0),
        ((1, 1), (0, 0), (0.5, 0.5), 0.0),
    ],
)
def test_nearest_distance_of_a_piece_of_path(before, after, target, distance):
    assert nearest_m(before, after, target) == pytest.approx(distance)
