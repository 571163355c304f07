"""What separates the causes of an ambiguous diagnosis: a manoeuvre, or else an instrument.

The segments of ``manoeuvres`` are simulated under the explanations as they were fitted, sampled and
disturbed as the data at hand were; ``experiment_design`` chooses among them. Where sixty seconds,
even swum a few times, would not decide, no manoeuvre is proposed but the look at the robot that
does: two causes that every channel sees alike (a turned camera, a turned compass) can be told
apart by measuring one of them directly, and by nothing else.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plant.trajectory import Start
from tools import scenario
from tools.configuration import Scenario
from tools.diagnosis.experiment_design import (
    ENOUGH,
    MOST_REPEATS,
    Choice,
    Explanation,
    classes,
    exchange,
    gram,
    repeats,
    separations,
)
from tools.diagnosis.fish.channels import CHANNELS
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.manoeuvres import (
    LONGEST_S,
    SEGMENTS,
    Segment,
    as_scenario,
    blank,
    intervals,
    place,
)
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray, Noise, Run
from tools.diagnosis.options import Options
from tools.diagnosis.result import Diagnosis

FILE = "separating.toml"

_POTENTIOMETER = "fit a potentiometer to the tail (channel tail_angle_rad)"
_TOWING = "tow the hull at a known speed with a spring balance"
_BENCH = "swing the tail in air before the camera, commands and angle on one clock"
DIRECTLY: Mapping[str, str] = {
    "water_current": "let a cork drift in the tank and follow it with the camera",
    "tail_offset": "command a bias of zero and measure the tail's angle with a protractor, or "
    + _POTENTIOMETER,
    "tail_gain": _POTENTIOMETER,
    "tail_fade": f"{_POTENTIOMETER}, and record battery_v",
    "servo_lag": _BENCH,
    "servo_delay": _BENCH,
    "servo_rate_limit": _BENCH,
    "servo_deadband": _POTENTIOMETER,
    "servo_backlash": "move the tail by hand with the servo held, and measure its play",
    "drag_scale": _TOWING,
    "yaw_drag_scale": "let the hull turn in the water by a twisted wire of known stiffness",
    "lift_scale": "hold the robot by a force balance while its tail beats",
    "drag_vs_bias": f"{_TOWING}, with the tail held at several angles",
    "linear_drag": f"{_TOWING}, at several speeds; look for a tether or cable too",
    "added_mass_surge": "push the resting hull by a spring and record its oscillation along",
    "added_mass_sway": "push the resting hull by a spring and record its oscillation across",
    "added_inertia_yaw": "let the hull oscillate about the vertical on a twisted wire in water",
    "payload": "weigh the robot",
    "tail_flexibility": "clamp the tail's root, hang a weight from its tip, measure how it bends",
    "fin_damage": "look at the tail and measure its depth with a ruler",
    "tail_body_coupling": "hold the robot by a force balance in a flow while its tail beats",
    "wall_effect": "swim the same programme along a wall and in the middle of the tank",
    "gyro_bias": "read the gyro for a minute while the robot lies still",
    "gyro_scale": "turn the robot on a turntable by a known angle, and add up the gyro",
    "compass_offset": "lay the robot along an edge of known direction and read the compass",
    "compass_hard_iron": "turn the robot on the spot through a full turn and read the compass",
    "compass_soft_iron": "turn the robot on the spot through a full turn and read the compass",
    "camera_scale": "lay a ruler into the picture of the camera",
    "camera_rotation": "lay a straight edge along the tank's wall into the picture of the camera",
    "camera_delay": "let the robot switch a lamp at a known time, and look for it in the pictures",
    "clock_drift": "let both clocks stamp the same event twice, ten minutes apart",
    "stale_samples": "film a stopwatch and look for pictures that come twice",
    "dropped_commands": "record what arrives: the servo's own command (tail_command_rad)",
}
"""How to look at each cause itself, without any model of swimming."""

TYPICAL = Noise(
    np.array([1e-3, 1e-3, 1.4e-2, 4e-3, 1e-2]), np.array([1e-4, 1e-4, 2e-3]), np.array([0.7] * 3)
)
"""Noise of camera, gyro and compass where only a table was measured (assumed, as of the emulated
instruments), with the disturbances of calm water."""
_TYPICAL_S = (1.0 / 30.0, 1.0 / 30.0, 1.0 / 30.0, 0.02, 0.05)


@dataclass(frozen=True, slots=True)
class Proposal:
    """What to do: in words, as a scenario where a manoeuvre helps, and how much it separates."""

    why: str
    toml: str | None
    separation: float


def propose(found: Diagnosis, believed: Scenario, options: Options) -> Proposal | None:
    """Return what separates the first group of causes that the data cannot tell apart."""
    group = explanations(found, options)
    if len(group) < 2:
        return None
    model, noise, every_s, supply_v = _laboratory(found)
    known = {p.name for p in model.tolerances} | {
        p.name for cause in model.causes for p in cause.parameters
    }
    group = [
        Explanation(e.name, {k: x for k, x in e.values.items() if k in known}, e.spread)
        for e in group
    ]
    names = [channel.name for channel in model.channels]
    lab = Laboratory(model, noise, believed, tuple(names), tuple(every_s), supply_v)
    return lab.propose(group)


def explanations(found: Diagnosis, options: Options) -> list[Explanation]:
    """Return the sets of causes within the margin, for the first member that has rivals."""
    selection = found.selection
    if selection is None or not found.report.confusable:
        return []
    names = set(found.report.confusable[0])
    for rivals in selection.rivals:
        alike = [r for r in rivals if r.names[-1] in names]
        if len(alike) != len(names):
            continue
        made = []
        for rival in alike:
            free = [p for member in rival.members for p in member.cause.parameters]
            sd = np.sqrt(np.maximum(np.diag(rival.fit.covariance), 0.0))
            spread = {p.name: float(s) for p, s in zip(free, sd, strict=True)}
            made.append(Explanation(rival.names[-1], dict(rival.fit.point.shared), spread))
        return made
    return []


@dataclass(frozen=True, slots=True)
class Programme:
    """What to swim, its scenario (None: none fits the tank), and how much it separates."""

    segments: tuple[Segment, ...]
    config: Scenario | None
    separation: float

    @property
    def helps(self) -> bool:
        """Whether swimming it a few times decides."""
        return self.config is not None and repeats(self.separation) <= MOST_REPEATS


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The believed robot in its tank, with its noise, and how its instruments sample."""

    model: FishModel
    noise: Noise
    believed: Scenario
    names: tuple[str, ...]
    every_s: tuple[float | None, ...]
    supply_v: float | None

    def _gram(
        self, segments: Sequence[Segment], start: Start, group: Sequence[Explanation]
    ) -> tuple[FloatArray, FloatArray]:
        run = blank(segments, start, self.names, self.every_s, self.supply_v)
        return gram(self.model, run, self.noise, group)

    def _offered(
        self, group: Sequence[Explanation]
    ) -> tuple[list[Segment], list[Choice], FloatArray]:
        """Return the segments that fit the tank, each with what it tells; and the priors."""
        offered, choices = [], []
        precision: FloatArray = np.empty(0)
        for segment in SEGMENTS:
            start = place(self.model.plant, self.believed, [segment])
            if start is None:
                continue
            matrix, precision = self._gram([segment], start, group)
            offered.append(segment)
            choices.append(Choice(segment.duration_s, matrix, segment.wall))
        return offered, choices, precision

    def best_programme(self, group: Sequence[Explanation]) -> Programme:
        """Return the best segments."""
        offered, choices, precision = self._offered(group)
        if not choices:
            return Programme((), None, 0.0)
        chosen = [offered[i] for i in exchange(choices, precision, LONGEST_S)]
        start = place(self.model.plant, self.believed, chosen)
        while start is None and len(chosen) > 1:
            chosen = chosen[:-1]
            start = place(self.model.plant, self.believed, chosen)
        if start is None or not chosen:
            return Programme((), None, 0.0)
        separation = float(np.min(separations(*self._gram(chosen, start, group))))
        told = f"tells {_or([e.name for e in group])} apart"
        config = as_scenario(self.believed, chosen, start, told)
        return Programme(tuple(chosen), config, separation)

    def propose(self, group: Sequence[Explanation]) -> Proposal:
        """Return what tells explanations apart, or as many of them as any manoeuvre can."""
        rated = self.best_programme(group)
        if rated.helps:
            return _worded(rated, group)
        alike = [[group[i] for i in kind] for kind in self.indistinct(group)]
        first = [kind[0] for kind in alike]
        if 1 < len(first) < len(group):
            some = self.best_programme(first)
            if some.helps:
                return _worded(some, first, [kind for kind in alike if len(kind) > 1])
        return _worded(rated, group)

    def indistinct(self, group: Sequence[Explanation]) -> list[list[int]]:
        """Return the explanations in classes that all segments together do not tell apart."""
        _, choices, precision = self._offered(group)
        if not choices:
            return [list(range(len(group)))]
        total: FloatArray = np.sum([choice.gram for choice in choices], axis=0)
        return classes(total, precision, ENOUGH / MOST_REPEATS)


