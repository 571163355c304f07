"""One set of the benchmark: made, diagnosed as a folder, scored, and told in a row of the journal.

A set is drawn from its part, seed and number alone. What it hides is known to the scoring only: the
diagnosis is given the folder.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.practice import folder
from tools.practice.draw import TWO_LEAST
from tools.practice.experiment import Effect, shape_of, stream, swim_experiment
from tools.practice.hidden import LISTED, UNLISTED
from tools.practice.reveal import NO_CAUSE, score
from tools.practice.strength import likeness, sized

if TYPE_CHECKING:
    from tools.diagnosis.fish.model import FishModel
    from tools.diagnosis.result import Diagnosis

TIMING = "timing"
"""Sets that are diagnosed one after the other with all processors, for the wall time."""
HEALTHY_ROBOT = "healthy-emulated"
"""Sets that the emulated robot swims with nothing hidden, of every form that users have."""
PARTS = (
    "exact",
    "healthy",
    "two",
    "unlisted",
    "taken-out",
    "emulated",
    HEALTHY_ROBOT,
    "curve",
    TIMING,
)
ALIKE = 0.9
"""|cosine| from which causes look alike."""
EXACT = 100.0
CURVE = (25.0, 50.0, 200.0, 400.0)
UNKNOWN = (100.0, 400.0)
"""Strengths of effects that are in no table: what has no shape that is looked for shows later."""
_FIRST_SEED = 100_000
_SEEDS = {
    "healthy": 300,
    "two": 60,
    "unlisted": 5,
    "taken-out": 2,
    "emulated": 1,
    HEALTHY_ROBOT: 60,
    TIMING: 1,
}
_STREAMS = {"healthy": 2, "two": 3, "unlisted": 4, "emulated": 5, HEALTHY_ROBOT: 6}
"""The same experiments where effects are to be compared, others where sets shall be new."""
_FEWEST = 10


@dataclass(frozen=True, slots=True)
class Case:
    """One set; ``strength``: λ of each effect that is wanted."""

    part: str
    seed: int
    names: tuple[str, ...]
    strength: float

    @property
    def key(self) -> str:
        """What tells it from others in a journal."""
        return f"{self.part}/{self.seed}/{'+'.join(self.names)}/{self.strength:g}"


def cases(part: str, seeds: int | None) -> Iterator[Case]:
    """Yield the sets of a part, seed by seed; ``seeds`` None: as many as the benchmark wants."""
    from tools.practice.emulated import EMULATED

    count = _SEEDS.get(part, _FEWEST) if seeds is None else seeds
    begin = _FIRST_SEED * _STREAMS.get(part, 1)
    for seed in range(begin, begin + count):
        if part in ("healthy", HEALTHY_ROBOT):
            yield Case(part, seed, (), 0.0)
        elif part == "two":
            pair = stream(seed, 11).choice(LISTED, 2, replace=False)
            yield Case(part, seed, tuple(str(name) for name in pair), TWO_LEAST)
        elif part == "curve":
            name = str(stream(seed, 12).choice(LISTED))
            for strength in CURVE:
                yield Case(part, seed, (name,), strength)
        else:
            names = {"unlisted": UNLISTED, "emulated": EMULATED}.get(part, LISTED)
            order = stream(seed, 13).permutation(len(names))
            for index in order:
                for strength in UNKNOWN if part == "unlisted" else (EXACT,):
                    yield Case(part, seed, (names[index],), strength)


def perform(case: Case, workers: int | None, cache: Path | None) -> dict[str, Any]:
    """Make a set, diagnose and score it; a crash is a row too. Calibrations are timed, too."""
    cache = None if case.part == TIMING else cache
    row: dict[str, Any] = {
        "key": case.key,
        "part": case.part,
        "seed": case.seed,
        "hidden": list(case.names),
        "strength": case.strength,
    }
    begin = time.perf_counter()
    try:
        row |= _perform(case, workers, cache)
    except Exception as error:  # whatever it is: a solver that crashes is a miss
        row |= {"score": "crashed", "error": repr(error), "where": traceback.format_exc(limit=-3)}
    return row | {"wall_s": round(time.perf_counter() - begin, 1)}


def _perform(case: Case, workers: int | None, cache: Path | None) -> dict[str, Any]:
    from tools.diagnosis.command import to_json
    from tools.diagnosis.data.experiment import fish_model, read_experiment
    from tools.diagnosis.engine import diagnose
    from tools.diagnosis.options import Options

    found = [sized(case.seed, name, case.strength) for name in case.names]
    effects = tuple(
        Effect(name, size, shape_of(name, case.seed))
        for name, (size, _) in zip(case.names, found, strict=True)
    )
    row: dict[str, Any] = {
        "sizes": [effect.size for effect in effects],
        "reached": [reached for _, reached in found],
    }
    kinds = {"healthy": "none", HEALTHY_ROBOT: "none", "two": "two", "unlisted": "unlisted"}
    kind = kinds.get(case.part, "one")
    answer = folder.answer(case.seed, kind, case.strength, effects)
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory) / "set"
        if case.part == "emulated":
            from tools.practice.emulated import BELIEVED, swim_emulated

            folder.write(place, "set", BELIEVED, swim_emulated(case.seed, effects), answer)
        elif case.part == HEALTHY_ROBOT:
            from tools.practice.emulated import BELIEVED, swim_healthy

            folder.write(place, "set", BELIEVED, swim_healthy(case.seed), answer)
        else:
            folder.write(place, "set", "wang2014", swim_experiment(case.seed, effects), answer)
        experiment = read_experiment(place)
    model = fish_model(experiment)
    if case.part == "taken-out":
        take_out(model, case.names[0])
    begin = time.perf_counter()
    diagnosis = diagnose(model, experiment.runs, Options(workers=workers, cache=cache))
    seconds = time.perf_counter() - begin
    scored = score(answer, json.loads(to_json(diagnosis.report)))
    row |= {
        "verdict": scored.verdict,
        "named": list(scored.named),
        "reported": list(scored.reported),
        "score": scored.score,
        "gain": scored.gain,
        "errors": {f"{e.cause}.{e.parameter}": e.errors for e in scored.estimates},
        "best": [(line.name, round(line.gain, 1)) for line in diagnosis.ranking[:5]],
        "rivals": [
            [(r.names[-1], round(r.evidence - rivals[0].evidence, 1)) for r in rivals[:4]]
            for rivals in (diagnosis.selection.rivals if diagnosis.selection else ())
        ],
        "threshold": diagnosis.threshold,
        "notes": list(diagnosis.report.notes),
        "remaining": diagnosis.report.remaining_structure.where,
        "diagnosis_s": round(seconds, 1),
        "calibration_s": round(diagnosis.seconds.get("calibration", 0.0), 1),
        "cached": diagnosis.calibration.cached,
    }
    if case.part in ("exact", "curve"):
        row["look_alikes"] = look_alikes(diagnosis, case.names[0])
        row["held_out_share"] = share_of_oracle(diagnosis, answer)
    if case.part == "taken-out" and diagnosis.values and NO_CAUSE not in scored.named:
        row["likeness"] = likeness(case.seed, effects, diagnosis.values)
    return row


def take_out(model: FishModel, name: str) -> None:
    """Take a cause out of the table of a model."""
    model.restrict(tuple(cause.name for cause in model.causes if cause.name != name))


def look_alikes(diagnosis: Diagnosis, name: str) -> list[str] | None:
    """Return the causes that these data can hardly tell from one; None: it cannot be seen."""
    if name not in diagnosis.names:
        return None
    own = diagnosis.names.index(name)
    return [
        other
        for i, other in enumerate(diagnosis.names)
        if i != own and diagnosis.cosines[own, i] >= ALIKE
    ]


def share_of_oracle(diagnosis: Diagnosis, answer: Mapping[str, Any]) -> float | None:
    """Return what was gained on held-out runs, relative to a refit that knows the causes.

    Both are gains in twice the log-likelihood under the final whitening; the oracle starts at the
    true values. None where it gains nothing there.
    """
    from dataclasses import replace

    from tools.diagnosis.held_out import Split, compare
    from tools.diagnosis.options import Options
    from tools.diagnosis.selection import table, without
    from tools.diagnosis.workers import Workers

    final, options = diagnosis.stage, Options()
    held = [i for i, held in enumerate(diagnosis.traces.held_out) if held]
    before, after = diagnosis.traces.innovations_before, diagnosis.traces.innovations_after
    gained = sum(float(before[i] @ before[i] - after[i] @ after[i]) for i in held)
    rows = table(diagnosis.problem)
    members = [rows[effect["name"]] for effect in answer["effects"]]
    if {m.cause.name for m in members} == {m.cause.name for m in final.members}:
        return 1.0
    truth: dict[str, float] = {}
    for member, effect in zip(members, answer["effects"], strict=True):
        numbers = list(effect["parameters"].values())
        if member.cause.show is not None:
            size, angle = numbers
            numbers = [size * math.cos(angle), size * math.sin(angle)]
        truth |= member.cause.values(*numbers)
    point = without(final.point, final.members).moved(truth)
    # the diagnosis has sent its own workers home
    problem = replace(final.problem, workers=Workers(1))
    start = replace(final, problem=problem, fit=replace(final.fit, point=point))
    rest = tuple(i for i, flag in enumerate(diagnosis.traces.held_out) if not flag)
    oracle = compare(start, members, Split(rest, tuple(held), None, ""), {}, options)
    return gained / oracle.evidence if oracle.evidence > 0.0 else None
