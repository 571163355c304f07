"""What the instruments said against what was: small multiples, each with its residual below."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tools.records.data import FloatArray, RunData, Series
from tools.report.charts import Chart, figure, legend
from tools.report.scale import MINUS, limits

BoolArray: TypeAlias = npt.NDArray[np.bool_]

WIDTH = 356.0
BEATS = 5
"""How many beats the upper picture of a swinging instrument shows."""


@dataclass(frozen=True, slots=True)
class Instrument:
    """A row: which channel is compared with which column of the truth, and how it is shown."""

    channel: str
    truth: str
    head: str
    unit: str
    scale: float = 1.0
    angle: bool = False
    """Whether values are angles, whose difference is taken the short way round."""
    fast: bool = False
    """Whether it swings with the tail: then the upper picture shows a few beats only."""


DEGREES = 180 / np.pi

INSTRUMENTS = (
    Instrument("gyro_z_rad_s", "yaw_rate_rad_s", "Gyro, yaw rate", "°/s", DEGREES, fast=True),
    Instrument("compass_rad", "heading_rad", "Compass", "°", DEGREES, angle=True, fast=True),
    Instrument("heading_rad", "heading_rad", "Camera heading", "°", DEGREES, angle=True, fast=True),
    Instrument("accel_x_m_s2", "accel_x_m_s2", "Accelerometer, x", "m/s²", fast=True),
    Instrument("accel_y_m_s2", "accel_y_m_s2", "Accelerometer, y", "m/s²", fast=True),
    Instrument("x_m", "x_m", "Camera, x", "cm", 100.0),
    Instrument("y_m", "y_m", "Camera, y", "cm", 100.0),
    Instrument("gps_x_m", "x_m", "GPS, x", "m"),
    Instrument("gps_y_m", "y_m", "GPS, y", "m"),
    Instrument("tail_angle_rad", "tail_angle_rad", "Potentiometer", "°", DEGREES, fast=True),
    Instrument("battery_v", "battery_v", "Battery", "V"),
    Instrument("servo_current_a", "servo_current_a", "Servo current", "mA", 1e3, fast=True),
    Instrument("temperature_c", "temperature_c", "Temperature", "°C"),
    Instrument("pollutant_ug_l", "pollutant_ug_l", "Water probe", "µg/L"),
)


def sensor_figures(data: RunData) -> str:
    """One small picture for each instrument that the run has."""
    drawn = [
        _figure(data, row)
        for row in INSTRUMENTS
        if row.channel in data.channels
        and row.truth in data.truth
        and data.channels[row.channel].value.size
    ]
    if not drawn:
        return '<p class="soft">No instrument is fitted.</p>'
    keys = legend((("truth", "true"), ("c1 dot", "measured"), ("c2", "measured minus true")))
    return f'{keys}<div class="grid3">{"".join(drawn)}</div>'


def residual(row: Instrument, series: Series, time: FloatArray, truth: FloatArray) -> FloatArray:
    """Measured minus true, in the shown unit."""
    if row.angle:
        true = np.interp(series.time_s, time, np.unwrap(truth))
        error = (series.value - true + np.pi) % (2 * np.pi) - np.pi
    else:
        error = series.value - np.interp(series.time_s, time, truth)
    return np.asarray(error * row.scale, dtype=np.float64)


def _within(time: FloatArray, span: tuple[float, float]) -> BoolArray:
    return np.asarray((time >= span[0]) & (time <= span[1]), dtype=np.bool_)


def _figure(data: RunData, row: Instrument) -> str:
    series = data.channels[row.channel]
    time, truth = data.truth["time_s"], data.truth[row.truth]
    error = residual(row, series, time, truth)
    true = (np.unwrap(truth) if row.angle else truth) * row.scale
    measured = np.interp(series.time_s, time, true) + error
    span = (float(time[0]), float(time[-1])) if time.size > 1 else (0.0, 1.0)
    near = span
    if row.fast and data.beat_frequency_hz > 0:
        near = (max(span[0], span[1] - BEATS / data.beat_frequency_hz), span[1])
    inside, seen = _within(time, near), _within(series.time_s, near)
    least = 0.02 * max(1.0, float(np.abs(true).max())) if true.size else 1.0
    top = Chart(WIDTH, 136, near, limits(true[inside], measured[seen], least=least), x_label="")
    top.bottom, top.left, top.y_ticks, top.x_ticks, top.y_unit = 22.0, 48.0, 4, 4, row.unit
    top.title = f"{row.head}: measured and true"
    top.line(time[inside], true[inside], "truth wide", "true")
    if seen.sum() > 400:
        top.line(series.time_s[seen], measured[seen], "c1 thin", "measured")
    else:
        top.points(series.time_s[seen], measured[seen], "c1", 1.3)
    below = Chart(WIDTH, 92, span, limits(error, least=1e-6))
    reach = max(abs(below.y_range[0]), abs(below.y_range[1]))
    below.y_range = (-reach, reach)
    below.left, below.y_ticks, below.x_ticks, below.y_unit = 48.0, 4, 4, row.unit
    below.title = f"{row.head}: measured minus true"
    below.rule(0.0)
    below.line(series.time_s, error, "c2 thin", "error")
    mean, spread = float(error.mean()), float(error.std())
    digits = max(0, 1 - math.floor(math.log10(spread))) if spread > 0 else 2
    said = f"{round(mean, digits) + 0.0:.{digits}f} ± {spread:.{digits}f} {row.unit}"
    said = said.replace("-", MINUS)
    return figure(
        f"{row.head}, {row.unit}",
        top.svg() + below.svg(),
        note=f"Error: {said}",
    )
