"""The path in the tank, to scale: true, as the camera saw it, and averaged over beats.

The robot is drawn at its own size where it started and where it ended. A path that fills little of
the tank is enlarged, and a small map says where in the tank that is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tools.records.data import FloatArray, RunData, TankView
from tools.records.metrics import beat_average
from tools.report.charts import RIGHT, TOP, Chart, figure, xy
from tools.report.scale import nice_step

HALF, WIDTH = 600.0, 1090.0
WIDE_ASPECT = 1.9
"""A view that is so much wider than high gets the whole width of the page."""

LEAST_VIEW_M = 0.8
ENLARGE_BELOW = 0.4
"""A path that spans less than this share of the tank is enlarged."""

HALF_BODY_M = 0.07
"""Half of the body's length (Table 3.1: c), for the drawing of the robot."""

MODES = {
    "approaching": ("c3", "begins to approach"),
    "turning": ("c4", "begins to turn"),
    "leaving": ("c6", "begins to leave"),
}
"""Controllers of target tracking: colour and words where one takes over."""

Box = tuple[float, float, float, float]  # x0, x1, y0, y1 in metres


def path_figure(data: RunData) -> str:
    """The section's main picture."""
    entries = [("c1", "true path"), ("c2", "averaged over a beat")]
    if "x_m" in data.channels:
        entries.append(("c5 dot", "camera"))
    seen = {switch.mode for switch in data.switches}
    entries += [(f"{style} dot", words) for mode, (style, words) in MODES.items() if mode in seen]
    return figure("Path in the tank", path_svg(data), entries=entries)


def is_wide(data: RunData) -> bool:
    """Whether the picture wants the whole width of the page."""
    return _is_wide(_view(data, tank_box(data.tank)))


def _is_wide(view: Box) -> bool:
    return (view[1] - view[0]) > WIDE_ASPECT * (view[3] - view[2])


def path_picture(data: RunData) -> str:
    """The same as a file of its own."""
    return alone(path_svg(data))


def alone(svg: str) -> str:
    """Make a file of a picture: with the style sheet inside."""
    style = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
    opening = '<svg xmlns="http://www.w3.org/2000/svg" style="background:var(--card)"'
    return svg.replace("<svg", opening, 1).replace(">", f"><style>{style}</style>", 1)


