"""The other robots about, as the camera's batches of poses show them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from procboard.applications.tracking_estimate import CAMERA_CLOCK_MS
from procboard.survey.avoidance import Seen
from radio_802154.messages import Pose

KEPT: Final = 16
"""The nearest; within the 1.4 m in which robots look for each other there is hardly room for more
(our choice)."""
KEPT_BYTES: Final = KEPT * 16
"""Address, place, heading, time and the change of place since the pose before."""
LONGEST_MS: Final = 2_500
"""Poses further apart say nothing of the speed: the way between them is bent."""


@dataclass(slots=True)
class _Robot:
    """One that was seen."""

    pose: Pose
    seen_s: float
    speed_m_s: float = 0.0


class Surroundings:
    """Robots by their addresses, this one left out."""

    def __init__(self) -> None:
        self._robots: dict[int, _Robot] = {}

    def take(
        self, address: int, pose: Pose, now_s: float, own: tuple[float, float, float] | None
    ) -> None:
        """Note a robot's pose; a full table keeps those nearest to ``own``."""
        before = self._robots.get(address)
        if before is None:
            if len(self._robots) >= KEPT and not self._make_room(pose, own):
                return
            self._robots[address] = _Robot(pose, now_s)
            return
        later_ms = (pose.camera_time_ms - before.pose.camera_time_ms) % CAMERA_CLOCK_MS
        if not 0 < later_ms < CAMERA_CLOCK_MS // 2:
            return  # the same exposure again, or an earlier one
        speed = 0.0
        if later_ms <= LONGEST_MS:
            way_m = math.dist((pose.x_m, pose.y_m), (before.pose.x_m, before.pose.y_m))
            speed = 1e3 * way_m / later_ms
        self._robots[address] = _Robot(pose, now_s, speed)

    def _make_room(self, pose: Pose, own: tuple[float, float, float] | None) -> bool:
        if own is None:
            return False

        def away_m(at: Pose) -> float:
            return math.dist((at.x_m, at.y_m), own[:2])

        farthest = max(self._robots, key=lambda address: away_m(self._robots[address].pose))
        if away_m(pose) >= away_m(self._robots[farthest].pose):
            return False
        del self._robots[farthest]
        return True

    def seen(self, now_s: float) -> dict[int, Seen]:
        """Return all that are known, by address."""
        return {
            address: Seen(
                robot.pose.x_m,
                robot.pose.y_m,
                robot.pose.heading_rad,
                robot.speed_m_s,
                max(0.0, now_s - robot.seen_s),
            )
            for address, robot in self._robots.items()
        }