def _worded(
    rated: Programme,
    group: Sequence[Explanation],
    alike: Sequence[Sequence[Explanation]] = (),
) -> Proposal:
    """Return the words for a programme; ``alike``: those of whom ``group`` holds the first only."""
    separation, config = rated.separation, rated.config
    size = f"{separation:.0f}" if separation < 1000.0 else "over 1000"
    names = [each.name.replace("_", " ") for each in group]
    if config is None or not rated.helps:
        return Proposal(
            f"With the instruments at hand no manoeuvre of {LONGEST_S:g} s tells {_or(names)} "
            f"apart (expected separation {separation:.1f}, {ENOUGH:g} would be needed). Look at "
            f"one of them directly: {_looks(group)}.",
            None,
            separation,
        )
    swum = ", then ".join(_counted(rated.segments))
    times = repeats(separation)
    again = "" if times == 1 else f" Swim it {times} times: once is not decisive."
    wall = " Set it down beside the wall." if rated.segments[0].wall else ""
    rest = "".join(
        f" However it swims, {_and([each.name.replace('_', ' ') for each in kind])} look the same: "
        f"to tell these, {_looks(kind)}."
        for kind in alike
    )
    return Proposal(
        f"{swum}. There {_and(names)} predict different motion: afterwards the true one is "
        f"favoured at 20 to 1 or more in nine cases of ten (expected separation {size}; "
        f"{ENOUGH:g} are needed).{again}{wall}{rest}",
        scenario.to_toml(config),
        separation,
    )


