"""`RunData`: all that a run knows about itself, as plain arrays and rows.

The bench fills it, the writers and the report read it, and none of them knows another. Times are
seconds since the start of the run, as 64-bit floats; the exact femtoseconds live in the trace.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
Metric: TypeAlias = "float | int | None"

CHANNEL_COLUMNS = (
    "time_s",
    "tail_bias_rad",
    "tail_amplitude_rad",
    "tail_frequency_hz",
    "tail_command_rad",
    "x_m",
    "y_m",
    "heading_rad",
    "gyro_z_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "compass_rad",
    "gps_x_m",
    "gps_y_m",
    "tail_angle_rad",
    "battery_v",
    "servo_current_a",
    "temperature_c",
)
"""Columns of channels.csv, in the order of the contract."""

TRUTH_COLUMNS = (
    "time_s",
    "x_m",
    "y_m",
    "heading_rad",
    "surge_m_s",
    "sway_m_s",
    "yaw_rate_rad_s",
    "tail_command_rad",
    "tail_angle_rad",
    "tail_rate_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "battery_v",
    "servo_current_a",
    "temperature_c",
    "pollutant_ug_l",
)
"""First columns of truth.csv: what is, without any instrument. Accelerations are of the body axes.
What else a plant has stands behind them: of a tail that bends `tail_tip_m`."""

METRICS = (
    "speed_m_s",
    "turn_radius_m",
    "turn_period_s",
    "path_length_m",
    "energy_j",
    "spi_frames",
    "spi_crc_errors",
    "spi_lost",
    "radio_sent",
    "radio_received",
    "samples_stored",
    "samples_lost",
)
"""Keys of `metrics` in summary.json; null where one does not apply."""


@dataclass(frozen=True, slots=True)
class Series:
    """Samples of one channel: times in seconds, rising, and values in the channel's unit."""

    time_s: FloatArray
    value: FloatArray

    def __post_init__(self) -> None:
        if self.time_s.shape != self.value.shape:
            raise ValueError("a series needs as many values as times")


@dataclass(frozen=True, slots=True)
class SpiFrame:
    """One frame on the wires between the boards."""

    time_s: float
    from_master: bool
    kind: str
    """Name of the message, or "ack" for a frame that only acknowledges."""
    outcome: str
    """"ok", "retransmission", "duplicate", "crc-error" or "lost"."""
    octets: int


@dataclass(frozen=True, slots=True)
class RadioFrame:
    """One frame in the air."""

    time_s: float
    duration_s: float
    source: str
    """Who sent it: "robot", "base", …"""
    kind: str
    """"command", "telemetry", "pose", "ack", …"""
    outcome: str
    """"received", "lost" or "collided"."""
    octets: int


@dataclass(frozen=True, slots=True)
class EnergyState:
    """What one consumer used in one of its states."""

    consumer: str
    state: str
    seconds: float
    joules: float
    board: str = ""
    """Where it sits: "navigation board", "processing board", …"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One row of "what makes the difference to the ideal plant", nearest to the ideal first."""

    label: str
    speed_m_s: float | None
    turn_radius_m: float | None
    why: str = ""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened once: a reset, a fault, a command, an arrival."""

    time_s: float
    where: str
    what: str
    severity: str = "info"
    """"info", "warning" or "fault"."""
    label: str = ""
    """A word or two for the charts; empty: it is in the list only."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command from the base station, and what became of it."""

    sent_s: float
    what: str
    attempts: int
    outcome: str
    """"applied", "accepted", …; "no answer" where there was none."""
    answered_s: float | None = None


@dataclass(frozen=True, slots=True)
class LinkEnd:
    """What one end of the link counted, over all its boots."""

    name: str
    messages_sent: int
    messages_acknowledged: int
    retransmissions: int
    damaged: int
    """Frames received with a wrong CRC or broken framing."""
    duplicates: int
    """Messages received again and suppressed."""
    lost: int


@dataclass(frozen=True, slots=True)
class Mount:
    """The log as a boot of the processing board found it."""

    time_s: float
    records: int


@dataclass(frozen=True, slots=True)
class TargetVisit:
    """A target that the robot swam to by target tracking, in the order in which it did."""

    x_m: float
    y_m: float
    since_s: float
    """When it became the target."""
    reached_s: float | None
    """When the robot struck it off; None: it did not."""
    nearest_m: float
    """How near the robot truly came while it was the target."""


@dataclass(frozen=True, slots=True)
class ModeSwitch:
    """Another controller of target tracking took over: "approaching", "turning" or "leaving"."""

    time_s: float
    mode: str


@dataclass(frozen=True, slots=True)
class Change:
    """A key of the scenario that has not the value of the bundled model."""

    what: str
    """In words: "water: shear x per y"."""
    key: str
    """In the scenario, dotted."""
    value: str
    """With its unit; "none" where there is none."""
    usual: str
    """Of the bundled model."""


@dataclass(frozen=True, slots=True)
class Changes:
    """Where a scenario differs from the bundled model that it goes back to."""

    model: str
    rows: tuple[Change, ...]
    """The robot and its water first."""


@dataclass(frozen=True, slots=True)
class TankView:
    """What the picture of the path needs to know."""

    corner_m: tuple[float, float]
    size_m: tuple[float, float]
    target_m: tuple[float, float] | None = None
    """Of the heading controller."""
    targets_m: tuple[tuple[float, float], ...] = ()
    """Of target tracking, those that the scenario lists."""
    arrival_radius_m: float = 0.0
    base_station_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class TailShape:
    """A tail that bends, over the last beat that it made."""

    time_s: FloatArray
    points_m: FloatArray
    """(times, points, 2): joint to tip in body axes from the joint, x ahead, y to port."""


@dataclass(frozen=True, slots=True)
class RunData:
    """One robot's run."""

    scenario: str
    description: str
    seed: int
    duration_s: float
    """Simulated time that was reached."""
    wall_s: float
    version: str
    trace_sha256: str
    tank: TankView
    metrics: Mapping[str, Metric]
    truth: Mapping[str, FloatArray]
    """By the names of `TRUTH_COLUMNS` and others that the plant has, all of one length."""
    channels: Mapping[str, Series]
    """By the names of `CHANNEL_COLUMNS` (without time_s), also names beyond those."""
    changes: Changes | None = None
    """None: nobody looked."""
    tail_shape: TailShape | None = None
    """None: the tail is rigid, or did not move."""
    truth_every: int = 1
    """Rows of `truth` for one of truth.csv."""
    beat_frequency_hz: float = 0.0
    """Tail-beat frequency at the end; 0 where the tail rests."""
    interrupted: bool = False
    spi_frames: tuple[SpiFrame, ...] = ()
    radio_frames: tuple[RadioFrame, ...] = ()
    energy: tuple[EnergyState, ...] = ()
    comparison: tuple[Comparison, ...] = ()
    comparison_note: str = ""
    """Why there is no comparison, as a clause."""
    events: tuple[Event, ...] = ()
    outages: tuple[tuple[float, float], ...] = ()
    """Times without supply, from and to."""
    commands: tuple[Command, ...] = ()
    links: tuple[LinkEnd, ...] = ()
    mounts: tuple[Mount, ...] = ()
    targets: tuple[TargetVisit, ...] = ()
    switches: tuple[ModeSwitch, ...] = ()
    lateness: Mapping[str, float] = field(default_factory=dict)
    """Of a real-time run: `maximum_s`, `p99_s`, `missed`."""
    hil: Mapping[str, Any] = field(default_factory=dict)
    """Of a run with a real board, what is known of it and of the line: see docs."""
