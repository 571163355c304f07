"""A tail is rigid, segments or a beam; what contradicts itself is refused with the reason."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plant.errors import InvalidParameterError
from plant.flexible.segments import joint_stiffness_n_m
from plant.packing import pack
from plant.parameters import PlantParameters, Tail
from plant.profile import factor_at, integral, moments
from plant.robots import flexible_tail, long_flexible_tail, wang2014, wang2014_flexible

SHEET: dict[str, Any] = {"modulus_pa": 1.48e9, "thickness_m": 3e-4}


@pytest.mark.parametrize(
    ("fields", "field", "reason"),
    [
        ({"depth_m": 0.0}, "tail.depth_m", "an extent"),
        ({"segments": 0}, "tail.segments", "at least 1"),
        ({"segments": 2.5, **SHEET}, "tail.segments", "whole number"),
        ({"segments": 65, **SHEET}, "tail.segments", "at most 64"),
        ({"modes": -1}, "tail.modes", "at least 0"),
        ({"segments": 5, "modulus_pa": 1e9}, "tail.thickness_m", "a modulus needs a thickness"),
        ({"segments": 5, "thickness_m": 1e-3}, "tail.modulus_pa", "a thickness needs a modulus"),
        ({"segments": 5}, "tail.modulus_pa", "needs a stiffness"),
        ({"modes": 3}, "tail.modulus_pa", "needs a stiffness"),
        ({"segments": 5, "modes": 3, **SHEET}, "tail.modes", "not both"),
        ({"segments": 5, "joint_stiffness_n_m": 1.0, **SHEET}, "tail.joint_stiffness_n_m", "too"),
        ({"modes": 2, "joint_stiffness_n_m": 1.0}, "tail.joint_stiffness_n_m", "no joints"),
        (SHEET, "tail.modulus_pa", "does not bend"),
        ({"damping_s": 0.1}, "tail.damping_s", "does not bend"),
        ({"joint_stiffness_n_m": 0.1}, "tail.joint_stiffness_n_m", "does not bend"),
        ({"thickness_profile": (1.0, 0.5)}, "tail.thickness_profile", "does not bend"),
        ({"segments": 5, "damping_s": -0.1, **SHEET}, "tail.damping_s", "at least 0"),
        ({"depth_profile": (1.0,)}, "tail.depth_profile", "two or more"),
        ({"depth_profile": [1.0, 0.5]}, "tail.depth_profile", "two or more"),
        ({"depth_profile": (0.0, 1.0)}, "tail.depth_profile", "positive"),
        ({"depth_profile": (1.0, -0.5)}, "tail.depth_profile", "positive"),
        ({"depth_profile": (1.0, float("nan"))}, "tail.depth_profile", "numbers"),
    ],
)
def test_nonsense_is_refused_with_the_reason(
    fields: dict[str, Any], field: str, reason: str
) -> None:
    with pytest.raises(InvalidParameterError, match=reason) as caught:
        Tail(**fields)
    assert caught.value.field == field


def test_published_joint_stiffness() -> None:
    # chapter 4: 5.2e-3 and 4.0e-3 N·m for five segments
    for tail, published in ((flexible_tail(), 5.2e-3), (long_flexible_tail(), 4.0e-3)):
        got = joint_stiffness_n_m(wang2014_flexible(tail), 1)
        assert got == pytest.approx(published, abs=0.05e-3)  # as printed


def test_published_virtual_mass() -> None:
    assert pack(wang2014()).tail_mass == pytest.approx(0.4909, abs=5e-5)  # 490.9 g per metre


def test_profile_is_linear_between_stations() -> None:
    profile = (1.0, 0.5, 0.8)
    assert [factor_at(profile, x) for x in (0.0, 0.25, 0.5, 0.75, 1.0)] == pytest.approx(
        [1.0, 0.75, 0.5, 0.65, 0.8], rel=1e-15
    )
    assert factor_at((), 0.3) == 1.0


def test_integrals_are_exact_between_kinks() -> None:
    profile = (1.0, 0.5, 0.8, 0.0)
    x = np.linspace(0.2, 0.9, 70001)
    values = np.interp(x, np.linspace(0, 1, 4), profile) ** 2 * x**2
    trapezoid = float(np.sum(0.5 * (values[1:] + values[:-1]) * np.diff(x)))
    got = integral(lambda p: factor_at(profile, p) ** 2 * p**2, 0.2, 0.9, (4,))
    assert got == pytest.approx(trapezoid, rel=1e-8)


def test_moments_of_a_triangle() -> None:
    # m = m₀ (1 − x)²: ∫ = 1/3, ∫x = 1/12, ∫x² = 1/30
    got = moments(2.0, 0.5, (1.0, 0.0))
    assert got == pytest.approx((2 * 0.5 / 3, 2 * 0.25 / 12, 2 * 0.125 / 30), rel=1e-14)


def test_a_uniform_profile_is_no_profile() -> None:
    plain = pack(wang2014())
    same = pack(replace(wang2014(), tail=Tail(depth_profile=(1.0, 1.0, 1.0))))
    assert same == pytest.approx(plain, rel=1e-14, abs=1e-17)
    parts = moments(0.49, 0.08, (), 0.25, 0.5)
    assert moments(0.49, 0.08, (1.0, 1.0), 0.25, 0.5) == pytest.approx(parts, rel=1e-14)


def test_a_tail_of_chapter_4_is_anchored_and_flexible() -> None:
    p = wang2014_flexible()
    assert isinstance(p, PlantParameters)
    assert p.tail.flexible
    assert not Tail().flexible
    assert p.hydrodynamics.body_motion_in_tail == 0.0
