"""Steering: the error that the controller saw, the bias that it chose, how near the target came."""

from __future__ import annotations

import numpy as np

from tools.records.data import RunData, Series
from tools.report.charts import Chart, figure
from tools.report.marks import label_events, shade
from tools.report.scale import limits, number

WIDE = 1080.0


def control_figure(data: RunData) -> str:
    """Error, bias and distance over time; empty where nothing steered."""
    error, bias = data.channels.get("control_error_rad"), data.channels.get("control_bias_rad")
    if error is None or bias is None or (data.tank.target_m is None and not data.targets):
        return ""
    steering, span = _steering(data, error, bias)
    if data.tank.target_m is None:
        return steering + _distances(data, span)
    return steering + _distance(data, span, data.tank.target_m)


def _steering(data: RunData, error: Series, bias: Series) -> tuple[str, tuple[float, float]]:
    """Heading error and tail bias over time."""
    time = data.truth["time_s"]
    span = (float(time[0]), float(time[-1])) if time.size > 1 else (0.0, 1.0)
    # The boards record the target's direction against the heading; θ is the other way round.
    errors, biases = -np.degrees(error.value), np.degrees(bias.value)
    chart = Chart(WIDE, 200, span, limits(errors, biases, least=4.0), y_label="°")
    chart.y_unit, chart.title = "°", "heading error and tail bias over time"
    shade(chart, data)
    chart.rule(0.0)
    # What held until the controller was told to rest; afterwards it decided nothing.
    reached = [visit.reached_s for visit in data.targets]
    end = data.metrics.get("arrival_s") or (reached[-1] if reached else None) or span[1]
    held = np.append(bias.time_s, max(float(bias.time_s[-1]), float(end)))
    chart.steps(held, np.append(biases, biases[-1]), "c2", "bias")
    chart.line(error.time_s, errors, "c1 thin faded", "heading error")
    chart.points(error.time_s, errors, "c1", 2.2)
    label_events(chart, data)
    picture = figure(
        "Target tracking, degrees" if data.targets else "Heading control, degrees",
        chart.svg(),
        entries=[("c1 dot", "heading error that it saw"), ("c2", "tail bias that it chose")],
        note="Heading error θ > 0: the target lies to starboard; bias > 0 turns the robot there.",
    )
    return picture, span


def _distance(data: RunData, span: tuple[float, float], target_m: tuple[float, float]) -> str:
    """Distance to the heading controller's one target."""
    time = data.truth["time_s"]
    x_m, y_m = target_m
    distance = np.hypot(data.truth["x_m"] - x_m, data.truth["y_m"] - y_m)
    near = Chart(WIDE, 150, span, limits(distance, zero=True), y_label="m")
    near.y_unit, near.title = "m", "distance to the target over time"
    shade(near, data)
    near.rule(data.tank.arrival_radius_m, "radius")
    near.line(time, distance, "c1", "distance")
    label_events(near, data)
    return figure(
        "Distance to the target, m",
        near.svg(),
        entries=[("c1", "true distance"), ("c2", "arrival radius")],
        note=_arrival(data),
    )


def _distances(data: RunData, span: tuple[float, float]) -> str:
    """Distance to each target while it was the one."""
    time, x_m, y_m = (data.truth[name] for name in ("time_s", "x_m", "y_m"))
    distance = np.full(time.shape, np.nan)
    for visit in data.targets:
        since = time >= visit.since_s
        distance[since] = np.hypot(x_m[since] - visit.x_m, y_m[since] - visit.y_m)
    if data.targets[-1].reached_s is not None:
        distance[time > data.targets[-1].reached_s] = np.nan
    near = Chart(WIDE, 150, span, limits(distance[np.isfinite(distance)], zero=True), y_label="m")
    near.y_unit, near.title = "m", "distance to the present target over time"
    shade(near, data)
    near.rule(data.tank.arrival_radius_m, "radius")
    near.line(time, distance, "c1", "distance")
    label_events(near, data)
    came = [
        f"{number}: {visit.reached_s:.0f} s, {100 * visit.nearest_m:.1f} cm"
        if visit.reached_s is not None
        else f"{number}: not reached, {100 * visit.nearest_m:.1f} cm"
        for number, visit in enumerate(data.targets, start=1)
    ]
    return figure(
        "Distance to the present target, m",
        near.svg(),
        entries=[("c1", "true distance"), ("c2", "arrival radius")],
        note=f"Targets with time and true nearest distance: {'; '.join(came)}.",
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
