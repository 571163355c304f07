"""A body in the water with its battery, and what instruments find there.

The part of a robot that physics moves, without any board: a whole robot is built around it, and a
plant in the loop is nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from firmware_model.time import FS_PER_S
from navboard.config import NavInputs
from tools.bench import model, wrong
from tools.bench.power import Power

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from tools.configuration import Scenario
    from tools.records.data import FloatArray

RENAMED = {"u_m_s": "surge_m_s", "v_m_s": "sway_m_s", "r_rad_s": "yaw_rate_rad_s"}
"""Columns of the vehicle's truth that truth.csv calls otherwise."""


class Swimmer:
    """Vehicle, power and water of a scenario.

    Args:
        config: the scenario.
        scheduler: time.
        nav, proc: whether that board is emulated and draws its current from the pack.
        keep: whether truth and voltage are kept over time.
        on: whether the pack is in.

    """

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        *,
        nav: bool = True,
        proc: bool = True,
        keep: bool = True,
        on: bool = True,
    ) -> None:
        self._config = config
        self.battery = model.battery(config)
        self.power = Power(scheduler, self.battery, nav=nav, proc=proc, on=on)
        self.temperature = model.temperature_c(config)
        self.pollutant = model.pollutant_ug_l(config)
        self.parameters = model.plant_parameters(config)
        self.vehicle = model.vehicle(
            config,
            self.parameters,
            self.power.volts,
            keep=keep and not config.hil.nav,  # of a real fish nothing true is known
        )
        self.power.keep_history = keep
        if not on and not self.vehicle.servo.ideal:
            self.vehicle.set_supply(0, 0.0)

    def inputs(self) -> NavInputs:
        """Return what the instruments of a navigation board look at."""
        vehicle = self.vehicle
        temperature, pollutant = self.temperature.value, self.pollutant.value
        return NavInputs(
            gyro_z_rad_s=wrong.gyro(self._config, vehicle.r),
            accel_x_m_s2=vehicle.body_acceleration_x,
            accel_y_m_s2=vehicle.body_acceleration_y,
            heading_rad=wrong.compass(self._config, vehicle.heading),
            x_m=vehicle.x,
            y_m=vehicle.y,
            temperature_c=lambda t: temperature(*vehicle.position(t)),
            battery_v=self.power.battery_v,
            servo_current_a=vehicle.servo_current,
            water_quality_ug_l=lambda t: pollutant(*vehicle.position(t)),
            tail_angle_rad=vehicle.tail_angle,
        )

    def truth(
        self, until_fs: int, told: Callable[[FloatArray], FloatArray], *, known: bool = True
    ) -> dict[str, FloatArray]:
        """Return the columns of truth.csv; without rows where nothing true is `known`.

        `told` says what the servo was told at given times.
        """
        rows = self.vehicle.truth(until_fs)
        if not known:
            rows = rows[:0]
        truth = {
            RENAMED.get(name, name): rows[:, column].copy()
            for column, name in enumerate(self.vehicle.truth_columns)
        }
        truth["tail_command_rad"] = told(truth["time_s"])
        looks = np.array(self.power.history)
        truth["battery_v"] = np.interp(truth["time_s"], looks[:, 0] / FS_PER_S, looks[:, 1])
        places = list(zip(truth["x_m"].tolist(), truth["y_m"].tolist(), strict=True))
        truth["temperature_c"] = np.array([self.temperature.value(x, y) for x, y in places])
        truth["pollutant_ug_l"] = np.array([self.pollutant.value(x, y) for x, y in places])
        return truth
