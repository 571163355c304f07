"""Where the robot is and how it moves: from poses by radio and the other board's reports.

A pose comes once a beat, so it shows the heading at one phase of the yaw that every beat makes, and
a difference of two poses the mean velocity between them. The navigation board's heading comes ten
times a second: its mean over the last beat tells how far that one phase lies from the mean, its
change over a beat is the mean yaw rate. Where its compass points does not matter, because only
differences are used. Without it, poses alone must do.

Where poses stop, the robot's place is carried on by that heading and the last speed, for a while.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from procboard.applications.heading import wrap
from procboard.applications.tracking_law import Motion

CAMERA_CLOCK_MS: Final = 1 << 32
"""`camera_time_ms` wraps there (radio_802154.messages)."""
HEADINGS_KEPT: Final = 64
"""Reports of the navigation board: over two beats of 1 Hz at 25 reports a second."""
HEADING_FRESH_BEATS: Final = 0.5
"""A report older than this is none: the navigation board has fallen silent."""
POSES_KEPT: Final = 16
LONGEST_CHORD_BEATS: Final = 2.5
"""Poses further apart in time say nothing of the velocity: the path between them is bent."""


@dataclass(frozen=True, slots=True)
class _Seen:
    """A pose that was taken, or carried on."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float


def nearest_m(
    before: tuple[float, float], after: tuple[float, float], target_m: tuple[float, float]
) -> float:
    """Return the least distance of a straight piece of path from a target."""
    ax, ay = before[0] - target_m[0], before[1] - target_m[1]
    bx, by = after[0] - before[0], after[1] - before[1]
    square = bx * bx + by * by
    part = min(1.0, max(0.0, -(ax * bx + ay * by) / square)) if square > 0 else 0.0
    return math.hypot(ax + part * bx, ay + part * by)


