"""A survey over time: how much was known, how exactly, and what each robot did meanwhile."""

from __future__ import annotations

import math
from html import escape

import numpy as np

from tools.records.data import FloatArray
from tools.report.charts import LEFT, RIGHT, Chart, figure, xy
from tools.report.scale import limits, nice_step, tick_text, ticks
from tools.report.survey_view import Doing, SurveyView, root_mean_square

WIDTH = 1090.0
ROW, LEAST_ROW, ROWS_HIGH = 20.0, 7.0, 620.0
"""Rows of a large shoal become as thin as fits."""
STYLES = {Doing.SWIMS: "c5", Doing.RESTS: "truth calm", Doing.DEAD: "bad"}
SAMPLE_STYLE = "sample"


def time_figures(view: SurveyView) -> str:
    """One below the other, with one axis of time."""
    error = _error_figure(view)
    return f'<div class="rows wide">{_known_figure(view)}{error}{_doing_figure(view)}</div>'


def _known_figure(view: SurveyView) -> str:
    """Cells sampled, wanted and known."""
    chart = Chart(WIDTH, 210.0, _range(view), (0.0, 1.04 * view.cells), y_label="cells")
    chart.title = "cells sampled, wanted and known over time"
    _outages(chart, view)
    times = np.array([0.0, *(state.time_s for state in view.known), view.duration_s])
    wanted = [float(state.wanted) for state in view.known]
    known = [float(np.isfinite(state.matrix).sum()) for state in view.known]
    if known:
        chart.steps(times, _held(known), "c3", "known")
        chart.steps(times, _held(wanted), "c2", "wanted so far")
    count, found, when, seen = 0, [0.0], [0.0], set()
    for sample in view.samples:
        if sample.cell not in seen:
            seen.add(sample.cell)
            count += 1
        when.append(sample.time_s)
        found.append(float(count))
    chart.steps(np.array([*when, view.duration_s]), np.array([*found, found[-1]]), "c1", "sampled")
    chart.rule(float(view.cells))
    _marks(chart, view)
    entries = [("c1", "sampled"), ("c2", "wanted so far"), ("c3", "known: sampled or recovered")]
    note = "Dotted, level: all cells. Dotted, upright: deaths, and the end of the survey."
    if view.base_outages:
        note += " Bands: nobody could reach the base station."
    return figure("Cells", chart.svg(), entries=entries if known else entries[:1], note=note)


def _error_figure(view: SurveyView) -> str:
    """Root mean square error of what was known, where the truth is known."""
    if view.field is None or not view.known:
        return ""
    found = [root_mean_square(state.matrix - view.field) for state in view.known]
    errors = np.array([math.nan if value is None else value for value in found])
    times = np.array([*(state.time_s for state in view.known), view.duration_s])
    errors = np.append(errors, errors[-1])
    inside = np.isfinite(errors)
    if not inside.any():
        return ""
    chart = Chart(WIDTH, 160.0, _range(view), limits(errors, zero=True), y_unit=view.unit)
    chart.title = "root mean square error of the known cells over time"
    _outages(chart, view)
    chart.steps(times[inside], errors[inside], "c2", "error")
    _marks(chart, view)
    name = f"Error of the known cells, root mean square, {view.unit}"
    return figure(name, chart.svg())


def _held(values: list[float]) -> FloatArray:
    """From the run's begin to its end."""
    return np.array([values[0], *values, values[-1]])


def _range(view: SurveyView) -> tuple[float, float]:
    return (0.0, max(view.duration_s, 1e-3))


def _outages(chart: Chart, view: SurveyView) -> None:
    for start, end in view.base_outages:
        words = f"base station out of reach, {start:.0f} to {end:.0f} s"
        chart.span(start, end, "outage", words)


def _marks(chart: Chart, view: SurveyView) -> None:
    """Deaths, and the end of the survey."""
    for robot in view.robots:
        for start, _ in robot.dead():
            chart.rule_x(start, "moment", f"{robot.name} died")
    if view.complete_s is not None:
        chart.rule_x(view.complete_s, "moment", "the field is known")


def _doing_figure(view: SurveyView) -> str:
    """A row for each robot: bars for what lasts, ticks for samples."""
    high = max(LEAST_ROW, min(ROW, ROWS_HIGH / max(len(view.robots), 1)))
    top, floor = 4.0, 4.0 + high * len(view.robots)
    low, end = _range(view)
    scale = (WIDTH - LEFT - RIGHT) / (end - low)
    parts = [
        (
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {xy(floor + 34)}" role="img" '
            'aria-label="what each robot did over time">'
        )
    ]
    every = max(1, math.ceil(12 / high))
    for place, robot in enumerate(view.robots):
        y = top + place * high
        for (start, stop), doing in robot.doing:
            hint = f"{robot.name} {doing.value}, {start:.0f} to {stop:.0f} s"
            bar = 0.62 * high if doing is not Doing.RESTS else 0.14 * high
            parts.append(
                f'<rect class="{STYLES[doing]}" x="{xy(LEFT + start * scale)}" '
                f'y="{xy(y + (high - bar) / 2)}" width="{xy(max((stop - start) * scale, 0.4))}" '
                f'height="{xy(bar)}"><title>{escape(hint)}</title></rect>'
            )
        own = [sample for sample in view.samples if sample.robot == robot.address]
        line = "".join(
            f"M{xy(LEFT + s.time_s * scale)},{xy(y + 0.1 * high)}v{xy(0.8 * high)}" for s in own
        )
        parts.append(f'<path class="{SAMPLE_STYLE}" d="{line}"/>')
        if place % every == 0:
            parts.append(
                f'<text class="tick" x="{LEFT - 7:g}" y="{xy(y + high / 2)}" dy=".32em" '
                f'text-anchor="end">{escape(robot.name)}</text>'
            )
    step, axis = nice_step(end - low, int(WIDTH / 95)), [f"M{LEFT:g},{xy(floor)}H{WIDTH - RIGHT:g}"]
    for value in ticks(low, end, step):
        x = xy(LEFT + value * scale)
        axis.append(f"M{x},{xy(floor)}v4")
        parts.append(
            f'<text class="tick" x="{x}" y="{xy(floor + 16)}" text-anchor="middle">'
            f"{tick_text(value, step)}</text>"
        )
    parts.append(
        f'<path class="axis" d="{"".join(axis)}"/><text class="label" x="{WIDTH - RIGHT:g}" '
        f'y="{xy(floor + 31)}" text-anchor="end">time, s</text></svg>'
    )
    entries = [("c5 box", "swims"), ("truth", "rests"), ("bad box", "dead")]
    note = (
        "Upright ticks: samples. A robot rests where it does not come on, whatever its tail does."
    )
    return figure("Who did what", "".join(parts), entries=entries, note=note)
