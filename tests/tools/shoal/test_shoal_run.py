"""Several robots on one clock and one medium: what they share, and what is each one's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from radio_802154 import messages
from tools import scenario
from tools.bench import Bench
from tools.errors import ScenarioError
from tools.shoal import ShoalBench
from tools.shoal.members import members

SMALL = ("shoal.robots=3", "shoal.switch_on_s=0.2", "procboard.telemetry_period_s=0.5")


def swum(*sets: str, duration_s: float = 3.0, seed: int = 1) -> ShoalBench:
    config = scenario.load("shoal", (*SMALL, *sets), duration_s=duration_s, seed=seed)
    bench = ShoalBench.from_scenario(config)
    bench.run(lambda seconds: None, lambda: False)
    return bench


@pytest.fixture(scope="module")
def data() -> Any:
    return swum().run_data()


def test_the_same_scenario_and_seed_give_the_same_trace(data: Any) -> None:
    assert swum().run_data().trace_sha256 == data.trace_sha256
    assert swum(seed=2).run_data().trace_sha256 != data.trace_sha256


def test_interrupting_ends_it_at_a_whole_slice() -> None:
    config = scenario.load("shoal", SMALL, duration_s=5.0)
    bench = ShoalBench.from_scenario(config)
    seen: list[float] = []
    bench.run(seen.append, lambda: len(seen) == 4)
    ended = bench.run_data()
    assert ended.interrupted
    assert ended.duration_s == pytest.approx(0.2)
    assert seen == pytest.approx([0.05, 0.1, 0.15, 0.2])


def test_a_shoal_of_one_swims_as_one_robot_does() -> None:
    sets = ("initial.x_m=0.3", "initial.heading_rad=0.4", "records.truth_period_s=0.02")
    one = Bench.from_scenario(scenario.load("circle", sets, duration_s=3.0))
    one.run(lambda seconds: None, lambda: False)
    alone = one.run_data(compare=False)
    config = scenario.load("circle", (*sets, "shoal.robots=1"), duration_s=3.0)
    bench = ShoalBench.from_scenario(config)
    bench.run(lambda seconds: None, lambda: False)
    (robot,) = bench.run_data().robots
    for name, values in robot.truth.items():
        np.testing.assert_array_equal(values, alone.truth[name][:: alone.truth_every], err_msg=name)
    assert robot.metrics["energy_j"] == pytest.approx(alone.metrics["energy_j"], rel=1e-3)
    assert robot.metrics["samples_stored"] == alone.metrics["samples_stored"]
    assert set(robot.channels) == set(alone.channels)


def test_what_one_robot_does_does_not_depend_on_those_that_it_does_not_hear() -> None:
    """Of three or of four on the same places: the first three have the same chances."""
    starts = "shoal.starts=[{x_m=0,y_m=0}, {x_m=1,y_m=0}, {x_m=0,y_m=1}, {x_m=1,y_m=1}]"
    quiet = ("procboard.telemetry_period_s=600", "shoal.robots=4", starts)
    four = swum(*quiet, duration_s=1.5)
    three = swum(
        quiet[0],
        starts.replace(", {x_m=1,y_m=1}", ""),
        duration_s=1.5,
    )
    names = [name for name in three.trace.names() if name.startswith("fish0")]
    assert len(names) > 40
    for name in names:
        if "radio" not in name:  # the first telemetry goes out at boot, and meets others
            assert three.trace.channel(name).digest() == four.trace.channel(name).digest(), name


def test_names_make_different_random_numbers() -> None:
    """Of two robots that are alike in everything else, on the same place."""
    starts = "shoal.starts=[{x_m=1, y_m=0}, {x_m=1, y_m=0}]"
    alike = ("shoal.robots=2", starts, "shoal.switch_on_s=0", "shoal.clock_spread_ppm=0")
    one, two = (
        swum(*alike, "navboard.tail_potentiometer.fitted=true", duration_s=0.5).run_data().robots
    )
    for channel in ("gyro_z_rad_s", "accel_x_m_s2", "temperature_c", "tail_angle_rad", "x_m"):
        first, second = one.channels[channel].value[:10], two.channels[channel].value[:10]
        assert first.size >= 5
        assert not np.array_equal(first, second), channel
    np.testing.assert_array_equal(one.truth["x_m"], two.truth["x_m"])


def test_crystals_and_moments_of_switching_on_differ_as_the_scenario_says() -> None:
    sets = ("shoal.robots=100", "shoal.switch_on_s=2.0", "shoal.clock_spread_ppm=10.0")
    every = members(scenario.load("shoal", sets))
    drifts = np.array([member.config.procboard.clock_drift_ppm for member in every])
    moments = np.array([member.switch_on_s for member in every])
    nominal = scenario.load("shoal").procboard.clock_drift_ppm
    # Five standard errors of mean and deviation of a hundred.
    assert abs(drifts.mean() - nominal) < 5.0
    assert 6.5 < drifts.std() < 13.5
    assert 0.0 <= moments.min() < 0.2
    assert 1.8 < moments.max() < 2.0
    alike = members(scenario.load("shoal", ("shoal.clock_spread_ppm=0", "shoal.switch_on_s=0")))
    assert {member.config.procboard.clock_drift_ppm for member in alike} == {nominal}
    assert {member.switch_on_s for member in alike} == {0.0}


def test_each_is_off_before_it_is_switched_on(data: Any) -> None:
    for robot in data.robots:
        (begin, end) = robot.outages[0]
        assert (begin, len(robot.outages)) == (0.0, 1)
        assert 0.0 < end < 0.2
        assert robot.mounts[0].time_s > end
        assert robot.truth["battery_v"][0] == 0.0
        assert robot.truth["battery_v"][-1] > 8.0


def test_all_start_where_they_should_and_head_outwards(data: Any) -> None:
    for robot in data.robots:
        x, y, psi = (robot.truth[name] for name in ("x_m", "y_m", "heading_rad"))
        assert np.cos(psi[0]) == pytest.approx(x[0] / np.hypot(x[0], y[0]))
        assert np.hypot(x[-1], y[-1]) > np.hypot(x[0], y[0])
    distance = data.whole["least_distance_m"]
    assert distance == pytest.approx(0.4, abs=0.005)
    assert data.whole["least_distance_between"] in (1, 2)


def test_the_base_station_hears_all_of_them(data: Any) -> None:
    for robot in data.robots:
        assert robot.metrics["telemetry_received"] >= 5
        assert robot.metrics["telemetry_received"] == robot.metrics["radio_sent"]
    assert data.whole["telemetry_received"] == sum(
        robot.metrics["telemetry_received"] for robot in data.robots
    )


def test_who_heard_whom_adds_up(data: Any) -> None:
    hearing = data.hearing
    assert hearing.names == ("fish01", "fish02", "fish03", "base")
    assert (hearing.heard <= hearing.sent[:, None]).all()
    assert not hearing.heard.diagonal().any()
    # Three robots in half a metre: only who sends itself does not hear.
    ratio = hearing.ratio()
    assert np.isnan(ratio.diagonal()).all()
    assert np.nanmin(ratio) > 0.8
    # The base acknowledges what it got.
    assert hearing.sent[3] == data.whole["telemetry_received"]


def test_commands_go_to_whom_they_are_for() -> None:
    ended = swum(
        "base_station.tail_beats=[{at_s=1.0, bias_rad=0.3, robots=[2]}, {at_s=1.5, bias_rad=0.1}]"
    ).run_data()
    biases = [robot.channels["tail_bias_rad"].value for robot in ended.robots]
    assert [bool((bias > 0.25).any()) for bias in biases] == [False, True, False]
    assert [bias[-1] for bias in biases] == pytest.approx([0.1] * 3, abs=1e-3)
    said = [command.what.rpartition(" to ")[2] for command in ended.commands]
    assert said == ["fish02", "fish01", "fish02", "fish03"]
    assert {command.outcome for command in ended.commands} == {"applied"}
    assert [robot.metrics["radio_received"] for robot in ended.robots] == [1, 2, 1]


def test_poses_go_to_each_robot_evenly_apart_and_are_its_own() -> None:
    poses = ("base_station.send_pose=true", "base_station.pose_period_s=0.6")
    config = scenario.load("shoal", (*SMALL, *poses), duration_s=2.0)
    bench = ShoalBench.from_scenario(config)
    sent: list[Any] = []
    bench.trace.channel("base.radio.sent").sink(sent.extend)
    bench.run(lambda seconds: None, lambda: False)
    ended = bench.run_data()
    assert [destination for _, (destination, *_) in sent] == [1, 2, 3, 1, 2, 3, 1]
    assert np.diff([time_fs / 1e15 for time_fs, _ in sent]) == pytest.approx(0.2, abs=0.02)
    for _, (destination, am_type, payload, _) in sent:
        pose = messages.decode(am_type, payload)
        truth = ended.robots[destination - 1].truth
        assert isinstance(pose, messages.Pose)
        assert pose.x_m == pytest.approx(truth["x_m"][0], abs=0.03)
        assert pose.y_m == pytest.approx(truth["y_m"][0], abs=0.03)


def test_a_fault_hits_whom_it_is_for() -> None:
    ended = swum("faults.supply_cuts=[{at_s=1.0, duration_s=600.0, robots=[3]}]").run_data()
    stored = [robot.metrics["samples_stored"] for robot in ended.robots]
    assert stored[2] < stored[0] / 2
    assert [len(robot.outages) for robot in ended.robots] == [1, 1, 2]
    assert any("fish03, supply" in event.where for event in ended.events)


def test_one_robots_bench_refuses_a_shoal() -> None:
    with pytest.raises(ScenarioError, match="several robots"):
        Bench.from_scenario(scenario.load("shoal"))
