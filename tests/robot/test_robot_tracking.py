"""Target tracking with the whole robot: camera, radio, both boards, servo; and what it lacks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_model.time import FS_PER_S, from_seconds
from plant.vehicle import TRUTH_COLUMNS
from procboard.applications.target_tracking import TARGETS_KEPT
from procboard.applications.tracking_estimate import PoseTrack
from radio_802154.messages import CommandStatus, Pose, TailBeatCommand, TargetCommand
from tools import scenario
from tools.bench import Bench
from tools.errors import ScenarioError

ONE = "procboard.tracking.targets_m=[[0.5,0.3]]"


class Tank:
    """A bench that can be stepped, with somebody's hand on the poses that go out."""

    def __init__(self, *sets, seed=1):
        config = scenario.load("track-targets", sets, duration_s=200.0, seed=seed)
        self.bench = Bench.from_scenario(config)
        self.said = []
        self.bench.trace.channel("proc.tracking").sink(self.said.extend)
        self.beats = []
        self.bench.trace.channel("proc.tail_beat").sink(self.beats.extend)
        app = self.bench.host.base.app
        self.app, self._send = app, app.send_pose
        self.hand = lambda pose: pose
        app.send_pose = self._pass_on

    def _pass_on(self, robot, pose):
        pose = self.hand(pose)
        if pose is not None:
            self._send(robot, pose)

    def run(self, until_s):
        self.bench.scheduler.run(from_seconds(until_s))
        self.bench.trace.flush()

    def run_until(self, word, limit_s):
        """Until the board said a word; returns when, or fails."""
        until_s = self.bench.scheduler.now / FS_PER_S
        while not self.words(word):
            until_s += 1.0
            assert until_s <= limit_s, f"no {word!r} within {limit_s} s: {self.said}"
            self.run(until_s)
        return self.first_s(word)

    def truth(self, *names):
        """Columns of what truly was."""
        rows = self.bench.robot.vehicle.truth(self.bench.scheduler.now)
        return [rows[:, TRUTH_COLUMNS.index(name)] for name in names]

    def words(self, *wanted):
        return [value for _, value in self.said if value[0] in wanted]

    def first_s(self, word):
        return next(time / FS_PER_S for time, value in self.said if value[0] == word)

    def tail_rate(self, from_s):
        """Fastest that the tail moved since a time, rad/s."""
        time, rate = self.truth("time_s", "tail_rate_rad_s")
        return float(np.abs(rate[time >= from_s]).max())


@pytest.fixture(scope="module")
def two(swim):
    """The bundled scenario as far as its second target."""
    return swim("track-targets", duration_s=72.0, keep=True)


def test_targets_are_reached_in_their_order(two):
    visits = two.data.targets
    assert [(visit.x_m, visit.y_m) for visit in visits] == [(0.35, 0.9), (1.25, 0.7), (0.8, 0.1)]
    assert [visit.reached_s is not None for visit in visits] == [True, True, False]
    assert visits[1].since_s == visits[0].reached_s
    # Reached by poses with noise; the truth is not far from that.
    assert all(visit.nearest_m <= 0.025 for visit in visits[:2])
    assert two.data.metrics["targets_reached"] == 2
    assert two.data.metrics["target_2_reached_s"] == visits[1].reached_s
    assert two.data.metrics["target_3_reached_s"] is None
    assert two.data.metrics["target_3_nearest_m"] == visits[2].nearest_m
    assert {switch.mode for switch in two.data.switches} <= {"turning", "approaching", "leaving"}


def test_the_truth_came_where_the_board_says_so(two):
    truth = two.data.truth
    for visit in two.data.targets[:2]:
        before = truth["time_s"] <= visit.reached_s
        distance = np.hypot(truth["x_m"] - visit.x_m, truth["y_m"] - visit.y_m)[before]
        assert distance.min() == pytest.approx(visit.nearest_m)


def test_the_page_shows_targets_and_switches(two):
    page = (two.folder / "report.html").read_text(encoding="utf-8")
    for words in ("targets reached", "target 3", "begins to approach", "begins to turn"):
        assert words in page
    assert "Target tracking, degrees" in page
    assert "3: not reached" in page
    assert 'class="dots c3"' in (two.folder / "path.svg").read_text(encoding="utf-8")


