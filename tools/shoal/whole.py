"""What a shoal as a whole has: how near its robots came to each other, and sums over them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tools.records.data import FloatArray, Metric
from tools.records.shoal_data import Hearing, SwumRobot

SUMS = (
    "path_length_m", "energy_j", "spi_frames", "spi_crc_errors", "spi_lost", "samples_stored",
    "samples_lost", "samples_recovered", "telemetry_received",
)  # fmt: skip
"""Metrics of the robots that are added up."""


def whole(
    robots: Sequence[SwumRobot], hearing: Hearing, base: tuple[int, int]
) -> dict[str, Metric]:
    """Return the metrics of a shoal; `base`: messages that its radio sent and received."""
    distance, at_s, pair = nearest(robots)
    found: dict[str, Metric] = {
        "robots": len(robots),
        "least_distance_m": distance,
        "least_distance_s": at_s,
        "least_distance_between": pair[0],
        "least_distance_and": pair[1],
    }
    for name in SUMS:
        values = [robot.metrics.get(name) for robot in robots]
        found[name] = sum(value for value in values if value is not None)
    for name, own in zip(("radio_sent", "radio_received"), base, strict=True):
        found[name] = own + sum(robot.metrics.get(name) or 0 for robot in robots)
    found["radio_frames"] = int(hearing.sent.sum())
    ratio = hearing.ratio()[:-1, -1]
    heard = ratio[~np.isnan(ratio)]
    found["base_reception_ratio"] = float(heard.mean()) if heard.size else None
    return found


def nearest(
    robots: Sequence[SwumRobot],
) -> tuple[float | None, float | None, tuple[int | None, int | None]]:
    """Return the least distance between two robots in m, when it was in s, and their addresses.

    Between their places (the middle of each body), at the times of truth.csv.
    """
    best: tuple[float, float, tuple[int, int]] | None = None
    x, y = (np.stack([robot.truth[name] for robot in robots]) for name in ("x_m", "y_m"))
    time = robots[0].truth["time_s"]
    for first in range(len(robots) - 1):
        distance: FloatArray = np.hypot(x[first + 1 :] - x[first], y[first + 1 :] - y[first])
        if not distance.size:
            continue
        other, moment = (int(i) for i in np.unravel_index(distance.argmin(), distance.shape))
        least = float(distance[other, moment])
        if best is None or least < best[0]:
            pair = robots[first].address, robots[first + 1 + other].address
            best = least, float(time[moment]), pair
    return best if best is not None else (None, None, (None, None))
