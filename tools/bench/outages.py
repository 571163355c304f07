"""Lines of a run to somebody outside: opened, opened again when they are lost, and their outages.

Whoever has such a line knows it by its key in `[hil]`, and tells of its outages in the summary and
as events of the run.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from spi_bus.errors import TransportError
from spi_bus.transports import BackOff, OpenContext, OutageLog, open_transport
from spi_bus.transports.outage import OutageBegan, OutageEvent
from tools.errors import ScenarioError
from tools.records.data import Event

if TYPE_CHECKING:
    from spi_bus.transports.base import Clock, Transport
    from tools.bench.pace import LineScheduler


class LineOutages:
    """The outages of a line: their sums, and each with its begin and end."""

    def __init__(self) -> None:
        self.heard: list[OutageEvent] = []
        self._log = OutageLog()

    def note(self, event: OutageEvent) -> None:
        """Take notice."""
        self._log.note(event)
        self.heard.append(event)

    def summary(self) -> dict[str, float]:
        """Counters for a `summary.json`."""
        return self._log.summary()

    def events(self, scheduler: LineScheduler, who: str) -> list[Event]:
        """Begin and end of each, in the run's time; `who` was lost."""
        told = []
        for event in self.heard:
            at_s = max(0.0, scheduler.emulated_s(event.time_s))
            if isinstance(event, OutageBegan):
                told.append(Event(at_s, who, f"lost: {event.reason}", "fault", f"{who} lost"))
            else:
                words = f"back after {event.duration_s:.2f} s, attempt {event.attempts}"
                told.append(Event(at_s, who, words, label=f"{who} back"))
        return told


@contextmanager
def named_by(key: str) -> Iterator[None]:
    """Turn what is wrong with a line into a `ScenarioError` that names its key in `[hil]`."""
    try:
        yield
    except TransportError as error:
        raise ScenarioError(f"hil.{key}: {error}") from error


def open_line(key: str, url: str, clock: Clock, outages: LineOutages) -> Transport:
    """Open a line that is opened again when it is lost; `outages` hears of that.

    Raises:
        ScenarioError: it cannot be opened; the text is one line with the remedy.

    """
    with named_by(key):
        return open_transport(url, OpenContext(clock, reconnect=BackOff(), notify=outages.note))
