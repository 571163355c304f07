"""What is known at each measurement, for whoever asks what the innovations follow."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from plant.layout import Drive
from plant.tail_input import told_angle
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.plan import Plan
from tools.diagnosis.fish.records import Kind
from tools.diagnosis.model import FloatArray, IntArray

_FORGOTTEN_S = 0.5
"""Time in which an estimator forgets a kick, about."""
_CELL_M, _MANY_CELLS = 0.4, 1_000_000
"""The tank is looked at in squares of this size: some body lengths."""


def known(
    inputs: FishInputs, plan: Plan, yaw_rate: FloatArray, table: FloatArray
) -> Mapping[str, FloatArray | IntArray]:
    """Return series (n,) by their names: time, inputs, yaw rate and place; ``table`` of drives."""
    found: dict[str, FloatArray | IntArray] = {
        "the time": plan.time_s,
        "the yaw rate": yaw_rate,
        "the place in the tank": _cells(plan),
    }
    if inputs.told_s is not None and inputs.told_rad is not None:
        found["the command"] = np.interp(plan.time_s, inputs.told_s, inputs.told_rad)
        return found
    programme = inputs.programme
    row = np.searchsorted(programme.starts_s, plan.time_s, side="right") - 1
    beats = np.array([(b.bias_rad, b.amplitude_rad, b.frequency_hz) for b in programme.beats])[
        np.maximum(row, 0)
    ]
    names = ("the bias", "the amplitude", "the frequency")
    found |= {name: beats[:, i].copy() for i, name in enumerate(names)}
    return found | {"jumps of the command": _jumps(table, plan.time_s)}


def _cells(plan: Plan) -> IntArray:
    """Return labels of the part of the tank where the camera last saw the robot; one without.

    Last is before: along the edge of a cell a frame's own noise would choose its label, and
    then the mean of what is in a cell is not zero in healthy data.
    """
    label = np.zeros(plan.time_s.size, dtype=np.int64)
    for kind in (Kind.X, Kind.Y):
        seen = plan.kind == int(kind)
        if seen.any():
            before = np.searchsorted(plan.time_s[seen], plan.time_s, side="left") - 1
            where = plan.value[seen][np.maximum(before, 0)]
            label = label * _MANY_CELLS + np.floor(where / _CELL_M).astype(np.int64)
    return label


def _jumps(table: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return by how much the commanded angle jumped last, and how long ago (rad, dying out)."""
    drives_ = [Drive(*row.tolist()) for row in table]
    size = np.zeros(len(drives_))
    for i, (before, after) in enumerate(itertools.pairwise(drives_), start=1):
        size[i] = told_angle(after, 0.0) - told_angle(before, after.start - before.start)
    begun = np.array([drive.start for drive in drives_])
    last = np.maximum(np.searchsorted(begun, time_s, side="right") - 1, 0)
    found: FloatArray = size[last] * np.exp(-np.maximum(time_s - begun[last], 0.0) / _FORGOTTEN_S)
    return found
