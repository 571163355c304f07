"""The paths of all robots of a shoal in their tank, to scale."""

from __future__ import annotations

import numpy as np

from tools.records.data import FloatArray
from tools.records.shoal_data import ShoalData
from tools.report.charts import Chart, figure, xy
from tools.report.path import Box, alone, draw_base, draw_robot, draw_water, tank_axes, tank_box
from tools.report.scale import number

COLOURS = ("c1", "c2", "c3", "c4", "c5", "c6")
MOST_POINTS = 40_000
"""Of all paths together: 0.5 MB of the page."""
LABELLED = 40
"""In a larger shoal the robots carry no numbers: they would hide each other."""
MARGIN = 0.08
"""Air around the paths, as a share of their extent."""
LEAST_M = 1.0
ENLARGE_BELOW = 0.6
"""Paths that span less than this share of the tank are enlarged."""


def paths_figure(data: ShoalData) -> str:
    """The section's main picture."""
    least, when = data.whole.get("least_distance_m"), data.whole.get("least_distance_s")
    note = "Small outlines: where each robot started; filled: where it ended."
    if least is not None:
        pair = (data.whole.get("least_distance_between"), data.whole.get("least_distance_and"))
        note += (
            f" The ring: where two came nearest to each other, {number(100 * least)} cm"
            f" at {number(when)} s, robots {pair[0]} and {pair[1]}."
        )
    return figure("Paths in the tank", paths_svg(data), note=note)


def paths_picture(data: ShoalData) -> str:
    """The same as a file of its own."""
    return alone(paths_svg(data))


def paths_svg(data: ShoalData) -> str:
    """Draw it."""
    tank = tank_box(data.tank)
    view = _view(data, tank)
    chart = tank_axes(view)
    draw_water(chart, tank, view)
    rows = sum(robot.truth["x_m"].size for robot in data.robots)
    step = max(1, -(-rows // MOST_POINTS))
    chart.raw('<g clip-path="url(#view)">')
    for place, robot in enumerate(data.robots):
        x, y = (_thinned(robot.truth[name], step) for name in ("x_m", "y_m"))
        chart.line(x, y, f"{colour(place)} thin", robot.name, every=True)
    chart.raw("</g>")
    draw_base(chart, data.tank, view)
    labelled = len(data.robots) <= LABELLED
    for robot in data.robots:
        if robot.truth["x_m"].size:
            draw_robot(chart, robot.truth, 0, "mark", "")
            draw_robot(chart, robot.truth, -1, "mark full", str(robot.address) if labelled else "")
    _nearest(chart, data)
    return chart.svg()


def colour(place: int) -> str:
    """Colour of a robot by its place in the shoal."""
    return COLOURS[place % len(COLOURS)]


def _nearest(chart: Chart, data: ShoalData) -> None:
    """Ring the place where two robots came nearest to each other."""
    when, first = (data.whole.get(f"least_distance_{key}") for key in ("s", "between"))
    robot = next((robot for robot in data.robots if robot.address == first), None)
    if robot is None or when is None:
        return
    at = int(np.searchsorted(robot.truth["time_s"], when))
    x, y = (float(robot.truth[name][at]) for name in ("x_m", "y_m"))
    chart.raw(f'<circle class="ring" cx="{xy(chart.x(x))}" cy="{xy(chart.y(y))}" r="9"/>')


def _thinned(values: FloatArray, step: int) -> FloatArray:
    """Every so many samples, and the last one."""
    kept = values[::step]
    return kept if (values.size - 1) % step == 0 else np.append(kept, values[-1])


def _view(data: ShoalData, tank: Box) -> Box:
    """The part of the tank that is shown: all of it, or what lies around the paths."""
    x, y = (np.concatenate([robot.truth[name] for robot in data.robots]) for name in ("x_m", "y_m"))
    if not x.size:
        return tank
    spans = float(np.ptp(x)), float(np.ptp(y))
    if max(spans) >= ENLARGE_BELOW * max(tank[1] - tank[0], tank[3] - tank[2]):
        return tank
    side = max(*spans, LEAST_M) * (1 + 2 * MARGIN)
    middle_x, middle_y = float(x.min() + x.max()) / 2, float(y.min() + y.max()) / 2
    return (middle_x - side / 2, middle_x + side / 2, middle_y - side / 2, middle_y + side / 2)
