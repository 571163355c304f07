"""Speed, heading and tail over time."""

from __future__ import annotations

import numpy as np

from tools.records.data import FloatArray, RunData, Series
from tools.records.metrics import beat_average
from tools.report.bend import bend_figures
from tools.report.charts import Chart, figure
from tools.report.marks import label_events, last_motion_s, shade
from tools.report.scale import limits

HALF = 520.0
WIDE = 1080.0
ZOOM_BEATS = 4.0


def speed_figure(data: RunData) -> str:
    """Speed over ground: through each beat, and averaged over one."""
    truth = data.truth
    time = truth["time_s"]
    speed = 100 * np.hypot(truth["surge_m_s"], truth["sway_m_s"])
    centre, mean = beat_average(time, 100 * truth["surge_m_s"], data.beat_frequency_hz)
    chart = Chart(HALF, 208, _span(time), limits(speed, zero=True), y_label="cm/s")
    chart.y_unit, chart.title = "cm/s", "speed of the body centre over time"
    shade(chart, data)
    chart.line(time, speed, "c1 thin faded", "speed")
    chart.line(centre, mean, "c2 wide", "surge, beat average")
    return figure(
        "Speed, cm/s",
        chart.svg(),
        entries=[("c1", "speed"), ("c2", "surge, averaged over a beat")],
    )


def heading_figure(data: RunData) -> str:
    """True heading, and what the camera and the compass made of it."""
    truth = data.truth
    time = truth["time_s"]
    heading = np.degrees(np.unwrap(truth["heading_rad"]))
    entries = [("truth", "true")]
    drawn: list[tuple[Series, str, str]] = []
    for name, style, label in (("compass_rad", "c3", "compass"), ("heading_rad", "c1", "camera")):
        if name in data.channels:
            drawn.append((_along(data.channels[name], time, heading), style, label))
            entries.append((f"{style} dot", label))
    chart = Chart(
        HALF,
        208,
        _span(time),
        limits(heading, *(series.value for series, _, _ in drawn), least=4.0),
        y_label="°",
    )
    chart.y_unit, chart.title = "°", "heading over time"
    shade(chart, data)
    for series, style, _ in drawn:
        thin = max(1, series.value.size // 900)
        chart.points(series.time_s[::thin], series.value[::thin], f"{style} faded", 1.0)
    chart.line(time, heading, "truth", "heading")
    centre, mean = beat_average(time, heading, data.beat_frequency_hz)
    if centre.size < time.size:
        chart.line(centre, mean, "c2 wide", "beat average")
        entries.append(("c2", "true, averaged over a beat"))
    return figure("Heading, °", chart.svg(), entries=entries)


def tail_figures(data: RunData) -> str:
    """The tail over the whole run, a few beats from its end, and its bend where it has one."""
    time = data.truth["time_s"]
    whole = _tail_chart(data, _span(time), 190)
    entries = [("c2", "commanded"), ("c1", "true")]
    parts = [figure("Tail angle, degrees", whole, entries=entries)]
    if data.beat_frequency_hz > 0 and time.size:
        end = last_motion_s(data)
        start = max(float(time[0]), end - ZOOM_BEATS / data.beat_frequency_hz)
        near = _tail_chart(data, (start, max(end, start + 1e-3)), 230)
        lag = tail_lag_s(data)
        note = "" if lag is None else f"The tail follows its command {1e3 * lag:.0f} ms later."
        if lag is not None and lag < 0.0:  # an ideal tail has the beat, not the board's samples
            note = f"The tail goes {-1e3 * lag:.0f} ms ahead of its sampled command."
        parts.append(
            figure(f"The last {ZOOM_BEATS:g} beats, degrees", near, entries=entries, note=note)
        )
    bend = bend_figures(data)
    return f'<div class="rows"><div class="rows wide">{"".join(parts)}</div>{bend}</div>'


def _tail_chart(data: RunData, span: tuple[float, float], height: float) -> str:
    time = data.truth["time_s"]
    inside = (time >= span[0]) & (time <= span[1])
    command = np.degrees(data.truth["tail_command_rad"])
    angle = np.degrees(data.truth["tail_angle_rad"])
    chart = Chart(
        WIDE, height, span, limits(command[inside], angle[inside], least=4.0), y_label="°"
    )
    chart.y_unit, chart.title = "°", "tail angle commanded and true"
    shade(chart, data, "supply off")
    chart.rule(0.0)
    chart.line(time[inside], command[inside], "c2", "commanded")
    chart.line(time[inside], angle[inside], "c1", "true")
    label_events(chart, data)
    return chart.svg()


def tail_lag_s(data: RunData) -> float | None:
    """Delay between command and tail at the beat frequency, from the phases of both.

    The phase is that of the Fourier component over the last whole beats, at most ten.
    """
    time, frequency = data.truth["time_s"], data.beat_frequency_hz
    if frequency <= 0 or time.size < 3:
        return None
    end = last_motion_s(data)
    beats = min(10, int((end - time[0]) * frequency))
    told = np.isfinite(data.truth["tail_command_rad"])  # a board's first pulse may come late
    inside = (time > end - beats / frequency) & (time <= end)
    if beats < 1 or not told[inside].all() or inside.sum() < 8:
        return None
    turn = np.exp(-2j * np.pi * frequency * time[inside])
    parts = [
        complex((data.truth[name][inside] * turn).sum())
        for name in ("tail_command_rad", "tail_angle_rad")
    ]
    if min(abs(part) for part in parts) < 1e-9:
        return None
    return float(np.angle(parts[0] / parts[1]) / (2 * np.pi * frequency))


def _along(series: Series, time: FloatArray, heading_deg: FloatArray) -> Series:
    """An angle in degrees on the same turn as the true heading: within 180° of it."""
    true = np.interp(series.time_s, time, heading_deg)
    measured = np.degrees(series.value)
    return Series(series.time_s, measured - 360 * np.round((measured - true) / 360))


def _span(time: FloatArray) -> tuple[float, float]:
    if time.size < 2 or time[-1] <= time[0]:
        return (0.0, 1.0)
    return (float(time[0]), float(time[-1]))
