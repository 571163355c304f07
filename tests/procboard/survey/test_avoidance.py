"""Robots that keep off each other: by hand, and up to twenty that cross on their circles."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import pytest

from procboard.survey.avoidance import Room, Seen, steered
from tests.procboard.survey.shoal import Swimmer

BODY_M = 0.05
"""Width of a robot."""


def standing(x_m, y_m):
    return Seen(x_m, y_m, 0.0, 0.0)


EAST = Seen(0.0, 0.0, 0.0, 0.03)


def test_alone_or_far_from_others_the_goal_is_the_goal():
    goal = (2.0, 0.3)
    assert steered(1, EAST, goal, {}) == goal
    assert steered(1, EAST, goal, {1: standing(0.1, 0.0), 2: standing(0.3, 1.5)}) == goal
    assert steered(1, EAST, goal, {2: standing(-0.3, 0.0)}) == goal


def test_of_ways_past_a_standing_robot_the_one_that_turns_least_port_first():
    way = steered(1, EAST, (2.0, 0.0), {2: standing(0.6, 0.0)})
    assert way is not None
    assert 0.0 < math.atan2(way[1], way[0]) < math.radians(50.0)
    other = steered(1, EAST, (2.0, 0.0), {2: standing(0.6, 0.12)})
    assert other is not None
    assert -math.radians(50.0) < math.atan2(other[1], other[0]) < 0.0


def test_two_that_meet_head_on_turn_to_different_sides_of_the_water():
    west = Seen(0.7, 0.0, math.pi, 0.03)
    one = steered(1, EAST, (2.0, 0.0), {2: west})
    two = steered(2, west, (-1.0, 0.0), {1: EAST})
    assert one is not None
    assert two is not None
    assert one[1] > 0.0 > two[1]


def test_where_every_way_is_closed_it_stops():
    wall = {number: standing(0.2, 0.12 * (number - 4)) for number in range(2, 7)}
    assert steered(1, EAST, (2.0, 0.0), wall) is None


def test_the_lower_address_goes_first_where_ways_cross():
    north = Seen(0.3, -0.3, math.pi / 2, 0.03)
    assert steered(1, EAST, (2.0, 0.0), {2: north}) == (2.0, 0.0)
    assert steered(3, EAST, (2.0, 0.0), {2: north}) != (2.0, 0.0)


def test_who_has_waited_accepts_less_room():
    gap = {2: standing(0.3, 0.15), 3: standing(0.3, -0.15)}
    assert steered(1, EAST, (0.5, 0.0), gap) != (0.5, 0.0)
    assert steered(1, EAST, (0.5, 0.0), gap, 60.0) == (0.5, 0.0)


def test_an_old_pose_wants_more_room():
    late = Seen(0.3, -0.3, 0.0, 0.03, age_s=3.0)
    fresh = Seen(0.39, -0.3, 0.0, 0.03)
    goal, room = (2.0, 0.0), Room(clear_m=0.28)
    assert steered(3, EAST, goal, {2: fresh}, room=room) == goal
    assert steered(3, EAST, goal, {2: late}, room=room) != goal


def test_who_has_no_goal_rests_or_makes_way():
    assert steered(1, EAST, None, {2: standing(0.3, 0.0)}) is None
    way = steered(1, EAST, None, {2: standing(-0.2, 0.0)})
    assert way is not None
    assert way[0] > 0.5


def test_it_does_not_go_where_it_could_not_leave():
    pocket = {number: standing(0.55 + dx, dy) for number, (dx, dy) in enumerate(
        [(0.22, 0.0), (0.15, 0.19), (0.15, -0.19), (0.0, 0.21), (0.0, -0.21)], 2)}  # fmt: skip
    goal = (0.5, 0.0)
    assert steered(1, EAST, goal, pocket) != goal
    del pocket[2]
    assert steered(1, EAST, goal, pocket) == goal


@dataclass
class Crossing:
    """What became of robots that swim from goal to goal."""

    arrived: bool
    least_m: float
    seconds: int


def crossing(count, side_m, radius_m, *, seed, goals=2, lost=0.2, limit_s=1500):
    """Robots from anywhere to cells of 0.25 m; each learns others' poses a beat late, or later."""
    rng = random.Random(seed)
    bodies: list[Swimmer] = []
    while len(bodies) < count:
        x, y = rng.uniform(0, side_m), rng.uniform(0, side_m)
        if all(math.dist((x, y), (body.x_m, body.y_m)) > 0.4 for body in bodies):
            bodies.append(Swimmer(x, y, rng.uniform(-3, 3), radius_m=radius_m))
    across = range(round(side_m / 0.25) + 1)
    cells = [(0.25 * i, 0.25 * j) for i in across for j in across]
    rng.shuffle(cells)
    todo = [[cells.pop() for _ in range(goals)] for _ in bodies]
    room = Room(radius_m=radius_m)
    seen: list[dict[int, tuple[int, Seen]]] = [{} for _ in bodies]
    held, swims, least = [0] * count, [False] * count, math.inf
    for now in range(limit_s):
        if not any(todo):
            return Crossing(True, least, now)
        poses = [
            Seen(body.x_m, body.y_m, body.heading_rad, 0.03 if moves else 0.0)
            for body, moves in zip(bodies, swims, strict=True)
        ]
        for i, body in enumerate(bodies):
            for j, pose in enumerate(poses):
                if rng.random() >= lost or j not in seen[i]:
                    seen[i][j] = now, pose
            others = {
                j: Seen(pose.x_m, pose.y_m, pose.heading_rad, pose.speed_m_s, now - at)
                for j, (at, pose) in seen[i].items()
            }
            goal = todo[i][0] if todo[i] else None
            target = steered(i, poses[i], goal, others, held[i], room)
            held[i] += goal is not None and target != goal
            swims[i] = target is not None
            for _ in range(5):
                body.steer(target, 0.2)
                if goal is not None and math.dist((body.x_m, body.y_m), goal) < 0.02:
                    todo[i].pop(0)
                    held[i] = 0
                    break
        least = min(
            [least]
            + [
                math.dist((a.x_m, a.y_m), (b.x_m, b.y_m))
                for i, a in enumerate(bodies)
                for b in bodies[:i]
            ]
        )
    return Crossing(False, least, limit_s)


@pytest.mark.parametrize("radius_m", [0.13, 0.27])
@pytest.mark.parametrize(
    ("count", "side_m", "seeds"), [(2, 1.0, 20), (4, 1.5, 6), (8, 2.5, 2), (20, 4.0, 1)]
)
def test_all_arrive_and_none_touch(count, side_m, seeds, radius_m):
    for seed in range(seeds):
        found = crossing(count, side_m, radius_m, seed=seed, goals=1 if count == 20 else 2)
        assert found.arrived, seed
        assert found.least_m > BODY_M, seed


def test_without_the_law_they_do_touch(monkeypatch):
    monkeypatch.setitem(crossing.__globals__, "steered", lambda *arguments: arguments[2])
    assert crossing(8, 2.5, 0.13, seed=1).least_m < BODY_M
