"""Sources of fields against SciPy's Bessel functions, their own balances, and the same bits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
import scipy.special
from hypothesis import given
from hypothesis import strategies as st

from plant.errors import InvalidParameterError
from plant.field_sources import HeatedTank, Leak, bessel_k0_scaled, spill
from plant.tank import Tank

SMALL = Tank(x_min_m=-0.4, y_min_m=0.1, x_max_m=1.1, y_max_m=1.1, depth_m=0.5)
HEATER = HeatedTank(
    SMALL, x_m=0.3, y_m=0.45, heater_radius_m=0.01, conductivity_w_m_k=30.0, ambient_c=18.0
)
"""Little stirring, so that the field falls off within the tank: ℓ = 0.55 m."""


@given(st.floats(-8.0, 4.0))
def test_the_bessel_function_is_scipys(exponent):
    x = 10.0**exponent
    assert bessel_k0_scaled(x) == pytest.approx(float(scipy.special.k0e(x)), rel=2e-13)


@given(st.floats(-0.4, 1.1), st.floats(0.1, 1.1))
def test_heat_is_the_sum_over_mirror_images(x, y):
    """The same lattice of images by SciPy, out to where nothing is left."""
    n = np.arange(-12, 13)
    xs = np.concatenate([-0.4 + 2 * n * 1.5 + side * 0.7 for side in (1, -1)])
    ys = np.concatenate([0.1 + 2 * n * 1.0 + side * 0.35 for side in (1, -1)])
    r = np.maximum(np.hypot(x - xs[:, None], y - ys), 0.01)
    amplitude = 1000.0 / (2 * math.pi * 30.0 * 0.3)
    wanted = 18.0 + amplitude * scipy.special.k0(r / math.sqrt(0.3)).sum()
    assert HEATER.value(x, y) == pytest.approx(float(wanted), rel=1e-7)


def test_the_surface_loses_what_the_heater_gives():
    """∫hθ dA = Q: no image, no wall and no sign can be wrong. The heater's disc is left small."""
    x, wx = np.polynomial.legendre.leggauss(24)
    total = 0.0
    # Gauss–Legendre on four rectangles that meet at the heater
    for x0, x1 in ((-0.4, 0.3), (0.3, 1.1)):
        for y0, y1 in ((0.1, 0.45), (0.45, 1.1)):
            # square of the variable from the heater's corner: the logarithm becomes harmless
            u, v = 0.5 * (x + 1.0), 0.5 * (x + 1.0)
            px = 0.3 + (x1 - x0) * u**2 * (1 if x1 > 0.3 else -1)
            py = 0.45 + (y1 - y0) * v**2 * (1 if y1 > 0.45 else -1)
            weight = np.outer(2 * u * wx, 2 * v * wx) * 0.25 * (x1 - x0) * (y1 - y0)
            theta = np.array([[HEATER.value(a, b) - 18.0 for b in py] for a in px])
            total += 30.0 * float((weight * theta).sum())
    assert total == pytest.approx(1000.0, rel=2e-4)


def laplacian(value, x, y, h=1e-3):
    around = value(x + h, y) + value(x - h, y) + value(x, y + h) + value(x, y - h)
    return (around - 4 * value(x, y)) / h**2


def test_heat_obeys_its_equation_and_walls_let_none_through():
    for x, y in ((0.0, 0.3), (0.9, 0.9), (-0.3, 1.0)):
        assert laplacian(HEATER.value, x, y) == pytest.approx(
            (HEATER.value(x, y) - 18.0) / 0.3, rel=1e-4
        )
    for x, y, ahead in ((-0.4, 0.6, (1e-4, 0)), (0.7, 1.1, (0, -1e-4))):
        rise = HEATER.value(x + ahead[0], y + ahead[1]) - HEATER.value(x, y)
        assert abs(rise) < 1e-5  # an open wall would lose about 40 °C/m · 1e-4 m
    assert HEATER.value(0.3, 0.45) == pytest.approx(HEATER.value(0.31, 0.45), abs=0.05)


LEAK = Leak(
    x_m=0.2, y_m=-0.1, leak_ug_s=5e3, current_m_s=0.03, heading_rad=0.5, along_m2_s=4e-3,
    across_m2_s=1e-3, decay_per_s=2e-3, radius_m=1e-3,
)  # fmt: skip


