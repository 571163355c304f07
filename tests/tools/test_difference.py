"""The comparison with the plant alone is made where it says something, and only there."""

from __future__ import annotations

import pytest

from plant.comparison import FRAME_FS
from tools import scenario
from tools.bench.difference import FRAME_HZ, objection

REASONS = {
    "navboard.control_hz=10": "did not tick with the servo's frame, 50 Hz",
    "plant.servo.ideal=true": "ideal already",
    "procboard.application=telemetry": "chose its tail beat itself",
    "procboard.tail_beat.amplitude_rad=0": "did not beat",
    "procboard.tail_beat.frequency_hz=0.1": "fewer than 20 beats",
    "initial.surge_m_s=0.1": "start from rest",
    "faults.supply_cuts=[{at_s=1, duration_s=1}]": "supply was cut",
    "base_station.tail_beats=[{at_s=1}]": "changed by radio",
}


def test_a_steady_swim_is_compared() -> None:
    assert objection(scenario.load("swim-forward")) == ""
    assert objection(scenario.load("circle")) == ""


@pytest.mark.parametrize("text", REASONS)
def test_what_cannot_be_compared_says_why(text: str) -> None:
    assert REASONS[text] in objection(scenario.load("swim-forward", [text]))


def test_the_frame_is_that_of_the_plant() -> None:
    assert FRAME_HZ * FRAME_FS == 10**15
