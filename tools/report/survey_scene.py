"""The surveyed water from above, to scale: the grid, the base station, and the robots' ways.

What the film and the picture of the ways have in common, and that picture, as in Figs. 6.7 and 6.8
of the source: the way of each robot over the grid, with its samples where they were taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

import numpy as np

from tools.records.data import FloatArray
from tools.report.charts import Chart, figure, xy
from tools.report.path import Box, tank_axes
from tools.report.scale import number
from tools.report.survey_colours import robot_styles
from tools.report.survey_thin import thinned
from tools.report.survey_view import SurveyRobot, SurveyView

MARGIN = 0.03
"""Air around grid and paths, as a share of their extent."""
FINEST = 1 / 1200
"""Of the grid's longer side: half a pixel. Finer ways would not look otherwise."""
MOST_POINTS = 15_000
"""Of all paths together, a quarter of a megabyte; coarser ones are taken until they fit."""
BODY_M = 0.15
LEAST_BODY = 17.0
"""Robots are drawn at their length, or at this one, in pixels, where that is too small to see."""


@dataclass(frozen=True, slots=True, eq=False)
class ThinPath:
    """A robot's way with few points."""

    robot: SurveyRobot
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """All robots' ways with few points."""

    paths: tuple[ThinPath, ...]
    off_m: float
    """How far they are at the most from where a robot was at the same moment."""


def thin_ways(view: SurveyView) -> Ways:
    """Take the finest ways that the budget allows."""
    off_m = FINEST * max(view.grid.shape) * view.grid.spacing_m
    while (paths := _thin(view, off_m)) is None:
        off_m *= 2.0
    return Ways(paths, off_m)


def _thin(view: SurveyView, off_m: float) -> tuple[ThinPath, ...] | None:
    """Return all ways with this error; None where they have too many points."""
    paths, points = [], 0
    for robot in view.robots:
        kept = thinned(robot.time_s, robot.x_m, robot.y_m, off_m)
        points += kept.size
        if points > MOST_POINTS and off_m < view.grid.spacing_m:
            return None
        paths.append(ThinPath(robot, robot.time_s[kept], robot.x_m[kept], robot.y_m[kept]))
    return tuple(paths)


def scene(view: SurveyView, title: str) -> Chart:
    """Axes to scale around grid, ways and base, with the grid drawn."""
    chart = tank_axes(_around(view))
    chart.title, chart.y_label = title, "y, m"
    (x0, x1, y0, y1), (rows, columns) = grid_box(view), view.grid.shape
    left, top, right, floor = chart.x(x0), chart.y(y1), chart.x(x1), chart.y(y0)
    chart.raw(
        f'<rect class="water" x="{xy(left)}" y="{xy(top)}" width="{xy(right - left)}" '
        f'height="{xy(floor - top)}"/>'
    )
    side = (right - left) / columns
    lines = [f"M{xy(left + n * side)},{xy(top)}V{xy(floor)}" for n in range(1, columns)]
    lines += [f"M{xy(left)},{xy(top + n * side)}H{xy(right)}" for n in range(1, rows)]
    chart.raw(f'<path class="lattice" d="{"".join(lines)}"/>')
    return chart


def draw_base(chart: Chart, view: SurveyView) -> None:
    """A triangle where the base station is, as in the other pictures."""
    if view.base_m is not None:
        x, y = chart.x(view.base_m[0]), chart.y(view.base_m[1])
        chart.raw(
            f'<path class="mark base" d="M{xy(x)},{xy(y - 6)}l5,10h-10z">'
            "<title>base station</title></path>"
        )


def grid_box(view: SurveyView) -> Box:
    """Edges of all cells together."""
    grid = view.grid
    half = grid.spacing_m / 2
    return (
        grid.x_m - half,
        grid.x_m + (grid.columns - 0.5) * grid.spacing_m,
        grid.y_m - half,
        grid.y_m + (grid.rows - 0.5) * grid.spacing_m,
    )


