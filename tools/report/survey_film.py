"""The mission as a film: robots swim, cells fill with what was known of them at each moment.

The page holds the film's last picture, complete without scripts, and numbers from which a small
script (survey_film.js) draws any other moment: thinned ways, samples, and the reconstruction as
often as it changed, a letter a cell. Nothing plays unless it is asked to.
"""

from __future__ import annotations

import json
import math
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from tools.records.data import FloatArray
from tools.report.charts import Chart, xy
from tools.report.scale import number
from tools.report.survey_colours import VIRIDIS, Values, robot_styles
from tools.report.survey_scene import (
    ThinPath,
    Ways,
    body,
    draw_base,
    draw_fish,
    grid_box,
    scene,
)
from tools.report.survey_view import Span, SurveyView

TRACK = 600.0
LETTERS = "0123456789abcdefghijklmnopqrstuvwxyz"
UNKNOWN = "-"
MOST_LETTERS = 400_000
"""Of all reconstructions together; of more states some are left out, never the last."""
SPEEDS = (1, 5, 20, 50, 100, 200, 500)
LASTS_S = 30.0
"""About so long a film takes at the speed that is chosen at first."""


def film_figure(view: SurveyView, ways: Ways) -> str:
    """The film with its controls."""
    chart = _picture(view, ways.paths)
    styles = robot_styles(tuple(robot.address for robot in view.robots))
    speed = min(SPEEDS, key=lambda factor: abs(math.log(factor * LASTS_S / _length(view))))
    choices = "".join(
        f'<option value="{factor}"{" selected" if factor == speed else ""}>{factor} ×</option>'
        for factor in SPEEDS
    )
    script = (Path(__file__).resolve().parent / "survey_film.js").read_text(encoding="utf-8")
    data = json.dumps(_numbers(view, ways.paths, chart, styles), separators=(",", ":"))
    note = (
        "With a dot: sampled; without: recovered from what was known then. Behind each robot its "
        f"way of the last 30 s. Places are within {number(1000 * ways.off_m, 2)} mm; robots head "
        "where they come on to. Above the slider: crosses for robots that died, bands where nobody "
        "could reach the base station."
    )
    return (
        f'<figure class="survey-film"><div class="head"><h3>Film</h3></div>'
        f'<div class="scroll">{chart.svg()}</div>'
        '<div class="film" hidden><button type="button">play</button><div class="track">'
        f'{_track(view)}<input type="range" min="0" max="{_length(view):g}" step="any" '
        f'value="{_length(view):g}" aria-label="time of the mission, s"></div>'
        f'<select aria-label="times real time">{choices}</select>'
        f"<output></output></div><figcaption>{escape(note)}</figcaption>"
        f'<script type="application/json">{data}</script><script>{script}</script></figure>'
    )


def _length(view: SurveyView) -> float:
    return max(view.duration_s, 1e-3)


def _picture(view: SurveyView, paths: tuple[ThinPath, ...]) -> Chart:
    """The last picture; the script finds its parts by their classes and order."""
    chart = scene(view, "film of the survey, its last picture")
    values, (rows, columns) = Values(*view.span), view.grid.shape
    x0, x1, y0, _ = grid_box(view)
    side = (chart.x(x1) - chart.x(x0)) / columns
    chart.raw('<g class="cells" shape-rendering="crispEdges">')
    for row in range(rows):
        for column in range(columns):
            value = float(view.reconstruction[row, column])
            fill = 'fill="none"' if math.isnan(value) else values.fill(value)
            chart.raw(
                f'<rect {fill} x="{xy(chart.x(x0) + column * side)}" '
                f'y="{xy(chart.y(y0) - (row + 1) * side)}" width="{xy(side)}" '
                f'height="{xy(side)}"/>'
            )
    chart.raw("</g>")
    for style in ("ondark", "onbright"):
        dots = "".join(
            f"M{xy(chart.x(x))},{xy(chart.y(y))}h0"
            for row in range(rows)
            for column in range(columns)
            if view.order[row, column]
            and values.mark(float(view.reconstruction[row, column])) == style
            for x, y in (view.grid.centre((row, column)),)
        )
        width = xy(max(1.6, min(5.0, 0.2 * side)))
        chart.raw(f'<path class="dots {style}" stroke-width="{width}" d="{dots}"/>')
    styles = robot_styles(tuple(robot.address for robot in view.robots))
    draw_base(chart, view)
    for path in paths:
        style = styles[path.robot.address]
        chart.raw(f'<g class="trail"><path class="case"/><path class="line {style}"/></g>')
    for path in paths:
        if path.time_s.size:
            dead = path.robot.dead_at(view.duration_s)
            draw_fish(chart, path, styles[path.robot.address], "haloed", dead=dead)
        else:
            chart.raw(f'<path class="fish" d="{body(chart)}"/><text class="haloed"></text>')
    return chart


