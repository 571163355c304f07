"""From a run folder back to `RunData`, as far as its files go.

Frames, energy by state, the comparison and the events are in the report only; everything else of a
run, the pictures of motion and sensors included, can be made again from the folder.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools import scenario
from tools.errors import RunFolderError
from tools.records.changes import changes
from tools.records.csv import read_columns
from tools.records.data import RunData, Series, TankView
from tools.records.folder import is_run_folder

if TYPE_CHECKING:
    from tools.configuration import Scenario


def _number(value: object, above: float = -math.inf) -> bool:
    """Whether a value of a JSON document is a finite number above a limit."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return above < value < math.inf


def _numbers(value: object) -> bool:
    """Whether a value of a JSON document is an object of metrics."""
    return isinstance(value, dict) and all(
        metric is None or _number(metric) for metric in value.values()
    )


_SUMMARY: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
    ("scenario", lambda value: isinstance(value, str), "a text"),
    ("seed", lambda value: type(value) is int and value >= 0, "a whole number from 0 on"),
    ("duration_s", lambda value: _number(value, above=0.0), "a number above 0"),
    ("wall_s", _number, "a number"),
    ("version", lambda value: isinstance(value, str), "a text"),
    (
        "trace_sha256",
        lambda value: isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value) is not None,
        "64 hexadecimal digits",
    ),
    (
        "metrics",
        lambda value: (
            isinstance(value, dict)
            and (_numbers(value) or all(_numbers(part) for part in value.values()))
        ),
        "an object of numbers, or one for each robot",
    ),
)
"""What summary.json must hold: key, whether a value fits, and what does in words."""


def read_run_folder(folder: Path) -> RunData:
    """Read a run folder; raises `RunFolderError` where it is none or is damaged."""
    if not is_run_folder(folder):
        raise RunFolderError(f"{folder}: no run folder: scenario.toml or summary.json is missing")
    config = scenario.load(folder / "scenario.toml")
    if config.shoal.robots:
        raise RunFolderError(f"{folder}: the run of a shoal: each robot's tables are in its folder")
    summary = read_summary(folder)
    try:
        truth = {name: series.value for name, series in read_columns(folder / "truth.csv").items()}
        channels = read_columns(folder / "channels.csv")
    except (OSError, ValueError, StopIteration) as error:
        raise RunFolderError(f"{folder}: its tables cannot be read: {error}") from error
    channels.pop("time_s", None)
    return RunData(
        scenario=str(summary["scenario"]),
        description=config.scenario.description,
        seed=int(summary["seed"]),
        duration_s=float(summary["duration_s"]),
        wall_s=float(summary["wall_s"]),
        version=str(summary["version"]),
        trace_sha256=str(summary["trace_sha256"]),
        tank=tank_view(config),
        metrics=summary["metrics"],
        truth=truth,
        channels=channels,
        changes=changes(config),
        beat_frequency_hz=_last(channels.get("tail_frequency_hz")),
        interrupted=bool(summary.get("interrupted", False)),
        lateness=summary.get("lateness", {}),
    )


def read_summary(folder: Path) -> dict[str, Any]:
    """summary.json as plain data, with the keys of the contract."""
    path = folder / "summary.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    if not isinstance(found, dict):
        raise RunFolderError(f"{path}: must be an object")
    for key, fits, says in _SUMMARY:
        if key not in found:
            raise RunFolderError(f"{path}: has no {key}")
        if not fits(found[key]):
            raise RunFolderError(f"{path}: {key} = {json.dumps(found[key])[:60]}: must be {says}")
    return found


def tank_view(config: Scenario) -> TankView:
    """What the picture of the path shows of a scenario."""
    heads_for_target = config.procboard.application == "heading"
    heading, tracking = config.procboard.heading, config.procboard.tracking
    tracks = config.procboard.application == "target-tracking"
    base = config.base_station
    radius_m = tracking.arrival_radius_m if tracks else 0.0
    return TankView(
        corner_m=config.tank.corner_m,
        size_m=config.tank.size_m,
        target_m=heading.target_m if heads_for_target else None,
        targets_m=tracking.targets_m if tracks else (),
        arrival_radius_m=heading.arrival_radius_m if heads_for_target else radius_m,
        base_station_m=(base.x_m, base.y_m),
    )


def _last(series: Series | None) -> float:
    """The last value of a channel, 0 where there is none."""
    return float(series.value[-1]) if series is not None and series.value.size else 0.0