POSES = [
    (0.2, 0.3, 0.0),  # straight ahead
    (0.4, 0.3, math.pi / 2),  # beside it, within the turning circle
    (0.5, 0.45, math.pi),
    (0.8, 0.6, 1.0),  # behind it
]


@pytest.mark.parametrize(("x", "y", "heading"), POSES)
def test_it_arrives_from_poses_all_around(x, y, heading):
    tank = Tank(ONE, f"initial.x_m={x}", f"initial.y_m={y}", f"initial.heading_rad={heading}")
    reached_s = tank.run_until("reached", 60.0)
    true_x, true_y = tank.truth("x_m", "y_m")
    assert np.hypot(true_x - 0.5, true_y - 0.3).min() < 0.025
    # With no target left it rests: the tail stands still in the end.
    tank.run(reached_s + 5.0)
    assert tank.tail_rate(reached_s + 4.0) < 0.05


def test_it_does_not_set_out_before_it_knows_where_it_is():
    tank = Tank()
    tank.hand = lambda pose: None
    tank.run(5.0)
    assert tank.beats == []
    assert tank.words("target") == [("target", 1, 0.35, 0.9)]
    tank.hand = lambda pose: pose
    tank.run(7.0)
    assert tank.beats


def test_without_poses_it_coasts_then_stops_then_goes_on():
    tank = Tank()
    tank.run(8.0)
    tank.hand = lambda pose: None  # the last pose went out at 8 s
    tank.run(12.5)
    assert tank.words("pose lost") == []
    decided = [time for time, value in tank.beats]
    assert decided[-1] > 11 * FS_PER_S  # it steers by dead reckoning meanwhile
    tank.run(22.0)
    assert 13.0 < tank.first_s("pose lost") < 15.0
    assert tank.tail_rate(18.0) < 0.05
    tank.hand = lambda pose: pose
    tank.run(25.0)
    assert tank.words("pose found") == [("pose found",)]
    assert tank.tail_rate(24.0) > 0.5


def test_a_pose_that_is_repeated_counts_as_lost():
    tank = Tank()
    tank.run(8.0)
    frozen = []

    def freeze(pose):
        frozen.append(pose)
        return frozen[0]

    tank.hand = freeze
    tank.run(16.0)
    assert len(frozen) > 5
    assert 13.0 < tank.first_s("pose lost") < 16.0


def test_single_poses_may_get_lost():
    tank = Tank(ONE)
    count = 0

    def drop(pose):
        nonlocal count
        count += 1
        return None if count % 3 == 0 else pose

    tank.hand = drop
    tank.run_until("reached", 60.0)
    assert tank.words("pose lost") == []


def test_a_lossy_air_delays_and_does_not_hinder():
    tank = Tank(ONE, "radio.loss_probability=0.4")
    tank.run_until("reached", 60.0)
    assert tank.bench.recorder.radio_received < tank.bench.recorder.radio_sent


def test_after_a_restart_the_list_begins_anew(swim):
    near = "procboard.tracking.targets_m=[[0.3,0.3],[0.8,0.3]]"
    cut = "faults.supply_cuts=[{at_s=20.0,duration_s=1.0}]"
    run = swim("track-targets", near, cut, duration_s=34.0)
    said = [value[1:] for value in run.values("proc.tracking") if value[0] == "target"]
    assert said == [(1, 0.3, 0.3), (2, 0.8, 0.3), (1, 0.3, 0.3)]
    assert [(visit.x_m, visit.reached_s is not None) for visit in run.data.targets] == [
        (0.3, True), (0.8, False), (0.3, False),
    ]  # fmt: skip
    assert run.data.metrics["targets_reached"] == 1


