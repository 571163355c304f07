"""Durations counted in bounded memory: how late, how long, how often.

A run in real time may last days, so what it measures at every step cannot be kept. Values fall into
buckets that grow by 2.2 % (32 an octave) from one microsecond up; count, sum, smallest and largest
are exact. A quantile is the upper edge of its bucket, so it is at most 2.2 % (below a microsecond:
one microsecond) too large and never too small: lateness is not made to look better than it was.
"""

from __future__ import annotations

from math import ceil, floor, log2
from typing import Final

__all__ = ["DurationHistogram"]

_FIRST_S: Final = 1e-6
_PER_OCTAVE: Final = 32
_BUCKETS: Final = 40 * _PER_OCTAVE  # up to 1e-6 · 2^40 s: twelve days


class DurationHistogram:
    """How often durations (in seconds, not negative) occurred."""

    __slots__ = ("_counts", "count", "maximum_s", "minimum_s", "total_s")

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}  # bucket → count; at most _BUCKETS + 1 of them
        self.count = 0
        self.total_s = 0.0
        self.maximum_s = 0.0
        self.minimum_s = 0.0

    def __len__(self) -> int:
        return self.count

    def record(self, duration_s: float) -> None:
        """Count a duration; below zero counts as zero."""
        duration_s = max(0.0, duration_s)
        bucket = 0
        if duration_s > _FIRST_S:
            bucket = min(1 + floor(_PER_OCTAVE * log2(duration_s / _FIRST_S)), _BUCKETS)
        self._counts[bucket] = self._counts.get(bucket, 0) + 1
        self.minimum_s = min(self.minimum_s, duration_s) if self.count else duration_s
        self.maximum_s = max(self.maximum_s, duration_s)
        self.total_s += duration_s
        self.count += 1

    @property
    def mean_s(self) -> float:
        """Arithmetic mean, 0 while empty."""
        return self.total_s / self.count if self.count else 0.0

    def quantile_s(self, q: float) -> float:
        """Return a duration that at least the share `q` of all did not exceed; 0 while empty.

        Raises:
            ValueError: `q` outside 0 to 1.

        """
        if not 0 <= q <= 1:
            raise ValueError(f"quantile {q} is outside 0 to 1")
        rank = max(1, ceil(q * self.count))
        seen = 0
        for bucket in sorted(self._counts):
            seen += self._counts[bucket]
            if seen >= rank:
                edge_s = _FIRST_S * 2.0 ** (bucket / _PER_OCTAVE)
                last = bucket == _BUCKETS
                return self.maximum_s if last else min(edge_s, self.maximum_s)
        return 0.0

    def above(self, duration_s: float) -> int:
        """Return how many were longer; one that shares its bucket with the limit counts as such."""
        return sum(
            count
            for bucket, count in self._counts.items()
            if _FIRST_S * 2.0 ** (bucket / _PER_OCTAVE) > duration_s and self.maximum_s > duration_s
        )

    def summary(self) -> dict[str, float]:
        """Count, mean, median, 99th percentile and maximum, for a `summary.json`."""
        return {
            "count": self.count,
            "mean_s": self.mean_s,
            "median_s": self.quantile_s(0.5),
            "p99_s": self.quantile_s(0.99),
            "maximum_s": self.maximum_s,
        }
