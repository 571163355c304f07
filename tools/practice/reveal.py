"""How well a diagnosis found what was hidden: its words against the answer.

A score is a name of ``SCORES``; `exact` asks for the true causes and no other, `in_set` for every
true cause to be among those that the diagnosis reports or calls indistinguishable from them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.errors import UserError
from tools.practice.folder import unseal

SCORES = {
    "exact": "what was hidden was named, and nothing else",
    "in_set": "what was hidden is among the causes that were reported as indistinguishable",
    "unexplained": "something was seen, and not named",
    "wrong": "another cause was named",
    "missed": "nothing was seen",
    "false_alarm": "something was reported where nothing was hidden",
}
NO_CAUSE = "unknown_force"


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number of a hidden effect: true value, estimate with its standard error or None."""

    cause: str
    parameter: str
    truth: float
    estimate: float | None
    standard_error: float | None
    unit: str

    @property
    def errors(self) -> float | None:
        """Distance of the estimate from the truth in standard errors."""
        if self.estimate is None or not self.standard_error:
            return None
        error = self.estimate - self.truth
        if self.parameter == "phi_rad":  # a phase: a turn more or less is none
            error = math.remainder(error, 2.0 * math.pi)
        return error / self.standard_error


@dataclass(frozen=True, slots=True)
class Revealed:
    """A diagnosis beside its answer."""

    kind: str
    hidden: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    reported: tuple[str, ...]
    score: str
    estimates: tuple[Estimate, ...]
    gain: float | None


def reveal(place: Path, diagnosis: Path | None = None) -> Revealed:
    """Score the diagnosis in a folder against its answer.

    Raises ``UserError`` where either is missing.
    """
    answer = unseal(place)
    file = find(place) if diagnosis is None else diagnosis
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"{file}: is not there") from None
    except ValueError as error:
        raise UserError(f"{file}: is no diagnosis ({error})") from error
    return score(answer, document)


def find(place: Path) -> Path:
    """Return where `fishbed diagnose` has left its diagnosis of a folder, if it has."""
    for file in (place / "diagnosis" / "diagnosis.json", place / "diagnosis.json"):
        if file.exists():
            return file
    raise UserError(f"{place}: was not diagnosed yet; run `fishbed diagnose {place}` first")


def score(answer: Mapping[str, Any], document: Mapping[str, Any]) -> Revealed:
    """Score one diagnosis (the document of diagnosis.json) against an answer."""
    hidden = tuple(effect["name"] for effect in answer["effects"])
    verdict = document["verdict"]
    named = tuple(cause["name"] for cause in document["causes"])
    alike = {name for group in document.get("confusable", ()) for name in group}
    reported = tuple(dict.fromkeys((*named, *sorted(alike))))
    held = document.get("held_out") or {}
    return Revealed(
        kind=answer["kind"],
        hidden=hidden,
        verdict=verdict,
        named=named,
        reported=reported,
        score=_score(answer["kind"], hidden, verdict, named, reported),
        estimates=tuple(_estimates(answer, document)),
        gain=held.get("gain"),
    )


def _score(
    kind: str,
    hidden: tuple[str, ...],
    verdict: str,
    named: tuple[str, ...],
    reported: tuple[str, ...],
) -> str:
    if kind == "none":
        return "exact" if verdict == "nothing_wrong" else "false_alarm"
    if verdict == "nothing_wrong":
        return "missed"
    if kind == "unlisted":
        return "exact" if verdict == "unexplained" or NO_CAUSE in named else "wrong"
    if verdict == "named" and set(named) == set(hidden):
        return "exact"
    if set(hidden) <= set(reported):
        return "in_set"
    if verdict == "unexplained" or set(named) <= {NO_CAUSE}:
        return "unexplained"
    return "wrong"


def _estimates(answer: Mapping[str, Any], document: Mapping[str, Any]) -> list[Estimate]:
    found = {cause["name"]: cause["parameters"] for cause in document["causes"]}
    rows = []
    for effect in answer["effects"]:
        for name, truth in effect["parameters"].items():
            told = found.get(effect["name"], {}).get(name)
            rows.append(
                Estimate(
                    effect["name"],
                    name,
                    truth,
                    told and told["estimate"],
                    told and told["standard_error"],
                    told["unit"] if told else "",
                )
            )
    return rows
