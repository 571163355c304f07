"""A shoal that surveys, in a plane without dynamics: missions, sharing, and swimmers.

Boards are `tests.procboard.routing.air` nodes with `Sharing` and a `Mission`; what a board shares
lies on its flash, which outlives a reset. A swimmer goes at one speed or none, turns on circles no
tighter than its radius, and once a beat learns where it is, with an error. The sensor is read ten
times a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

from procboard.routing.machine import Outgoing
from procboard.routing.sharing import Sharing
from procboard.survey.avoidance import Room, Seen, steered
from procboard.survey.expansion import Expansion
from procboard.survey.mission import Mission, MissionConfig
from radio_802154.routing_messages import ITEM_AM, VERSIONS_AM
from tests.procboard.routing.air import Air, Links, Node, chance

BEAT_S = 1.0
READINGS_A_BEAT = 10
ARRIVAL_M = 0.02
LEAVE_RADII = 2.5
FieldAt = Callable[[float, float], float]


@dataclass
class Swimmer:
    """A unicycle that turns with a radius."""

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    speed_m_s: float = 0.03
    radius_m: float = 0.13
    leaving: bool = False
    stuck: bool = False

    def steer(self, target: tuple[float, float] | None, duration_s: float) -> None:
        """Swim towards a target for a while; None: rest."""
        if target is None or self.stuck:
            return
        dx, dy = target[0] - self.x_m, target[1] - self.y_m
        distance = math.hypot(dx, dy)
        error = math.remainder(math.atan2(dy, dx) - self.heading_rad, math.tau)
        if self.leaving:
            self.leaving = distance < LEAVE_RADII * self.radius_m
        else:  # a target within the tightest turn is never reached by turning
            sine = 1.0 if abs(error) > math.pi / 2 else abs(math.sin(error))
            self.leaving = distance < 2 * self.radius_m * sine - 1e-6
        most = duration_s * self.speed_m_s / self.radius_m
        turn = 0.0 if self.leaving else max(-most, min(most, error))
        middle = self.heading_rad + turn / 2
        self.heading_rad = math.remainder(self.heading_rad + turn, math.tau)
        self.x_m += duration_s * self.speed_m_s * math.cos(middle)
        self.y_m += duration_s * self.speed_m_s * math.sin(middle)


@dataclass
class Robot(Node):
    """A board, its flash, and its body; address 0 is the base and has none."""

    config: MissionConfig | None = None
    survey: Callable[[], Expansion] | None = None
    field_at: FieldAt | None = None
    swimmer: Swimmer = field(default_factory=lambda: Swimmer(0.0, 0.0))
    reading_sigma: float = 0.0
    place_error_m: float = 0.0
    flash: dict[tuple[int, int], bytes] = field(default_factory=dict)
    stored: set[tuple[int, int]] = field(default_factory=set)
    """Own items ever stored."""
    blocked: set[tuple[int, int]] = field(default_factory=set)
    """Cells that the robot cannot reach."""
    way_m: float = 0.0
    swims: bool = False
    held_s: float = 0.0
    held_for: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        self.random = Random(self.address + 1)
        self._boots = 0

    def begin(self, now_ms: int) -> None:
        assert self.config is not None
        assert self.survey is not None
        self._boots += 1
        own = [name for name in self.flash if name[0] == self.address]
        # others' items are fetched again: no need to trust that a table survived
        self.flash = {name: self.flash[name] for name in own}
        self.sharing = Sharing(
            self.address, chance(self.address, self._boots), {self.address: len(own)}
        )
        self.mission = Mission(self.address, self.config, self.survey, robot=self.address != 0)
        for name in own:
            self.mission.receive(*name, self.flash[name], now_ms)
        self.mission.start(now_ms)
        self.sharing.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        if message.am_type in (ITEM_AM, VERSIONS_AM):
            for event in self.sharing.receive(
                source, message.am_type, message.payload, -60, now_ms
            ):
                self.flash[event.origin, event.number] = event.item
                self.mission.receive(event.origin, event.number, event.item, now_ms)
        self._publish(now_ms)

    def take(self, now_ms: int) -> Outgoing | None:
        wanted = self.sharing.wanted
        if wanted is not None:
            self.sharing.provide(*wanted, self.flash[wanted])
        return self.sharing.take(now_ms)

    def next_deadline(self) -> int | None:
        due = (self.sharing.next_deadline(), self.mission.next_deadline())
        return min((at for at in due if at is not None), default=None)

    def handle_timer(self, now_ms: int) -> None:
        self.sharing.handle_timer(now_ms)
        self.mission.handle_timer(now_ms)
        self._publish(now_ms)

    def _publish(self, now_ms: int) -> None:
        while (octets := self.mission.take_item()) is not None:
            assert len(octets) <= 20
            number = self.sharing.publish(now_ms)
            self.flash[self.address, number] = octets
            self.stored.add((self.address, number))
            self.mission.receive(self.address, number, octets, now_ms)

    def seen(self) -> Seen:
        """This robot as a camera sees it."""
        body = self.swimmer
        speed = body.speed_m_s if self.swims else 0.0
        return Seen(body.x_m, body.y_m, body.heading_rad, speed)

    def _steered(self, others: dict[int, Seen]) -> tuple[float, float] | None:
        """Where to swim so as to keep off the others."""
        goal, target = self.mission.goal, self.mission.target
        if goal != self.held_for:
            self.held_for, self.held_s = goal, 0.0
        if goal is not None and target is None:  # it rests at a cell
            return None
        steer_for = steered(
            self.address, self.seen(), target, others, self.held_s, Room(radius_m=0.13)
        )
        self.held_s += BEAT_S * (target is not None and steer_for != target)
        return steer_for

    def beat(self, now_ms: int, others: dict[int, Seen] | None = None) -> None:
        """Swim for a beat, read the sensor on the way, then learn the pose."""
        assert self.field_at is not None
        body, mission, goal = self.swimmer, self.mission, self.mission.goal
        before = body.x_m, body.y_m
        target = None if goal in self.blocked else mission.target
        steer_for = target if others is None else self._steered(others)
        self.swims = steer_for is not None
        for step in range(READINGS_A_BEAT):
            body.steer(steer_for, BEAT_S / READINGS_A_BEAT)
            value = self.field_at(body.x_m, body.y_m) + self.random.gauss(0, self.reading_sigma)
            at = now_ms - round(1000 * BEAT_S * (1 - (step + 1) / READINGS_A_BEAT))
            mission.tell_reading(value, at)
        after = body.x_m, body.y_m
        self.way_m += math.dist(before, after)
        off = [self.random.gauss(0, self.place_error_m) for _ in range(2)]
        mission.tell_pose(after[0] + off[0], after[1] + off[1], now_ms)
        if target is not None:
            part, nearest = _nearest(before, after, (target[0] + off[0], target[1] + off[1]))
            if nearest <= ARRIVAL_M:
                x, y = (b + part * (a - b) for a, b in zip(after, before, strict=True))
                mission.arrive(x + off[0], y + off[1], now_ms)
        self._publish(now_ms)


def _nearest(
    before: tuple[float, float], after: tuple[float, float], place: tuple[float, float]
) -> tuple[float, float]:
    """Where on a straight piece of path a place is nearest, 0 to 1, and how near."""
    ax, ay = after[0] - before[0], after[1] - before[1]
    square = ax * ax + ay * ay
    along = (place[0] - before[0]) * ax + (place[1] - before[1]) * ay
    part = max(0.0, min(1.0, along / square)) if square else 0.0
    return part, math.dist((before[0] + part * ax, before[1] + part * ay), place)


class Shoal(Air):
    """Boards in the air and in the water."""

    def __init__(
        self, robots: list[Robot], links: Links, seed: int = 0, *, keeps_off: bool = False
    ) -> None:
        super().__init__(robots, links, seed)
        self.robots = robots
        self.keeps_off = keeps_off
        self.least_m = math.inf
        """Of the distances between robots, dead ones too."""
        self.at(1000.0, self._beat)

    def _beat(self) -> None:
        seen = {robot.address: robot.seen() for robot in self.robots if robot.address}
        for robot in self.robots:
            if robot.alive and robot.address:
                robot.beat(robot.now(self.time), seen if self.keeps_off else None)
                self.kick(robot)
        for robot in self.robots[1:]:
            for other in self.robots[1 : robot.address]:
                a, b = robot.swimmer, other.swimmer
                self.least_m = min(self.least_m, math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)))
        self.at(self.time + 1000 * BEAT_S, self._beat)

    def living(self) -> list[Robot]:
        return [robot for robot in self.robots if robot.alive]

    def reset(self, robot: Robot) -> None:
        """The board begins anew, with what is on its flash."""
        robot.alive = False
        self.revive(robot)

    def swim(self, limit_s: float, *, step_s: float = 50.0) -> bool:
        """Go on until all that live agree that the field is known; whether they did."""
        while self.time < 1000 * limit_s:
            self.run(self.time / 1000 + step_s)
            if all(robot.mission.agreed for robot in self.living()):
                return True
        return False