def _numbers(
    view: SurveyView, paths: tuple[ThinPath, ...], chart: Chart, styles: dict[int, str]
) -> dict[str, Any]:
    """What the script needs, in tenths of seconds and of pixels."""
    values, columns = Values(*view.span), view.grid.columns
    robots = []
    for path in paths:
        columns_of = (path.time_s, chart.x.pixels(path.x_m), chart.y.pixels(path.y_m))
        rows = [_tenths(column) for column in columns_of]
        robots.append(
            {
                "n": path.robot.address,
                "c": styles[path.robot.address],
                "p": [_differences(row) for row in rows],
                "dead": [_span(span) for span in path.robot.dead()],
            }
        )
    samples = [
        [
            round(10 * sample.time_s),
            sample.cell[0] * columns + sample.cell[1],
            values.index(sample.value),
        ]
        for sample in view.samples
    ]
    most = max(2, MOST_LETTERS // view.cells)
    every = max(1, math.ceil(len(view.known) / most))
    states = [*view.known[:-1:every], *view.known[-1:]]
    known = [
        [round(10 * state.time_s), state.wanted, _letters(state.matrix, values)] for state in states
    ]
    if view.complete_s is not None:
        wanted = view.known[-1].wanted if view.known else view.sampled
        final = _letters(view.reconstruction, values)
        known.append([round(10 * view.complete_s), wanted, final])
    x0, x1, y0, _ = grid_box(view)
    return {
        "end": round(10 * _length(view)),
        "palette": VIRIDIS,
        "bright": next(n for n in range(len(VIRIDIS)) if _is_bright(n)),
        "columns": columns,
        "origin": [round(chart.x(x0), 2), round(chart.y(y0), 2)],
        "side": round((chart.x(x1) - chart.x(x0)) / columns, 4),
        "robots": robots,
        "samples": samples,
        "known": known,
        "base": [_span(span) for span in view.base_outages],
        "complete": None if view.complete_s is None else round(10 * view.complete_s),
    }


def _is_bright(place: int) -> bool:
    return Values(0.0, len(VIRIDIS) - 1.0).mark(float(place)) == "onbright"


def _letters(matrix: FloatArray, values: Values) -> str:
    """A colour a cell, row by row."""
    return "".join(
        UNKNOWN if math.isnan(value) else LETTERS[values.index(value)]
        for value in matrix.ravel().tolist()
    )


def _tenths(column: FloatArray) -> list[int]:
    return [round(10 * value) for value in column.tolist()]


def _differences(row: list[int]) -> list[int]:
    """The first number and what is added from one to the next: short ones."""
    return row[:1] + [after - before for before, after in pairwise(row)]


def _span(span: Span) -> list[int]:
    return [round(10 * moment) for moment in span]


def _track(view: SurveyView) -> str:
    """Deaths and outages above the slider, on its scale."""
    scale = TRACK / _length(view)
    parts = [
        (
            f'<svg viewBox="0 0 {TRACK:g} 12" preserveAspectRatio="none" role="img" '
            'aria-label="deaths of robots and outages of the base station over time">'
        )
    ]
    for start, end in view.base_outages:
        parts.append(
            f'<rect class="outage" x="{xy(start * scale)}" y="0" '
            f'width="{xy((end - start) * scale)}" height="12"><title>base station out of reach, '
            f"{start:.0f} to {end:.0f} s</title></rect>"
        )
    for robot in view.robots:
        for start, _ in robot.dead():
            parts.append(
                f'<path class="line bad" d="M{xy(start * scale - 4)},2l8,8m0,-8l-8,8">'
                f"<title>{escape(robot.name)} died at {start:.0f} s</title></path>"
            )
    return "".join([*parts, "</svg>"])
