"""Tables of steady motion from swimming alone: no orbit of the plant's, no model of the diagnosis.

A robot swims a constant beat with the practice integrator (Dormand and Prince, 2.5 ms) until its
start is forgotten. Over the last whole beats the positions are averaged beat by beat, and a circle
is fitted to what is left, as one does with a yardstick in a pool; the turning period is a full
circle over the mean turn rate, the speed the path of the averaged positions over time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from plant.arrays import FloatArray
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from tools.practice.experiment import TOLERANCE, TOLERANCES
from tools.practice.swim import STEP_S, swim

TRANSIENT_S = 60.0
OBSERVED_S = 60.0
COLUMNS = ("turn_radius_m", "turn_period_s", "speed_m_s")


def tolerated(believed: PlantParameters, seed: int) -> PlantParameters:
    """Return a robot whose numbers are off by up to 3 %, uniformly."""
    draw = np.random.default_rng([0x57EAD, seed])
    parts = {}
    for section, names in TOLERANCES.items():
        part = getattr(believed, section)
        errors = {name: 1.0 + draw.uniform(-TOLERANCE, TOLERANCE) for name in names}
        parts[section] = replace(part, **{n: getattr(part, n) * e for n, e in errors.items()})
    return replace(believed, **parts)


@lru_cache(maxsize=4096)
def swum(robot: PlantParameters, beat: TailBeat) -> tuple[float, float, float]:
    """Return turning radius (m), turning period (s) and speed (m/s) of a beat."""
    period_s = 1.0 / beat.frequency_hz
    beats = round(OBSERVED_S / period_s)
    duration_s = TRANSIENT_S + (beats + 1) * period_s
    still = np.zeros((round(duration_s / STEP_S) + 2, 3))
    programme = TailProgramme((beat,), (0.0,))
    path = swim(robot, programme, duration_s, Start(0.0, 0.0, 0.0), still)
    time_s = STEP_S * np.arange(path.shape[0])

    def averaged(column: FloatArray) -> FloatArray:
        whole = np.concatenate(([0.0], np.cumsum(0.5 * (column[1:] + column[:-1])) * STEP_S))
        edges = time_s[-1] - period_s * np.arange(beats + 1)[::-1]
        found: FloatArray = np.diff(np.interp(edges, time_s, whole)) / period_s
        return found

    x, y, heading = (averaged(path[:, i]) for i in range(3))
    rate = (heading[-1] - heading[0]) / ((beats - 1) * period_s)
    columns = np.column_stack([2.0 * x, 2.0 * y, np.ones(beats)])
    centre = np.linalg.lstsq(columns, x * x + y * y, rcond=None)[0]
    radius = math.sqrt(centre[2] + centre[0] ** 2 + centre[1] ** 2)
    # the mean over a beat cuts the corner of the arc that is swum meanwhile
    half = 0.5 * abs(rate) * period_s
    radius *= half / math.sin(half)
    return radius, 2.0 * math.pi / abs(rate), radius * abs(rate)


def table(
    robot: PlantParameters,
    beats: Sequence[TailBeat],
    scatter: float,
    seed: int,
    columns: Sequence[str] = COLUMNS[:2],
    told: bool = False,
) -> str:
    """Return the CSV of a robot's beats; ``scatter``: relative, of each number, ``told`` or not."""
    draw = np.random.default_rng([0x7AB1E, seed])
    names = ["tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz"]
    for name in columns:
        names += [name, f"{name}_sd"] if told else [name]
    lines = [",".join(names)]
    for beat in beats:
        motion = dict(zip(COLUMNS, swum(robot, beat), strict=True))
        row = [beat.bias_rad, beat.amplitude_rad, beat.frequency_hz]
        for name in columns:
            value = motion[name] * (1.0 + scatter * draw.standard_normal())
            row += [value, scatter * motion[name]] if told else [value]
        lines.append(",".join(f"{number:.8g}" for number in row))
    return "\n".join(lines) + "\n"
