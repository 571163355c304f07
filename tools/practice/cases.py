"""One set of the benchmark: made, diagnosed as a folder, scored, and told in a row of the journal.

A set is drawn from its part, seed and number alone. What it hides is known to the scoring only: the
diagnosis is given the folder.
"""

from __future__ import annotations

import json
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.practice import folder
from tools.practice.draw import TWO_LEAST
from tools.practice.experiment import DURATION_S, RUNS, Effect, shape_of, stream, swim_experiment
from tools.practice.hidden import HIDDEN, LISTED, UNLISTED
from tools.practice.reveal import NO_CAUSE, Revealed, score
from tools.practice.strength import likeness, sized, true_noise

if TYPE_CHECKING:
    from tools.diagnosis.fish.model import FishModel
    from tools.diagnosis.options import Options
    from tools.diagnosis.result import Diagnosis

TIMING = "timing"
"""Sets that the whole command diagnoses, one after the other, for the wall time."""
HEALTHY_EMULATED = "healthy-emulated"
"""Sets that the emulated robot swims with nothing hidden, of every form that users have."""
BY_ROBOT = ("emulated", HEALTHY_EMULATED)
"""Parts whose sets the whole emulated robot swims."""
JUDGED = ("exact", "curve", "two")
"""Parts in which the gain on held-out runs is compared with an oracle's."""
PARTS = (
    "exact",
    "healthy",
    "two",
    "unlisted",
    "taken-out",
    "emulated",
    HEALTHY_EMULATED,
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
    HEALTHY_EMULATED: 60,
    TIMING: 5,
}
_STREAMS = {"healthy": 2, "two": 3, "unlisted": 4, "emulated": 5, TIMING: 6, HEALTHY_EMULATED: 7}
"""The same experiments where effects are to be compared, others where sets shall be new."""
_FEWEST = 10


@dataclass(frozen=True, slots=True)
class Case:
    """One set; ``strength``: λ of each effect that is wanted."""

    part: str
    seed: int
    names: tuple[str, ...]
    strength: float
    runs: int = RUNS
    duration_s: float = DURATION_S

    @property
    def key(self) -> str:
        """What tells it from others in a journal."""
        return f"{self.part}/{self.seed}/{'+'.join(self.names)}/{self.strength:g}"

    @property
    def kind(self) -> str:
        """What it hides, as an answer calls it."""
        if not self.names:
            return "none"
        if not all(HIDDEN[name].listed for name in self.names):
            return "unlisted"
        return "one" if len(self.names) == 1 else "two"


def cases(part: str, seeds: int | None) -> Iterator[Case]:
    """Yield the sets of a part, seed by seed; ``seeds`` None: as many as the benchmark wants."""
    from tools.practice.emulated import EMULATED

    count = _SEEDS.get(part, _FEWEST) if seeds is None else seeds
    begin = _FIRST_SEED * _STREAMS.get(part, 1)
    for seed in range(begin, begin + count):
        if part in ("healthy", HEALTHY_EMULATED):
            yield Case(part, seed, (), 0.0)
        elif part == "two":
            pair = stream(seed, 11).choice(LISTED, 2, replace=False)
            yield Case(part, seed, tuple(str(name) for name in pair), TWO_LEAST)
        elif part == "curve":
            name = str(stream(seed, 12).choice(LISTED))
            for strength in CURVE:
                yield Case(part, seed, (name,), strength)
        elif part == TIMING:
            # every kind of verdict takes another time
            draw = stream(seed, 14)
            one, two = draw.choice(LISTED, 2, replace=False)
            yield Case(part, seed, (), 0.0)
            yield Case(part, seed, (str(one),), EXACT)
            yield Case(part, seed, (str(one), str(two)), TWO_LEAST)
            yield Case(part, seed, (str(draw.choice(UNLISTED)),), max(UNKNOWN))
        else:
            names = {"unlisted": UNLISTED, "emulated": EMULATED}.get(part, LISTED)
            order = stream(seed, 13).permutation(len(names))
            for index in order:
                for strength in UNKNOWN if part == "unlisted" else (EXACT,):
                    yield Case(part, seed, (names[index],), strength)


def perform(case: Case, options: Options) -> dict[str, Any]:
    """Make a set, diagnose and score it; a crash is a row too, with what was known until then."""
    row: dict[str, Any] = {
        "key": case.key,
        "part": case.part,
        "seed": case.seed,
        "hidden": list(case.names),
        "strength": case.strength,
    }
    begin = time.perf_counter()
    try:
        for told in _performed(case, options):
            row |= told
    except Exception as error:  # whatever it is: a solver that crashes is a miss
        row |= {"score": "crashed", "error": repr(error), "where": traceback.format_exc(limit=-3)}
    return row | {"wall_s": round(time.perf_counter() - begin, 1)}


