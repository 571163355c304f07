"""One heap of events ordered by (time, priority, sequence).

The order within an instant is part of the contract (docs/timing.md): levels on wires settle first,
then peripherals react, then CPUs run, then observers look; among equals, first scheduled comes
first. Nothing else decides, so a run is the same on every machine.

An event is a small list, because lists compare in C. Cancelling clears its action and leaves it in
the heap, to be dropped when it surfaces: O(1), and the order of the others is untouched.
"""

from __future__ import annotations

import time as _time
from collections.abc import Callable
from enum import IntEnum
from heapq import heapify, heappop, heappush
from typing import Any, TypeAlias

from firmware_model.errors import SchedulingError
from firmware_model.histogram import DurationHistogram
from firmware_model.time import FS_PER_S

Action: TypeAlias = Callable[[], None]
Event: TypeAlias = list[Any]
"""An opaque handle: [time_fs, priority, sequence, action or None]."""

SPARE_S = 0.002
"""Work without a deadline begins only this long before the next event: a piece takes less."""
_NEVER = 1 << 200  # later than any time a run can reach


class Priority(IntEnum):
    """Order within an instant, first to last."""

    WIRE = 0
    PERIPHERAL = 1
    CPU = 2
    OBSERVER = 3


_PERIPHERAL = int(Priority.PERIPHERAL)


class Scheduler:
    """Runs actions in order of time, priority and sequence; `now` is the time in femtoseconds."""

    __slots__ = ("_cancelled", "_heap", "_limit", "_sequence", "now")

    def __init__(self) -> None:
        self.now = 0
        self._heap: list[Event] = []
        self._sequence = 0
        self._cancelled = 0
        self._limit = 0

    def at(self, time_fs: int, action: Action, priority: int = _PERIPHERAL) -> Event:
        """Schedule `action` at a time not before now; return a handle for `cancel`."""
        if time_fs < self.now:
            raise SchedulingError(f"cannot schedule at {time_fs} fs: it is already {self.now} fs")
        self._sequence += 1
        event: Event = [time_fs, priority, self._sequence, action]
        heappush(self._heap, event)
        return event

    def after(self, delay_fs: int, action: Action, priority: int = _PERIPHERAL) -> Event:
        """Schedule `action` a delay from now; return a handle for `cancel`."""
        return self.at(self.now + delay_fs, action, priority)

    def cancel(self, event: Event | None) -> None:
        """Make sure that an event does not happen; harmless after it has, or on None."""
        if event is not None and event[3] is not None:
            event[3] = None
            self._cancelled += 1
            if self._cancelled > 64 and self._cancelled > len(self._heap) // 2:
                self._heap[:] = [e for e in self._heap if e[3] is not None]
                heapify(self._heap)
                self._cancelled = 0

    def next_time(self) -> int | None:
        """Return the time of the next event, or None where there is none."""
        heap = self._heap
        while heap and heap[0][3] is None:
            heappop(heap)
            self._cancelled -= 1
        return heap[0][0] if heap else None

    def advance(self, time_fs: int) -> bool:
        """Move `now` to `time_fs` if nothing else is due up to and at that time; say whether.

        A CPU that runs alone uses this to charge cycles without a trip through the heap; the
        outcome is the same as scheduling its own completion.
        """
        if time_fs > self._limit:
            return False
        heap = self._heap
        while heap:
            head = heap[0]
            if head[3] is None:
                heappop(heap)
                self._cancelled -= 1
            elif head[0] <= time_fs:
                return False
            else:
                break
        self.now = time_fs
        return True

    def run(self, until_fs: int) -> None:
        """Run every event up to and including `until_fs`, then set `now` to it."""
        self._limit = until_fs
        heap = self._heap
        while heap and heap[0][0] <= until_fs:
            event = heappop(heap)
            action = event[3]
            if action is None:
                self._cancelled -= 1
                continue
            event[3] = None
            self.now = event[0]
            action()
        self._limit = 0
        self.now = max(self.now, until_fs)


class RealTimeScheduler(Scheduler):
    """A scheduler that holds each event back until the host's clock has reached it.

    It never hides lateness: `lateness_s` counts how late every event with waiting before it
    started (a histogram: its memory is bounded however long the run), and `missed` those later
    than `deadline_s`. `speed` is emulated seconds a host second.
    """

    __slots__ = (
        "_clock",
        "_sleep",
        "_speed",
        "_start_fs",
        "_start_host",
        "deadline_s",
        "lateness_s",
        "missed",
        "spare",
    )

    def __init__(
        self,
        speed: float = 1.0,
        deadline_s: float = 0.010,
        clock: Callable[[], float] = _time.monotonic,
        sleep: Callable[[float], None] = _time.sleep,
    ) -> None:
        if not speed > 0:
            raise ValueError(f"speed must be positive, not {speed}")
        super().__init__()
        self._speed = speed
        self._clock = clock
        self._sleep = sleep
        self._start_host: float | None = None
        self._start_fs = 0
        self.deadline_s = deadline_s
        self.lateness_s = DurationHistogram()
        self.missed = 0
        self.spare: Callable[[], bool] = lambda: False
        """Called while there is time; does a piece of work and returns whether there was any."""

    def advance(self, time_fs: int) -> bool:
        """Move `now` only after the host's clock has come as far."""
        if not super().advance(time_fs):
            return False
        self._hold(time_fs)
        return True

    def run(self, until_fs: int) -> None:
        """Run every event up to `until_fs`, none before its time on the host's clock."""
        while (due := self.next_time()) is not None and due <= until_fs:
            self._hold(due)
            super().run(due)
        self._hold(until_fs)
        super().run(until_fs)

    def _hold(self, time_fs: int) -> None:
        if self._start_host is None:
            self._start_host, self._start_fs = self._clock(), self.now
        host_due = self._start_host + (time_fs - self._start_fs) / FS_PER_S / self._speed
        ahead = host_due - self._clock()
        while ahead > SPARE_S and self.spare():
            ahead = host_due - self._clock()
        if ahead > 0:
            self._sleep(ahead)
            ahead = host_due - self._clock()
        late = max(0.0, -ahead)
        self.lateness_s.record(late)
        if late > self.deadline_s:
            self.missed += 1
