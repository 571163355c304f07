"""The generator's physics against the plant's own integrator, and its noise against theory."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from plant.integrate import simulate
from plant.trajectory import Start
from tools.practice.experiment import laboratory, plan, shape_of, stream, swim_experiment
from tools.practice.hidden import HIDDEN, LISTED, UNLISTED
from tools.practice.instruments import CAMERA_HZ, GYRO_NOISE_RAD_S, Instruments, measure
from tools.practice.swim import STEP_S, Unlisted, Water, disturbances, swim

STILL = np.zeros((round(60.0 / STEP_S) + 2, 3))


@pytest.mark.parametrize("seed", [7, 8])
def test_without_disturbance_it_swims_as_the_plant_does(seed: int) -> None:
    lab, planned = laboratory(seed), plan(seed, 0)
    path = swim(lab.parameters, planned.programme, 60.0, planned.start, STILL)
    truth = simulate(lab.parameters, planned.programme, 60.0, STEP_S, planned.start)
    np.testing.assert_allclose(path, truth.rows[:, :6], atol=1e-6)


def test_a_bending_tail_swims_as_the_plants() -> None:
    lab, planned = laboratory(7), plan(7, 0)
    bent = HIDDEN["tail_flexibility"].change(lab, 100.0, (1.0,)).parameters
    path = swim(bent, planned.programme, 5.0, planned.start, STILL)
    truth = simulate(bent, planned.programme, 5.0, STEP_S, planned.start)
    np.testing.assert_allclose(path, truth.rows[:, :6], atol=1e-9)


def test_a_tether_pulls_towards_its_anchor_with_its_frequency() -> None:
    # without drag a body on a spring oscillates; along its axis with m1, so ω = √(k/m1)
    lab = laboratory(7)
    p = lab.parameters
    free = replace(p, hydrodynamics=replace(p.hydrodynamics, drag=0.0, yaw_drag_n_m_s2=0.0))
    pull = 0.05
    mass = p.body.mass_kg + p.body.added_mass_surge_kg
    quarter_s = 0.5 * math.pi * math.sqrt(mass / pull)
    programme = replace(
        plan(7, 0).programme,
        beats=(replace(plan(7, 0).programme.beats[0], amplitude_rad=0.0, bias_rad=0.0),),
        starts_s=(0.0,),
    )
    path = swim(free, programme, 10.0, Start(x_m=-0.1), STILL, Unlisted(tether_n_m=pull))
    at = round(quarter_s / STEP_S)
    assert abs(path[at, 0]) < 1e-3
    assert path[at, 3] == pytest.approx(0.1 * math.sqrt(pull / mass), rel=1e-3)


def test_disturbances_have_their_size_and_their_spectrum() -> None:
    water = Water(force_n=1e-4, moment_n_m=1e-6, correlation_s=0.5)
    drawn = disturbances(water, 2_000_000, np.random.default_rng(1))
    np.testing.assert_allclose(drawn.std(axis=0), [1e-4, 1e-4, 1e-6], rtol=0.05)
    # two equal lags: S(f) = 4 σ² τ / (1 + (2πfτ)²)², one-sided
    f, density = welch(drawn[:, 0], 1.0 / STEP_S, nperseg=2**15)
    expected = 8.0 * 1e-8 * 0.5 / (1.0 + (2.0 * math.pi * f * 0.5) ** 2) ** 2
    band = (f > 0.05) & (f < 2.0)
    assert np.median(density[band] / expected[band]) == pytest.approx(1.0, abs=0.05)


def test_instruments_have_their_rates_and_noise() -> None:
    path = np.zeros((24001, 6))
    seen = measure(path, Instruments(), np.random.default_rng(2))
    camera, gyro = seen["x_m"], seen["gyro_z_rad_s"]
    assert np.diff(camera.time_s) == pytest.approx(1.0 / CAMERA_HZ)
    assert camera.value.std() == pytest.approx(1e-3 / math.sqrt(2.0), rel=0.05)
    assert seen["heading_rad"].value.std() == pytest.approx(math.sqrt(2.0) * 1e-3 / 0.1, rel=0.05)
    step = math.radians(3.3 / 4096 / 8.3e-3)
    assert gyro.value.std() == pytest.approx(
        math.hypot(GYRO_NOISE_RAD_S, step / math.sqrt(12)), rel=0.05
    )


def test_wrong_instruments_do_what_their_causes_say() -> None:
    path = np.zeros((24001, 6))
    grid = np.arange(24001) * STEP_S
    path[:, 0], path[:, 2], path[:, 5] = 0.02 * grid, 0.1 * grid, 0.1
    quiet = Instruments(noise_scale=0.0)

    def look(wrong: Instruments, name: str) -> tuple[np.ndarray, np.ndarray]:
        series = measure(path, wrong, np.random.default_rng(3))[name]
        return series.time_s, series.value

    time_s, gyro = look(replace(quiet, gyro_scale=0.5, gyro_bias_rad_s=0.2), "gyro_z_rad_s")
    assert gyro == pytest.approx(0.35, abs=2e-3)
    time_s, x = look(replace(quiet, camera_delay_s=0.5), "x_m")
    assert x[30:] == pytest.approx(0.02 * (time_s[30:] - 0.5), abs=1e-4)
    time_s, x = look(replace(quiet, clock_drift=0.01), "x_m")
    assert x == pytest.approx(0.02 * time_s / 1.01, abs=1e-4)
    time_s, compass = look(replace(quiet, hard_iron=(0.3, 0.4)), "compass_rad")
    error = np.angle(np.exp(1j * (compass - 0.1 * time_s)))
    assert error == pytest.approx(0.3 * np.sin(0.1 * time_s - 0.4), abs=5e-3)
    time_s, x = look(replace(quiet, hold_s=1.0), "x_m")
    ages = time_s - x / 0.02
    assert ages.max() < 1.0 + 0.02
    assert ages.max() > 0.8


def test_the_same_seed_is_the_same_experiment_and_an_effect_changes_nothing_else() -> None:
    one, again = (
        swim_experiment(3, runs=1, duration_s=10.0),
        swim_experiment(3, runs=1, duration_s=10.0),
    )
    for name, series in one["run01"].items():
        np.testing.assert_array_equal(series.value, again["run01"][name].value)
        np.testing.assert_array_equal(series.time_s, again["run01"][name].time_s)


@pytest.mark.parametrize("name", [*HIDDEN])
def test_an_effect_of_size_zero_is_none(name: str) -> None:
    lab = laboratory(4)
    changed = HIDDEN[name].change(lab, 0.0, shape_of(name, 4))
    assert changed.parameters == lab.parameters
    assert changed.dropped == 0.0


def test_the_tables_of_listed_and_unlisted_effects() -> None:
    assert len(LISTED) == 33
    assert len(UNLISTED) >= 6
    assert stream(1, 2).random() != stream(1, 3).random()
