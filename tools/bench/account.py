"""What a run says of itself beyond samples: arrivals, mounts of the log, counters of the link."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from firmware_model.time import FS_PER_S
from tools.records.data import Event, FloatArray, LinkEnd, Metric, Mount

if TYPE_CHECKING:
    from spi_bus.link import Link
    from tools.bench.robot import Robot
    from tools.configuration import Scenario


def target_metrics(config: Scenario, truth: Mapping[str, FloatArray]) -> dict[str, Metric]:
    """When the robot first was within the arrival radius, and how near to the target it came."""
    heading = config.procboard.heading
    if config.procboard.application != "heading" or not truth["time_s"].size:
        return {}
    x_m, y_m = heading.target_m
    distance = np.hypot(truth["x_m"] - x_m, truth["y_m"] - y_m)
    inside = np.flatnonzero(distance <= heading.arrival_radius_m)
    arrival = float(truth["time_s"][inside[0]]) if inside.size else None
    return {"arrival_s": arrival, "target_nearest_m": float(distance.min())}


def arrival_events(config: Scenario, metrics: Mapping[str, Metric]) -> list[Event]:
    """The arrival, where there was one."""
    arrival = metrics.get("arrival_s")
    if arrival is None:
        return []
    radius = 100 * config.procboard.heading.arrival_radius_m
    x_m, y_m = config.procboard.heading.target_m
    words = f"arrived: within {radius:g} cm of the target ({x_m:g}, {y_m:g}) m"
    return [Event(float(arrival), "robot", words, label="arrival")]


def mounts(found: Iterable[tuple[int, int]]) -> tuple[Mount, ...]:
    """What each boot found on the flash."""
    return tuple(Mount(time_fs / FS_PER_S, records) for time_fs, records in found)


def mount_events(found: Iterable[tuple[int, int]]) -> list[Event]:
    """Every boot of the processing board, with what its log held."""
    return [
        Event(
            mount.time_s,
            "processing board",
            f"boot {number}: log mounted, {mount.records or 'no'} records found",
            label=f"boot {number}" if number > 1 else "",
        )
        for number, mount in enumerate(mounts(found), start=1)
    ]


def link_ends(robot: Robot) -> tuple[LinkEnd, ...]:
    """Counters of both ends of the link, over all boots."""
    return (
        _end("processing board", robot.proc.links),
        _end("navigation board", robot.nav.links),
    )


def _end(name: str, links: Iterable[Link]) -> LinkEnd:
    counts = [link.statistics for link in links]
    return LinkEnd(
        name,
        sum(c.messages_sent for c in counts),
        sum(c.messages_acknowledged for c in counts),
        sum(c.retransmissions for c in counts),
        sum(c.crc_errors + c.framing_errors for c in counts),
        sum(c.duplicates for c in counts),
        sum(c.lost for c in counts),
    )
