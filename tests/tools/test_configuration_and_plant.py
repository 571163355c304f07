"""The scenario's plant sections are the plant's parameters: same names, same defaults."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import pytest

from plant.battery import BatteryParameters
from plant.camera import CameraParameters
from plant.fields import default_pollutant_ug_l, default_temperature_c
from plant.parameters import PlantParameters
from tools.configuration import Scenario

CONFIG = Scenario()
PAIRS: dict[str, tuple[Any, Any]] = {
    **{
        f"plant.{item.name}": (
            getattr(CONFIG.plant, item.name),
            getattr(PlantParameters(), item.name),
        )
        for item in dataclasses.fields(PlantParameters)
        if item.name != "force"  # a scenario says it as [effects.unknown_force]
    },
    "battery": (CONFIG.battery, BatteryParameters()),
    "camera": (CONFIG.camera, CameraParameters()),
}
NOT_IN_SCENARIOS = {"open_circuit_v", "x_min_m", "y_min_m", "x_max_m", "y_max_m"}
NOT_IN_PLANT = {"fitted"}


@pytest.mark.parametrize("name", PAIRS)
def test_a_section_has_the_fields_and_defaults_of_its_twin(name: str) -> None:
    section, twin = PAIRS[name]
    ours = {k: v for k, v in msgspec.structs.asdict(section).items() if k not in NOT_IN_PLANT}
    theirs = {
        item.name: getattr(twin, item.name)
        for item in dataclasses.fields(twin)
        if item.name not in NOT_IN_SCENARIOS
    }
    assert ours == theirs


def test_the_plant_accepts_every_section_as_it_is() -> None:
    for section, twin in PAIRS.values():
        values = msgspec.structs.asdict(section)
        fitting = {name: value for name, value in values.items() if name not in NOT_IN_PLANT}
        assert type(twin)(**fitting) == twin


def test_default_fields_are_those_of_the_plant() -> None:
    temperature, pollutant = CONFIG.tank.temperature, CONFIG.tank.pollutant
    assert temperature.base_c == default_temperature_c().base
    assert pollutant.base_ug_l == default_pollutant_ug_l().base
    for ours, theirs in (
        (temperature.plumes, default_temperature_c().plumes),
        (pollutant.plumes, default_pollutant_ug_l().plumes),
    ):
        assert [msgspec.structs.asdict(plume) for plume in ours] == [
            {
                item.name: getattr(plume, item.name)
                for item in dataclasses.fields(plume)
                if item.init
            }
            for plume in theirs
        ]
