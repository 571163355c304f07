"""Telemetry that came through a real mote: how much, what is missing, and what it said.

The numbers of a robot's messages tell what did not come; a number that comes again, or an older
one, is counted and not kept. A message with the RESET flag begins anew. Times are those of arrival
here: the robot's own clock is in the message.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from firmware_model.time import FS_PER_S
from radio_802154.messages import Telemetry, TelemetryFlag
from tools.records.data import Series

if TYPE_CHECKING:
    from collections.abc import Callable

COLUMNS: dict[str, Callable[[Telemetry], float | None]] = {
    "tail_bias_rad": lambda message: message.tail_bias_rad,
    "gyro_z_rad_s": lambda message: message.gyro_z_rad_s,
    "compass_rad": lambda message: message.heading_rad,
    "battery_v": lambda message: message.battery_v,
    "temperature_c": lambda message: message.temperature_c,
}
"""Column of channels.csv: what telemetry has for it."""
_NUMBERS = 0x10000


@dataclass(slots=True)
class _Robot:
    received: int = 0
    missing: int = 0
    repeated: int = 0
    resets: int = 0
    kept: list[tuple[float, Telemetry]] = field(default_factory=list)


class TelemetryLog:
    """Of all robots, by their address."""

    def __init__(self) -> None:
        self._robots: dict[int, _Robot] = {}

    def note(self, time_fs: int, robot: int, message: Telemetry) -> None:
        """Keep a message that arrived now."""
        log = self._robots.setdefault(robot, _Robot())
        log.received += 1
        if log.kept:
            step = (message.sequence - log.kept[-1][1].sequence) % _NUMBERS
            if message.flags & TelemetryFlag.RESET and message != log.kept[-1][1]:
                log.resets += 1
            elif step == 0 or step >= _NUMBERS // 2:
                log.repeated += 1
                return
            else:
                log.missing += step - 1
        log.kept.append((time_fs / FS_PER_S, message))

    def channels(self, robot: int) -> dict[str, Series]:
        """Return what one robot told, as columns of channels.csv."""
        kept = self._robots[robot].kept if robot in self._robots else []
        found = {}
        for column, value in COLUMNS.items():
            pairs = [(at_s, said) for at_s, message in kept if (said := value(message)) is not None]
            if pairs:
                array = np.array(pairs, dtype=np.float64)
                found[column] = Series(array[:, 0].copy(), array[:, 1].copy())
        return found

    def summary(self) -> dict[int, dict[str, Any]]:
        """Return counts, first and last arrival in seconds and the last message, by address."""
        return {
            address: {
                "received": log.received,
                "missing": log.missing,
                "repeated": log.repeated,
                "resets": log.resets,
                "first_s": log.kept[0][0],
                "last_s": log.kept[-1][0],
                "last": asdict(log.kept[-1][1]),
            }
            for address, log in sorted(self._robots.items())
        }
