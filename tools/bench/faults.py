"""What goes wrong on purpose: the supply is cut, at a time or amid a flash operation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_model.scheduler import Priority
from firmware_model.time import FS_PER_S, from_seconds
from tools.records.data import Event

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from tools.bench.robot import Robot
    from tools.configuration import FlashCut, Scenario


class Faults:
    """Arms the faults of a scenario and notes what they did."""

    def __init__(self, config: Scenario, scheduler: Scheduler, robot: Robot) -> None:
        self.events: list[Event] = []
        self._scheduler = scheduler
        self._power = robot.power
        self._flash = robot.proc.mote.flash
        self._armed: list[FlashCut] = []
        self._flash.on_cycle = self._flash_cycle
        for cut in config.faults.supply_cuts:
            restored = from_seconds(cut.at_s + cut.duration_s)
            scheduler.at(from_seconds(cut.at_s), self._cut, Priority.OBSERVER)
            scheduler.at(restored, self._restore, Priority.OBSERVER)
        for flash_cut in config.faults.flash_cuts:

            def arm(fault: FlashCut = flash_cut) -> None:
                self._armed.append(fault)

            scheduler.at(from_seconds(flash_cut.after_s), arm, Priority.OBSERVER)

    def _flash_cycle(self, span_fs: int) -> None:
        """Cut the supply within a flash cycle that has just begun, if one is to be cut."""
        if not self._armed:
            return
        fault = self._armed.pop(0)
        cut_fs = self._scheduler.now + int(fault.at_fraction * span_fs)
        self._scheduler.at(cut_fs, lambda: self._cut(fault.at_fraction, span_fs), Priority.OBSERVER)
        restored = cut_fs + from_seconds(fault.duration_s)
        self._scheduler.at(restored, self._restore, Priority.OBSERVER)

    def _cut(self, fraction: float = 0.0, span_fs: int = 0) -> None:
        if not self._power.on:
            return
        during = ""
        if span_fs:
            during = f", {100 * fraction:.0f} % into a flash operation of {span_fs / 1e12:.2f} ms"
        elif self._flash.busy:
            during = " during a flash operation"
        self._power.cut()
        self._note(f"cut{during}", "fault")

    def _restore(self) -> None:
        if not self._power.on:
            self._power.restore()
            self._note("restored")

    def _note(self, what: str, severity: str = "info") -> None:
        self.events.append(Event(self._scheduler.now / FS_PER_S, "supply", what, severity))
