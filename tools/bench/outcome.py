"""What a run says of one robot: its true path, its instruments, its figures, its events.

The same whether the robot was alone or one of a shoal; what lies around it (the air, the host, the
world outside) is of whoever put the robots together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tools.bench import account, tracking, wrong
from tools.records.data import Event, FloatArray, Metric, Series, SpiFrame, TargetVisit
from tools.records.metrics import path_metrics

if TYPE_CHECKING:
    from tools.bench.recorder import Recorder
    from tools.bench.robot import Robot
    from tools.configuration import Scenario


@dataclass(frozen=True, slots=True)
class Outcome:
    """One robot's run."""

    truth: dict[str, FloatArray]
    channels: dict[str, Series]
    beat_hz: float
    metrics: dict[str, Metric]
    """Those of the contract, and others that the application has."""
    visits: tuple[TargetVisit, ...]
    events: tuple[Event, ...]
    spi_frames: tuple[SpiFrame, ...]


def outcome(
    config: Scenario,
    robot: Robot,
    recorder: Recorder,
    until_fs: int,
    telemetry: int,
    further: Mapping[str, Series] | None = None,
) -> Outcome:
    """Return what is known of a robot at the end of its run.

    Args:
        config: the robot's scenario.
        robot: it.
        recorder: what kept its channels, all handed on by now.
        until_fs: the end.
        telemetry: messages of it that the base station got.
        further: channels that came from elsewhere.

    """
    # The fish is wherever the real board is: nothing true is known of it.
    known = config.hil.emulates_water
    truth = robot.swimmer.truth(until_fs, recorder.tail_command, known=known)
    channels = recorder.series()
    if (rate := wrong.clock_rate(config)) != 1.0:
        channels = {
            name: Series(series.time_s * rate, series.value) for name, series in channels.items()
        }
    channels.update(further or {})
    frequency = channels.get("tail_frequency_hz")
    beat_hz = float(frequency.value[-1]) if frequency is not None else 0.0
    spi_frames = recorder.spi_frames()
    damaged = sum(frame.outcome == "crc-error" for frame in spi_frames)
    metrics: dict[str, Metric] = dict(path_metrics(truth, beat_hz))
    metrics.update(_counts(config, robot, recorder, telemetry))
    metrics["spi_frames"] = len(spi_frames) + recorder.frames_seen
    metrics["spi_crc_errors"] = damaged + recorder.frames_damaged
    metrics.update(account.target_metrics(config, truth))
    visits = tracking.visits(recorder.tracking, truth)
    if config.procboard.application == "target-tracking":
        metrics.update(tracking.metrics(visits))
    events = (
        *recorder.events(),
        *robot.power.events,
        *account.mount_events(robot.proc.mounts),
        *account.arrival_events(config, metrics),
        *tracking.events(recorder.tracking, visits),
    )
    return Outcome(truth, channels, beat_hz, metrics, visits, events, spi_frames)


def _counts(
    config: Scenario, robot: Robot, recorder: Recorder, telemetry: int
) -> dict[str, Metric]:
    proc = robot.proc
    return {
        "energy_j": robot.power.joules if config.hil.emulates_robot else None,
        "spi_lost": _link_lost(robot),
        "radio_sent": recorder.radio_sent,
        "radio_received": recorder.radio_received,
        "samples_stored": proc.samples_stored,
        "samples_lost": proc.statistics()["samples_lost"],
        "samples_recovered": len(proc.stored_records()),
        "telemetry_received": telemetry,
    }


def _link_lost(robot: Robot) -> int:
    """Messages that one end acknowledged and did not deliver, over all boots."""
    return sum(link.statistics.lost for link in (*robot.nav.links, *robot.proc.links))
