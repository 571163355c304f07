"""A tail-beat frequency that was told in radians per second: the robot wags 2π times slower.

Whatever its strength, a tail that beats makes head and gyro swing at its frequency. So a line there
is compared with one at 1/2π of it, by least squares in each stretch of one beat. Only told
frequencies are looked at that few robots of this size can beat.
"""

from __future__ import annotations

import math

import numpy as np

from tools.diagnosis.data.notice import DataError
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.model import FloatArray, Run

_FAST_HZ = 2.5
"""2.5 rad/s is a beat of 0.4 Hz: slower ones hardly swim."""
_SETTLED_S = 1.0
_LEAST_SAMPLES, _LEAST_CYCLES = 30, 3.0
_WEAK = 0.05
"""Share of the line at 1/2π that the line has where it should be."""
_CLEAR = 20.0
"""The line at 1/2π, in units of what a line has in noise."""


def check_frequency(run: Run, names: list[str]) -> None:
    """Refuse frequencies that are radians per second."""
    inputs = run.inputs
    assert isinstance(inputs, FishInputs)
    swinging = _swinging(run, names)
    if inputs.told_s is not None or swinging is None:
        return
    time_s, rate = swinging
    starts = inputs.programme.starts_s
    ends = (*starts[1:], math.inf)
    told = slow = total = example = 0.0
    freedom = lines = 0
    for beat, start, end in zip(inputs.programme.beats, starts, ends, strict=True):
        f = beat.frequency_hz
        here = (time_s > start + _SETTLED_S) & (time_s < end)
        if f < _FAST_HZ or beat.amplitude_rad == 0.0 or int(here.sum()) < _LEAST_SAMPLES:
            continue
        t, y = time_s[here], rate[here]
        if (t[-1] - t[0]) * f / (2.0 * math.pi) < _LEAST_CYCLES:
            continue
        rest = _without(y, _trend(t))
        told += _line(t, rest, f)
        slow += _line(t, rest, f / (2.0 * math.pi))
        total += float(rest @ rest)
        lines, freedom = lines + 2, freedom + t.size - 4
        example = example or f
    if slow * freedom > _CLEAR * lines * (total - slow) and told < _WEAK * slow:
        raise DataError(
            f"{run.name}, column tail_frequency_hz: says {example:.3g}, and the robot wags "
            f"{example / (2.0 * math.pi):.3g} times a second: these are radians per second; add "
            f"[channels.tail_frequency_hz] scale = {0.5 / math.pi:.7g} to experiment.toml"
        )


def _swinging(run: Run, names: list[str]) -> tuple[FloatArray, FloatArray] | None:
    """Return times and values of what swings with the tail: a rate, or the tail itself."""
    for name in ("gyro_z_rad_s", "tail_angle_rad", "heading_rad", "compass_rad"):
        if name not in names:
            continue
        here = run.channel == names.index(name)
        t, v = run.time_s[here], run.value[here]
        if t.size < _LEAST_SAMPLES:
            continue
        if name in ("heading_rad", "compass_rad"):
            return 0.5 * (t[1:] + t[:-1]), np.diff(np.unwrap(v)) / np.diff(t)
        return t, v
    return None


def _trend(t: FloatArray) -> FloatArray:
    return np.column_stack((np.ones_like(t), t - t.mean()))


def _without(y: FloatArray, columns: FloatArray) -> FloatArray:
    rest: FloatArray = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return rest


def _line(t: FloatArray, y: FloatArray, frequency_hz: float) -> float:
    """Return the sum of squares that a sine of this frequency explains."""
    phase = 2.0 * math.pi * frequency_hz * t
    rest = _without(y, np.column_stack((_trend(t), np.cos(phase), np.sin(phase))))
    return float(y @ y - rest @ rest)
