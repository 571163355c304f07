"""Heading control: the error that it saw, the bias that it chose, and how near the target came."""

from __future__ import annotations

import numpy as np

from tools.records.data import RunData
from tools.report.charts import Chart, figure
from tools.report.marks import label_events, shade
from tools.report.scale import limits, number

WIDE = 1080.0


def control_figure(data: RunData) -> str:
    """Error, bias and distance over time; empty where nothing steered."""
    error, bias = data.channels.get("control_error_rad"), data.channels.get("control_bias_rad")
    if error is None or bias is None or data.tank.target_m is None:
        return ""
    time = data.truth["time_s"]
    span = (float(time[0]), float(time[-1])) if time.size > 1 else (0.0, 1.0)
    errors, biases = np.degrees(error.value), np.degrees(bias.value)
    chart = Chart(WIDE, 200, span, limits(errors, biases, least=4.0), y_label="°")
    chart.y_unit, chart.title = "°", "heading error and tail bias over time"
    shade(chart, data)
    chart.rule(0.0)
    # What held until the controller was told to rest; afterwards it decided nothing.
    end = data.metrics.get("arrival_s") or span[1]
    held = np.append(bias.time_s, max(float(bias.time_s[-1]), float(end)))
    chart.steps(held, np.append(biases, biases[-1]), "c2", "bias")
    chart.line(error.time_s, errors, "c1 thin faded", "heading error")
    chart.points(error.time_s, errors, "c1", 2.2)
    label_events(chart, data)
    steering = figure(
        "Heading control, degrees",
        chart.svg(),
        entries=[("c1 dot", "heading error that it saw"), ("c2", "tail bias that it chose")],
        note="Error > 0: the target lies to port; bias < 0 turns the robot to port.",
    )
    x_m, y_m = data.tank.target_m
    distance = np.hypot(data.truth["x_m"] - x_m, data.truth["y_m"] - y_m)
    near = Chart(WIDE, 150, span, limits(distance, zero=True), y_label="m")
    near.y_unit, near.title = "m", "distance to the target over time"
    shade(near, data)
    near.rule(data.tank.arrival_radius_m, "radius")
    near.line(time, distance, "c1", "distance")
    label_events(near, data)
    return steering + figure(
        "Distance to the target, m",
        near.svg(),
        entries=[("c1", "true distance"), ("c2", "arrival radius")],
        note=_arrival(data),
    )


def _arrival(data: RunData) -> str:
    nearest = data.metrics.get("target_nearest_m")
    if nearest is None:
        return ""
    arrival = data.metrics.get("arrival_s")
    came = f"It came as near as {number(100 * nearest, 2)} cm"
    radius = f"{100 * data.tank.arrival_radius_m:g} cm"
    if arrival is None:
        return f"{came} and did not arrive ({radius})."
    return f"Within {radius} after {arrival:.1f} s. {came}; then the tail rests and it glides on."
