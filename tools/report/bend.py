"""A tail that bends: its shapes over one beat, to scale, and how far its tip is from a rigid one's.

Shapes are taken at equal times, so that lines stand close where the tail is slow. Those on the way
to starboard and on the way back have colours of their own: a stiff tail draws both over each other,
a soft one shows its lag as the loop that the tip makes.
"""

from __future__ import annotations

import numpy as np

from tools.records.data import FloatArray, RunData
from tools.report.charts import RIGHT, TOP, Chart, figure
from tools.report.marks import last_motion_s, shade
from tools.report.scale import limits, nice_step, number

HALF = 520.0
SHAPES = 16
"""Over one beat."""
LEFT, BOTTOM = 46.0, 36.0
MOST_HEIGHT = 320.0
BEATS = 4.0
TIP = "tail_tip_m"


def bend_figures(data: RunData) -> str:
    """Both pictures; empty where the tail is rigid."""
    if data.tail_shape is None:
        return ""
    # behind the joint to the right, starboard (where tail angles are positive) upwards
    placed = -100.0 * data.tail_shape.points_m
    both = _shapes(placed[..., 0], placed[..., 1]) + _tip(data, placed[..., 1])
    return f'<div class="grid2 even">{both}</div>'


def _shapes(behind: FloatArray, across: FloatArray) -> str:
    """One beat, (times, points) each, cm."""
    x_range = limits(behind, zero=True)
    y_range = limits(across, least=0.25 * x_range[1])
    wide, high = x_range[1] - x_range[0], y_range[1] - y_range[0]
    plot = HALF - LEFT - RIGHT
    height = plot * high / wide
    if height > MOST_HEIGHT:  # equal scales on both axes all the same
        plot, height = plot * MOST_HEIGHT / height, MOST_HEIGHT
    chart = Chart(
        LEFT + plot + RIGHT,
        TOP + height + BOTTOM,
        x_range,
        y_range,
        x_label="behind the joint, cm",
        title="shapes of the tail over one beat, seen from above",
        left=LEFT,
        bottom=BOTTOM,
    )
    chart.step = nice_step(max(wide, high), 8)
    chart.rule(0.0)
    tip = across[:, -1]
    chart.line(behind[:, -1], tip, "truth wide", every=True)
    rising = np.gradient(tip) >= 0.0 if tip.size > 1 else np.ones(1, dtype=bool)
    for index in np.unique(np.linspace(0, tip.size - 1, SHAPES + 1).round().astype(int))[:-1]:
        style = "c2" if rising[index] else "c1"
        chart.line(behind[index], across[index], f"{style} thin", every=True)
    entries = [("c2", "on the way to starboard"), ("c1", "to port"), ("truth", "path of the tip")]
    return figure("Shape of the tail over its last beat, cm", chart.svg(), entries=entries)


def _tip(data: RunData, across: FloatArray) -> str:
    """How far the tip is from where a rigid tail's would be."""
    time, bend = data.truth["time_s"], 100.0 * data.truth[TIP]
    end = last_motion_s(data)
    begin = max(float(time[0]), end - BEATS / data.beat_frequency_hz)
    inside = (time >= begin) & (time <= end)
    span = (begin, max(end, begin + 1e-3))
    chart = Chart(HALF, 230, span, limits(bend[inside], least=0.1), y_label="cm")
    chart.y_unit, chart.title = "cm", "distance of the tail's tip from the line of its base"
    shade(chart, data)
    chart.rule(0.0)
    chart.line(time[inside], bend[inside], "c1", "tip")
    most = number(float(np.abs(bend[inside]).max()), 2)
    reach = number(float(np.ptp(across[:, -1])), 2)
    return figure(
        f"Bend: tip from the line of the base over {BEATS:g} beats, cm",
        chart.svg(),
        entries=[("c1", "true")],
        note=f"> 0: bent to where tail angles are positive, starboard. At most {most} cm; the tip "
        f"sweeps {reach} cm.",
    )
