"""The real servo stays near the ideal one, and the rungs add up."""

import pytest

from plant.comparison import Rung, compare_servo
from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters
from plant.robots import wang2014
from plant.tail_input import TailBeat

NAMES = ["ideal", "lag", "hold", "speed limit", "dead band"]


@pytest.fixture(scope="module")
def turning() -> tuple[Rung, ...]:
    return compare_servo(PlantParameters(), TailBeat.degrees(20, 15, 0.9))


def test_a_turn_stays_within_three_percent_of_the_ideal_servo(turning: tuple[Rung, ...]) -> None:
    assert [rung.name for rung in turning] == NAMES
    assert turning[0].motion.turn_radius_m == pytest.approx(0.275, rel=0.01)
    whole = turning[-1]
    assert whole.total_radius is not None
    assert abs(whole.total_radius) < 0.03
    assert abs(whole.total_speed) < 0.03


def test_straight_swimming_stays_within_three_percent_of_the_ideal_servo() -> None:
    rungs = compare_servo(PlantParameters(), TailBeat.degrees(0, 15, 0.9), 90.0, 20.0)
    assert abs(rungs[-1].total_speed) < 0.03
    assert rungs[-1].motion.turn_radius_m is None
    assert rungs[-1].total_radius is None


def test_the_rungs_add_up_and_differ(turning: tuple[Rung, ...]) -> None:
    product = 1.0
    for rung in turning:
        product *= 1.0 + rung.change_speed
        assert product == pytest.approx(1.0 + rung.total_speed)
    # at 15° and 0.9 Hz lag and dead band take from the amplitude; the speed limit is not reached
    by_name = {rung.name: rung for rung in turning}
    assert by_name["lag"].change_speed < -1e-3
    assert by_name["dead band"].change_speed < -1e-3
    assert abs(by_name["speed limit"].change_speed) < 1e-6
    assert by_name["ideal"].amplitude_rad > by_name["lag"].amplitude_rad


def test_a_fast_beat_meets_the_speed_limit() -> None:
    # 30° at 3 Hz asks for 9.9 rad/s of a servo that turns 5.8
    rungs = compare_servo(PlantParameters(), TailBeat.degrees(0, 30, 3.0), 30.0, 20.0)
    by_name = {rung.name: rung for rung in rungs}
    assert by_name["speed limit"].change_speed < -0.05


def test_an_ideal_servo_has_nothing_to_compare() -> None:
    with pytest.raises(InvalidParameterError, match=r"servo\.ideal"):
        compare_servo(wang2014(), TailBeat())
