"""Who heard whom: a map of the links where the robots ended, and the whole matrix.

A link is as good as its worse direction. Of a large shoal the map shows the links to the base
station alone; the matrix always shows all of them. Where the data go by several hops the map has
the tree, too: an arrow from each robot to its parent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from tools.records.data import FloatArray
from tools.records.shoal_data import ShoalData
from tools.report.charts import Chart, figure, xy
from tools.report.path import draw_water, tank_axes, tank_box
from tools.report.scale import number

MESH = 30
"""So many robots have all their links drawn."""
CLASSES = ((0.9, "c3", "90 % and more"), (0.5, "c6", "50 to 90 %"), (0.01, "bad", "less"))
"""Least reception ratio of a class of links, its colour, and words for it."""
LEVELS = 10
SIDE, HEAD = 520.0, 46.0


def links_figures(data: ShoalData, parents: Sequence[tuple[int, int]] = ()) -> str:
    """Map and matrix side by side; ``parents`` are addresses, 0 that of the base station."""
    entries = [(style, words) for _, style, words in CLASSES]
    whom = "to the base station" if len(data.robots) > MESH else "between all"
    note = f"Links {whom}, at the robots' last places; of both directions the worse one."
    note += " Arrows: to whom each sends its data on." if parents else ""
    named = figure("Map of the links", _map(data, parents), entries=entries, note=note)
    said = "A row is a sender, a column a listener; the darker, the more of its frames were found."
    matrix = figure("Packet reception ratio", _matrix(data), note=said)
    return f'<div class="grid2 even">{named}{matrix}</div>'


def _map(data: ShoalData, parents: Sequence[tuple[int, int]]) -> str:
    tank = tank_box(data.tank)
    places = _places(data)
    view = _around(places)
    chart = tank_axes(view)
    draw_water(chart, tank, view)
    ratio = data.hearing.ratio()
    for first, second in _pairs(data):
        both = (float(ratio[first, second]), float(ratio[second, first]))
        known = [value for value in both if not math.isnan(value)]
        worse = min(known, default=0.0)
        style = next((style for least, style, _ in CLASSES if worse >= least), "")
        if style:
            ends = [
                f"{xy(chart.x(x))},{xy(chart.y(y))}" for x, y in (places[first], places[second])
            ]
            names = (data.hearing.names[first], data.hearing.names[second])
            told = ", ".join(
                f"{a} to {b} {_percent(value)}"
                for (a, b), value in zip((names, names[::-1]), both, strict=True)
            )
            chart.raw(
                f'<path class="line thin {style}" opacity="{0.25 + 0.5 * worse:.2f}" '
                f'd="M{ends[0]}L{ends[1]}"><title>{escape(told)}</title></path>'
            )
    for arrow in _arrows(data, chart, places, parents):
        chart.raw(arrow)
    for (x, y), name in zip(places, data.hearing.names, strict=True):
        px, py = chart.x(float(x)), chart.y(float(y))
        if name == "base":
            chart.raw(f'<path class="mark full" d="M{xy(px)},{xy(py - 7)}l6,12h-12z"/>')
        else:
            chart.raw(f'<circle class="mark" cx="{xy(px)}" cy="{xy(py)}" r="4"/>')
        if len(places) <= MESH + 1:
            chart.text(px + 7, py - 6, name.removeprefix("fish"))
    return chart.svg()


def _arrows(
    data: ShoalData, chart: Chart, places: FloatArray, parents: Sequence[tuple[int, int]]
) -> Iterator[str]:
    """From each robot to its parent, with the head in the middle, where nothing hides it."""
    place = {robot.address: n for n, robot in enumerate(data.robots)} | {0: len(data.robots)}
    for child, parent in parents:
        if child not in place or parent not in place:
            continue
        (ax, ay), (bx, by) = (
            (chart.x(float(x)), chart.y(float(y)))
            for x, y in (places[place[child]], places[place[parent]])
        )
        names = data.hearing.names[place[child]], data.hearing.names[place[parent]]
        turn = math.degrees(math.atan2(by - ay, bx - ax))
        yield (
            f'<g class="tree"><title>{escape(" sends on to ".join(names))}</title>'
            f'<path class="line" d="M{xy(ax)},{xy(ay)}L{xy(bx)},{xy(by)}"/>'
            f'<path class="filled" transform="translate({xy((ax + bx) / 2)},{xy((ay + by) / 2)}) '
            f'rotate({turn:.0f})" d="M6,0L-4,4.5V-4.5Z"/></g>'
        )


def _pairs(data: ShoalData) -> Iterator[tuple[int, int]]:
    """Pairs of whom a link is drawn; the base station is the last."""
    last = len(data.hearing.names) - 1
    if last > MESH:
        yield from ((place, last) for place in range(last))
        return
    yield from ((a, b) for a in range(last + 1) for b in range(a + 1, last + 1))


def _places(data: ShoalData) -> FloatArray:
    """Where each robot was last, then the base station: shape (n, 2)."""
    rows = [[float(robot.truth[name][-1]) for name in ("x_m", "y_m")] for robot in data.robots]
    return np.array([*rows, data.tank.base_station_m or (0.0, 0.0)])


def _around(places: FloatArray) -> tuple[float, float, float, float]:
    """A square view around all places."""
    low, high = places.min(axis=0), places.max(axis=0)
    side = 1.15 * max(float((high - low).max()), 1.0)
    x, y = ((low + high) / 2).tolist()
    return (x - side / 2, x + side / 2, y - side / 2, y + side / 2)


def _matrix(data: ShoalData) -> str:
    """Cells of like level as one path a level: a hundred robots make ten thousand cells."""
    ratio, names = data.hearing.ratio(), data.hearing.names
    cell = (SIDE - HEAD) / len(names)
    cells: dict[int, list[str]] = {}
    for row, values in enumerate(ratio.tolist()):
        column = 0
        while column < len(values):
            level, first = _level(values[column]), column
            while column < len(values) and _level(values[column]) == level:
                column += 1
            if level:
                left, top = HEAD + first * cell, HEAD + row * cell
                wide, high = cell * (column - first), xy(cell)
                path = f"M{xy(left)},{xy(top)}h{xy(wide)}v{high}h{xy(-wide)}z"
                cells.setdefault(level, []).append(path)
    parts = [
        (
            f'<svg class="chart" viewBox="0 0 {SIDE:g} {SIDE:g}" role="img" '
            'aria-label="packet reception ratio of every pair">'
            f'<rect class="water" x="{HEAD:g}" y="{HEAD:g}" width="{xy(SIDE - HEAD)}" '
            f'height="{xy(SIDE - HEAD)}"/>'
        )
    ]
    parts += [
        f'<path class="c1 filled" opacity="{level / LEVELS:.1f}" d="{"".join(cells[level])}"/>'
        for level in sorted(cells)
    ]
    every = max(1, math.ceil(len(names) / 25))
    for place, name in enumerate(names):
        last = len(names) - 1
        if place != last and (place % every or place + every > last):
            continue
        middle, word = HEAD + (place + 0.5) * cell, escape(name.removeprefix("fish"))
        parts.append(
            f'<text class="tick" x="{xy(HEAD - 5)}" y="{xy(middle)}" dy=".32em" '
            f'text-anchor="end">{word}</text>'
            f'<text class="tick" text-anchor="start" '
            f'dy=".32em" transform="translate({xy(middle)},{xy(HEAD - 5)}) rotate(-90)">'
            f"{word}</text>"
        )
    return "".join(parts) + "</svg>"


def _level(value: float) -> int:
    """From 1 to `LEVELS`; 0 where nothing was heard, or nothing is known."""
    return 0 if math.isnan(value) or value <= 0.0 else max(1, round(LEVELS * value))


def _percent(value: float) -> str:
    return "—" if math.isnan(value) else f"{number(100 * value)} %"
