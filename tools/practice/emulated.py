"""The same laboratory with the whole emulated robot in it: boards, servo pulses, chips, the link.

What is believed is `fishbed-robot`. Commands go by radio, the camera and the navigation board
report, and the run's `channels.csv` is the measured run. Effects are those that a scenario can
express: the plant's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec

from plant.effects import EFFECTS
from tools.practice.experiment import (
    DURATION_S,
    TOLERANCES,
    Effect,
    Plan,
    laboratory,
    plan,
)
from tools.practice.hidden import HIDDEN

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.data import Series

BELIEVED = "fishbed-robot"
EMULATED = tuple(name for name in HIDDEN if name in EFFECTS and name != "tail_flexibility")
"""Effects that an emulated robot can have; bending tails take too long."""


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
    runs: int = 6,
    duration_s: float = DURATION_S,
) -> dict[str, dict[str, Series]]:
    """Run the emulated robot through an experiment; the channels of each run, by its name."""
    from firmware_model.time import from_seconds
    from tools.bench import Bench

    swum = {}
    for run in range(runs):
        config = scenario_of(seed, run, effects, plan(seed, run, duration_s), duration_s)
        bench = Bench.from_scenario(config)
        bench.scheduler.run(from_seconds(duration_s))
        channels = bench.run_data(compare=False).channels
        swum[f"run{run + 1:02d}"] = dict(channels)
    return swum
