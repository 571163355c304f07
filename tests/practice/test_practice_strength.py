"""The strength of an effect: its scaling, and that a size with a wanted strength is found."""

import numpy as np
import pytest

from plant.robots import wang2014
from tools.diagnosis.fish.model import FishModel
from tools.practice.experiment import Effect, plan, shape_of
from tools.practice.hidden import HIDDEN
from tools.practice.instruments import Instruments, measure
from tools.practice.strength import CHANNELS, NEAR, measured_runs, sized, strength
from tools.practice.swim import STEP_S, swim
from tools.records.data import Series

SEED = 11


def test_nothing_has_no_strength() -> None:
    assert strength(SEED, [Effect("drag_scale", 0.0, (1.0,))]) == pytest.approx(0.0, abs=1e-9)


def test_twice_a_small_size_is_four_times_as_strong() -> None:
    once, twice = (strength(SEED, [Effect("gyro_bias", size, (1.0,))]) for size in (0.02, 0.04))
    assert twice == pytest.approx(4.0 * once, rel=0.02)


@pytest.mark.parametrize("name", ["tail_gain", "camera_delay", "tether"])
def test_a_size_with_a_wanted_strength_is_found(name: str) -> None:
    size, reached = sized(SEED, name, 120.0)
    assert reached == pytest.approx(120.0, rel=NEAR)
    assert reached == pytest.approx(strength(SEED, [Effect(name, size, shape_of(name, SEED))]))


def test_no_size_is_larger_than_the_largest_credible_one() -> None:
    size, reached = sized(SEED, "gyro_bias", 1e9)
    assert size == HIDDEN["gyro_bias"].most
    assert 0.0 < reached < 1e9


def test_without_noise_the_model_predicts_what_the_generator_swims() -> None:
    # two integrators, one physics: only then is a healthy set healthy, changes of the beat included
    duration_s = 30.0
    model = FishModel(wang2014(), CHANNELS)
    planned = plan(SEED, 0, duration_s)
    still = np.zeros((round(duration_s / STEP_S) + 2, 3))
    path = swim(wang2014(), planned.programme, duration_s, planned.start, still)
    perfect = Instruments(noise_scale=0.0, rounded=False)
    samples = measure(path, perfect, np.random.default_rng(1))
    told = Series(np.array(planned.programme.starts_s), np.zeros(len(planned.programme.beats)))
    (run,) = measured_runs(SEED, {"run": samples | {"tail_bias_rad": told}}, duration_s)
    error = run.value - model.replay(run, {})
    assert len(planned.programme.beats) > 2
    np.testing.assert_allclose(np.sin(0.5 * error), 0.0, atol=2e-6)
