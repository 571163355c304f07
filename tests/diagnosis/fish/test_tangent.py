"""Slopes of one march for all forces and sensors' errors, against small differences for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plant.parameters import PlantParameters, Servo
from plant.robots import wang2014
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tools.diagnosis.evidence import Problem, neutral, responses, start_problem
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.screening import unnamed_terms
from tools.diagnosis.workers import Workers

PLANTS = {
    "ideal servo": wang2014(),
    "servo": PlantParameters(),
    "slow servo": PlantParameters(servo=Servo(ideal=True, slowness_s_rad=1.0)),
}


def problem(plant: PlantParameters, workers: Workers, *, at_rest: bool = True) -> Problem:
    model = FishModel(plant, NAMES)
    run = model.draw(blank(4), {}, NOISE, np.random.default_rng(4))
    run = replace(run, at_rest=at_rest)
    begun = start_problem(model, [run], workers)
    return begun.with_noise(NOISE, neutral(begun))


@pytest.mark.parametrize("at_rest", [True, False])
@pytest.mark.parametrize("kind", PLANTS)
def test_slopes_are_those_of_small_differences(kind: str, at_rest: bool) -> None:
    with Workers(1) as workers:
        asked = problem(PLANTS[kind], workers, at_rest=at_rest)
        names = [parameter.name for _, parameter in unnamed_terms(asked)]
        (slopes,) = responses(asked, neutral(asked), names)
        off, told = [], 0
        for name, slope in zip(names, slopes.T, strict=True):
            if np.isnan(slope).all():
                continue
            told += 1
            length = np.linalg.norm(slope)
            if length < 1e-6:  # an offset of the camera: the guess of the start follows it
                assert name in ("x_m: offset", "y_m: offset")
                continue
            size = 0.05 / length
            both = [asked.residual(0, {name: sign * size}) for sign in (1.0, -1.0)]
            difference = (both[0] - both[1]) / (2.0 * size)
            off.append(np.linalg.norm(difference - slope) / np.linalg.norm(difference))
        assert told == len(names) - 2  # sheared water carries the robot: no force
        assert np.max(off) < 0.08
        assert np.median(off) < 0.005


def test_what_one_march_cannot_tell_is_left_to_differences() -> None:
    with Workers(1) as workers:
        asked = problem(wang2014(), workers)
        names = [parameter.name for _, parameter in unnamed_terms(asked)]
        beside = neutral(asked).moved({"unknown_force.surge:1": 1e-4})
        assert np.isnan(responses(asked, beside, names)[0]).all()
