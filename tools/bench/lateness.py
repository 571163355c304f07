"""Where the time went when a run in real time was late: its worst stalls, each with its cause.

One long step makes hundreds of events late, so what is kept is stalls: from the last moment at
which the run was in time until it is again. Within a stall the scheduler says how long each step
took on the host's clock; together with the processor time of our thread and what the garbage
collector took that tells what was our own doing, and what was the machine's, which ran something
else. It costs a processor-clock call an event, about half a microsecond, and bounded memory.
"""

from __future__ import annotations

import gc
import heapq
import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from firmware_model.histogram import DurationHistogram

__all__ = ["LIMITS_S", "Stall", "StallLog", "above"]

LIMITS_S: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Durations whose exceedances a summary counts."""

KEPT: Final = 10
LEAST_S: Final = 0.001
"""Later than this a stall begins: a tenth of a period at 100 Hz."""


def above(durations: DurationHistogram) -> list[tuple[float, int]]:
    """Return how many exceeded each of `LIMITS_S`, as (limit in s, count)."""
    return [(limit_s, durations.above(limit_s)) for limit_s in LIMITS_S]


@dataclass(frozen=True, slots=True)
class Stall:
    """How late it got before it was in time again, and what the time was spent on."""

    at_s: float
    """Emulated time of the latest event."""
    late_s: float
    own_s: float
    """Processor time that this program used since it was last in time."""
    away_s: float
    """The rest, less what it slept on purpose: the machine ran other things, or it paged."""
    collecting_s: float
    """Garbage collection, a part of `own_s`."""
    longest: str
    """The step that took longest."""
    longest_s: float

    def words(self) -> str:
        """Say it in a line."""
        cause = "the machine was busy elsewhere"
        if self.own_s >= self.away_s:
            cause = f"{self.longest} took {1e3 * self.longest_s:.1f} ms"
            if self.longest_s < 0.5 * self.own_s:
                cause = f"many steps of our own, of which {cause}"
            if self.collecting_s > 0.5 * self.own_s:
                cause = "garbage collection"
        return f"{1e3 * self.late_s:.1f} ms at {self.at_s:.2f} s: {cause}"


class StallLog:
    """Keeps the worst stalls.

    Args:
        thread_time: processor time of this thread, in seconds.
        kept: how many.

    """

    def __init__(
        self, thread_time: Callable[[], float] = time.thread_time, kept: int = KEPT
    ) -> None:
        self.count = 0
        """Stalls there were."""
        self._thread_time = thread_time
        self._kept = kept
        self._order = itertools.count()
        self._worst: list[tuple[float, int, Stall]] = []  # a heap, the least bad first
        self._stall: Stall | None = None
        self._from_s = 0.0
        self._own_from_s = thread_time()
        self._collected_s = 0.0
        self._collecting_from_s = 0.0
        self._longest_s = 0.0
        self._longest: object = None

    def step(self, what: object, took_s: float) -> None:
        """Take notice of a step: a text, or what was called."""
        if took_s > self._longest_s:
            self._longest, self._longest_s = what, took_s

    def in_time(self, now_s: float) -> None:
        """The run waits, or begins an event when it is due: a stall is over, if there was one."""
        if self._stall is not None:
            self._keep(self._stall)
            self._stall = None
        self._from_s = now_s
        self._own_from_s = self._thread_time()
        self._collected_s = self._longest_s = 0.0
        self._longest = None

    def late(self, now_s: float, at_s: float, late_s: float) -> None:
        """An event begins late."""
        if late_s < LEAST_S:
            self.in_time(now_s)
        elif self._stall is None or late_s > self._stall.late_s:
            own_s = self._thread_time() - self._own_from_s
            away_s = max(0.0, now_s - self._from_s - own_s)
            self._stall = Stall(
                at_s, late_s, own_s, away_s, self._collected_s,
                _name(self._longest), self._longest_s,
            )  # fmt: skip

    def worst(self) -> list[Stall]:
        """Return the worst, the worst first."""
        stalls = [stall for _, _, stall in self._worst]
        if self._stall is not None:
            stalls.append(self._stall)
        return sorted(stalls, key=lambda stall: -stall.late_s)[: self._kept]

    def summary(self) -> list[dict[str, Any]]:
        """Return the worst for a `summary.json`."""
        return [asdict(stall) for stall in self.worst()]

    @contextmanager
    def collections(self) -> Iterator[None]:
        """Time the garbage collector meanwhile."""
        gc.callbacks.append(self._on_collection)
        try:
            yield
        finally:
            gc.callbacks.remove(self._on_collection)

    def _on_collection(self, phase: str, _info: dict[str, int]) -> None:
        now_s = time.perf_counter()
        if phase == "start":
            self._collecting_from_s = now_s
        else:
            self._collected_s += now_s - self._collecting_from_s

    def _keep(self, stall: Stall) -> None:
        self.count += 1
        entry = (stall.late_s, next(self._order), stall)
        if len(self._worst) < self._kept:
            heapq.heappush(self._worst, entry)
        else:
            heapq.heappushpop(self._worst, entry)


def _name(what: object) -> str:
    """A step in words: a text as it is, a function or method by its qualified name."""
    if what is None:
        return "nothing of ours"
    if isinstance(what, str):
        return what
    owner = getattr(what, "__self__", None)
    name: str = getattr(what, "__qualname__", repr(what))
    label = getattr(owner, "name", "")
    return f"{name} of {label}" if isinstance(label, str) and label else name