def _performed(case: Case, options: Options) -> Iterator[dict[str, Any]]:
    """Yield what a row tells of a set, step by step."""
    effects, reached = hide(case)
    yield {"sizes": [effect.size for effect in effects], "reached": reached}
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory) / "set"
        answer = make(case, effects, place)
        if case.part == TIMING:
            from tools.practice.timing import timed

            document, times = timed(place)
            yield _scored(score(answer, document)) | {"times": times}
            return
        diagnosis = diagnosed(case, place, options)
    scored = scored_by(answer, diagnosis)
    yield _scored(scored) | _traced(diagnosis)
    if case.kind == "one":
        yield {"look_alikes": look_alikes(diagnosis, case.names[0])}
    if case.part in JUDGED:
        from tools.practice.oracle import judge

        judged = judge(diagnosis, answer["effects"], true_noise(case.seed), options.workers)
        yield {"held_out": asdict(judged)}
    if case.part == "taken-out" and diagnosis.values and NO_CAUSE not in scored.named:
        told = likeness(case.seed, effects, diagnosis.values, case.runs, case.duration_s)
        yield {"likeness": told}


def hide(case: Case) -> tuple[tuple[Effect, ...], list[float]]:
    """Return the effects of a set in the sizes that it wants, and the λ that each of them has."""
    found = [sized(case.seed, n, case.strength, case.runs, case.duration_s) for n in case.names]
    effects = tuple(
        Effect(name, size, shape_of(name, case.seed))
        for name, (size, _) in zip(case.names, found, strict=True)
    )
    return effects, [reached for _, reached in found]


def make(case: Case, effects: tuple[Effect, ...], place: Path) -> dict[str, Any]:
    """Swim a set and write its folder; return what it hides."""
    answer = folder.answer(case.seed, case.kind, case.strength, effects)
    if case.part in BY_ROBOT:
        from tools.practice.emulated import BELIEVED, swim_emulated, swim_healthy

        if case.part == HEALTHY_EMULATED:
            swum = swim_healthy(case.seed)
        else:
            swum = swim_emulated(case.seed, effects, case.runs, case.duration_s)
        folder.write(place, "set", BELIEVED, swum, answer)
    else:
        swum = swim_experiment(case.seed, effects, case.runs, case.duration_s)
        folder.write(place, "set", "wang2014", swum, answer)
    return answer


def diagnosed(case: Case, place: Path, options: Options) -> Diagnosis:
    """Diagnose the folder of a set."""
    from tools.diagnosis.data.experiment import fish_model, read_experiment
    from tools.diagnosis.engine import diagnose

    experiment = read_experiment(place)
    model = fish_model(experiment)
    if case.part == "taken-out":
        take_out(model, case.names[0])
    return diagnose(model, experiment.runs, options)


def scored_by(answer: dict[str, Any], diagnosis: Diagnosis) -> Revealed:
    """Score a diagnosis by the document that it would write."""
    from tools.diagnosis.command import to_json

    return score(answer, json.loads(to_json(diagnosis.report)))


def _scored(scored: Revealed) -> dict[str, Any]:
    """What a row tells of a score; ``estimates`` of the true causes that were named."""
    return {
        "verdict": scored.verdict,
        "named": list(scored.named),
        "reported": list(scored.reported),
        "score": scored.score,
        "gain": scored.gain,
        "estimates": [asdict(each) for each in scored.estimates if each.cause in scored.named],
    }


def _traced(diagnosis: Diagnosis) -> dict[str, Any]:
    """What a row tells of how a diagnosis came about."""
    return {
        "best": [(line.name, round(line.gain, 1)) for line in diagnosis.ranking[:5]],
        "rivals": [
            [(r.names[-1], round(r.evidence - rivals[0].evidence, 1)) for r in rivals[:4]]
            for rivals in (diagnosis.selection.rivals if diagnosis.selection else ())
        ],
        "threshold": diagnosis.threshold,
        "notes": list(diagnosis.report.notes),
        "remaining": diagnosis.report.remaining_structure.where,
        "seconds": {part: round(s, 1) for part, s in diagnosis.seconds.items()},
        "cached": diagnosis.calibration.cached,
    }


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
