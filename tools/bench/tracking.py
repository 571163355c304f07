"""What target tracking did: visits, switches, metrics and events, from what the board said of it.

The board says which target it pursues and when it struck one off; how near the robot truly came is
the truth's. Targets are numbered as they were pursued, over restarts of the board, which begins its
list anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from firmware_model.time import FS_PER_S
from tools.records.data import Event, FloatArray, Metric, ModeSwitch, TargetVisit

Said = Iterable[tuple[int, Any]]
"""Records of the trace channel `proc.tracking`."""


def visits(said: Said, truth: Mapping[str, FloatArray]) -> tuple[TargetVisit, ...]:
    """Return every target that was pursued; the last may not have been reached."""
    pursued: list[TargetVisit] = []
    for time_fs, (word, *values) in said:
        now_s = time_fs / FS_PER_S
        if word == "target":
            pursued.append(TargetVisit(values[1], values[2], now_s, None, math.nan))
        elif word == "reached" and pursued:
            pursued[-1] = replace(pursued[-1], reached_s=now_s)
    ends = [visit.since_s for visit in pursued]
    return tuple(
        replace(visit, nearest_m=_nearest_m(truth, visit, visit.reached_s or end_s))
        for visit, end_s in zip(pursued, [*ends[1:], math.inf], strict=False)
    )


def _nearest_m(truth: Mapping[str, FloatArray], visit: TargetVisit, end_s: float) -> float:
    distance = np.hypot(truth["x_m"] - visit.x_m, truth["y_m"] - visit.y_m)
    meant = (truth["time_s"] >= visit.since_s) & (truth["time_s"] <= end_s)
    return float(distance[meant].min()) if meant.any() else math.nan


def switches(said: Said) -> tuple[ModeSwitch, ...]:
    """Return when which controller took over."""
    return tuple(
        ModeSwitch(time_fs / FS_PER_S, values[1]) for time_fs, values in said if values[0] == "mode"
    )


def metrics(found: tuple[TargetVisit, ...]) -> dict[str, Metric]:
    """How many targets were reached, then time and true nearest distance of each."""
    result: dict[str, Metric] = {
        "targets_reached": sum(visit.reached_s is not None for visit in found)
    }
    for number, visit in enumerate(found, start=1):
        result[f"target_{number}_reached_s"] = visit.reached_s
        result[f"target_{number}_nearest_m"] = visit.nearest_m
    return result


def events(said: Said, found: tuple[TargetVisit, ...]) -> list[Event]:
    """Arrivals, and poses that stayed away."""
    told = [
        Event(
            visit.reached_s,
            "robot",
            f"target {number} at ({visit.x_m:g}, {visit.y_m:g}) m reached "
            f"{visit.reached_s - visit.since_s:.1f} s after it was set, "
            f"{100 * visit.nearest_m:.1f} cm at the nearest",
            label=f"target {number}",
        )
        for number, visit in enumerate(found, start=1)
        if visit.reached_s is not None
    ]
    words = {
        "pose lost": ("no pose for too long: the robot stops", "warning"),
        "pose found": ("a pose again: the robot goes on", "info"),
    }
    told += [
        Event(time_fs / FS_PER_S, "robot", *words[values[0]])
        for time_fs, values in said
        if values[0] in words
    ]
    return told
