"""What of a run does not depend on any parameter, worked out once: order, ages, first guess."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from scipy.stats import theilslopes

from tools.diagnosis.fish.records import Kind
from tools.diagnosis.model import FloatArray, IntArray, Run

CAMERA_KINDS = (int(Kind.X), int(Kind.Y), int(Kind.HEADING))
_GUESS_S = 0.3
"""From this much of the beginning of a run its first pose is guessed, and how it moves."""
_FEWEST = 3
"""Samples from which a slope is taken; so many of the gyro's first say how fast it turns."""

_KEPT = 64
"""Runs that are remembered; a plan is cheap against what is done with it."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A run, ready for compiled code.

    ``time_s`` since the first row, ``kind``, ``value`` (n,); ``order`` (n,): by time; ``camera``
    (n,): whether the camera made it; ``age_s`` (n,): since when the camera shows this very frame.
    ``pose``: of the first guess, as the camera sees it (or true, without one), ``seen``: whether
    it sees position and heading; ``motion``: (ẋ, ẏ, r) of the first guess in that frame, zero at
    rest or where nothing tells it: forces go with the square of velocities, and an estimator that
    begins far off swims away; ``tail``: angle of a servo at the beginning, and its mean before;
    ``unsure`` (6,): standard deviations of the start.
    """

    time_s: FloatArray
    kind: IntArray
    value: FloatArray
    order: IntArray
    camera: np.ndarray[tuple[int], np.dtype[np.bool_]]
    age_s: FloatArray
    pose: tuple[float, float, float]
    seen: tuple[bool, bool]
    motion: tuple[float, float, float]
    tail: tuple[float, float]
    unsure: FloatArray

    @property
    def stalls(self) -> bool:
        """Whether the camera ever showed a frame again."""
        return bool(np.any(self.age_s > 0.0))


def make_plan(run: Run, kinds: IntArray) -> Plan:
    """Prepare a run; ``kinds``: the kind of each of the model's channels."""
    time_s = np.ascontiguousarray(run.time_s, dtype=np.float64)
    kind = kinds[run.channel]
    value = np.ascontiguousarray(run.value, dtype=np.float64)
    camera = np.isin(kind, CAMERA_KINDS)
    pose, seen = first_pose(time_s, kind, value)
    motion = None if run.at_rest else first_motion(time_s, kind, value)
    return Plan(
        time_s,
        kind,
        value,
        np.argsort(time_s, kind="stable"),
        camera,
        _ages(time_s, kind, value, camera),
        pose,
        seen,
        (0.0, 0.0, 0.0) if motion is None else motion,
        (0.0, 0.0) if run.at_rest else run.inputs.tail_at_start(),
        _unsure(motion, kind, seen),
    )


def _unsure(
    motion: tuple[float, float, float] | None, kind: IntArray, seen: tuple[bool, bool]
) -> FloatArray:
    """Standard deviations of the start: wide for the pose, tight for what is at rest (None)."""
    place = 0.2 if seen[0] else 3.0
    heading = 0.3 if seen[1] else 1.0
    if motion is None:
        return np.array([place, place, heading, 0.001, 0.001, 0.01])
    speeds = (0.03, 0.03) if motion[0] or motion[1] else (0.1, 0.05)
    return np.array([place, place, heading, *speeds, 0.15 if motion[2] else 0.5])


def first_pose(
    time_s: FloatArray, kind: IntArray, value: FloatArray
) -> tuple[tuple[float, float, float], tuple[bool, bool]]:
    """Guess position and heading at the beginning; say whether the camera saw each of them."""

    def first(wanted: Kind) -> FloatArray:
        found = np.flatnonzero(kind == int(wanted))
        if found.size == 0:
            return np.empty(0)
        near: FloatArray = value[found[time_s[found] <= time_s[found[0]] + _GUESS_S]]
        return near

    def middle(*wanted: Kind) -> tuple[float, bool]:
        for place, one in enumerate(wanted):
            values = first(one)
            if values.size:
                return float(np.median(values)), place == 0
        return 0.0, False

    def direction(*wanted: Kind) -> tuple[float, bool]:
        for place, one in enumerate(wanted):
            values = first(one)
            if values.size:
                return math.atan2(np.sin(values).mean(), np.cos(values).mean()), place == 0
        return _path_direction(time_s, kind, value), False

    x, x_seen = middle(Kind.X, Kind.GPS_X)
    y, y_seen = middle(Kind.Y, Kind.GPS_Y)
    heading, heading_seen = direction(Kind.HEADING, Kind.COMPASS)
    return (x, y, heading), (x_seen and y_seen, heading_seen)


def first_motion(
    time_s: FloatArray, kind: IntArray, value: FloatArray
) -> tuple[float, float, float]:
    """Guess how position and heading change at the beginning, by medians of slopes."""

    def slope(*wanted: Kind) -> float:
        for one in wanted:
            found = np.flatnonzero(kind == int(one))
            found = found[time_s[found] <= time_s[found].min(initial=math.inf) + _GUESS_S]
            if found.size >= _FEWEST:
                return float(theilslopes(np.unwrap(value[found]), time_s[found]).slope)
        return 0.0

    turning = value[kind == int(Kind.GYRO)][:_FEWEST]
    rate = float(np.median(turning)) if turning.size else slope(Kind.HEADING, Kind.COMPASS)
    return slope(Kind.X, Kind.GPS_X), slope(Kind.Y, Kind.GPS_Y), rate


def _path_direction(time_s: FloatArray, kind: IntArray, value: FloatArray) -> float:
    """Direction in which the path leaves: from its first second to its third."""
    ends = []
    for one in (Kind.X, Kind.Y):
        here = kind == int(one)
        t, v = time_s[here], value[here]
        early, late = v[t <= 1.0], v[(t > 2.0) & (t <= 4.0)]
        if not (early.size and late.size):
            return 0.0
        ends.append(float(late.mean() - early.mean()))
    return math.atan2(ends[1], ends[0])


def _ages(time_s: FloatArray, kind: IntArray, value: FloatArray, camera: np.ndarray) -> FloatArray:
    """Return for how long the camera has shown the same frame (all of its channels)."""
    age_s = np.zeros(time_s.size)
    which = np.flatnonzero(camera)
    if which.size == 0:
        return age_s
    moments, row = np.unique(time_s[which], return_inverse=True)
    column = np.searchsorted(CAMERA_KINDS, kind[which])
    frames = np.full((moments.size, len(CAMERA_KINDS)), np.nan)
    frames[row, column] = value[which]
    same = np.all((np.diff(frames, axis=0) == 0.0) | np.isnan(frames[1:]), axis=1)
    told = (np.sum(~np.isnan(frames[1:]), axis=1) > 1) & np.all(
        np.isnan(frames[1:]) == np.isnan(frames[:-1]), axis=1
    )
    new = np.concatenate(([True], ~(same & told)))
    since = np.maximum.accumulate(np.where(new, np.arange(moments.size), 0))
    age_s[which] = (moments - moments[since])[row]
    return age_s


class Plans:
    """Plans of the runs that were asked for last; safe for threads."""

    def __init__(self, kinds: IntArray) -> None:
        self._kinds = kinds
        self._lock = threading.Lock()
        self._kept: OrderedDict[int, tuple[Run, Plan]] = OrderedDict()

    def of(self, run: Run) -> Plan:
        """Return the plan of a run."""
        with self._lock:
            found = self._kept.get(id(run))
            if found is not None and found[0] is run:
                self._kept.move_to_end(id(run))
                return found[1]
        plan = make_plan(run, self._kinds)
        with self._lock:
            self._kept[id(run)] = (run, plan)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return plan
