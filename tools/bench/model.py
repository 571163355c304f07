"""From the scenario's words to the plant's objects: parameters, vehicle, fields, battery."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

import msgspec

from plant.battery import Battery, BatteryParameters
from plant.camera import CameraParameters
from plant.effects import EFFECTS, with_effects
from plant.errors import InvalidParameterError, PlantError
from plant.extra_force import ExtraForce, extra_force
from plant.fields import AnalyticField, Field, Plume
from plant.parameters import (
    Body,
    Hydrodynamics,
    Linkage,
    PlantParameters,
    Servo,
    Tail,
    Walls,
    Water,
)
from tools.effects import UNKNOWN_FORCE
from tools.errors import ScenarioError
from tools.field_files import read_field

if TYPE_CHECKING:
    from plant.underwater import UnderwaterVehicle
    from tools.configuration import Scenario


def plant_parameters(config: Scenario) -> PlantParameters:
    """Return the plant's parameters with the scenario's effects, among the walls of its tank.

    What the plant refuses is the scenario's fault.
    """
    as_dict = msgspec.structs.asdict
    plant = config.plant
    (left, low), (width, height) = config.tank.corner_m, config.tank.size_m
    try:
        parameters = PlantParameters(
            body=Body(**as_dict(plant.body)),
            tail=Tail(**as_dict(plant.tail)),
            hydrodynamics=Hydrodynamics(**as_dict(plant.hydrodynamics)),
            water=Water(**as_dict(plant.water)),
            walls=Walls(
                **as_dict(plant.walls),
                x_min_m=left,
                y_min_m=low,
                x_max_m=left + width,
                y_max_m=low + height,
            ),
            servo=Servo(**as_dict(plant.servo)),
            linkage=Linkage(**as_dict(plant.linkage)),
        )
    except PlantError as error:
        raise ScenarioError(f"plant.{error}") from error
    effects = msgspec.to_builtins(config.effects)
    try:
        parameters = with_effects(parameters, {name: effects[name] for name in EFFECTS})
    except PlantError as error:
        raise ScenarioError(str(error)) from error
    try:
        force = extra_force(**effects[UNKNOWN_FORCE.name])
    except InvalidParameterError as error:
        place = error.field.replace(ExtraForce.SECTION, f"effects.{UNKNOWN_FORCE.name}", 1)
        raise ScenarioError(f"{place}: {error.reason}") from error
    return replace(parameters, force=force) if force.acting else parameters


DENSE_S = 0.005
"""The servo steps every 20 ms and the body shakes with it: what the report compares instruments
with must be denser than truth.csv, or that ripple would look like their error."""


def truth_steps(config: Scenario) -> tuple[int, int]:
    """Grid steps between rows of the kept truth, and kept rows between rows of truth.csv."""
    step_s = config.plant.step_s
    dense_s = DENSE_S if not config.shoal.robots else inf  # no such comparison: less to keep
    written = max(1, round(config.records.truth_period_s / step_s))
    kept = next(
        (n for n in range(1, written) if written % n == 0 and n * step_s >= dense_s * (1 - 1e-9)),
        written,
    )
    return kept, written // kept


UNKEPT_S = 3600.0
"""Between rows of the truth where nobody wants them."""


def vehicle(
    config: Scenario, parameters: PlantParameters, supply_v: float, *, keep: bool = True
) -> UnderwaterVehicle:
    """Return the body in the water, where and how the scenario starts it, with or without truth."""
    from plant.trajectory import Start
    from plant.vehicle import FS_PER_S, Vehicle

    step_fs = round(config.plant.step_s * FS_PER_S)
    initial = config.initial
    start = Start(
        x_m=initial.x_m,
        y_m=initial.y_m,
        heading_rad=initial.heading_rad,
        u_m_s=initial.surge_m_s,
        v_m_s=initial.sway_m_s,
        r_rad_s=initial.yaw_rate_rad_s,
    )
    return Vehicle(
        parameters,
        start,
        step_fs=step_fs,
        history_fs=step_fs
        * (truth_steps(config)[0] if keep else round(UNKEPT_S / config.plant.step_s)),
        supply_v=supply_v,
    )


def temperature_c(config: Scenario) -> Field:
    """Return the water's temperature over the tank, °C."""
    grid = read_field(config, "temperature")
    if grid is not None:
        return grid
    field = config.tank.temperature
    return AnalyticField(
        base=field.base_c,
        gradient_x_per_m=field.gradient_x_c_m,
        gradient_y_per_m=field.gradient_y_c_m,
        plumes=tuple(Plume(**msgspec.structs.asdict(plume)) for plume in field.plumes),
    )


def pollutant_ug_l(config: Scenario) -> Field:
    """Return the pollutant's concentration over the tank, µg/L."""
    grid = read_field(config, "pollutant")
    if grid is not None:
        return grid
    field = config.tank.pollutant
    return AnalyticField(
        base=field.base_ug_l,
        gradient_x_per_m=field.gradient_x_ug_l_m,
        gradient_y_per_m=field.gradient_y_ug_l_m,
        plumes=tuple(Plume(**msgspec.structs.asdict(plume)) for plume in field.plumes),
        least=0.0,
    )


def battery(config: Scenario) -> Battery:
    """Return the pack with its charge at the start."""
    return Battery(BatteryParameters(**msgspec.structs.asdict(config.battery)))


def camera(config: Scenario) -> CameraParameters:
    """Return the overhead camera's data."""
    values = msgspec.structs.asdict(config.camera)
    del values["fitted"]
    return CameraParameters(**values)
