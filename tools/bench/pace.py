"""Real time with a line in it: hold events back, and let in what comes meanwhile.

Waiting is on the line's descriptor, so bytes are taken when they come and not at the next event:
what they cause is scheduled at the moment that the host's clock shows, as far as the run has come.
A run that is behind looks at the line all the same, every half millisecond. One that is ahead uses
its waiting for work that has no deadline (`spare`), such as writing down what has happened.
"""

from __future__ import annotations

import time as _time
from collections.abc import Callable
from typing import Any, Final

from firmware_model.scheduler import SPARE_S, RealTimeScheduler, Scheduler
from firmware_model.time import FS_PER_S
from tools.bench.lateness import StallLog, above
from tools.bench.line_group import ServedLine

LOOK_S: Final = 0.0005
"""How long a run that is behind leaves the line alone."""


class LineScheduler(RealTimeScheduler):
    """A real-time scheduler that serves a line while it waits.

    Args:
        line: what to wait on; its `on_incoming` is called at the emulated time of arrival.
        deadline_s: an event that starts later than this is counted in `missed`.
        bound_s: `too_late` becomes true when an event starts later than this; None: never.
        clock: monotonic, in seconds; the line's.

    """

    __slots__ = ("_looked_s", "bound_s", "line", "served", "stalls", "too_late")

    def __init__(
        self,
        line: ServedLine,
        *,
        deadline_s: float = 0.010,
        bound_s: float | None = None,
        clock: Callable[[], float] = _time.monotonic,
    ) -> None:
        super().__init__(1.0, deadline_s, clock)
        self.line = line
        self.bound_s = bound_s
        self.too_late = False
        self.served: Callable[[], None] = lambda: None
        """Called after every look at the line, at the emulated time of the look."""
        self.stalls = StallLog()
        self._looked_s = clock()

    def emulated_s(self, host_s: float) -> float:
        """Return the emulated time, in seconds, that belongs to a time of the host's clock."""
        start = self._start_host if self._start_host is not None else host_s
        return self._start_fs / FS_PER_S + host_s - start

    def lateness(self, policy: str, bound_s: float) -> dict[str, Any]:
        """Return how punctual it was, for `hil.lateness` of a `summary.json`."""
        return {
            **self.lateness_s.summary(),
            "above": above(self.lateness_s),
            "missed": self.missed,
            "deadline_s": self.deadline_s,
            "policy": policy,
            "bound_s": bound_s,
            "stopped": self.too_late,
            "stalls": self.stalls.count,
            "worst": self.stalls.summary(),
        }

    def run(self, until_fs: int) -> None:
        """Run every event up to `until_fs`, none early, and serve the line all the while."""
        if self._start_host is None:
            self._start_host, self._start_fs = self._clock(), self.now
            self.stalls.in_time(self._start_host)
        while True:
            due = self.next_time()
            target_fs = until_fs if due is None else min(due, until_fs)
            if self._serve(target_fs):
                continue  # there may be something earlier now
            if due is None or due > until_fs:
                break
            action = self._heap[0][3]
            began_s = self._clock()
            Scheduler.run(self, due)
            self.stalls.step(action, self._clock() - began_s)
        Scheduler.run(self, until_fs)

    def _serve(self, target_fs: int) -> bool:
        """Wait until a time; return True, sooner, when the line brought something."""
        assert self._start_host is not None
        host_due_s = self._start_host + (target_fs - self._start_fs) / FS_PER_S
        while True:
            now_s = self._clock()
            if now_s < host_due_s:
                self.stalls.in_time(host_due_s)
                if now_s + SPARE_S < host_due_s and self.spare():
                    self.stalls.step("writing down what happened", self._clock() - now_s)
                else:
                    self.line.wait(host_due_s - now_s)
            elif now_s - self._looked_s < LOOK_S:
                self._record(now_s, now_s - host_due_s, target_fs)
                return False
            self._looked_s = now_s = self._clock()
            came = self.line.poll()
            elapsed_fs = int((now_s - self._start_host) * FS_PER_S) + self._start_fs
            self.now = max(self.now, min(target_fs, elapsed_fs))
            if came:
                self.line.on_incoming()
            self.served()
            self.stalls.step("the line", self._clock() - now_s)
            after = self.next_time()
            if came or (after is not None and after < target_fs):
                return True

    def _record(self, now_s: float, late_s: float, target_fs: int) -> None:
        self.lateness_s.record(late_s)
        self.stalls.late(now_s, target_fs / FS_PER_S, late_s)
        if late_s > self.deadline_s:
            self.missed += 1
        if self.bound_s is not None and late_s > self.bound_s:
            self.too_late = True
