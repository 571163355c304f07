"""Robots that keep off each other: from last known poses, a goal to steer for now, or a stop.

A robot cannot turn on the spot or swim back; it can stop, and then is where others find it. So it
looks some 0.6 m ahead, about what a lateral step of a body length takes at its turning radius:
predicted is its way on the tightest circle towards its goal, then straight, against each other
robot, on its way with the heading it has, and stopped, as it may be at any moment. If that comes
too near it tries directions ever farther from the goal's, starboard and port, and of two that are
as far port first; so two that meet head on pass each other. If none is free it stops.

**Who gives way.** The robot with the lower address counts on the others' giving way: to it they are
where they are, and on their way for the next ``trust_s`` only. So among robots that meet, one
always sees a standing world and goes through it.

**No deadlock.** Who is held up accepts ever less room, down to ``least_m``, and looks half as far.
A goal counts as free only if there is a way on from it, past those that stand about; and who has no
goal makes way for who stands too near to turn off. Two that are stuck all the same may squeeze past
each other, a body's width apart. Tested, not proven: tests/procboard/survey/test_avoidance.py.
(What is proven for vehicles that turn on circles, such as the roundabouts of Pallottino et al.
2007, wants a free circle of 0.7 m for each, which cells of 0.25 m do not leave.)

A pure function, called once a beat; it knows no walls. A direction costs a processor without
floating point 20 steps of a sine, a cosine and an arctangent, and for each robot within 1.4 m 40
comparisons of distances (docs/survey.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from procboard.survey.sweeps import Place


@dataclass(frozen=True, slots=True)
class Seen:
    """A robot as it was last seen: place, m, heading, rad, speed, m/s, and how long ago, s."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Room:
    """How robots swim and how far they keep off each other; distances between centres.

    The speed and the radius are the bundled robot's at 15° and 1 Hz (docs/tracking.md); lengths are
    our choice for a body of 0.15 m × 0.05 m.
    """

    speed_m_s: float = 0.03
    radius_m: float = 0.27
    """Of the turns it may count on: twice the tightest."""
    clear_m: float = 0.2
    """Kept where there is a way that does."""
    least_m: float = 0.09
    """Not less, but for two that stand nearer already."""
    body_m: float = 0.07
    """A body of 0.05 m and a little: what two that are stuck keep."""
    turn_m: float = 0.24
    """Of a robot that stands so far ahead one can turn away, and pass at ``least_m``."""
    ahead_m: float = 0.6
    patience_s: float = 30.0
    """Waiting so long brings the one down to the other."""
    trust_s: float = 3.0
    """For so long at least robots that give way are taken to swim on: they must notice first."""
    blur_m: float = 0.1
    """Most that an old pose adds to the distance kept."""


DIRECTIONS = tuple(
    math.radians(sign * 15.0 * step) for step in range(1, 13) for sign in (1.0, -1.0)
)
"""Off the direction of the goal, in the order in which they are tried; port is positive."""
STEP_S = 1.0
"""Of predictions: 3 cm."""
_SQUEEZE_M = 0.02
"""By which robots that are stuck may come nearer, to get past each other."""


def steered(
    address: int,
    own: Seen,
    goal: Place | None,
    others: Mapping[int, Seen],
    held_s: float = 0.0,
    room: Room | None = None,
) -> Place | None:
    """Return where to swim now, so as to come to the goal past the others; None: rest."""
    return chosen(address, own, goal, others, held_s, room).place


class Choice(NamedTuple):
    """Where to swim now, and what it took to find out."""

    place: Place | None
    """None: rest."""
    ways: int = 0
    """Directions that were tried."""
    near: int = 0
    """Robots against which each was."""


