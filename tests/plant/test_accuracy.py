"""How near the fixed step comes to the same model solved by SciPy at tight tolerance, over 30 s."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.arrays import FloatArray
from plant.integrate import simulate
from plant.layout import Drive, State
from plant.orbit import periodic_orbit
from plant.packing import pack
from plant.parameters import Hydrodynamics, PlantParameters
from plant.rigid_tail import rates
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme

DURATION_S = 30.0


def right_hand_side(
    p: PlantParameters, beat: TailBeat
) -> Callable[[float, FloatArray], tuple[float, ...]]:
    """Rates of x, y, heading, u, v, r of a robot with an ideal tail."""
    packed = pack(p)
    drive: Drive = TailProgramme.steady(beat).segments(1e-3)[0][1]

    def rhs(t: float, z: FloatArray) -> tuple[float, ...]:
        x, y, psi, u, v, r = z.tolist()
        return tuple(rates(packed, drive, t, State(x, y, psi, u, v, r, 0.0, 0.0, 0.0)))[:6]

    return rhs


def error(run: FloatArray, reference: FloatArray) -> float:
    """Largest difference of any state, as a share of the largest value that it takes."""
    difference = np.abs(run - reference).max(axis=0) / np.abs(reference).max(axis=0)
    return float(difference.max())


@pytest.fixture(scope="module")
def reference() -> FloatArray:
    beat = TailBeat.degrees(20, 15, 0.9)
    times = np.linspace(0.0, DURATION_S, 301)
    solution = solve_ivp(
        right_hand_side(wang2014(), beat),
        (0.0, DURATION_S),
        np.zeros(6),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-15,
        max_step=0.05,  # the kink of r|r| would lead the error estimate astray
    )
    states: FloatArray = solution.y.T
    return states


@pytest.mark.parametrize(("step_s", "wanted"), [(1e-3, 2e-9), (5e-3, 2e-7), (1e-2, 1e-6)])
def test_thirty_seconds_from_rest_agree_with_dop853(
    reference: FloatArray, step_s: float, wanted: float
) -> None:
    beat = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
    run = simulate(wang2014(), beat, DURATION_S, step_s, save_every=round(0.1 / step_s))
    assert error(run.rows[:, :6], reference) < wanted
    # the comparison is able to fail: another step is not as near
    assert error(run.rows[:-1, :6], reference[1:]) > 1e-2


@pytest.mark.parametrize("frequency", [0.5, 0.9, 2.0])
@pytest.mark.parametrize("bias", [0.0, 40.0])
def test_four_hundred_steps_a_beat_keep_six_digits(frequency: float, bias: float) -> None:
    # against a step eight times finer; DOP853 above says that finer means nearer
    beat = TailProgramme.steady(TailBeat.degrees(bias, 20.0, frequency))
    coarse = simulate(wang2014(), beat, DURATION_S, 1 / (400 * frequency), save_every=4)
    fine = simulate(wang2014(), beat, DURATION_S, 1 / (3200 * frequency), save_every=32)
    assert error(coarse.rows[:, 3:6], fine.rows[:, 3:6]) < 1e-6


def radius_errors(p: PlantParameters, beat_steps: tuple[int, ...]) -> FloatArray:
    beat = TailBeat.degrees(20, 15, 0.9)
    orbits = [periodic_orbit(p, beat, 1 / (0.9 * n), tolerance=1e-12) for n in (*beat_steps, 3072)]
    radii = np.array([orbit.turn_radius_m for orbit in orbits], dtype=np.float64)
    errors: FloatArray = np.abs(radii[:-1] / radii[-1] - 1.0)
    return errors


def test_the_orbit_converges_with_order_four() -> None:
    smooth = replace(wang2014(), hydrodynamics=Hydrodynamics(yaw_drag_n_m_s2=0.0))
    errors = radius_errors(smooth, (96, 192, 384))
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([4.0] * 2, abs=0.3)


def test_the_kink_of_the_yaw_drag_takes_one_order_of_the_orbit_at_most() -> None:
    errors = radius_errors(wang2014(), (48, 384))
    assert math.log(errors[0] / errors[1], 8.0) > 2.9
    assert errors[1] < 1e-8
