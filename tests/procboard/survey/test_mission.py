"""Missions in a small world: they end, agree and are as right as they say, whatever goes wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import hypothesis
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procboard.errors import SurveyError
from procboard.survey.fixed import at_random, everywhere
from procboard.survey.items import ITEMS, Done, Gone, Present, Sample, Skip
from procboard.survey.knowledge import Grid
from procboard.survey.mission import Mission, MissionConfig, Phase
from procboard.survey.tolerant import noise_tolerant
from tests.procboard.routing.air import clique
from tests.procboard.survey.known_fields import low_rank
from tests.procboard.survey.shoal import Robot, Shoal, Swimmer

CELL_M = 0.25
SIGMA = 0.5
LIMIT_S = 20_000.0


def sea(count, loss=0.0, *, seed=0, shape=(7, 7), rank=2, sigma=SIGMA, survey=None, **config):
    """A field, and robots 1 … count with a base 0 that survey it."""
    field = 30.0 * low_rank(np.random.default_rng(seed), shape, rank)
    made = MissionConfig(Grid(*shape, CELL_M), reading_sigma=sigma, **config)
    expected = made.deviation(10)

    def field_at(x_m, y_m):
        row, column = round(y_m / CELL_M), round(x_m / CELL_M)
        return float(field[min(max(row, 0), shape[0] - 1), min(max(column, 0), shape[1] - 1)])

    robots = [
        Robot(
            number,
            config=made,
            survey=survey or (lambda: noise_tolerant(shape, expected)),
            field_at=field_at,
            swimmer=Swimmer(0.3 * number, -0.3, math.pi / 2),
            reading_sigma=sigma,
        )
        for number in range(count + 1)
    ]
    return field, Shoal(robots, clique(count + 1, loss), seed)


def check(field, shoal, *, given_up=()):
    """All that live have one reconstruction, of every sample stored once, right as stated."""
    living = shoal.living()
    found = [robot.mission.outcome() for robot in living]
    for other in found[1:]:
        assert np.array_equal(found[0].matrix, other.matrix)
        assert np.array_equal(found[0].deviation, other.deviation, equal_nan=True)
    stored = {}
    for robot in living:
        for name in robot.stored:
            item = ITEMS.decode(robot.flash[name])
            if isinstance(item, Sample):
                stored.setdefault(item.cell, []).append(item)
    for robot in living:
        known = robot.mission.knowledge.samples
        for cell, items in stored.items():
            assert all(item in known[cell].values() for item in items)
            weights = [item.deviation**-2 for item in known[cell].values()]
            mean = np.average([item.value for item in known[cell].values()], weights=weights)
            assert found[0].matrix[cell] == pytest.approx(mean)
            assert found[0].deviation[cell] == pytest.approx(sum(weights) ** -0.5)
    assert found[0].complete
    assert found[0].given_up == tuple(given_up)
    assert np.isfinite(found[0].matrix).all()
    stated = np.isfinite(found[0].deviation)
    off = (found[0].matrix - field)[stated] / found[0].deviation[stated]
    assert np.abs(off).max() < 6.0
    return found[0]


@pytest.mark.slow
@settings(max_examples=10, phases=[hypothesis.Phase.generate])  # smaller ones say no more
@given(
    st.integers(1, 8),
    st.floats(0.0, 0.5),
    st.integers(1, 3),
    st.lists(st.tuples(st.integers(1, 8), st.floats(0.0, 700.0)), max_size=2),
    st.lists(st.tuples(st.integers(1, 8), st.floats(0.0, 700.0)), max_size=2),
    st.integers(0, 1000),
)
def test_it_ends_and_agrees_whatever_is_lost_killed_or_reset(
    count, loss, rank, kills, resets, seed
):
    field, shoal = sea(count, loss, seed=seed, rank=rank)
    for number, time_s in kills:
        if 1 < number <= count:  # one is left
            shoal.at(1000 * time_s, shoal.kill, shoal.robots[number])
    for number, time_s in resets:
        robot = shoal.robots[number % count + 1]
        shoal.at(1000 * time_s, lambda robot=robot: robot.alive and shoal.reset(robot))
    shoal.run(750.0)  # what is to happen has happened
    assert shoal.swim(LIMIT_S)
    check(field, shoal)


def test_errors_are_as_large_as_stated():
    squares = []
    for seed in range(5):
        field, shoal = sea(3, 0.2, seed=seed, shape=(8, 8))
        assert shoal.swim(LIMIT_S)
        found = check(field, shoal)
        squares.append(((found.matrix - field) / found.deviation) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


def test_robots_share_the_way_and_hardly_ever_do_a_thing_twice():
    ways, times = [], []
    for count in (1, 2, 4):
        field, shoal = sea(count, 0.2, shape=(10, 10))
        assert shoal.swim(LIMIT_S, step_s=5.0)
        found = check(field, shoal)
        known = shoal.robots[0].mission.knowledge.samples
        assert sum(map(len, known.values())) <= found.sampled.sum() + 1
        ways.append([robot.way_m for robot in shoal.robots[1:]])
        times.append(shoal.time)
    assert max(ways[1]) < 0.7 * ways[0][0]
    assert max(ways[2]) < 0.75 * max(ways[1])
    assert times[0] > times[1] > times[2]


def test_the_cells_of_a_robot_that_dies_are_taken_over():
    field, shoal = sea(3, 0.3, seed=3)
    shoal.at(200_000.0, shoal.kill, shoal.robots[2])
    shoal.run(200.0)
    left = set(shoal.robots[1].mission.plan[2]) - set(shoal.robots[1].mission.knowledge.samples)
    assert shoal.swim(LIMIT_S)
    check(field, shoal)
    assert left <= set(shoal.robots[1].mission.knowledge.samples)
    for robot in shoal.living():
        assert not robot.mission.knowledge.lives(2)


def test_a_robot_that_returns_from_the_dead_takes_part_again():
    field, shoal = sea(2, 0.1, seed=5, shape=(9, 9))
    late = shoal.robots[2]
    shoal.at(100_000.0, shoal.kill, late)
    shoal.at(600_000.0, shoal.revive, late)
    shoal.run(550.0)
    assert not shoal.robots[1].mission.knowledge.lives(2)
    before = len(late.stored)
    shoal.run(750.0)
    assert shoal.robots[1].mission.knowledge.lives(2)
    assert shoal.swim(LIMIT_S)
    check(field, shoal)
    items = [ITEMS.decode(late.flash[name]) for name in sorted(late.stored)[before:]]
    assert items[0] == replace(items[0], joined=True)
    assert sum(isinstance(item, Sample) for item in items) > 3


def test_a_robot_that_was_cut_off_learns_that_it_was_gone():
    field, shoal = sea(3, 0.1, seed=6, shape=(9, 9))
    links, nobody = shoal.links, {**clique(4), 3: {}}
    for heard in (0, 1, 2):
        nobody[heard] = {other: loss for other, loss in links[heard].items() if other != 3}

    def cut(to):
        shoal.links = to

    shoal.at(150_000.0, cut, nobody)
    shoal.at(500_000.0, cut, links)
    shoal.run(480.0)
    assert not shoal.robots[1].mission.knowledge.lives(3)
    assert not shoal.robots[3].mission.knowledge.lives(1)  # nor did it hear of them
    shoal.run(620.0)
    for robot in shoal.robots:
        assert all(robot.mission.knowledge.lives(number) for number in (1, 2, 3))
    assert shoal.swim(LIMIT_S)
    check(field, shoal)


def test_the_base_is_not_needed():
    field, shoal = sea(2, 0.1, seed=7)
    base = shoal.robots[0]
    shoal.at(1000.0, shoal.kill, base)
    assert shoal.swim(LIMIT_S)
    shoal.revive(base)
    shoal.run(shoal.time / 1000 + 200.0)
    check(field, shoal)
    assert base.mission.agreed
    assert base.mission.target is None
    assert base.stored == set()


def test_a_cell_that_one_robot_does_not_reach_is_sampled_by_another():
    field, shoal = sea(2, 0.1, seed=8)
    for row in range(7):
        shoal.robots[1].blocked |= {(row, 0)}
    assert shoal.swim(LIMIT_S)
    check(field, shoal)


def test_a_cell_that_nobody_reaches_is_given_up_and_said():
    for count in (1, 3):
        field, shoal = sea(count, 0.1, seed=9)
        for robot in shoal.robots:
            robot.blocked.add((1, 1))
        assert shoal.swim(LIMIT_S)
        found = check(field, shoal, given_up=[(1, 1)])
        assert not found.sampled[1, 1]
        assert found.deviation[1, 1] > 10 * SIGMA


def test_a_robot_that_cannot_swim_says_so_and_does_not_hold_up_the_others():
    field, shoal = sea(3, 0.1, seed=10)
    shoal.robots[2].swimmer.stuck = True
    assert shoal.swim(LIMIT_S)
    check(field, shoal)
    said = [ITEMS.decode(shoal.robots[2].flash[name]) for name in sorted(shoal.robots[2].stored)]
    assert sum(isinstance(item, Skip) for item in said) <= 4
    assert Gone(2, 0) in said
    assert shoal.time < 2_000_000


def test_robots_that_keep_off_each_other_survey_all_the_same():
    field, crowd = sea(5, 0.2, seed=13, shape=(9, 9))
    assert crowd.swim(LIMIT_S)
    for seed in (13, 14):
        field, shoal = sea(5, 0.2, seed=seed, shape=(9, 9))
        shoal.keeps_off = True
        shoal.at(150_000.0, shoal.kill, shoal.robots[4])  # it stays where it died
        assert shoal.swim(LIMIT_S)
        # a cell beside the dead robot may be out of reach
        given_up = shoal.robots[1].mission.knowledge.given_up()
        dead = shoal.robots[4].swimmer
        for row, column in given_up:
            assert math.dist((column * CELL_M, row * CELL_M), (dead.x_m, dead.y_m)) < 0.2
        check(field, shoal, given_up=given_up)
        assert shoal.least_m > 0.05 > crowd.least_m


def test_a_robot_that_stops_counts_the_readings_at_the_cell_alone():
    field, shoal = sea(2, 0.0, seed=11, before_ms=0, dwell_ms=3000)
    assert shoal.swim(LIMIT_S)
    found = check(field, shoal)
    assert found.deviation[found.sampled].max() < SIGMA / math.sqrt(20)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_fixed_lists_are_surveyed_likewise(share):
    shape = (5, 6)
    made = (lambda: everywhere(shape, SIGMA)) if share == 1.0 else (
        lambda: at_random(shape, share, SIGMA, seed=4)
    )  # fmt: skip
    field, shoal = sea(3, 0.3, seed=12, shape=shape, rank=1, survey=made)
    assert shoal.swim(LIMIT_S)
    found = check(field, shoal)
    assert found.sampled.mean() == share
    assert np.isnan(found.deviation).sum() == (1 - share) * 30


# --- one board, by hand ---------------------------------------------------------------------


def board(**config):
    made = MissionConfig(Grid(4, 4, CELL_M), **config)
    mission = Mission(1, made, lambda: noise_tolerant((4, 4), 0.1))
    mission.start(0)
    return mission


def publish(mission, now_ms):
    """Store and number what the mission shares, as an application does."""
    items = []
    while (octets := mission.take_item()) is not None:
        mission.receive(1, mission.knowledge.latest.get(1, 0) + 1, octets, now_ms)
        items.append(ITEMS.decode(octets))
    return items


def joined(**config):
    mission = board(**config)
    mission.tell_pose(0.0, -0.5, 1000)
    mission.handle_timer(30_000)
    assert publish(mission, 30_000) == [Present(0.0, -0.5, joined=True)]
    return mission


def test_it_listens_first_and_does_not_join_without_a_pose():
    mission = board()
    assert (mission.phase, mission.next_deadline()) == (Phase.GATHERING, 30_000)
    mission.handle_timer(30_000)
    assert mission.take_item() is None
    assert mission.target is None
    mission.tell_pose(0.1, 0.2, 31_000)
    assert publish(mission, 31_000) == [Present(0.1, 0.2, joined=True)]
    assert mission.target == (0.0, 0.0)
    assert mission.phase is Phase.SURVEYING


def test_a_sample_is_the_mean_of_the_readings_of_the_pass():
    mission = joined(reading_sigma=0.6)
    for at, value in ((38_500, 100.0), (39_100, 2.0), (39_500, 4.0), (40_000, 9.0)):
        mission.tell_reading(value, at)
    mission.tell_reading(math.nan, 40_000)
    mission.arrive(0.01, -0.02, 40_000)
    (sample,) = publish(mission, 40_000)
    assert sample == Sample(0, 0, 5.0, 0.3464, 3, 0.01, -0.02, 40_000)
    assert mission.bad_readings == 1
    assert mission.goal != (0, 0)


def test_a_robot_that_stops_rests_meanwhile():
    mission = joined(before_ms=0, dwell_ms=2000)
    mission.tell_reading(7.0, 39_900)
    mission.arrive(0.0, 0.0, 40_000)
    assert mission.target is None
    assert mission.next_deadline() == 42_000
    for at, value in ((40_500, 1.0), (42_000, 3.0)):
        mission.tell_reading(value, at)
    mission.handle_timer(42_000)
    (sample,) = publish(mission, 42_000)
    assert (sample.value, sample.readings) == (2.0, 2)


def test_an_arrival_without_readings_or_elsewhere_is_none():
    mission = joined()
    mission.arrive(0.0, 0.0, 40_000)
    assert mission.take_item() is None
    mission.tell_reading(1.0, 40_500)
    mission.arrive(0.2, 0.0, 40_600)
    assert mission.take_item() is None
    assert mission.goal == (0, 0)


def test_a_sample_counts_once_it_is_stored_and_its_cell_is_not_the_goal_before():
    mission = joined()
    mission.tell_reading(3.0, 40_000)
    mission.arrive(0.0, 0.0, 40_000)
    assert mission.goal != (0, 0)
    assert mission.knowledge.samples == {}
    publish(mission, 41_000)
    assert set(mission.knowledge.samples) == {(0, 0)}


def test_silence_is_told_once_with_the_last_item_known():
    mission = joined()
    other = ITEMS.encode(Present(1.0, 1.0, joined=True))
    mission.receive(2, 7, other, 35_000)
    mission.hear(2, 50_000)
    mission.handle_timer(249_000)
    assert [item for item in publish(mission, 249_000) if isinstance(item, Gone)] == []
    mission.handle_timer(250_000)
    mission.handle_timer(250_100)
    assert [item for item in publish(mission, 250_100) if isinstance(item, Gone)] == [Gone(2, 7)]
    assert not mission.knowledge.lives(2)
    mission.receive(2, 8, other, 260_000)
    assert mission.knowledge.lives(2)


def test_who_hears_that_it_is_gone_joins_again():
    mission = joined()
    mission.tell_pose(0.3, 0.1, 39_000)
    mission.receive(2, 1, ITEMS.encode(Gone(1, 1)), 40_000)
    assert publish(mission, 40_000) == [Present(0.3, 0.1, joined=True)]
    mission.receive(2, 2, ITEMS.encode(Gone(1, 1)), 41_000)  # old news
    assert mission.take_item() is None


def test_it_is_agreed_once_all_that_live_have_said_so_of_the_same_samples():
    grid = Grid(1, 1, CELL_M)
    mission = Mission(1, MissionConfig(grid), lambda: everywhere((1, 1), 0.1))
    mission.start(0)
    mission.tell_pose(0.1, 0.0, 1000)
    mission.handle_timer(30_000)
    mission.receive(2, 1, ITEMS.encode(Present(1.0, 1.0, joined=True)), 31_000)
    publish(mission, 31_000)
    mission.tell_reading(5.0, 40_000)
    mission.arrive(0.0, 0.0, 40_000)
    publish(mission, 40_000)
    (done,) = publish(mission, 40_000) or [mission.knowledge.done(1)]
    assert (mission.phase, mission.target) == (Phase.COMPLETE, None)
    assert done == Done(1, mission.knowledge.digest())
    assert not mission.agreed
    mission.receive(2, 2, ITEMS.encode(Done(1, done.digest ^ 1)), 41_000)
    assert not mission.agreed
    mission.receive(2, 3, ITEMS.encode(done), 42_000)
    assert mission.agreed


def test_a_robot_says_now_and_then_that_it_lives():
    mission = joined(reach_ms=10**9)
    for minute in (1, 2):
        assert mission.next_deadline() == 30_000 + minute * 60_000
        mission.handle_timer(30_000 + minute * 60_000)
        assert publish(mission, 30_000 + minute * 60_000) == [Present(0.0, -0.5, joined=False)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"reading_sigma": -1.0},
        {"place_sigma": math.nan},
        {"before_ms": 0},
        {"gather_ms": -1},
        {"reach_ms": 0},
        {"silence_ms": 100_000},
    ],
)
def test_what_makes_no_mission_is_refused(wrong):
    with pytest.raises(SurveyError):
        MissionConfig(Grid(4, 4, CELL_M), **wrong)


def test_a_base_that_is_out_of_range_for_long_waits_for_nothing():
    """It says nothing of silent robots, so it must not ask to be woken for them."""
    _, shoal = sea(2, seed=3)
    links = shoal.links
    alone = {a: {b: loss for b, loss in heard.items() if a and b} for a, heard in links.items()}
    shoal.at(60_000.0, lambda: setattr(shoal, "links", alone))
    shoal.run(400.0)
    base, robot = shoal.robots[0].mission, shoal.robots[1].mission
    assert base.next_deadline() is None
    assert len(base.knowledge.samples) < len(robot.knowledge.samples)
    shoal.links = links
    assert shoal.swim(LIMIT_S)
    assert base.knowledge.samples == robot.knowledge.samples
