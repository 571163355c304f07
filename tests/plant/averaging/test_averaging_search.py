"""The search of section 5.4: its published outcome, and that it finds what it looks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plant.averaging.dynamics import AVERAGE, Dynamics, Scaling
from plant.averaging.equilibrium import NoEquilibriumError, equilibria, equilibrium
from plant.averaging.motion import steady_turn
from plant.averaging.search import (
    BeatGrid,
    Match,
    Turn,
    blanket_search,
    identify,
    match,
    original_turn,
    plant_turn,
)
from plant.errors import InvalidParameterError
from plant.parameters import Body, PlantParameters, Servo, Tail
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.spheroid import spheroid_added_mass
from plant.tail_input import TailBeat

ROBOT = PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))
HEAVY = replace(
    ROBOT, body=replace(ROBOT.body, mass_kg=0.622, yaw_inertia_kg_m2=0.622 * 0.14**2 / 12.0)
)
BEAT = TailBeat.degrees(20, 15, 1.0)


def test_table_5_1() -> None:
    shares: list[float] = []
    found = identify(ROBOT, progress=shares.append)
    assert len(found.matches) == 125
    assert shares[-1] == 1.0
    assert found.scaling.force == pytest.approx(0.8485, rel=0.02)
    assert found.moment_per_bias == pytest.approx(
        [0.0796, 0.1596, 0.2424, 0.3300, 0.4160], rel=0.02
    )
    # the line: within 2 % of the largest coefficient where it crosses the grid's biases
    assert found.scaling.moment == pytest.approx(-0.0074, abs=1e-3)
    assert found.scaling.moment_per_rad == pytest.approx(0.4831, rel=0.002)
    # "independent of frequency"
    assert np.ptp(found.force, axis=1).max() < 1e-6
    assert np.ptp(found.moment, axis=1).max() < 1e-6


def test_table_5_3() -> None:
    found = identify(HEAVY, BeatGrid((1.0,), (10.0, 20.0, 30.0), (20.0,)))
    assert found.force.ravel() == pytest.approx([0.8780, 0.8980, 0.8980], rel=0.015)
    assert found.moment.ravel() == pytest.approx([0.2500, 0.4650, 0.6100], rel=0.01)
    assert found.scaling.force == pytest.approx(0.891, rel=0.01)
    assert found.scaling.moment == pytest.approx(0.0817, abs=1e-3)
    assert found.scaling.moment_per_rad == pytest.approx(1.0313, rel=0.005)


def test_mass_without_inertia_is_not_what_the_source_doubled() -> None:
    light_turning = replace(ROBOT, body=replace(ROBOT.body, mass_kg=0.622))
    found = identify(light_turning, BeatGrid((1.0,), (10.0, 20.0, 30.0), (20.0,)))
    assert abs(found.moment.ravel()[2] / 0.61 - 1.0) > 0.1


def other_robot() -> PlantParameters:
    added = spheroid_added_mass(0.11, 0.04)
    return PlantParameters(
        body=Body(
            mass_kg=0.8,
            hinge_distance_m=0.11,
            wetted_area_m2=0.024,
            yaw_inertia_kg_m2=2.6e-3,
            added_mass_surge_kg=added.surge_kg,
            added_mass_sway_kg=added.sway_kg,
            added_inertia_yaw_kg_m2=added.yaw_kg_m2,
        ),
        tail=Tail(0.10, 0.04),
        hydrodynamics=replace(COEFFICIENT_SETS["chapter-5"], drag=0.3, yaw_drag_n_m_s2=2e-3),
        servo=Servo(ideal=True),
    )


@pytest.mark.parametrize("robot", [ROBOT, HEAVY, other_robot()])
def test_the_blanket_search_ends_at_the_exact_match(robot: PlantParameters) -> None:
    for bias, amplitude in ((10, 10), (35, 20), (50, 30)):
        beat = TailBeat.degrees(bias, amplitude, 1.0)
        turn = original_turn(robot, beat)
        exact, searched = match(robot, beat, turn), blanket_search(robot, beat, turn)
        assert searched.force == pytest.approx(exact.force, rel=2e-4)
        assert searched.moment == pytest.approx(exact.moment, rel=1e-4)


def turn_with(robot: PlantParameters, found: Match, full_tail: bool = False) -> Turn:
    scaling = Scaling(found.force, found.moment)
    at = equilibrium(robot, found.beat, scaling, full_tail)
    return Turn(at.turn_radius_m, at.turn_period_s)


@pytest.mark.parametrize("coupling", [0.0, 0.3])
@pytest.mark.parametrize("full_tail", [False, True])
def test_the_matched_average_turns_as_it_should(coupling: float, full_tail: bool) -> None:
    robot = replace(HEAVY, hydrodynamics=replace(HEAVY.hydrodynamics, munk_coupling=coupling))
    for bias in (15.0, -40.0):
        beat = TailBeat.degrees(bias, 20, 1.0)
        turn = original_turn(robot, beat)
        again = turn_with(robot, match(robot, beat, turn, full_tail), full_tail)
        assert again.radius_m == pytest.approx(turn.radius_m, rel=1e-9)
        assert again.period_s == pytest.approx(turn.period_s, rel=1e-9)


def test_a_scaling_for_the_full_plant() -> None:
    robot = wang2014()
    found = identify(robot, BeatGrid((1.0,), (20.0, 35.0), (15.0, 20.0)), plant_turn)
    for one in found.matches:
        turns = [
            (at.turn_radius_m, at.turn_period_s)
            for at in equilibria(robot, one.beat, Scaling(one.force, one.moment))
        ]
        met = pytest.approx((one.turn.radius_m, one.turn.period_s), rel=1e-9)
        assert any(turn == met for turn in turns)
    # the body's motion takes a third of the force away that (5.5) has
    assert 0.3 < found.scaling.force < 0.8


def test_another_robot_swims_by_its_own_scaling() -> None:
    robot = other_robot()
    found = identify(robot, BeatGrid((1.0,), (10.0, 20.0, 30.0, 40.0), (15.0, 25.0)))
    assert abs(found.scaling.force - 0.8485) > 0.01
    beat = TailBeat.degrees(27, 18, 1.7)  # none of the grid's
    original = steady_turn(robot, beat)
    own = steady_turn(robot, beat, replace(AVERAGE, scaling=found.scaling))
    assert own.turn_period_s == pytest.approx(original.turn_period_s, rel=0.03)
    assert own.turn_radius_m == pytest.approx(original.outer_radius_m, rel=0.03)
    foreign = steady_turn(robot, beat, Dynamics(full_tail=False, scaling=Scaling(0.8485, 0.1596)))
    assert original.turn_period_s is not None
    assert foreign.turn_period_s is not None
    assert abs(foreign.turn_period_s / original.turn_period_s - 1.0) > 0.1


def test_what_cannot_be_met_is_refused() -> None:
    with pytest.raises(NoEquilibriumError):
        blanket_search(ROBOT, BEAT, Turn(50.0, 5.0))
    with pytest.raises(NoEquilibriumError):
        match(ROBOT, BEAT, Turn(0.01, 1.0))
    with pytest.raises(InvalidParameterError):
        match(ROBOT, TailBeat.degrees(0, 15, 1), Turn(0.3, 60.0))
    with pytest.raises(InvalidParameterError):
        Turn(-1.0, 60.0)
    with pytest.raises(InvalidParameterError):
        identify(ROBOT, BeatGrid(()))
    coupled = replace(ROBOT, hydrodynamics=replace(ROBOT.hydrodynamics, munk_coupling=1.0))
    with pytest.raises(InvalidParameterError):
        blanket_search(coupled, BEAT, Turn(0.3, 60.0))