def chosen(
    address: int,
    own: Seen,
    goal: Place | None,
    others: Mapping[int, Seen],
    held_s: float = 0.0,
    room: Room | None = None,
) -> Choice:
    """Choose where to swim now.

    Args:
        address: this robot's; lower ones go first.
        own: its own pose, now.
        goal: where it wants to be, m; None: anywhere.
        others: robots by address, living or not.
        held_s: for how long this has not returned the goal, since there is this goal.
        room: how far to keep off.

    """
    room = room or Room()
    share = min(1.0, max(0.0, held_s / room.patience_s))
    clear = room.clear_m - share * (room.clear_m - room.least_m)
    room = replace(room, ahead_m=room.ahead_m * (1.0 - 0.5 * share))
    near = [
        _Other(own, other, room, share, gives_way=number > address)
        for number, other in sorted(others.items())
        if number != address
    ]
    near = [other for other in near if other.gap_m < 2.0 * room.ahead_m + room.clear_m]
    if goal is None:
        nearest = min(near, key=lambda other: other.gap_m, default=None)
        if nearest is None or nearest.gap_m > room.turn_m:
            return Choice(None)
        towards = math.atan2(own.y_m - nearest.y, own.x_m - nearest.x)
    else:
        towards = math.atan2(goal[1] - own.y_m, goal[0] - own.x_m)
        way = _way(own, towards, goal, room)
        if _free(way, near, clear) and (way[-1] != goal or _has_exit(own, way, near, room)):
            return Choice(goal, 1, len(near))
    tried = DIRECTIONS if goal else (0.0, *DIRECTIONS)
    for count, off in enumerate(tried, start=1 + (goal is not None)):
        if _free(_way(own, towards + off, None, room), near, clear):
            far = 2.0 * room.ahead_m
            place = (
                own.x_m + far * math.cos(towards + off),
                own.y_m + far * math.sin(towards + off),
            )
            return Choice(place, count, len(near))
    return Choice(None, len(tried) + 1, len(near))


class _Other:
    """Another robot: where it stands and may swim to, from now on."""

    def __init__(self, own: Seen, seen: Seen, room: Room, share: float, *, gives_way: bool) -> None:
        self.vx = seen.speed_m_s * math.cos(seen.heading_rad)
        self.vy = seen.speed_m_s * math.sin(seen.heading_rad)
        # an old pose is carried on a little, and is that much less certain
        self.blur = min(seen.age_s * seen.speed_m_s, room.blur_m)
        carried = self.blur / seen.speed_m_s if seen.speed_m_s else 0.0
        self.x, self.y = seen.x_m + carried * self.vx, seen.y_m + carried * self.vy
        self.gap_m = math.hypot(self.x - own.x_m, self.y - own.y_m)
        # who is nearer already must not come nearer still, but for what frees two that are stuck
        lost = share * max(0.0, min(_SQUEEZE_M, self.gap_m - room.body_m))
        self.nearer_m = self.gap_m - 1e-3 - lost
        self.swims_s = room.trust_s if gives_way else math.inf

    def keeps_off(self, x: float, y: float, at_s: float, clear: float) -> bool:
        """Whether it is far enough from a place at a time, swimming or standing."""
        room = min(clear + self.blur, self.nearer_m)
        if (x - self.x) ** 2 + (y - self.y) ** 2 < room * room:
            return False
        if at_s > self.swims_s:
            return True
        dx, dy = x - self.x - at_s * self.vx, y - self.y - at_s * self.vy
        return dx * dx + dy * dy >= room * room


def _free(way: list[Place], near: list[_Other], clear: float) -> bool:
    return all(
        other.keeps_off(x, y, (step + 1) * STEP_S, clear)
        for other in near
        for step, (x, y) in enumerate(way)
    )


def _has_exit(own: Seen, way: list[Place], near: list[_Other], room: Room) -> bool:
    """Whether a robot that has come to its goal can swim on past those that stand about."""
    goal = way[-1]
    before = way[-2] if len(way) > 1 else (own.x_m, own.y_m)
    heading = math.atan2(goal[1] - before[1], goal[0] - before[0])
    there = Seen(*goal, heading if goal != before else own.heading_rad, room.speed_m_s)
    return any(
        all(
            math.hypot(x - other.x, y - other.y) > room.least_m
            for other in near
            for x, y in _way(there, heading + turn, None, room)
        )
        for turn in (0.0, 0.5 * math.pi, -0.5 * math.pi)
    )


def _way(own: Seen, towards: float, goal: Place | None, room: Room) -> list[Place]:
    """Places each second of a turn towards a direction or a goal, and of the straight way on."""
    x, y, heading = own.x_m, own.y_m, own.heading_rad
    most = STEP_S * room.speed_m_s / room.radius_m
    step_m = STEP_S * room.speed_m_s
    way = []
    for _ in range(round(room.ahead_m / step_m)):
        if goal is not None:
            dx, dy = goal[0] - x, goal[1] - y
            if dx * dx + dy * dy < step_m * step_m:
                way.append(goal)
                break
            towards = math.atan2(dy, dx)
        turn = max(-most, min(most, math.remainder(towards - heading, math.tau)))
        middle = heading + 0.5 * turn
        heading += turn
        x, y = x + step_m * math.cos(middle), y + step_m * math.sin(middle)
        way.append((x, y))
    return way
