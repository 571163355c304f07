"""What the tail was told in a run, as drives of the plant at true times.

Beats become one drive each, with the phase that runs on; a record of the servo's commands becomes
one drive a sample: held for a servo, which holds its pulse; a piece of a spline for an ideal tail,
which needs rates (``spline``). Delay and lag of the command, a clock that runs
fast, and commands that never arrived are worked in here, exactly and without a grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from plant.layout import DRIVE, Drive
from plant.parameters import Servo
from plant.servo import lag_share
from plant.tail_input import TailProgramme, drive_of
from tools.diagnosis.fish.spline import smooth
from tools.diagnosis.model import FloatArray

FEWEST = 10
"""Commands from which it can be said how they were before."""
KNOWN_S, UNKNOWN_S = 1.0, 0.5
"""From so much of a record that begins in motion the commands of so long before it are made up:
many lags of a servo."""
STEP_HZ = 1.05
BEATS_HZ = 0.2 * STEP_HZ ** np.arange(62)
"""Frequencies of a tail that are tried for that, up to 4 Hz, before the best is fitted."""


@dataclass(frozen=True, slots=True)
class FishInputs:
    """The programme of one run, times in seconds of the recorder since its first row.

    ``programme``: beats as they were commanded. ``told_s``, ``told_rad`` (m,): what a servo was
    told, where that was recorded; it then takes the place of the beats. In a run that begins in
    motion it may begin before time zero: a servo is still on its way. ``supply_v``: of the servo;
    None sets no limit to its speed.
    """

    programme: TailProgramme
    told_s: FloatArray | None = None
    told_rad: FloatArray | None = None
    supply_v: float | None = None

    def tail_at_start(self, memory_s: float = 2.0) -> tuple[float, float]:
        """Return the first command and the mean of those after it: where a servo may be then."""
        if self.told_s is not None and self.told_rad is not None:
            first = self.told_rad[self.told_s <= self.told_s[0] + memory_s]
            return float(first[0]), float(np.mean(first))
        beat = self.programme.beats[0]
        swing = beat.amplitude_rad * math.sin(self.programme.phase_rad)
        return beat.bias_rad + swing, beat.bias_rad

    @property
    def changes(self) -> int:
        """Commands after the first that may be lost; none where it is known what arrived."""
        if self.told_s is not None:
            return 0
        return len(self.programme.beats) - 1


def in_motion(time_s: FloatArray, angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return commands (n,) with those before the first of them, when the tail was in motion, too.

    They go on as the bias and the sine that fit the record's beginning best.
    """
    since_s = time_s - time_s[0]
    known = since_s <= KNOWN_S
    if np.count_nonzero(known) < FEWEST:
        return time_s, angle_rad
    before_s = np.arange(-UNKNOWN_S, 0.0, float(np.median(np.diff(since_s[known]))))

    def fitted(hertz: float) -> tuple[float, FloatArray]:
        phase = 2.0 * math.pi * hertz * np.concatenate((before_s, since_s[known]))
        terms = np.column_stack((np.ones_like(phase), np.sin(phase), np.cos(phase)))
        inside = terms[before_s.size :]
        sizes = np.linalg.lstsq(inside, angle_rad[known], rcond=1e-6)[0]
        misfit = float(np.sum((angle_rad[known] - inside @ sizes) ** 2))
        return misfit, terms[: before_s.size] @ sizes

    rough = min(BEATS_HZ.tolist(), key=lambda hertz: fitted(hertz)[0])
    near = (rough / STEP_HZ, rough * STEP_HZ)
    fine = minimize_scalar(lambda hertz: fitted(hertz)[0], bounds=near, method="bounded").x
    before = fitted(float(fine))[1]
    return np.concatenate((time_s[0] + before_s, time_s)), np.concatenate((before, angle_rad))


def arrived(programme: TailProgramme, lost: Sequence[int]) -> TailProgramme:
    """Return the programme without some of its changes; the beat before each of them goes on."""
    if not lost:
        return programme
    kept = [i for i in range(len(programme.beats)) if i not in lost]
    return TailProgramme(
        tuple(programme.beats[i] for i in kept),
        tuple(programme.starts_s[i] for i in kept),
        programme.phase_rad,
    )


def speed_limit(servo: Servo, supply_v: float | None) -> float:
    """Return the largest speed of a servo at a supply."""
    if servo.ideal or supply_v is None:
        return servo.largest_speed_rad_s
    return servo.speed_limit_rad_s(supply_v)


def drives(
    inputs: FishInputs,
    servo: Servo,
    clock_drift: float = 0.0,
    lost: Sequence[int] = (),
    memory_s: float = 2.0,
) -> FloatArray:
    """Return the drives (m, DRIVE) of a run, first one from time zero on.

    ``memory_s``: over which the bias of a recorded command is averaged (``bias_memory_s``).
    """
    limit = speed_limit(servo, inputs.supply_v)
    if inputs.told_s is not None and inputs.told_rad is not None:
        told_s = inputs.told_s / (1.0 + clock_drift)
        if servo.ideal:
            now = max(int(np.searchsorted(told_s, 0.0, side="right")) - 1, 0)
            begun_s = np.maximum(told_s[now:], 0.0)
            return smooth(begun_s, inputs.told_rad[now:], servo, limit, memory_s)
        return _held(told_s, inputs.told_rad, servo, limit)
    return _beats(arrived(inputs.programme, lost), servo, clock_drift, limit)


def _beats(programme: TailProgramme, servo: Servo, clock_drift: float, limit: float) -> FloatArray:
    """One drive a beat, as ``TailProgramme.segments`` makes them, at exact times."""
    rows = np.empty((len(programme.beats), DRIVE))
    swept, lag_s, delay_s = lag_share(servo), servo.command_lag_s, servo.command_delay_s
    phase, omega, previous = programme.phase_rad, 0.0, 0.0
    before: Drive | None = None
    for i, (start, beat) in enumerate(zip(programme.starts_s, programme.beats, strict=True)):
        true_s = start / (1.0 + clock_drift)
        phase += omega * (true_s - previous)
        omega = 2.0 * math.pi * beat.frequency_hz
        begin_s = true_s + delay_s if before is not None else 0.0
        late_s = 0.0 if before is not None else -delay_s
        before = drive_of(beat, phase + omega * late_s, begin_s, lag_s, limit, before, swept)
        rows[i] = before
        previous = true_s
    return rows


def _held(time_s: FloatArray, angle_rad: FloatArray, servo: Servo, limit: float) -> FloatArray:
    """One drive a change of the held command."""
    new = np.flatnonzero(np.diff(angle_rad, prepend=np.nan) != 0.0)
    rows = np.zeros((new.size, DRIVE))
    rows[:, 0] = angle_rad[new]
    rows[:, 4] = limit
    rows[:, 5] = time_s[new] + servo.command_delay_s
    rows[0, 5] = min(time_s[0], 0.0)
    if servo.command_lag_s > 0.0:
        swept, transient = lag_share(servo), 0.0
        for i in range(1, new.size):
            spent = math.exp(-(rows[i, 5] - rows[i - 1, 5]) / servo.command_lag_s)
            transient = swept * (rows[i - 1, 0] + transient * spent - rows[i, 0])
            rows[i, 6] = transient
    return rows