def test_targets_by_radio_are_added_to_the_end():
    tank = Tank("procboard.tracking.targets_m=[]", "initial.x_m=0.3")
    tank.run(3.0)
    assert tank.said == []
    assert tank.beats == []
    first = tank.app.send_command(1, TargetCommand(0, 0.45, 0.3))
    second = tank.app.send_command(1, TargetCommand(0, 0.6, 0.3))
    tank.run(4.0)
    assert (first.status, second.status) == (CommandStatus.ACCEPTED, CommandStatus.ACCEPTED)
    assert tank.words("target") == [("target", 1, 0.45, 0.3)]
    tank.run(26.0)
    assert tank.words("target", "reached") == [
        ("target", 1, 0.45, 0.3),
        ("reached", 1, 0.45, 0.3),
        ("target", 2, 0.6, 0.3),
        ("reached", 2, 0.6, 0.3),
    ]


def test_there_is_room_for_so_many_targets():
    tank = Tank("procboard.tracking.targets_m=[]")
    tank.hand = lambda pose: None
    tank.run(0.5)
    commands = []
    for number in range(TARGETS_KEPT + 1):
        commands.append(tank.app.send_command(1, TargetCommand(0, 0.05 * number, 0.3)))
        tank.run(0.5 + 0.1 * (number + 1))
    tank.run(6.0)
    assert [command.status for command in commands] == [
        *[CommandStatus.ACCEPTED] * TARGETS_KEPT,
        CommandStatus.REFUSED,
    ]


def test_a_tail_beat_command_ends_the_tracking():
    tank = Tank()
    tank.run(6.0)
    command = tank.app.send_command(1, TailBeatCommand(0, 0.1, 0.2, 0.5, 0.0))
    tank.run(7.0)
    assert command.status is CommandStatus.APPLIED
    tank.run(12.0)
    late = [value for time, value in tank.beats if time > 7 * FS_PER_S]
    assert late
    assert {value[1:4] for value in late} == {(0.1, 0.2, 0.5)}
    tank.app.send_command(1, TargetCommand(0, 0.6, 0.3))  # and a target begins it again
    tank.run(14.0)
    assert tank.beats[-1][1][2] == pytest.approx(math.radians(15))


def test_a_navigation_board_that_is_reset_is_got_over(monkeypatch):
    forgotten = []
    forget = PoseTrack.forget_headings
    monkeypatch.setattr(
        PoseTrack, "forget_headings", lambda track: (forgotten.append(track), forget(track))
    )
    tank = Tank(ONE)
    tank.run(9.3)
    tank.bench.robot.nav.mcu.request_reset()
    tank.run_until("reached", 40.0)
    assert len(tank.bench.robot.nav.links) == 2  # it did boot anew
    assert len(forgotten) == 1  # headings of two boots do not go together


def test_a_base_station_whose_clock_began_anew_is_believed():
    tank = Tank()
    tank.run(8.0)
    tank.hand = lambda pose: Pose(pose.x_m, pose.y_m, pose.heading_rad, pose.camera_time_ms - 8000)
    tank.run(18.0)
    assert tank.words("pose found") == [("pose found",)]


REFUSED = {
    "procboard.tracking.targets_m=[[0.5,0.5],[9,0]]": ("targets_m[1]", "must lie in the tank"),
    "base_station.send_pose=false": ("send_pose", "poses by radio"),
    "camera.fitted=false": ("camera.fitted", "camera's poses"),
    "procboard.tracking.bias_max_rad=0.85": ("bias_max_rad", "tail_limit_rad"),
    "procboard.tracking.approach_below_rad=1.0": ("approach_below_rad", "turn_above_rad"),
    "procboard.tracking.leave_radii=1.5": ("leave_radii", "at least 2"),
    "procboard.tail_beat.frequency_hz=0": ("frequency_hz", "> 0"),
    "procboard.tail_beat.amplitude_rad=0": ("amplitude_rad", "> 0"),
    f"procboard.tracking.targets_m={[[0.1, 0.1]] * 17}": (
        "targets_m",
        "17 targets",
        f"{TARGETS_KEPT}",
    ),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_is_refused_in_a_line(text):
    with pytest.raises(ScenarioError) as caught:
        scenario.load("track-targets", [text])
    for words in REFUSED[text]:
        assert words in str(caught.value)
    assert "\n" not in str(caught.value)
