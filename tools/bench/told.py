"""What the boards told one another over the link, counted and kept as it comes.

Counting needs bounded memory however long the run; what a run folder shows (`keep`) is a row of
numbers a report. A report that is missing was refused by its board, which then says so before the
next one (`BoardEvent` QUEUE_FULL), or it was lost on the way, which must not happen: the order of
the link's messages tells the two apart.
"""

from __future__ import annotations

from array import array
from collections import Counter
from math import nan
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from firmware_model.time import FS_PER_S
from navboard.sensor_controller import local_position
from spi_bus.messages import (
    LINK_MESSAGES,
    BoardEvent,
    BoardEventCode,
    CommandApplied,
    GpsReport,
    SensorReport,
)
from tools.records.data import FloatArray, Series

if TYPE_CHECKING:
    from firmware_model.trace import Record
    from navboard.chips.gps18x import Gps18xConfig
    from tools.bench.board_clock import ClockFit

__all__ = ["REPORT_COLUMNS", "Told"]

REPORT_COLUMNS: Final = {
    "gyro_z_rad_s": "gyro_z_rad_s",
    "accel_x_m_s2": "accel_x_m_s2",
    "accel_y_m_s2": "accel_y_m_s2",
    "compass_rad": "compass_rad",
    "tail_command_rad": "tail_command_rad",
    "battery_v": "battery_v",
    "servo_current_a": "servo_current_a",
    "temperature_c": "temperature_c",
}
"""Column of channels.csv: field of a SensorReport."""
GPS_COLUMNS: Final = ("gps_x_m", "gps_y_m")
BEAT_COLUMNS: Final = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
_FIRST: Final = 4096
"""Reports whose stamps are remembered, to tell at the end which were made before the link was up:
more than any board has memory for."""
_BACK: Final = 0x8000  # a step of the number by so much goes back


class Told:
    """Messages of the navigation board as the processing board received them, and its commands.

    Args:
        gps: where the GPS positions' tank is.
        keep: whether to keep samples; without it memory is bounded.

    """

    def __init__(self, gps: Gps18xConfig, *, keep: bool) -> None:
        self._gps = gps
        self._keep = keep
        self._delivered = 0
        self._missing = self._repeated = self._refused = self._lost = 0
        self._pending = 0  # refused reports that the board told of since the last one came
        self._last: int | None = None
        self._first: list[tuple[float, int, int]] = []  # stamp, missing and repeated before it
        self._given: Counter[int] = Counter()
        self._applied: Counter[int] = Counter()
        self._reports = array("d")
        self._fixes = array("d")
        self._beats = array("d")

    # --- what comes ------------------------------------------------------------------------

    def take_messages(self, block: list[Record]) -> None:
        """A sink for payloads that came."""
        for time_fs, payload in block:
            message = LINK_MESSAGES.decode(cast("bytes", payload))
            if isinstance(message, SensorReport):
                self._report(time_fs / FS_PER_S, message)
            elif isinstance(message, GpsReport):
                self._fix(time_fs / FS_PER_S, message)
            elif isinstance(message, CommandApplied):
                self._applied[message.command_id] += 1
            elif isinstance(message, BoardEvent):
                self._event(message)

    def take_beats(self, block: list[Record]) -> None:
        """A sink for tail-beat commands that were queued."""
        for time_fs, value in block:
            command_id, *beat, _valid_s = cast("tuple[Any, ...]", value)
            self._given[command_id] += 1
            if self._keep:
                self._beats.extend((time_fs / FS_PER_S, *beat))

    def _report(self, arrived_s: float, message: SensorReport) -> None:
        missing = repeated = 0
        if self._last is not None:
            step = (message.sequence - self._last) % 0x10000
            if 0 < step < _BACK:
                missing = step - 1
            else:
                repeated = 1
        self._last = message.sequence
        self._delivered += 1
        self._missing += missing
        self._repeated += repeated
        self._lost += max(0, missing - self._pending)
        self._pending = 0
        if len(self._first) < _FIRST:
            self._first.append((message.time_us / 1e6, missing, repeated))
        if self._keep:
            values = (getattr(message, name) for name in REPORT_COLUMNS.values())
            self._reports.extend((message.time_us / 1e6, arrived_s))
            self._reports.extend(nan if value is None else value for value in values)

    def _fix(self, arrived_s: float, message: GpsReport) -> None:
        if self._keep and message.latitude_deg is not None and message.longitude_deg is not None:
            place = local_position(self._gps, message.latitude_deg, message.longitude_deg)
            self._fixes.extend((message.time_us / 1e6, arrived_s, *place))

    def _event(self, message: BoardEvent) -> None:
        if message.code == BoardEventCode.QUEUE_FULL:
            self._refused += message.detail
            self._pending += message.detail
        elif message.code == BoardEventCode.RESET:
            self._last = None  # its numbers begin anew
            self._pending = 0

    # --- what is known at the end ----------------------------------------------------------

    def reports(self, fit: ClockFit | None, up_s: float) -> dict[str, int]:
        """Return how many sensor reports came, and gaps and repetitions in their numbers.

        `fit` is None where stamps cannot be trusted. What the board made before `up_s` is its
        backlog, whose gaps count as `refused` and `lost` only.
        """
        backlog = missing = repeated = 0
        if fit is not None:
            for stamp_s, gap, again in self._first:
                missing += gap
                repeated += again
                if fit.host_s(stamp_s) >= up_s:
                    break
                backlog += 1
        return {
            "delivered": self._delivered,
            "backlog": backlog,
            "missing": self._missing - missing,
            "repeated": self._repeated - repeated,
            "refused": self._refused,
            "lost": self._lost,
        }

    def commands(self) -> dict[str, int]:
        """Tail-beat commands queued, and confirmations; a command may be given again, by its id."""
        return {
            "given": self._given.total(),
            "applied": (self._given & self._applied).total(),
            "surplus": (self._applied - self._given).total(),
        }

    def channels(self, fit: ClockFit | None) -> dict[str, Series]:
        """Return what was reported, and what was told, as channels, at the times of measuring."""
        found: dict[str, Series] = {}
        for columns, rows in (
            (tuple(REPORT_COLUMNS), self._reports),
            (GPS_COLUMNS, self._fixes),
        ):
            table = np.array(rows).reshape(-1, 2 + len(columns))
            times = table[:, 1] if fit is None else fit.host_times(table[:, 0])
            found.update(_series(columns, times, table[:, 2:]))
        beats = np.array(self._beats).reshape(-1, 1 + len(BEAT_COLUMNS))
        for column, name in enumerate(BEAT_COLUMNS, start=1):
            if len(beats):
                found[name] = Series(beats[:, 0].copy(), beats[:, column].copy())
        return found


def _series(columns: tuple[str, ...], times: FloatArray, table: FloatArray) -> dict[str, Series]:
    """Columns without their gaps; what was measured before the run began is none of its samples."""
    before = np.concatenate(([0.0], np.maximum.accumulate(times)[:-1]))[: len(times)]
    forward = times > np.maximum(before, 0.0)
    found = {}
    for column, name in enumerate(columns):
        there = forward & ~np.isnan(table[:, column])
        if there.any():
            found[name] = Series(times[there].copy(), table[there, column].copy())
    return found
