"""Several lines served as one: what a run in real time waits on, whoever is at their other ends.

A `LineScheduler` serves a line: waits on it, polls it, and tells it when something came. A group is
such a line made of others, so that a real board, a tracker and an operator's module may take part
in one run, and none of them knows of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from spi_bus.transports.base import Clock, Waitable, wait_any


class ServedLine(Protocol):
    """What a `LineScheduler` asks of a line."""

    def wait(self, timeout_s: float) -> None:
        """Block until there may be something to do, at most this long."""

    def poll(self) -> bool:
        """Move what can be moved now; return whether something came for the emulation."""

    def on_incoming(self) -> None:
        """Hand on what came, at the emulated time of its arrival."""


class GroupedLine(Protocol):
    """What a group asks of its members."""

    def waitables(self) -> list[Waitable]:
        """Return what to wait on; none where nothing will come any more."""

    def poll(self) -> bool:
        """As of a `ServedLine`."""

    def on_incoming(self) -> None:
        """As of a `ServedLine`."""


class LineGroup:
    """Serves its members together; `members` may be added to before the run."""

    def __init__(self, members: Sequence[GroupedLine], clock: Clock) -> None:
        self.members = list(members)
        self._clock = clock
        self._came: list[GroupedLine] = []

    def wait(self, timeout_s: float) -> None:
        """Block until any of them may have something to do, at most this long."""
        wait_any([each for member in self.members for each in member.waitables()],
                 timeout_s, self._clock)  # fmt: skip

    def poll(self) -> bool:
        """Look at all of them."""
        self._came = [member for member in self.members if member.poll()]
        return bool(self._came)

    def on_incoming(self) -> None:
        """Tell those to which something came."""
        came, self._came = self._came, []
        for member in came:
            member.on_incoming()
