"""A survey as the base station's host sees it: the samples that came, the field, and the end.

The host has a `Mission` like the boards', of what the base's mote hears; it does not swim and says
nothing. Of each sample it may know the item, which all boards share, and the record, which was
carried to the base and acknowledged; of a robot that died it may have one without the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from firmware_model.time import FS_PER_MS, FS_PER_S
from procboard.alarms import TICKS_PER_S
from procboard.survey.items import SAMPLE, Sample
from procboard.survey.mission import Mission, Phase
from spi_bus.errors import PayloadError
from tools.bench.mission import mission_config, way
from tools.records.data import Event
from tools.shoal.survey_watch import SurveyWatch

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from procboard.board import BaseStation
    from tools.configuration import Scenario

WRAP_MS = 1 << 32
"""Of a sample's time."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A sample that the base knows of."""

    robot: int
    sample: Sample
    time_s: float | None
    """When it was taken, in the run's time; None where the base had no shared clock then."""
    arrived_s: float
    """When the base first had it."""
    record: int | None
    """Number of its record at the base; None where only the item came."""
    shared: bool
    """Whether the base has it as an item, so that it counts in the reconstruction."""


class BaseSurvey:
    """The mission at the base."""

    def __init__(self, config: Scenario, scheduler: Scheduler, base: BaseStation) -> None:
        self.config = config
        self.mission = Mission(
            config.base_station.address, mission_config(config), way(config), robot=False
        )
        self.watch = SurveyWatch(self.mission)
        self.events: list[Event] = []
        self.agreed_s: float | None = None
        """When all that lived first said that the field is known."""
        self.records = 0
        """That came, each once."""
        self.bad_records = 0
        self._scheduler = scheduler
        self._base = base
        self._times: dict[tuple[int, Sample], tuple[float | None, float]] = {}
        self._records: dict[tuple[int, Sample], int] = {}
        self._phase: Phase | None = None
        base.app.on_item = self._on_item
        base.app.on_record = self._on_record
        self.mission.start(0)

    def _on_item(self, origin: int, number: int, octets: bytes) -> None:
        mission = self.mission
        now_ms = self._scheduler.now // FS_PER_MS
        mission.receive(origin, number, octets, now_ms)
        mission.handle_timer(now_ms)
        for samples in mission.knowledge.samples.values():
            sample = samples.get((origin, number))
            if sample is not None:
                self._note(origin, sample)
        self._look()

    def _on_record(self, origin: int, number: int, octets: bytes) -> None:
        self.records += 1
        try:
            sample = SAMPLE.decode(octets)
        except PayloadError:
            self.bad_records += 1
            return
        self._note(origin, sample)
        self._records[origin, sample] = number

    def _note(self, robot: int, sample: Sample) -> None:
        """Work out when a sample was taken, while the shared clock is at hand."""
        if (robot, sample) in self._times:
            return
        now_s, at_s = self._scheduler.now / FS_PER_S, None
        routing = self._base.services.routing if self._base.services is not None else None
        ticks = routing.global_ticks() if routing is not None else None
        if ticks is not None:
            ago_ms = (ticks * 1_000 // TICKS_PER_S - sample.time_ms) % WRAP_MS
            at_s = now_s - ago_ms / 1e3
        self._times[robot, sample] = None if at_s is None or at_s < 0.0 else at_s, now_s

    def _look(self) -> None:
        now_s = self._scheduler.now / FS_PER_S
        self.watch.look(now_s)
        if self.mission.phase is not self._phase and self.mission.phase is Phase.COMPLETE:
            known = len(self.mission.knowledge.samples)
            self.events.append(Event(now_s, "survey", f"the base knows the field, {known} cells"))
        self._phase = self.mission.phase
        if self.agreed_s is None and self.mission.agreed:
            self.agreed_s = now_s
            self.watch.complete(now_s)
            self.events.append(Event(now_s, "survey", "all robots know the field", label="known"))

    @property
    def over(self) -> bool:
        """Whether all that live know the field, and the base has all their records."""
        if self.agreed_s is None or not self.mission.agreed:
            return False
        knowledge = self.mission.knowledge
        return all(
            (origin, sample) in self._records
            for samples in knowledge.samples.values()
            for (origin, _), sample in samples.items()
            if knowledge.lives(origin)
        )

    def taken(self) -> tuple[Taken, ...]:
        """Return all samples that the base knows of, in the order in which they were taken."""
        shared = {
            (origin, sample)
            for samples in self.mission.knowledge.samples.values()
            for (origin, _), sample in samples.items()
        }
        found = [
            Taken(*key, *times, self._records.get(key), shared=key in shared)
            for key, times in self._times.items()
        ]

        def when(one: Taken) -> tuple[float, int, int]:
            at_s = one.arrived_s if one.time_s is None else one.time_s
            return at_s, one.robot, one.sample.time_ms

        return tuple(sorted(found, key=when))
