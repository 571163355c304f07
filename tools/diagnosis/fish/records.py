"""The records of the compiled predictor: what instruments make of the truth, and what is random.

As in ``plant.layout``: named tuples inside compiled code, vectors at its border.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from plant.extra_force import AXES, TERMS

__all__ = [
    "AXES",
    "ESTIMATED",
    "INSTRUMENTS",
    "RESTLESS",
    "TERMS",
    "Instruments",
    "Kind",
    "Restless",
]


class Kind(IntEnum):
    """What a measurement is of; the value of its channel in ``CHANNELS``."""

    X = 0
    Y = 1
    HEADING = 2
    GYRO = 3
    COMPASS = 4
    ACCEL_X = 5
    ACCEL_Y = 6
    GPS_X = 7
    GPS_Y = 8
    TAIL = 9


class Instruments(NamedTuple):
    """What is wrong with the instruments; zero is nothing, but for the two of the rotation."""

    camera_scale: float
    camera_cos: float
    camera_sin: float
    camera_rotation: float  # rad
    gyro_bias: float  # rad/s
    gyro_scale: float
    compass_offset: float  # rad
    hard_iron: float  # rad
    hard_iron_at: float  # rad
    soft_iron: float  # rad
    soft_iron_at: float  # rad


class Restless(NamedTuple):
    """Disturbances of surge, sway and yaw: accelerations with first-order correlation.

    Stationary standard deviations in m/s², m/s², rad/s², and correlation times in s.
    """

    surge: float
    sway: float
    yaw: float
    surge_s: float
    sway_s: float
    yaw_s: float


INSTRUMENTS, RESTLESS = len(Instruments._fields), len(Restless._fields)

ESTIMATED = 9
"""States of the estimator: x, y, ψ, u, v, r, and a disturbance of each of the last three."""
