"""What can be measured of a fish, in the order of ``records.Kind``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tools.diagnosis.model import Channel

CHANNELS = (
    Channel("x_m", "m"),
    Channel("y_m", "m"),
    Channel("heading_rad", "rad", angle=True),
    Channel("gyro_z_rad_s", "rad/s"),
    Channel("compass_rad", "rad", angle=True),
    Channel("accel_x_m_s2", "m/s²"),
    Channel("accel_y_m_s2", "m/s²"),
    Channel("gps_x_m", "m"),
    Channel("gps_y_m", "m"),
    Channel("tail_angle_rad", "rad"),
)
"""All channels; a run may hold any subset. Index: ``records.Kind``."""

NAMES = tuple(channel.name for channel in CHANNELS)

CAMERA = ("x_m", "y_m", "heading_rad")


def with_sigmas(sigmas: Mapping[str, float]) -> tuple[Channel, ...]:
    """Return the channels, with noise where it is known."""
    return tuple(
        replace(channel, sigma=sigmas.get(channel.name, channel.sigma)) for channel in CHANNELS
    )