def path_svg(data: RunData) -> str:
    """Draw it."""
    x, y = data.truth["x_m"], data.truth["y_m"]
    tank = tank_box(data.tank)
    view = _view(data, tank)
    chart = tank_axes(view)
    draw_water(chart, tank, view)
    camera_x, camera_y = data.channels.get("x_m"), data.channels.get("y_m")
    chart.raw('<g clip-path="url(#view)">')
    if camera_x is not None and camera_y is not None:
        chart.points(camera_x.value, camera_y.value, "c5 haze", 1.1)
    step = max(1, x.size // 6000)
    chart.line(x[::step], y[::step], "c1 thin", "true path", every=True)
    _, mean_x = beat_average(data.truth["time_s"], x, data.beat_frequency_hz)
    _, mean_y = beat_average(data.truth["time_s"], y, data.beat_frequency_hz)
    step = max(1, mean_x.size // 1500)
    if mean_x.size < x.size:
        chart.line(mean_x[::step], mean_y[::step], "c2", "averaged", every=True)
    chart.raw("</g>")
    _places(chart, data, view)
    _time_marks(chart, data)
    if x.size:
        draw_robot(chart, data.truth, 0, "mark", "start")
        draw_robot(chart, data.truth, -1, "mark full", "end")
    if view != tank:
        _map(chart, tank, view)
    return chart.svg()


def tank_box(tank: TankView) -> Box:
    """The tank's walls."""
    (x0, y0), (width, height) = tank.corner_m, tank.size_m
    return (x0, x0 + width, y0, y0 + height)


def _view(data: RunData, tank: Box) -> Box:
    """The part of the tank that is shown."""
    xs, ys = [data.truth["x_m"]], [data.truth["y_m"]]
    for place in _targets(data):
        xs.append(np.array([place[0]]))
        ys.append(np.array([place[1]]))
    x, y = np.concatenate(xs), np.concatenate(ys)
    if x.size == 0:
        return tank
    spans = (float(np.ptp(x)), float(np.ptp(y)))
    inside = tank[0] <= x.min() and x.max() <= tank[1] and tank[2] <= y.min() <= y.max() <= tank[3]
    if inside and max(spans) >= ENLARGE_BELOW * max(tank[1] - tank[0], tank[3] - tank[2]):
        return tank
    width = max(spans[0] * 1.25 + 0.3, LEAST_VIEW_M)
    height = max(spans[1] * 1.25 + 0.3, LEAST_VIEW_M, 0.9 * width)
    middle_x, middle_y = float(x.min() + x.max()) / 2, float(y.min() + y.max()) / 2
    return (
        middle_x - width / 2,
        middle_x + width / 2,
        middle_y - height / 2,
        middle_y + height / 2,
    )


def _targets(data: RunData) -> list[tuple[float, float]]:
    """Every target, each place once."""
    tank = data.tank
    single = (tank.target_m,) if tank.target_m is not None else ()
    visited = ((visit.x_m, visit.y_m) for visit in data.targets)
    return list(dict.fromkeys((*single, *tank.targets_m, *visited)))


def tank_axes(view: Box) -> Chart:
    """A chart with equal scales on both axes."""
    left, bottom = 46.0, 36.0
    plot = (WIDTH if _is_wide(view) else HALF) - left - RIGHT
    height = plot * (view[3] - view[2]) / (view[1] - view[0])
    if height > 620:
        plot *= 620 / height
        height = 620
    chart = Chart(
        left + plot + RIGHT,
        TOP + height + bottom,
        (view[0], view[1]),
        (view[2], view[3]),
        x_label="x, m",
        title="path of the robot in the tank, seen from above",
        left=left,
        bottom=bottom,
    )
    chart.step = nice_step(max(view[1] - view[0], view[3] - view[2]), 8)
    return chart


def draw_water(chart: Chart, tank: Box, view: Box) -> None:
    """The tank's water where it is in view, with a grid on it; `#view` clips to the picture."""
    x0, x1 = (chart.x(max(min(v, view[1]), view[0])) for v in tank[:2])
    y1, y0 = (chart.y(max(min(v, view[3]), view[2])) for v in tank[2:])
    chart.raw(
        f'<clipPath id="view"><rect x="{xy(chart.left)}" y="{xy(TOP)}" '
        f'width="{xy(chart.width - RIGHT - chart.left)}" '
        f'height="{xy(chart.height - chart.bottom - TOP)}"/></clipPath>'
    )
    chart.raw(
        f'<rect class="water" x="{xy(x0)}" y="{xy(y0)}" width="{xy(x1 - x0)}" '
        f'height="{xy(y1 - y0)}"/>'
    )
    grid = "".join(f"M{xy(chart.x(v))},{xy(y0)}V{xy(y1)}" for v in chart.ticks_x()[0]) + "".join(
        f"M{xy(x0)},{xy(chart.y(v))}H{xy(x1)}" for v in chart.ticks_y()[0]
    )
    chart.raw(f'<path class="ripple" d="{grid}"/>')
    chart.text(2, chart.height - 3, "y, m", "label")


def _places(chart: Chart, data: RunData, view: Box) -> None:
    """Target and base station, where they are in view."""
    tank = data.tank
    targets = _targets(data)
    for number, (x_m, y_m) in enumerate(targets, start=1):
        x, y = chart.x(x_m), chart.y(y_m)
        radius = chart.x(tank.arrival_radius_m) - chart.x(0.0)
        if radius > 3:
            chart.raw(f'<circle class="ring" cx="{xy(x)}" cy="{xy(y)}" r="{xy(radius)}"/>')
        chart.raw(f'<path class="cross" d="M{xy(x - 5)},{xy(y)}h10M{xy(x)},{xy(y - 5)}v10"/>')
        words = f"target {number}" if len(targets) > 1 else "target"
        chart.text(x, y - max(radius, 5) - 6, words, "strong", "middle")
    _switches(chart, data)
    draw_base(chart, tank, view)


def draw_base(chart: Chart, tank: TankView, view: Box) -> None:
    """The base station, where it is in view."""
    base = tank.base_station_m
    if base is not None and view[0] <= base[0] <= view[1] and view[2] <= base[1] <= view[3]:
        x, y = chart.x(base[0]), chart.y(base[1])
        chart.raw(f'<path class="mark" d="M{xy(x)},{xy(y - 6)}l5,10h-10z"/>')
        chart.text(x + 9, y - 5, "base station")


def _switches(chart: Chart, data: RunData) -> None:
    """Where another controller of target tracking took over."""
    time, x, y = (data.truth[name] for name in ("time_s", "x_m", "y_m"))
    for mode, (style, _) in MODES.items():
        moments = np.array([switch.time_s for switch in data.switches if switch.mode == mode])
        if moments.size:
            chart.points(np.interp(moments, time, x), np.interp(moments, time, y), style, 4.0)


def _time_marks(chart: Chart, data: RunData) -> None:
    """Small labels along the path, every round number of seconds."""
    time, x, y = (data.truth[name] for name in ("time_s", "x_m", "y_m"))
    if time.size < 2 or time[-1] <= time[0]:
        return
    step = nice_step(float(time[-1] - time[0]), 8)
    labelled = [(chart.x(float(x[i])), chart.y(float(y[i]))) for i in (0, -1)]
    for count in range(1, int(float(time[-1]) / step) + 1):
        moment = count * step
        px = chart.x(float(np.interp(moment, time, x)))
        py = chart.y(float(np.interp(moment, time, y)))
        crowded = any(math.hypot(px - a, py - b) < 44 for a, b in labelled)
        if crowded or moment > time[-1] - step / 4:
            continue
        labelled.append((px, py))
        # The label stands beside the path, not on it: to the left of the way ahead.
        ahead = (
            np.interp([moment, moment + step / 4], time, x),
            np.interp([moment, moment + step / 4], time, y),
        )
        dx, dy = float(np.diff(ahead[0])[0]), float(np.diff(ahead[1])[0])
        length = math.hypot(dx, dy) or 1.0
        # On paper y grows upwards, in pixels downwards: left of (dx, dy) is (−dy, dx) in metres.
        chart.raw(f'<circle class="mark" cx="{xy(px)}" cy="{xy(py)}" r="2.4"/>')
        chart.text(
            px - 22 * dy / length, py - 15 * dx / length + 4, f"{moment:g} s", "note", "middle"
        )


def draw_robot(
    chart: Chart, truth: Mapping[str, FloatArray], index: int, style: str, word: str
) -> None:
    """A robot from above at its true size: a spindle of 14 cm and its tail; a word beside it."""
    x, y, heading, tail = (
        float(truth[name][index]) for name in ("x_m", "y_m", "heading_rad", "tail_angle_rad")
    )
    scale = chart.x(1.0) - chart.x(0.0)
    c, s = math.cos(heading), math.sin(heading)

    def at(forward: float, left: float) -> str:
        px = chart.x(x) + scale * (c * forward - s * left)
        py = chart.y(y) - scale * (s * forward + c * left)
        return f"{xy(px)},{xy(py)}"

    nose, joint, side = HALF_BODY_M, -HALF_BODY_M, 0.033
    # The tail points from the joint along (−cos α, −sin α), as in the source.
    length, fan = 0.08, 0.012
    tip_x, tip_y = joint - length * math.cos(tail), -length * math.sin(tail)
    across_x, across_y = -math.sin(tail) * fan, math.cos(tail) * fan
    body = (
        f"M{at(nose, 0)}C{at(nose, side)} {at(-0.01, side * 1.2)} {at(joint, 0)}"
        f"C{at(-0.01, -side * 1.2)} {at(nose, -side)} {at(nose, 0)}Z"
        f"M{at(joint, 0)}L{at(tip_x + across_x, tip_y + across_y)}"
        f"L{at(tip_x - across_x, tip_y - across_y)}Z"
    )
    chart.raw(f'<path class="{style}" stroke-linejoin="round" d="{body}"/>')
    # To the right of the robot: the time labels stand on its left.
    away = scale * 0.05 + 12
    chart.text(chart.x(x) + away * s * 1.3, chart.y(y) + away * c + 4, word, "strong", "middle")


def _map(chart: Chart, tank: Box, view: Box) -> None:
    """The whole tank, small, with the enlarged part marked; in the corner away from the end."""
    width = 104.0
    height = width * (tank[3] - tank[2]) / (tank[1] - tank[0])
    left, top = chart.width - RIGHT - width - 10, TOP + 10
    scale = width / (tank[1] - tank[0])
    box = (
        left + (max(view[0], tank[0]) - tank[0]) * scale,
        top + (tank[3] - min(view[3], tank[3])) * scale,
        (min(view[1], tank[1]) - max(view[0], tank[0])) * scale,
        (min(view[3], tank[3]) - max(view[2], tank[2])) * scale,
    )
    chart.raw(
        f'<rect class="map" x="{xy(left)}" y="{xy(top)}" width="{xy(width)}" '
        f'height="{xy(height)}"/>'
        f'<rect class="ring" x="{xy(box[0])}" y="{xy(box[1])}" width="{xy(box[2])}" '
        f'height="{xy(box[3])}"/>'
    )
    chart.text(left + width / 2, top + height + 13, "whole tank", "note", "middle")
