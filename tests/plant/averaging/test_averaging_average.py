"""Means of the tail's forces against quadrature of the forces themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from plant.averaging.average import forcing, mean_forces, scaled_forces
from plant.averaging.dynamics import (
    ORIGINAL,
    PUBLISHED,
    SIMPLIFIED,
    Dynamics,
    reduced,
    tail_part,
)
from plant.parameters import PlantParameters, Servo, Tail
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))
LARGE = PlantParameters(tail=Tail(length_m=0.13, depth_m=0.04), servo=Servo(ideal=True))


@pytest.mark.parametrize("robot", [ROBOT, LARGE])
@pytest.mark.parametrize("beat", [TailBeat.degrees(20, 15, 1.0), TailBeat.degrees(-50, 30, 3.3)])
@pytest.mark.parametrize("dynamics", [ORIGINAL, SIMPLIFIED])
def test_means_are_those_of_the_beating_tail(
    robot: PlantParameters, beat: TailBeat, dynamics: Dynamics
) -> None:
    p, f = reduced(robot, beat.bias_rad, dynamics), forcing(robot, beat, dynamics)
    period = 1.0 / beat.frequency_hz
    means = [
        quad(lambda t, i=i: tail_part(p, f, t)[i], 0.0, period, epsabs=1e-13)[0] / period
        for i in range(3)
    ]
    ours = mean_forces(robot, beat, dynamics.full_tail)
    assert [p.m1 * means[0], p.m2 * means[1], p.j3 * means[2]] == pytest.approx(
        list(ours), rel=1e-9
    )


def test_the_average_of_5_30_as_printed() -> None:
    a0, a, w = 0.35, 0.26, 2.0 * math.pi * 1.3
    m, length, c = math.pi * 1000 * 0.025**2 / 4, 0.08, 0.07
    m1, m2, j3 = 0.311 + 0.0621, 0.311 + 0.2299, 0.311 * 0.14**2 / 12 + 1.0413e-4
    f = forcing(ROBOT, TailBeat(a0, a, 1.3), Dynamics(full_tail=False, scaling=PUBLISHED))
    x = 0.8485 * m / (12 * m1) * length**2 * w**2 * a**2 * (3 - 1.5 * a0**2 - 3 / 8 * a**2)
    y = 0.8485 * m / (4 * m2) * length**2 * w**2 * a**2 * a0
    z = -(-0.0074 + 0.4831 * a0) * m / (4 * j3) * length**2 * c * w**2 * a**2 * a0
    assert (f.x, f.y, f.z) == pytest.approx((x, y, z), rel=1e-12)
    assert f.amplitude == 0.0


def test_the_polynomials_are_good_for_small_angles_only() -> None:
    for bias, least, most in ((5.0, 0.0, 1e-3), (50.0, 0.03, 0.06)):
        beat = TailBeat.degrees(bias, 5.0, 1.0)
        exact, polynomial = mean_forces(ROBOT, beat, True), mean_forces(ROBOT, beat)
        assert least <= abs(polynomial.x / exact.x - 1.0) <= most
    assert polynomial.y / exact.y == pytest.approx(1.139, abs=2e-3)


def test_scaling_is_even_in_the_bias() -> None:
    left, right = (scaled_forces(ROBOT, TailBeat.degrees(b, 15, 1), PUBLISHED) for b in (-20, 20))
    assert np.array(left) == pytest.approx(np.array(right) * [1.0, -1.0, -1.0], rel=1e-12)
