"""Offset and drift of a board's clock, from its time stamps and when they arrived here.

Delays only add: a stamp arrives at a + b·t plus a delay that is never below its least. So the line
that belongs to both clocks lies under all points and touches some. Among all lines below the points
we take the one with the least sum of distances (Moon, Skelly & Towsley, INFOCOM 1999, linear
programming): it is the edge of the lower convex hull under the mean of the stamps. However the
delays are distributed, late points do not pull at it.

The offset includes the least delay of the way, which no one-way measurement can tell from it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Final

from firmware_model.histogram import DurationHistogram

if TYPE_CHECKING:
    from tools.records.data import FloatArray

_MOST_POINTS: Final = 50_000
_JUMP_S: Final = 1.0
"""A stamp that goes back by more is a clock that was set to zero: the board was reset."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ClockFit:
    """host = offset_s + (1 − drift_ppm·1e-6) · board, in seconds of each clock."""

    offset_s: float
    """Host's time at which the board's clock began, with the least delay of the line."""
    drift_ppm: float
    """How much faster than the host's the board's clock runs."""
    span_s: float
    reports: int
    delay_median_s: float
    """Beyond the least delay."""
    delay_p99_s: float
    drift_uncertainty_ppm: float
    """Median delay over the span: what the end points of the line may be off."""

    def host_s(self, board_s: float) -> float:
        """Return the host's time of a stamp."""
        return self.offset_s + board_s * (1.0 - 1e-6 * self.drift_ppm)

    def host_times(self, board_s: FloatArray) -> FloatArray:
        """Return the host's times of several stamps."""
        return self.offset_s + board_s * (1.0 - 1e-6 * self.drift_ppm)


@dataclass(slots=True)
class BoardClock:
    """Collects pairs of (board's stamp, host's time), both in seconds."""

    resets: int = 0
    _points: list[Point] = field(default_factory=list)
    _every: int = 1
    _count: int = 0

    def note(self, board_s: float, host_s: float) -> None:
        """Take a pair; a stamp that jumped back begins anew."""
        points = self._points
        if points and board_s < points[-1][0] - _JUMP_S:
            self.resets += 1
            points.clear()
            self._every, self._count = 1, 0
        self._count += 1
        if self._count % self._every == 0:
            points.append((board_s, host_s))
        if len(points) >= _MOST_POINTS:
            del points[::2]
            self._every *= 2

    def fit(self, since_s: float = -inf) -> ClockFit | None:
        """Return offset and drift; None with fewer than three different stamps.

        Stamps of before `since_s` (host's time) waited for the link: their delays do not count.
        """
        points = _without_backlog(self._points)
        edge = _edge_below(points)
        if edge is None or len(points) < 3:
            return None
        (x0, y0), (x1, y1) = edge
        slope = (y1 - y0) / (x1 - x0)
        offset = y0 - slope * x0
        delays = DurationHistogram()
        for x, y in points:
            if offset + slope * x >= since_s:
                delays.record(y - offset - slope * x)
        span = points[-1][0] - points[0][0]
        median = delays.quantile_s(0.5)
        return ClockFit(
            offset_s=offset,
            drift_ppm=1e6 * (1.0 - slope),
            span_s=span,
            reports=self._count,
            delay_median_s=median,
            delay_p99_s=delays.quantile_s(0.99),
            drift_uncertainty_ppm=1e6 * median / span if span > 0 else 0.0,
        )


def _without_backlog(points: list[Point]) -> list[Point]:
    """Leave out the burst that came at once when the link came up: queued, not delayed."""
    begin = 0
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        if y1 - y0 >= 0.5 * (x1 - x0):
            break
        begin += 1
    return points[begin + 1 :] if begin else points


def _edge_below(points: list[Point]) -> tuple[Point, Point] | None:
    """Return the edge of the lower convex hull (Andrew's monotone chain) under the mean of x."""
    if not points:
        return None
    hull: list[Point] = []
    for point in sorted(points):
        if hull and point[0] == hull[-1][0]:
            continue  # the same stamp again, later
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean = sum(x for x, _ in points) / len(points)
    for left, right in itertools.pairwise(hull):
        if left[0] <= mean <= right[0]:
            return left, right
    return None


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])
