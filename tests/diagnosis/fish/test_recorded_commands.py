"""Commands that were recorded in place of beats, for an ideal tail and for a servo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from plant.parameters import PlantParameters, Servo
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from tests.diagnosis.fish.fish_runs import NAMES, blank
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.fish.spline import jumps
from tools.diagnosis.model import FloatArray, Run

PERIOD_S = 0.02


def angle(programme: TailProgramme, time_s: FloatArray) -> FloatArray:
    """What a programme tells at each time, phase running on: straight from the definition."""
    result = np.empty(time_s.size)
    phase, last = 0.0, 0.0
    which = np.searchsorted(programme.starts_s, time_s + 1e-9, side="right") - 1
    for i, (t, k) in enumerate(zip(time_s, which, strict=True)):
        beat = programme.beats[k]
        begin = max(last, programme.starts_s[k])
        before = programme.beats[which[i - 1]] if i else beat
        phase += (
            2 * math.pi * (before.frequency_hz * (begin - last) + beat.frequency_hz * (t - begin))
        )
        last = t
        result[i] = beat.bias_rad + beat.amplitude_rad * math.sin(phase)
    return result


def with_record(run: Run) -> Run:
    time_s = np.arange(0.0, 20.0 + PERIOD_S, PERIOD_S)
    record = angle(run.inputs.programme, time_s)
    empty = TailProgramme.steady(TailBeat())
    return replace(run, inputs=FishInputs(empty, time_s, record))


def predicted(plant: PlantParameters, run: Run) -> FloatArray:
    fish = FishModel(plant, NAMES)
    result = np.full(run.value.size, np.nan)
    fish._predict(fish._of({}), run, fish._plans.of(run), result, None)
    return -result


@pytest.mark.parametrize(
    "servo",
    [
        Servo(ideal=True),
        Servo(ideal=True, command_lag_s=0.12),
        Servo(ideal=True, command_delay_s=0.1),
    ],
    ids=["plain", "lag", "delay"],
)
def test_an_ideal_tail_does_the_same_by_samples_as_by_beats(servo: Servo) -> None:
    plant = replace(wang2014(), servo=servo)
    run = blank(1)
    programme = replace(run.inputs.programme, starts_s=(0.0, 6.0, 13.0))
    run = replace(run, inputs=FishInputs(programme))
    beats, samples = predicted(plant, run), predicted(plant, with_record(run))
    # a record does not say what was told before it: behind a lag or delay the beginnings differ,
    # and so does the place that the robot comes to; it swims in the same way
    later = run.time_s > 4.0
    here = (run.channel == 3) & later
    assert np.abs(beats[here] - samples[here]).max() < 2e-2 * np.abs(beats[here]).max()
    if servo == Servo(ideal=True):
        for channel, bound in ((0, 5e-4), (1, 5e-4), (2, 2e-3)):
            here = run.channel == channel
            away = beats[here] - samples[here]
            assert np.abs(np.arctan2(np.sin(away), np.cos(away))).max() < bound


def test_a_servo_holds_what_it_was_told() -> None:
    run = blank(1)
    programme = replace(run.inputs.programme, starts_s=(0.0, 6.0, 13.0))
    run = replace(run, inputs=FishInputs(programme))
    beats, samples = (
        predicted(PlantParameters(), run),
        predicted(PlantParameters(), with_record(run)),
    )
    here = run.channel == 3
    # holding for 20 ms delays by 10 ms on average, which is ω · 10 ms of phase
    turning = np.abs(beats[here]).max()
    assert 1e-3 < np.abs(beats[here] - samples[here]).max() < 0.3 * turning


def test_jumps_are_found_and_beats_are_none() -> None:
    time_s = np.arange(0.0, 20.0, PERIOD_S)
    steady = TailProgramme((TailBeat(0.3, 0.26, 0.9),))
    assert jumps(angle(steady, time_s)) == []
    stepped = TailProgramme((TailBeat(0.3, 0.26, 0.9), TailBeat(-0.2, 0.26, 0.9)), (0.0, 7.0))
    assert jumps(angle(stepped, time_s)) == [350]
