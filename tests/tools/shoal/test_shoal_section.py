"""`[shoal]`: where robots start, what they are called, and what contradicts what."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from tools import scenario
from tools.configuration import Scenario
from tools.errors import ScenarioError
from tools.shoal_section import addresses, names, recorded, starts

ROOMY = ("tank.size_m=[40, 40]", "tank.corner_m=[-20, -20]")


def load(*sets: str) -> Scenario:
    return scenario.load(sets=(*ROOMY, *sets))


def test_without_a_shoal_there_is_one_robot() -> None:
    config = scenario.load()
    assert config.shoal.robots == 0
    assert list(addresses(config)) == [1]


def test_addresses_and_names_count_from_the_processing_boards() -> None:
    config = load("shoal.robots=3", "procboard.address=9", "base_station.address=0")
    assert list(addresses(config)) == [9, 10, 11]
    assert names(config) == ("fish09", "fish10", "fish11")
    many = names(load("shoal.robots=100"))
    assert (many[0], many[-1]) == ("fish001", "fish100")
    assert list(many) == sorted(many)


def test_a_grid_lies_around_the_initial_pose_in_rows_across_its_heading() -> None:
    sets = ("initial.x_m=1.0", "initial.y_m=2.0", f"initial.heading_rad={math.pi / 2}")
    places = starts(load(*sets, "shoal.robots=5", "shoal.spacing_m=0.4"))
    # Heading along y: ahead is +y, left is −x. Three in the first row, two in the second.
    expected = [(0.6, 2.2), (1.0, 2.2), (1.4, 2.2), (0.8, 1.8), (1.2, 1.8)]
    assert [place[:2] for place in places] == [pytest.approx(place) for place in expected]
    assert {place[2] for place in places} == {math.pi / 2}


@pytest.mark.parametrize("robots", [2, 3, 7, 20])
def test_neighbours_on_a_circle_are_the_spacing_apart_and_head_outwards(robots: int) -> None:
    places = starts(load(f"shoal.robots={robots}", "shoal.formation=circle", "shoal.spacing_m=0.7"))
    gaps = [math.dist(a[:2], b[:2]) for a, b in pairwise([*places, places[0]])]
    assert gaps == pytest.approx([0.7] * robots)
    for x, y, heading in places:
        assert math.hypot(x, y) * math.cos(heading) == pytest.approx(x, abs=1e-12)
        assert math.hypot(x, y) * math.sin(heading) == pytest.approx(y, abs=1e-12)


@pytest.mark.parametrize("formation", ["grid", "circle"])
def test_a_shoal_of_one_starts_as_the_robot_does(formation: str) -> None:
    pose = ("initial.x_m=0.3", "initial.y_m=-0.1", "initial.heading_rad=0.7")
    assert starts(load(*pose, "shoal.robots=1", f"shoal.formation={formation}")) == (
        (0.3, -0.1, 0.7),
    )


def test_starts_one_by_one_take_the_place_of_a_formation() -> None:
    rows = "shoal.starts=[{x_m=1, y_m=2, heading_rad=3}, {x_m=0, y_m=0}]"
    assert starts(load("shoal.robots=2", rows)) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))


def test_wires_are_recorded_of_few_unasked_and_of_many_by_name() -> None:
    assert recorded(load("shoal.robots=4")) == (1, 2, 3, 4)
    assert recorded(load("shoal.robots=5")) == ()
    assert recorded(load("shoal.robots=50", "shoal.spi_vcd=[7, 50]")) == (7, 50)


MISTAKES = {
    "unknown key": (("shoal.robot=2",), "shoal.robot: no such key; did you mean shoal.robots?"),
    "unit": (("shoal.robots=2", "shoal.spacing=1"), "did you mean shoal.spacing_m?"),
    "range": (("shoal.robots=-1",), "shoal.robots = -1: must be a whole number >= 0"),
    "choice": (("shoal.formation=ring",), "must be one of 'grid', 'circle'"),
    "starts": (("shoal.robots=2", "shoal.starts=[{x_m=1, y_m=0}]"), "one for each robot"),
    "starts alone": (("shoal.starts=[{x_m=1, y_m=0}]",), "one for each robot"),
    "tank": (("shoal.robots=9", "shoal.spacing_m=30"), "shoal.spacing_m = 30: robot 1 of the grid"),
    "start": (
        ("shoal.robots=1", "shoal.starts=[{x_m=1, y_m=99}]"),
        "shoal.starts[0].y_m = 99: must lie in the tank",
    ),
    "base": (
        ("shoal.robots=2", "base_station.address=2"),
        "base_station.address = 2: must not be the address of a robot: they have 1 to 2",
    ),
    "reserved": (("shoal.robots=2", "procboard.address=65533"), "must be < 65534"),
    "second board": (
        ("shoal.robots=2", 'hil.nav="pty:"'),
        "a shoal is emulated as a whole: leave hil.nav out",
    ),
    "tracker": (("shoal.robots=2", 'hil.camera="pty:"'), "leave hil.camera out"),
    "nobody": (
        ("shoal.robots=2", "base_station.tail_beats=[{at_s=1, robots=[1, 3]}]"),
        "base_station.tail_beats[0].robots[1] = 3: no robot has this address: they have 1 to 2",
    ),
    "nobody's supply": (
        ("faults.supply_cuts=[{at_s=1, duration_s=1, robots=[2]}]",),
        "faults.supply_cuts[0].robots[0] = 2: no robot has this address: the robot has 1",
    ),
    "nobody's wires": (("shoal.robots=2", "shoal.spi_vcd=[9]"), "shoal.spi_vcd[0] = 9"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_with_its_key(name: str) -> None:
    sets, says = MISTAKES[name]
    with pytest.raises(ScenarioError) as caught:
        load(*sets)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
