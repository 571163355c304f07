"""`ShoalData`: all that a run of several robots knows about itself, as plain arrays and rows.

What is known of each robot has the form that it has of one alone (`tools.records.data`); beside it
stands what only several have: who heard whom, and how near they came to each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tools.records.data import (
    Changes,
    Command,
    EnergyState,
    Event,
    FloatArray,
    LinkEnd,
    Metric,
    Mount,
    Series,
    TankView,
)
from tools.records.survey_data import SurveyData

CountArray: TypeAlias = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class SwumRobot:
    """One robot of a shoal."""

    name: str
    address: int
    metrics: Mapping[str, Metric]
    truth: Mapping[str, FloatArray]
    """As in `RunData`, at the times of truth.csv."""
    channels: Mapping[str, Series]
    beat_frequency_hz: float
    energy: tuple[EnergyState, ...]
    links: tuple[LinkEnd, ...]
    mounts: tuple[Mount, ...]
    outages: tuple[tuple[float, float], ...]
    """Times without supply, the one before it was switched on included."""


@dataclass(frozen=True, slots=True)
class Hearing:
    """Who heard whom: frames in the air, and whose receivers found their beginnings.

    A receiver that is off, sends itself, or is busy with another frame does not find one; neither
    does one that is too far, or where two collide. What follows of a frame that is for another is
    not received: address recognition sees to that.
    """

    names: tuple[str, ...]
    """The robots in the order of their addresses, and the base station."""
    sent: CountArray
    """(n,): frames that each began to send, acknowledgements included."""
    heard: CountArray
    """(n, n): [sender, listener] frames whose beginning the listener found."""

    def ratio(self) -> FloatArray:
        """Packet reception ratio [sender, listener]; NaN of who sent nothing, and to oneself."""
        with np.errstate(invalid="ignore"):
            found: FloatArray = np.where(
                self.sent[:, None] > 0, self.heard / np.maximum(self.sent[:, None], 1), np.nan
            )
        np.fill_diagonal(found, np.nan)
        return found


@dataclass(frozen=True, slots=True)
class ShoalData:
    """A run of several robots."""

    scenario: str
    description: str
    seed: int
    duration_s: float
    """Simulated time that was reached."""
    wall_s: float
    version: str
    trace_sha256: str
    tank: TankView
    robots: tuple[SwumRobot, ...]
    """In the order of their addresses."""
    whole: Mapping[str, Metric]
    """Metrics of the shoal."""
    hearing: Hearing
    changes: Changes | None = None
    interrupted: bool = False
    events: tuple[Event, ...] = ()
    commands: tuple[Command, ...] = ()
    lateness: Mapping[str, float] = field(default_factory=dict)
    """Of a real-time run: `maximum_s`, `p99_s`, `missed`."""
    hil: Mapping[str, Any] = field(default_factory=dict)
    """Nobody from outside takes part."""
    survey: SurveyData | None = None
    """What a survey found."""
