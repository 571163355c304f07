"""Whoever takes part in a run from outside: a real board, a tracker, an operator's module, a mote.

Each knows its own line and measures it; here they share the scheduler that keeps to real time and
serves all lines (`line_group`), and their figures become one `hil` of the summary.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any

from tools.bench.base_port import BasePort
from tools.bench.line_group import GroupedLine, LineGroup
from tools.bench.mote import RealMote
from tools.bench.pace import LineScheduler
from tools.bench.plant_port import PlantPort
from tools.bench.real import RealBoard
from tools.bench.tracker import Tracker
from tools.bench.xbee_port import XBeePort

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.data import Event, Series


class Live:
    """The lines of a run, open until `close`.

    Raises:
        ScenarioError: a line cannot be opened; those that were open are closed again.

    """

    def __init__(
        self, config: Scenario, clock: Callable[[], float] = time.monotonic, *, keep: bool = True
    ) -> None:
        hil = config.hil
        self.config = config
        with ExitStack() as stack:
            kept = stack.enter_context
            self.real = kept(closing(RealBoard(config, clock, keep=keep))) if hil.url else None
            self.tracker = kept(closing(Tracker(config, clock, _tell))) if hil.camera else None
            self.module = kept(closing(XBeePort(config, clock))) if hil.xbee else None
            self.mote = kept(closing(RealMote(config, clock))) if hil.mote else None
            self.port = kept(closing(BasePort(config, clock))) if hil.base_port else None
            self.plant = (
                kept(closing(PlantPort.from_scenario(config, clock))) if hil.plant else None
            )
            self._stack = stack.pop_all()
        lines: tuple[GroupedLine | None, ...] = (
            self.real.line if self.real is not None else None,
            self.tracker,
            self.module,
            self.mote,
            self.port,
            self.plant.line if self.plant is not None else None,
        )
        group = LineGroup([line for line in lines if line is not None], clock)
        bound_s = hil.late_bound_s if hil.late == "stop" else None
        self.scheduler = LineScheduler(group, bound_s=bound_s, clock=clock)
        if self.real is not None:
            self.real.scheduler = self.scheduler

    def places(self) -> list[str]:
        """Say who is expected where, a line each."""
        told = []
        if self.real is not None:
            told.append(f"the other board is expected at {self.real.where}")
        if self.tracker is not None:
            told.append(f"the tracker is expected at {self.tracker.where}")
        if self.mote is not None:
            told.append(f"the mote is expected at {self.mote.where}")
        if self.port is not None:
            told.append(f"the base station's USB port is {self.port.where}")
        if self.plant is not None:
            told.append(f"the plant is expected at {self.plant.where}")
        return told

    def ready_places(self) -> list[str]:
        """Say who can be spoken to where, now that the run is about to begin."""
        if self.module is None:
            return []
        return [f"the XBee module's serial port is {self.module.where}"]

    @property
    def stops(self) -> bool:
        """Whether the run ends because it was later than the scenario allows."""
        return self.scheduler.too_late

    def events(self) -> list[Event]:
        """What happened to the lines."""
        told: list[Event] = []
        for part in (self.real, self.tracker, self.module, self.mote, self.port, self.plant):
            if part is not None:
                told += part.events()
        return told

    def channels(self) -> dict[str, Series]:
        """What came from outside that belongs into `channels.csv`."""
        found: dict[str, Series] = {}
        for part in (self.real, self.tracker, self.mote):
            if part is not None:
                found.update(part.channels())
        return found

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil`."""
        told: dict[str, Any] = {"diagnosis": ""}
        if self.real is not None:
            told = self.real.summary()
        told["lateness"] = self.scheduler.lateness(
            self.config.hil.late, self.config.hil.late_bound_s
        )
        if self.tracker is not None:
            told["camera"] = self.tracker.summary()
            told["diagnosis"] = told["diagnosis"] or told["camera"]["diagnosis"]
        if self.module is not None:
            told["xbee"] = self.module.summary()
        if self.mote is not None:
            told["mote"] = self.mote.summary()
            told["diagnosis"] = told["diagnosis"] or told["mote"]["diagnosis"]
        if self.port is not None:
            told["base_port"] = self.port.summary()
        if self.plant is not None:
            told["plant"] = self.plant.summary()
        return told

    def close(self) -> None:
        """Give all lines back."""
        self._stack.close()


def _tell(words: str) -> None:
    print(f"fishbed: {words}", file=sys.stderr, flush=True)
