"""What the instruments said against what was: small multiples, each with its residual below."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tools.records.data import FloatArray, RunData, Series
from tools.report.charts import Chart, figure, legend
from tools.report.marks import last_motion_s, shade
from tools.report.scale import MINUS, limits

BoolArray: TypeAlias = npt.NDArray[np.bool_]

WIDTH = 356.0
SETTLING_S = 0.15
"""Around an outage the true values jump between two rows of the record."""
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
    Instrument("water_quality_ug_l", "pollutant_ug_l", "Water probe", "µg/L"),
)


def sensor_figures(data: RunData) -> str:
    """One small picture for each instrument that the run has."""
    drawn = [
        _figure(data, row, series)
        for row in INSTRUMENTS
        if row.channel in data.channels and row.truth in data.truth
        if (series := _with_supply(data.channels[row.channel], data)).value.size
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


def _off(time: FloatArray, data: RunData, margin_s: float) -> BoolArray:
    """Where there was no supply, or none a moment before or after."""
    off = np.zeros(time.shape, dtype=np.bool_)
    for begin, end in data.outages:
        off |= (time > begin - margin_s) & (time < end + margin_s)
    return off


def _with_supply(series: Series, data: RunData) -> Series:
    """The samples that were taken with the supply on: amid its edges there is no truth to meet."""
    on = ~_off(series.time_s, data, SETTLING_S)
    return Series(series.time_s[on], series.value[on])


def _with_gaps(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same with a break wherever an instrument was silent for long."""
    if time.size < 3:
        return time, values
    steps = np.diff(time)
    silent = np.flatnonzero(steps > max(10 * float(np.median(steps)), 0.3)) + 1
    return np.insert(time, silent, time[silent - 1]), np.insert(values, silent, np.nan)


def _within(time: FloatArray, span: tuple[float, float]) -> BoolArray:
    return np.asarray((time >= span[0]) & (time <= span[1]), dtype=np.bool_)


def _figure(data: RunData, row: Instrument, series: Series) -> str:
    time, truth = data.truth["time_s"], data.truth[row.truth]
    if row.channel == "battery_v":
        truth = np.where(_off(time, data, SETTLING_S / 3), np.nan, truth)
    error = residual(row, series, time, truth)
    true = (np.unwrap(truth) if row.angle else truth) * row.scale
    measured = np.interp(series.time_s, time, true) + error
    span = (float(time[0]), float(time[-1])) if time.size > 1 else (0.0, 1.0)
    near = span
    if row.fast and data.beat_frequency_hz > 0:
        end = last_motion_s(data)
        near = (max(span[0], end - BEATS / data.beat_frequency_hz), max(end, span[0] + 1e-3))
    inside, seen = _within(time, near), _within(series.time_s, near)
    least = 0.02 * max(1.0, float(np.nanmax(np.abs(true)))) if true.size else 1.0
    top = Chart(WIDTH, 136, near, limits(true[inside], measured[seen], least=least), x_label="")
    top.bottom, top.left, top.y_ticks, top.x_ticks, top.y_unit = 22.0, 48.0, 4, 4, row.unit
    top.title = f"{row.head}: measured and true"
    shade(top, data)
    if seen.sum() > 400:
        top.line(*_with_gaps(series.time_s[seen], measured[seen]), "c1 thin faded", "measured")
        top.line(time[inside], true[inside], "truth wide", "true")
    else:
        top.line(time[inside], true[inside], "truth wide", "true")
        top.points(series.time_s[seen], measured[seen], "c1", 1.3)
    below = Chart(WIDTH, 92, span, limits(error, least=1e-6))
    reach = max(abs(below.y_range[0]), abs(below.y_range[1]))
    below.y_range = (-reach, reach)
    below.left, below.y_ticks, below.x_ticks, below.y_unit = 48.0, 4, 4, row.unit
    below.title = f"{row.head}: measured minus true"
    shade(below, data)
    below.rule(0.0)
    below.line(*_with_gaps(series.time_s, error), "c2 thin", "error")
    mean, spread = float(error.mean()), float(error.std())
    digits = max(0, 1 - math.floor(math.log10(spread))) if spread > 0 else 2
    said = f"{round(mean, digits) + 0.0:.{digits}f} ± {spread:.{digits}f} {row.unit}"
    said = said.replace("-", MINUS)
    return figure(
        f"{row.head}, {row.unit}",
        top.svg() + below.svg(),
        note=f"Error: {said}",
    )
