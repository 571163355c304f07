"""What a diagnosis hands over: `Report`, which is diagnosis.json, and `Diagnosis` with arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import msgspec

from tools.diagnosis.calibration import Calibration, NullLaw
from tools.diagnosis.evidence import Point, Problem
from tools.diagnosis.model import FloatArray
from tools.diagnosis.selection import Selection, Stage

Verdict = Literal["nothing_wrong", "named", "ambiguous", "unexplained"]


class Estimate(msgspec.Struct, frozen=True):
    """A parameter: its estimate and standard error, in ``unit``."""

    estimate: float
    standard_error: float
    unit: str


class NamedCause(msgspec.Struct, frozen=True):
    """A cause: parameters by their short names, and how improbable its gain is if healthy."""

    name: str
    parameters: dict[str, Estimate]
    p_value: float
    statement: str


class ProposedExperiment(msgspec.Struct, frozen=True):
    """What would separate what cannot be told apart; ``scenario`` null: no manoeuvre would.

    ``separation``: expected gain of the true explanation in twice the log-likelihood.
    """

    why: str
    scenario: str | None
    separation: float | None = None


class HeldOut(msgspec.Struct, frozen=True):
    """The gain on runs that the fit never saw; errors per channel, in its unit."""

    runs: list[str]
    rmse_before: dict[str, float]
    rmse_after: dict[str, float]
    gain: float
    gain_ci95: tuple[float, float]
    noise_floor: dict[str, float]


class RemainingStructure(msgspec.Struct, frozen=True):
    """Whether what is left is more than noise, and where it stands."""

    found: bool
    where: str


class Report(msgspec.Struct, frozen=True):
    """diagnosis.json. ``smallest_detectable`` is null where no size could be seen."""

    verdict: Verdict
    causes: list[NamedCause]
    confusable: list[list[str]]
    proposed_experiment: ProposedExperiment | None
    held_out: HeldOut
    smallest_detectable: dict[str, float | None]
    remaining_structure: RemainingStructure
    extended_model: str | None
    seed: int
    notes: list[str] = []


@dataclass(frozen=True, slots=True)
class Ranked:
    """One line of the ranking: robust gain on the one-parameter scale, alone, and its p-value."""

    name: str
    kind: str
    gain: float
    p_value: float


@dataclass(frozen=True, slots=True)
class Traces:
    """Per run: whitened innovations and replays of the believed and of the extended model."""

    held_out: tuple[bool, ...]
    innovations_before: tuple[FloatArray, ...]
    innovations_after: tuple[FloatArray, ...]
    replay_before: tuple[FloatArray, ...]
    replay_after: tuple[FloatArray, ...]
    spread: tuple[FloatArray, ...]
    """Standard deviations of draws of the extended model: the band around ``replay_after``."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The report and everything that a page about it shows.

    ``values``: the extended model's values of causes (as fitted on the training runs).
    ``before`` and ``after``: with all nuisances. ``stage``: what is included, with all runs.
    ``names`` and ``cosines``: the confusability map.
    """

    report: Report
    values: dict[str, float]
    before: Point
    after: Point
    stage: Stage
    selection: Selection | None
    law: NullLaw
    calibration: Calibration
    threshold: float
    ranking: tuple[Ranked, ...]
    names: tuple[str, ...]
    cosines: FloatArray
    traces: Traces
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """All runs, with the whitening under which they were compared."""
        return self.stage.problem