class PoseTrack:
    """Poses and headings of the last beats.

    Args:
        beat_s: period of the tail beat, s.
        forget_s: after so long without a pose, the next is taken whatever its camera's clock says
            (the base station may have been started anew).

    Times are the board's own clock in s; it need not be the camera's.

    """

    __slots__ = (
        "_beat_s",
        "_camera_ms",
        "_forget_s",
        "_headings",
        "_offset_rad",
        "_place",
        "_poses",
        "_speed_m_s",
        "pose_s",
    )

    def __init__(self, beat_s: float, forget_s: float) -> None:
        self._beat_s = beat_s
        self._forget_s = forget_s
        self._headings: deque[tuple[float, float]] = deque(maxlen=HEADINGS_KEPT)
        self._poses: deque[_Seen] = deque(maxlen=POSES_KEPT)
        self._place: _Seen | None = None
        self._camera_ms = 0
        self._offset_rad: float | None = None
        self._speed_m_s = (0.0, 0.0)
        self.pose_s: float | None = None
        """When the last pose came; None: none yet."""

    # --- what comes in ------------------------------------------------------------------

    def take_heading(self, time_s: float, heading_rad: float) -> None:
        """Note the navigation board's heading; it is kept unwrapped."""
        if self._headings:
            before = self._headings[-1][1]
            heading_rad = before + wrap(heading_rad - before)
        self._headings.append((time_s, heading_rad))

    def forget_headings(self) -> None:
        """The navigation board was reset: its headings before and after do not go together."""
        self._headings.clear()
        self._offset_rad = None

    def take_pose(
        self, time_s: float, x_m: float, y_m: float, heading_rad: float, camera_ms: int
    ) -> bool:
        """Note a pose; False where it is an old one that was sent again."""
        exposure_s = time_s
        if self.pose_s is not None:
            later_ms = (camera_ms - self._camera_ms) % CAMERA_CLOCK_MS
            rested_s = time_s - self.pose_s
            if not 0 < later_ms < CAMERA_CLOCK_MS // 2 and rested_s < self._forget_s:
                return False
            if rested_s > LONGEST_CHORD_BEATS * self._beat_s:
                self._poses.clear()
            # The camera's clock tells the time between two poses better than their arrival does.
            elif self._poses and abs(later_ms / 1e3 - rested_s) < 0.5 * self._beat_s:
                exposure_s = self._poses[-1].time_s + later_ms / 1e3
        self._camera_ms = camera_ms
        self.pose_s = time_s
        if self._fresh(time_s):
            self._offset_rad = wrap(heading_rad - self._headings[-1][1])
        self._place = seen = _Seen(exposure_s, x_m, y_m, heading_rad)
        self._poses.append(seen)
        before = self._beat_before(seen)
        if before is None:
            self._speed_m_s = (0.0, 0.0)
        else:
            duration_s = seen.time_s - before.time_s
            vx, vy = (seen.x_m - before.x_m) / duration_s, (seen.y_m - before.y_m) / duration_s
            heading, rate = self._mean_heading(seen)
            middle = heading - 0.5 * rate * duration_s
            c, s = math.cos(middle), math.sin(middle)
            self._speed_m_s = (vx * c + vy * s, vy * c - vx * s)
        return True

    def carry_on(self, time_s: float) -> None:
        """Carry the place on by the heading and the last speed, where no pose came."""
        place = self._place
        if place is None or time_s <= place.time_s:
            return
        duration_s = time_s - place.time_s
        heading, rate = self._mean_heading(place, time_s)
        middle = heading - 0.5 * rate * duration_s
        u, v = self._speed_m_s
        c, s = math.cos(middle), math.sin(middle)
        self._place = _Seen(
            time_s,
            place.x_m + duration_s * (u * c - v * s),
            place.y_m + duration_s * (u * s + v * c),
            place.heading_rad + rate * duration_s,
        )

    # --- what goes out ------------------------------------------------------------------

    @property
    def place(self) -> tuple[float, float, float] | None:
        """Where the robot is and heads, last seen or carried on; None before the first pose."""
        place = self._place
        return None if place is None else (place.x_m, place.y_m, place.heading_rad)

    @property
    def speed_m_s(self) -> float:
        """Over the last beat."""
        return math.hypot(*self._speed_m_s)

    @property
    def middle(self) -> tuple[float, float] | None:
        """Half way between the last two poses."""
        if not self._poses:
            return None
        last, before = self._poses[-1], self._poses[-2 if len(self._poses) > 1 else -1]
        return 0.5 * (last.x_m + before.x_m), 0.5 * (last.y_m + before.y_m)

    def passed_m(self, target_m: tuple[float, float]) -> float:
        """Return how near the straight path from the pose before to the last one comes."""
        poses = self._poses
        if not poses:
            return math.inf
        last, before = poses[-1], poses[-2] if len(poses) > 1 else poses[-1]
        return nearest_m((before.x_m, before.y_m), (last.x_m, last.y_m), target_m)

    def motion(self, target_m: tuple[float, float]) -> Motion | None:
        """Return means over the last beat, with the target as seen now; None without a pose."""
        place = self._place
        if place is None:
            return None
        heading, rate = self._mean_heading(place)
        dx, dy = target_m[0] - place.x_m, target_m[1] - place.y_m
        error = wrap(heading - math.atan2(dy, dx))
        return Motion(math.hypot(dx, dy), error, *self._speed_m_s, rate)

    def _fresh(self, time_s: float) -> bool:
        headings = self._headings
        limit_s = HEADING_FRESH_BEATS * self._beat_s
        return bool(headings) and time_s - headings[-1][0] <= limit_s

    def _beat_before(self, last: _Seen) -> _Seen | None:
        """Return the pose nearest to a beat before, or None where there is none of use."""
        due_s = last.time_s - self._beat_s
        nearest = min(self._poses, key=lambda pose: abs(pose.time_s - due_s))
        return nearest if last.time_s - nearest.time_s > 0.5 * self._beat_s else None

    def _mean_heading(self, place: _Seen, time_s: float | None = None) -> tuple[float, float]:
        """Return the heading now without the beat's yaw, rad in the tank, and the mean yaw rate."""
        now_s = place.time_s if time_s is None else time_s
        if self._offset_rad is not None and self._fresh(now_s):
            beat = self._beat_of_headings()
            if beat is not None:
                mean, rate = beat
                return self._offset_rad + mean + 0.5 * rate * self._beat_s, rate
        rate = 0.0
        if self._poses:
            last = self._poses[-1]
            before = self._beat_before(last)
            if before is not None:
                turned = wrap(last.heading_rad - before.heading_rad)
                rate = turned / (last.time_s - before.time_s)
        return place.heading_rad, rate

    def _beat_of_headings(self) -> tuple[float, float] | None:
        """Return mean and mean rate of the reported heading over the beat up to the last report.

        By the trapezoidal rule, which is exact for a periodic signal sampled evenly.
        """
        newest_s, newest = self._headings[-1]
        begin_s = newest_s - self._beat_s
        later_s, later, area = newest_s, newest, 0.0
        for time_s, heading in reversed(self._headings):
            if time_s <= begin_s + 1e-9:
                share = (later_s - begin_s) / (later_s - time_s) if later_s > time_s else 0.0
                first = later + share * (heading - later)
                area += 0.5 * (later + first) * (later_s - begin_s)
                return area / self._beat_s, (newest - first) / self._beat_s
            area += 0.5 * (later + heading) * (later_s - time_s)
            later_s, later = time_s, heading
        return None
