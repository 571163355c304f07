"""Fields against their formulas; walls."""

import math

import pytest

from plant.errors import InvalidParameterError
from plant.fields import AnalyticField, Plume, default_pollutant_ug_l, default_temperature_c
from plant.tank import Tank


def test_base_gradient_and_plume_add() -> None:
    plume = Plume(5.0, 1.0, 2.0, sigma_along_m=0.5, sigma_across_m=0.25, axis_rad=math.pi / 2)
    field = AnalyticField(20.0, 0.1, -0.2, (plume,))
    assert field.value(1.0, 2.0) == pytest.approx(20.0 + 0.1 - 0.4 + 5.0)
    # the long axis points along y
    assert plume.value(1.0, 2.5) == pytest.approx(5.0 * math.exp(-0.5))
    assert plume.value(1.25, 2.0) == pytest.approx(5.0 * math.exp(-0.5))
    assert plume.value(100.0, 2.0) == 0.0
    slanted = Plume(1.0, sigma_along_m=2.0, sigma_across_m=0.5, axis_rad=math.radians(30))
    along, across = 1.0, 0.25
    x = along * math.cos(math.radians(30)) - across * math.sin(math.radians(30))
    y = along * math.sin(math.radians(30)) + across * math.cos(math.radians(30))
    assert slanted.value(x, y) == pytest.approx(math.exp(-0.5 * (0.25 + 0.25)))


def test_a_concentration_never_falls_below_its_least() -> None:
    field = AnalyticField(1.0, gradient_x_per_m=-1.0, least=0.0)
    assert field.value(3.0, 0.0) == 0.0
    assert field.value(0.5, 0.0) == 0.5
    assert default_pollutant_ug_l().value(1.0, 0.5) == pytest.approx(82.0)
    assert default_temperature_c().value(2.0, 2.0) == pytest.approx(24.0)


def test_the_tank_knows_its_walls() -> None:
    tank = Tank(0.0, 0.0, 3.0, 2.0)
    assert tank.wall_distance_m(1.0, 0.5) == 0.5
    assert tank.wall_distance_m(2.9, 1.0) == pytest.approx(0.1)
    assert tank.wall_distance_m(-0.2, 1.0) == pytest.approx(-0.2)
    assert tank.contains(3.0, 2.0)
    assert not tank.contains(3.1, 2.0)
    assert tank.corners_m == ((0, 0), (3, 0), (3, 2), (0, 2))


def test_nonsense_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match=r"tank\.x_max_m"):
        Tank(x_min_m=1.0, x_max_m=1.0)
    with pytest.raises(InvalidParameterError, match=r"plume\.sigma_along_m"):
        Plume(1.0, sigma_along_m=0.0)
    with pytest.raises(InvalidParameterError, match=r"field\.base"):
        AnalyticField(math.nan)
