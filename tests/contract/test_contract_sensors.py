"""Every row of the sensor table, unasked: a constant comes through chip, wires and driver.

The world is held still on one value, the board runs, and what the row's channel reports must lie
within what the instrument's data sheet allows. A row without an entry below fails: who adds an
instrument says here what it promises.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_S
from firmware_model.trace import Trace
from navboard.board import NavBoard
from navboard.chips.gps18x import Gps18xConfig
from navboard.config import NavConfig, NavInputs
from navboard.sensor_controller import SAMPLE_CHANNELS
from navboard.sensors import SENSORS

DEGREE = math.radians(1)


@dataclass(frozen=True)
class Promise:
    """Values to measure, and how far a mean report may be from each."""

    values: tuple[float, ...]
    offset: float
    """Zero error and resolution, in the channel's unit."""
    share: float = 0.0
    """Scale error, as a fraction of the value."""
    world: str = ""
    """The input of the board, where it is not called as the channel is."""
    turns: bool = False

    def allowed(self, value: float) -> float:
        return self.offset + self.share * abs(value)


# Tolerances are drawn per part as a normal deviate whose two sigma are the data sheet's limit; four
# sigma are allowed here, noise is averaged away.
PROMISES = {
    # LPY503AL: zero rate 0.5 °/s (1 σ, after the board's calibration); ×1 beyond ±29 °/s.
    "gyro_z_rad_s": Promise(
        (0.0, 20 * DEGREE, -25 * DEGREE, 60 * DEGREE, -100 * DEGREE), 2 * DEGREE
    ),
    # LSM303DLH: zero-g level ±60 mg (two sigma), 1 mg a bit.
    "accel_x_m_s2": Promise((0.0, 3.0, -9.0), 1.2, 0.02),
    "accel_y_m_s2": Promise((0.0, -4.0, 8.0), 1.2, 0.02),
    "accel_z_m_s2": Promise((9.80665, -9.80665), 1.2, 0.02),
    # The same magnetometer, level: the direction of a horizontal field of about 19 µT.
    "compass_rad": Promise((0.0, 1.0, -2.0, 3.1), 0.1, world="heading_rad", turns=True),
    # GPS 18x: its error of 1.5 m (1 σ) wanders within a minute.
    "gps_x_m": Promise((0.0, 120.0, -45.0), 6.5, world="x_m"),
    "gps_y_m": Promise((0.0, 80.0, -150.0), 6.5, world="y_m"),
    # TMP36: ±1 °C at 25 °C, taken as two sigma.
    "temperature_c": Promise((0.0, 20.0, 35.0), 2.1),
    "battery_v": Promise((6.0, 7.4, 8.4), 0.01, 0.012),
    "servo_current_a": Promise((0.05, 0.33, 2.1), 0.003, 0.02),
    "water_quality_ug_l": Promise((1.0, 50.0, 400.0), 0.3, 0.04),
    "tail_angle_rad": Promise((0.0, 0.6, -1.0), 0.003),
}


def test_every_row_has_its_promise() -> None:
    assert PROMISES.keys() == {sensor.name for sensor in SENSORS}


def reports(name: str, world: str, value: float, seed: int) -> list[float]:
    """What the board reports of one channel in three seconds of a world that stands still."""
    scheduler = Scheduler()
    board = NavBoard(
        scheduler,
        Trace(),
        Rail(scheduler, "3V3", 3.3),
        NavInputs(**{world: constant(value)}),
        lambda _time_fs, _angle_rad: None,
        NavConfig(gps=Gps18xConfig(), tail_potentiometer_fitted=True, water_probe_fitted=True),
        seed,
    )
    found: list[float] = []
    column = SAMPLE_CHANNELS.index(name)

    def sample(_time_fs: int, values: Any) -> None:
        if values[column] is not None:
            found.append(values[column])

    board.on_sample = sample
    scheduler.run(3 * FS_PER_S)
    return found


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("name", "value"),
    [(name, value) for name, promise in PROMISES.items() for value in promise.values],
)
def test_a_constant_comes_out_as_the_instrument_promises(
    name: str, value: float, seed: int
) -> None:
    promise = PROMISES[name]
    found = reports(name, promise.world or name, value, seed)
    assert len(found) >= 2
    errors = [report - value for report in found]
    if promise.turns:
        errors = [(error + math.pi) % (2 * math.pi) - math.pi for error in errors]
    assert abs(fmean(errors)) <= promise.allowed(value)
    # An instrument is never exact.
    assert any(error != 0.0 for error in errors)


@pytest.mark.parametrize("name", PROMISES)
def test_the_channel_follows_its_own_quantity(name: str) -> None:
    """Two values of the world give two reports, as far apart: no row is wired to another."""
    promise = PROMISES[name]
    low, high = promise.values[0], promise.values[-1]
    world = promise.world or name
    means = [fmean(reports(name, world, value, 7)) for value in (low, high)]
    apart = means[1] - means[0]
    scale = 0.03 * abs(high - low) + promise.offset / 4
    assert apart == pytest.approx(high - low, abs=max(scale, promise.share * abs(high - low)))
