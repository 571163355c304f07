"""Runs for the tests: what a camera, a gyro and a compass sample of a programme of beats."""

from __future__ import annotations

import math

import numpy as np

from plant.tail_input import TailBeat, TailProgramme
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.model import FloatArray, IntArray, Noise, Run

NAMES = ("x_m", "y_m", "heading_rad", "gyro_z_rad_s", "compass_rad")
NOISE = Noise(
    np.array([7e-4, 7e-4, 1.4e-2, 3.6e-3, 1e-2]), np.array([1e-4, 1e-4, 2e-3]), np.full(3, 0.7)
)
RATES_HZ = (30.0, 30.0, 30.0, 50.0, 20.0)


def programme(seed: int, duration_s: float = 20.0) -> TailProgramme:
    """Three beats that differ in everything."""
    draw = np.random.default_rng(seed)
    beats = tuple(
        TailBeat(
            math.radians(draw.uniform(-35.0, 35.0)),
            math.radians(draw.uniform(10.0, 22.0)),
            draw.uniform(0.7, 1.3),
        )
        for _ in range(3)
    )
    return TailProgramme(beats, (0.0, 0.3 * duration_s, 0.65 * duration_s))


def moments(seed: int, duration_s: float) -> tuple[FloatArray, IntArray]:
    """Times and channels of all samples; camera channels come together."""
    draw = np.random.default_rng(seed)
    frame, gyro, compass = draw.uniform(0.0, 0.02, 3)
    times, channels = [], []
    for channel, (rate, first) in enumerate(
        zip(RATES_HZ, (frame, frame, frame, gyro, compass), strict=True)
    ):
        count = math.floor((duration_s - first) * rate)
        times.append(first + np.arange(count) / rate)
        channels.append(np.full(count, channel, dtype=np.int64))
    time_s = np.concatenate(times)
    order = np.argsort(time_s, kind="stable")
    return time_s[order], np.concatenate(channels)[order]


def blank(seed: int, duration_s: float = 20.0, value: FloatArray | None = None) -> Run:
    """A run with nothing measured in it yet."""
    time_s, channel = moments(seed, duration_s)
    inputs = FishInputs(programme(seed, duration_s))
    return Run(
        f"run{seed}", time_s, channel, np.zeros(time_s.size) if value is None else value, inputs
    )