def _around(view: SurveyView) -> Box:
    x0, x1, y0, y1 = grid_box(view)
    xs = [np.array([x0, x1]), *(robot.x_m for robot in view.robots)]
    ys = [np.array([y0, y1]), *(robot.y_m for robot in view.robots)]
    if view.base_m is not None:
        xs.append(np.array(view.base_m[:1]))
        ys.append(np.array(view.base_m[1:]))
    x, y = np.concatenate(xs), np.concatenate(ys)
    air = MARGIN * max(float(np.ptp(x)), float(np.ptp(y)))
    return (
        float(x.min()) - air,
        float(x.max()) + air,
        float(y.min()) - air,
        float(y.max()) + air,
    )


def body(chart: Chart) -> str:
    """A robot's outline about its middle, heading to the right: a spindle with a tail fin."""
    half = max(BODY_M * (chart.x(1.0) - chart.x(0.0)), LEAST_BODY) / 2
    wide, fin = 0.45 * half, 0.3 * half
    return (
        f"M{xy(half)},0Q{xy(0.2 * half)},{xy(wide)} {xy(-0.6 * half)},0"
        f"L{xy(-half)},{xy(fin)}V{xy(-fin)}L{xy(-0.6 * half)},0"
        f"Q{xy(0.2 * half)},{xy(-wide)} {xy(half)},0Z"
    )


def heading_deg(path: ThinPath) -> float:
    """Direction in which a robot last came on, degrees clockwise on the page."""
    dx, dy = np.diff(path.x_m), np.diff(path.y_m)
    moved = np.flatnonzero(np.hypot(dx, dy) > 0)
    if not moved.size:
        return 0.0
    return -math.degrees(math.atan2(float(dy[moved[-1]]), float(dx[moved[-1]])))


def draw_fish(chart: Chart, path: ThinPath, style: str, label: str, *, dead: bool) -> None:
    """A robot where it was last, with its number."""
    x, y = chart.x(float(path.x_m[-1])), chart.y(float(path.y_m[-1]))
    colour = "dead" if dead else style
    chart.raw(
        f'<path class="fish {colour}" transform="translate({xy(x)},{xy(y)}) '
        f'rotate({heading_deg(path):.0f})" d="{body(chart)}"/>'
        f'<text class="{label}" transform="translate({xy(x)},{xy(y)})" x="8" y="-8">'
        f"{path.robot.address}</text>"
    )


def ways_figure(view: SurveyView, ways: Ways) -> str:
    """Who swam where, and sampled there."""
    chart = scene(view, "ways of the robots over the grid, and where they sampled")
    styles = robot_styles(tuple(robot.address for robot in view.robots))
    chart.raw('<g class="ways">')
    for path in ways.paths:
        robot = path.robot
        if not path.time_s.size:
            continue
        px, py = chart.x.pixels(path.x_m), chart.y.pixels(path.y_m)
        line = "L".join(f"{xy(a)},{xy(b)}" for a, b in zip(px.tolist(), py.tolist(), strict=True))
        own = [sample for sample in view.samples if sample.robot == robot.address]
        dots = "".join(f"M{xy(chart.x(s.x_m))},{xy(chart.y(s.y_m))}h0" for s in own)
        metres = way_m(robot)
        words = f"{robot.name}: {number(metres)} m, samples: {len(own)}"
        style = styles[robot.address]
        chart.raw(
            f'<g class="way"><title>{escape(words)}</title>'
            f'<path class="hit" d="M{line}"/><path class="line thin {style}" d="M{line}"/>'
            f'<path class="dots {style}" stroke-width="5" d="{dots}"/>'
        )
        draw_fish(chart, path, style, "strong cased", dead=robot.dead_at(view.duration_s))
        chart.raw("</g>")
    chart.raw("</g>")
    draw_base(chart, view)
    note = (
        "Dots: samples, where the robots took them. Grey: dead at the end. "
        f"Ways are drawn to within {number(1000 * ways.off_m, 2)} mm. Point at one to see it alone."
    )
    return figure("Ways", chart.svg(), note=note)


def way_m(robot: SurveyRobot) -> float:
    """Length of a robot's way, m."""
    return float(np.hypot(np.diff(robot.x_m), np.diff(robot.y_m)).sum())
