"""The same laboratory with the whole emulated robot in it: boards, servo pulses, chips, the link.

What is believed is `fishbed-robot`. Commands go by radio, the camera and the navigation board
report, and the run's `channels.csv` is the measured run. Effects are those that a scenario can
express: the plant's.

Healthy sets come in the forms that users have (``FORMS``): what alarms may be the form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from plant.effects import EFFECTS
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from tools.practice.experiment import (
    DURATION_S,
    RUNS,
    TOLERANCES,
    Effect,
    Plan,
    laboratory,
    plan,
    stream,
)
from tools.practice.hidden import HIDDEN

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.data import Series

BELIEVED = "fishbed-robot"
EMULATED = tuple(name for name in HIDDEN if name in EFFECTS and name != "tail_flexibility")
"""Effects that an emulated robot can have; bending tails take too long."""


@dataclass(frozen=True, slots=True)
class Form:
    """What a set of runs is like; ``accelerometer``: whether it was recorded."""

    runs: int
    duration_s: float
    planned: Callable[[int, int, float], Plan]
    accelerometer: bool = True


def one_beat(seed: int, run: int, duration_s: float) -> Plan:
    """Draw a run of one beat, as `fishbed run` makes it: a turn, and every third straight ahead.

    That one swims along the edge of the squares in which a tank is looked at.
    """
    draw = stream(seed, 14, run)
    if run % 3 == 2:
        ahead = TailBeat.degrees(0.0, float(draw.uniform(10.0, 20.0)), 0.9)
        return Plan(TailProgramme((ahead,), (0.0,)), Start(-1.5, 0.0, 0.0))
    bias = float(draw.choice((-1.0, 1.0)) * draw.uniform(10.0, 34.0))  # a tail goes to 60°
    beat = TailBeat.degrees(bias, float(draw.uniform(10.0, 25.0)), float(draw.uniform(0.6, 1.5)))
    heading = float(draw.uniform(-3.1, 3.1))
    return Plan(TailProgramme((beat,), (0.0,)), Start(0.0, 0.0, heading))


FORMS = (
    Form(RUNS, DURATION_S, plan),
    Form(1, DURATION_S, one_beat),
    Form(3, 40.0, one_beat),
    Form(1, 120.0, plan),
    Form(3, DURATION_S, plan, accelerometer=False),
    Form(1, DURATION_S, one_beat, accelerometer=False),
)
"""Of healthy sets, in turn. A single run is cut into pieces that begin in motion; one beat says
little of the tolerances."""


def scenario_of(
    seed: int, run: int, effects: Sequence[Effect], planned: Plan, duration_s: float
) -> Scenario:
    """Return the scenario in which one run is swum."""
    from tools import scenario
    from tools.configuration import TimedTailBeat

    truth = laboratory(seed).parameters
    sets = [
        f"effects.{effect.name}.{key}={value!r}"
        for effect in effects
        for key, value in effect.parameters().items()
    ]
    for section, keys in TOLERANCES.items():
        part = getattr(truth, section)
        sets += [f"plant.{section}.{key}={float(getattr(part, key))!r}" for key in keys]
    start, programme = planned.start, planned.programme
    first = programme.beats[0]
    sets += [
        f"initial.x_m={start.x_m!r}",
        f"initial.y_m={start.y_m!r}",
        f"initial.heading_rad={start.heading_rad!r}",
        f"procboard.tail_beat.bias_rad={first.bias_rad!r}",
        f"procboard.tail_beat.amplitude_rad={first.amplitude_rad!r}",
        f"procboard.tail_beat.frequency_hz={first.frequency_hz!r}",
    ]
    config = scenario.load(BELIEVED, sets, duration_s=duration_s, seed=seed * 16 + run)
    later = tuple(
        TimedTailBeat(
            at_s=at_s,
            bias_rad=beat.bias_rad,
            amplitude_rad=beat.amplitude_rad,
            frequency_hz=beat.frequency_hz,
        )
        for at_s, beat in zip(programme.starts_s[1:], programme.beats[1:], strict=True)
    )
    station = msgspec.structs.replace(config.base_station, tail_beats=later)
    return msgspec.structs.replace(config, base_station=station)


def swim_emulated(
    seed: int,
    effects: Sequence[Effect] = (),
    runs: int = RUNS,
    duration_s: float = DURATION_S,
    planned: Callable[[int, int, float], Plan] = plan,
) -> dict[str, dict[str, Series]]:
    """Run the emulated robot through an experiment; the channels of each run, by its name.

    ``planned``: makes the manoeuvres of a run from seed, run and duration.
    """
    from firmware_model.time import from_seconds
    from tools.bench import Bench

    swum = {}
    for run in range(runs):
        config = scenario_of(seed, run, effects, planned(seed, run, duration_s), duration_s)
        bench = Bench.from_scenario(config)
        bench.scheduler.run(from_seconds(duration_s))
        channels = bench.run_data(compare=False).channels
        swum[f"run{run + 1:02d}"] = dict(channels)
    return swum


def swim_healthy(seed: int) -> dict[str, dict[str, Series]]:
    """Run the healthy robot through an experiment of the form whose turn it is."""
    form = FORMS[seed % len(FORMS)]
    swum = swim_emulated(seed, (), form.runs, form.duration_s, form.planned)
    if form.accelerometer:
        return swum
    return {
        run: {name: s for name, s in channels.items() if not name.startswith("accel")}
        for run, channels in swum.items()
    }