def _looks(group: Sequence[Explanation]) -> str:
    """Return how to look at each of some causes itself."""
    return "; or ".join(
        f"for {each.name.replace('_', ' ')}, {DIRECTLY[each.name]}"
        for each in group
        if each.name in DIRECTLY
    )


def _counted(segments: Sequence[Segment]) -> list[str]:
    """Return what is swum in words, the same several times running told once."""
    told = []
    for words, same in itertools.groupby(segment.words for segment in segments):
        times = len(list(same))
        told.append(words if times == 1 else f"{times} × {words}")
    return told


def _laboratory(found: Diagnosis) -> tuple[FishModel, Noise, list[float | None], float | None]:
    """Return model, noise, and how channels are sampled: as measured, or typical for a table."""
    problem = found.problem
    model = problem.model
    if not isinstance(model, FishModel):
        plant = model.plant  # type: ignore[attr-defined]  # of steady motion
        fish = FishModel(plant, [channel.name for channel in CHANNELS[:5]])
        return fish, TYPICAL, [*_TYPICAL_S], None
    runs: Sequence[Run] = problem.runs
    supplies = [r.inputs.supply_v for r in runs if isinstance(r.inputs, FishInputs)]
    supply_v = next((v for v in supplies if v is not None), None)
    return model, problem.noise, intervals(runs, len(model.channels)), supply_v


def _or(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} from {names[-1]}" if len(names) > 1 else "".join(names)


def _and(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
