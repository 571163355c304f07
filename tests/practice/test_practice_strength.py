"""The strength of an effect: its scaling, and that a size with a wanted strength is found."""

import pytest

from tools.practice.experiment import Effect, shape_of
from tools.practice.hidden import HIDDEN
from tools.practice.strength import NEAR, sized, strength

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
