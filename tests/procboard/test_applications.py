"""The applications' pure parts, and the base station where nobody answers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_S
from firmware_model.trace import Trace
from procboard.applications.base_station import ATTEMPTS
from procboard.applications.heading import (
    HeadingConfig,
    HeadingEstimate,
    bias_for,
    heading_error,
    wrap,
)
from procboard.applications.telemetry import TelemetryConfig
from procboard.board import BaseStation
from procboard.errors import ProcConfigError
from procboard.network import NetworkConfig
from radio_802154.errors import RadioError
from radio_802154.medium import Antenna, Medium
from radio_802154.messages import Pose, TailBeatCommand

angles = st.floats(-50.0, 50.0)


@pytest.mark.parametrize(
    ("x", "y", "heading", "expected"),
    [
        (0.0, 0.0, 0.0, math.pi / 4),  # the source's start: at the origin, target (2, 2)
        (0.0, 0.0, math.pi / 4, 0.0),
        (0.0, 0.0, math.pi, -3 * math.pi / 4),
        (2.0, 0.0, 0.0, math.pi / 2),
        (4.0, 2.0, 0.0, -math.pi),
        (2.0, 4.0, 0.0, -math.pi / 2),
    ],
)
def test_heading_error(x, y, heading, expected):
    assert heading_error(x, y, heading, (2.0, 2.0)) == pytest.approx(expected)


@given(angles)
def test_wrap_keeps_the_direction(angle):
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


@given(angles, angles, angles, st.floats(-3, 3), st.floats(-3, 3))
def test_the_error_turns_with_the_robot(x, y, heading, dx, dy):
    """Turning robot and target together about the robot changes nothing."""
    turned = (
        x + dx * math.cos(1.0) - dy * math.sin(1.0),
        y + dx * math.sin(1.0) + dy * math.cos(1),
    )
    if math.hypot(dx, dy) < 1e-3:
        return
    a = heading_error(x, y, heading, (x + dx, y + dy))
    b = heading_error(x, y, heading + 1.0, turned)
    assert abs(wrap(a - b)) < 1e-6


def test_the_bias_is_proportional_limited_and_turns_the_right_way():
    # A target to port (error > 0) wants the tail to port, which is a negative angle (3.18).
    assert bias_for(0.4, 0.5, 0.6) == pytest.approx(-0.2)
    assert bias_for(-0.4, 0.5, 0.6) == pytest.approx(0.2)
    assert bias_for(3.0, 0.5, 0.6) == -0.6
    assert bias_for(-3.0, 0.5, 0.6) == 0.6
    assert bias_for(0.0, 0.5, 0.6) == 0.0


def test_between_poses_the_boards_heading_leads():
    estimate = HeadingEstimate()
    estimate.take(Pose(0.0, 0.0, 1.0, 0), 0, 3.0)  # the compass is off by two radians
    assert estimate.heading_rad(3.0) == pytest.approx(1.0)
    assert estimate.heading_rad(3.1) == pytest.approx(1.1)
    assert estimate.heading_rad(-3.1) == pytest.approx(1.0 + (2 * math.pi - 6.1))
    assert estimate.heading_rad(None) == 1.0
    estimate.take(Pose(0.0, 0.0, 2.0, 0), 0, None)
    assert estimate.heading_rad(0.5) == 2.0


@pytest.mark.parametrize(
    "wrong",
    [{"period_s": 0.0}, {"frequency_hz": 0.0}, {"gain": -1.0}, {"bias_limit_rad": 2.0}],
)
def test_impossible_controllers_are_refused(wrong):
    with pytest.raises(ProcConfigError):
        HeadingConfig(**wrong)


def test_negative_periods_are_refused():
    with pytest.raises(ProcConfigError, match="report_period_s"):
        TelemetryConfig(report_period_s=-0.1)


@pytest.fixture
def base():
    scheduler = Scheduler()
    medium = Medium(scheduler)
    medium.place("base", Antenna())
    rail = Rail(scheduler, "3V", 3.0)
    station = BaseStation(scheduler, Trace(), rail, medium, NetworkConfig(1))
    scheduler.run(FS_PER_S // 10)
    return station


def test_an_unanswered_command_is_abandoned_in_the_end(base):
    heard = []
    base.app.on_reply = heard.append
    pending = base.app.send_command(7, TailBeatCommand(0, 0.0, 0.1, 1.0, 5.0))
    assert base.app.pending == (pending,)
    base.scheduler.run(10 * FS_PER_S)
    assert pending.abandoned
    assert pending.settled
    assert pending.attempts == ATTEMPTS
    assert heard == [pending]
    assert base.app.pending == ()


def test_commands_get_numbers_and_impossible_ones_are_refused_at_once(base):
    first = base.app.send_command(7, TailBeatCommand(0, 0.0, 0.1, 1.0, 5.0))
    second = base.app.send_command(7, TailBeatCommand(0, 0.0, 0.1, 1.0, 5.0))
    third = base.app.send_command(7, TailBeatCommand(77, 0.0, 0.1, 1.0, 5.0))
    assert [p.command.command_id for p in (first, second, third)] == [1, 2, 77]
    with pytest.raises(RadioError, match="frequency_hz"):
        base.app.send_command(7, TailBeatCommand(0, 0.0, 0.1, 99.0, 5.0))
    with pytest.raises(RadioError, match="x_m"):
        base.app.send_pose(7, Pose(1e6, 0.0, 0.0, 0))


def test_a_command_outlives_a_reset_of_the_mote(base):
    pending = base.app.send_command(7, TailBeatCommand(0, 0.0, 0.1, 1.0, 5.0))
    base.scheduler.run(FS_PER_S)
    attempts = pending.attempts
    base.mote.mcu.press_reset()
    base.scheduler.run(2 * FS_PER_S)
    assert pending.attempts > attempts
    assert base.boot_number == 2
