"""Shortest tours by dynamic programming over sets of points (Held and Karp, 1962), for few points.

Written from the recurrence and sharing nothing with what it judges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product

Point = tuple[float, float]


def shortest_by_set(start: Point | None, points: Sequence[Point], closed: bool) -> list[float]:
    """For every set of points (bits of the index): the shortest way through all of them.

    From `start`, and back where `closed`; without a start, a closed tour through the set alone.
    """
    count = len(points)
    best = [math.inf] * (1 << count)
    best[0] = 0.0
    origins = [start] if start is not None else list(points)
    for origin in origins:
        ways: dict[tuple[int, int], float] = {}
        for mask in range(1, 1 << count):
            for last in range(count):
                if not mask >> last & 1:
                    continue
                rest = mask & ~(1 << last)
                if rest == 0:
                    ways[mask, last] = math.dist(origin, points[last])
                else:
                    ways[mask, last] = min(
                        ways[rest, before] + math.dist(points[before], points[last])
                        for before in range(count)
                        if rest >> before & 1
                    )
                back = math.dist(points[last], origin) if closed else 0.0
                # without a start, `origin` itself is one of the set
                if start is not None or mask >> points.index(origin) & 1:
                    best[mask] = min(best[mask], ways[mask, last] + back)
    return best


def best_shares(
    starts: Sequence[Point],
    points: Sequence[Point],
    closed: bool,
    cost: Callable[[Sequence[float]], float],
) -> float:
    """The least cost over every way to share the points among robots."""
    tables = [shortest_by_set(start, points, closed) for start in starts]
    least = math.inf
    for shares in product(range(len(starts)), repeat=len(points)):
        masks = [0] * len(starts)
        for point, robot in enumerate(shares):
            masks[robot] |= 1 << point
        least = min(least, cost([table[mask] for table, mask in zip(tables, masks, strict=True)]))
    return least