def rotated(value, xi, eta):
    return value(
        0.2 + xi * math.cos(0.5) - eta * math.sin(0.5),
        -0.1 + xi * math.sin(0.5) + eta * math.cos(0.5),
    )


@pytest.mark.parametrize(("xi", "eta"), [(0.5, 0.0), (1.0, 0.2), (-0.1, 0.05), (0.3, -0.3)])
def test_a_leak_obeys_advection_mixing_and_decay(xi, eta):
    c = lambda a, b: rotated(LEAK.value, a, b)  # noqa: E731  # short, and used here alone
    h = 1e-3
    carried = 0.03 * (c(xi + h, eta) - c(xi - h, eta)) / (2 * h)
    mixed = 4e-3 * (c(xi + h, eta) - 2 * c(xi, eta) + c(xi - h, eta)) / h**2
    mixed += 1e-3 * (c(xi, eta + h) - 2 * c(xi, eta) + c(xi, eta - h)) / h**2
    assert carried == pytest.approx(mixed - 2e-3 * c(xi, eta), rel=2e-3)


def test_a_leak_is_what_decays():
    """λ ∫c dA times the layer is the leak; in the polar coordinates in which mixing is even."""
    leak = replace(LEAK, decay_per_s=0.05)

    def ring(rho):
        angles = 2 * math.pi * np.arange(64) / 64
        along, across = math.sqrt(4e-3) * rho, math.sqrt(1e-3) * rho
        around = [rotated(leak.value, along * math.cos(a), across * math.sin(a)) for a in angles]
        return 2 * math.pi * rho * float(np.mean(around)) * math.sqrt(4e-3 * 1e-3)

    whole, _ = scipy.integrate.quad(ring, 0.03, 300.0, epsrel=1e-6, limit=200)
    assert whole * 0.05 * 0.1 * 1000.0 == pytest.approx(5e3, rel=1e-3)


def test_a_spill_keeps_its_mass_and_a_leak_is_made_of_spills():
    slick = spill(2e6, 100.0, x_m=1.0, y_m=2.0, current_m_s=0.05, heading_rad=0.5)
    assert (slick.x_m, slick.y_m) == pytest.approx((1 + 5 * math.cos(0.5), 2 + 5 * math.sin(0.5)))
    mass = slick.peak * 2 * math.pi * slick.sigma_along_m * slick.sigma_across_m * 0.1 * 1000.0
    assert mass == pytest.approx(2e6)
    one = {
        "x_m": 0.2, "y_m": -0.1, "current_m_s": 0.03, "heading_rad": 0.5, "along_m2_s": 4e-3,
        "across_m2_s": 1e-3, "decay_per_s": 2e-3,
    }  # fmt: skip
    # ∫ spills of every age dt = the steady leak; ln t, since fresh spills are small and strong
    found, _ = scipy.integrate.quad(
        lambda s: math.exp(s) * spill(5e3, math.exp(s), **one).value(0.9, 0.4), -2.0, 9.0
    )
    assert found == pytest.approx(LEAK.value(0.9, 0.4), rel=1e-7)


def test_the_same_bits_everywhere():
    """The exact sums of looks, in hexadecimal as one machine had them: any other must agree."""
    places = [(0.013 * n - 0.39, 0.0083 * n + 0.11) for n in range(100)]
    assert math.fsum(HEATER.value(*place) for place in places).hex() == HEAT
    assert math.fsum(LEAK.value(*place) for place in places).hex() == OIL


HEAT = "0x1.12e184762c124p+12"
OIL = "0x1.b1c4028dc6b4bp+13"


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: HeatedTank(SMALL, x_m=1.2, y_m=0.5), "x_m"),
        (lambda: HeatedTank(SMALL, x_m=1.0, y_m=0.5, layer_m=0.0), "layer_m"),
        (lambda: HeatedTank(SMALL, x_m=1.0, y_m=0.5, power_w=math.inf), "power_w"),
        (lambda: Leak(0.0, 0.0, -1.0, 0.1), "leak_ug_s"),
        (lambda: Leak(0.0, 0.0, 1.0, 0.1, decay_per_s=0.0), "decay_per_s"),
        (lambda: spill(1.0, 0.0, x_m=0.0, y_m=0.0), "age_s"),
    ],
)
def test_what_cannot_be_is_refused(make, field):
    with pytest.raises(InvalidParameterError, match=field):
        make()
