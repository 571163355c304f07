"""The surveyed field cell by cell, as in Figs. 6.4 to 6.12 of the source.

True field and reconstruction on one scale of colours, error and stated deviation on another; who
sampled which cell, and in what order. Each cell of a small grid says its figures under the pointer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from html import escape

import numpy as np

from tools.records.data import FloatArray
from tools.records.survey_data import Cell
from tools.report.charts import figure, xy
from tools.report.scale import number
from tools.report.survey_colours import (
    FAINT,
    STRONG,
    Paint,
    Strength,
    Values,
    Whose,
    bar,
    robot_styles,
)
from tools.report.survey_view import SurveyView, root_mean_square

WIDTH, LEFT, TOP, BOTTOM, SCALE = 520.0, 34.0, 22.0, 36.0, 56.0
HIGHEST = 430.0
TOLD = 2500
"""Cells of a larger grid say no words: 100 octets each, in five maps."""
LEGIBLE = 13.0
"""Narrower cells, in pixels, carry no numbers."""
LARGEST_TYPE = 13.0

Draw = Callable[[Cell, float, float, float], str]
"""What is drawn upon a cell, from its middle and its side in pixels."""


def field_figures(view: SurveyView) -> str:
    """What there was, what was found, and how far it is off; without the truth only the second."""
    grid, error, parts = view.grid, view.error, []
    values = Values(*view.span)
    if view.field is not None:
        truth = _map(view, f"true {view.quantity}", view.field, values, unit=view.unit)
        size = f"{grid.rows} × {grid.columns} cells of {100 * grid.spacing_m:g} cm"
        parts.append(figure(f"True {view.quantity}", truth, note=f"At the cells' centres: {size}."))
    found = view.reconstruction
    drawn = _map(
        view, f"reconstructed {view.quantity}", found, values, _dots(view, values), view.unit
    )
    note = "With a dot: sampled. Without: recovered."
    note += " Crosses: given up, with a stand-in." if view.given_up else ""
    parts.append(figure("Reconstruction", drawn, note=note))
    sizes = [np.abs(matrix) for matrix in (error, view.deviation) if matrix is not None]
    greatest = max((float(np.nanmax(m)) for m in sizes if np.isfinite(m).any()), default=0.0)
    errors = Strength(0.0, greatest or 1.0)
    if error is not None:
        drawn = _map(view, "error of the reconstruction", sizes[0], errors, unit=view.unit)
        parts.append(figure("Error", drawn, note=_error_note(view, error)))
    drawn = _map(view, "stated deviation", view.deviation, errors, unit=view.unit)
    hole = " Empty: nothing is stated." if np.isnan(view.deviation).any() else ""
    said = f"Standard deviation of the error, as the boards state it.{hole}"
    parts.append(figure("Stated deviation", drawn, note=said))
    return f'<div class="grid2 even maps">{"".join(parts)}</div>'


def sample_figures(view: SurveyView) -> str:
    """Which cells were sampled: in what order, and by whom."""
    order = np.where(view.order > 0, view.order, np.nan).astype(np.float64)
    later = Strength(1.0, max(len(view.samples), 2.0), "c1", FAINT, STRONG)
    numbers = _map(view, "order of the samples", order, later, _numbers(order))
    whom = np.full(view.grid.shape, np.nan)
    for sample in reversed(view.samples):
        whom[sample.cell] = sample.robot
    whose = Whose(robot_styles(tuple(robot.address for robot in view.robots)))
    robots = _map(view, "who sampled", whom, whose, _numbers(whom))
    again = len(view.samples) - view.sampled
    note = "The number of a cell's first sample; the stronger, the later."
    note += f" Samples of a cell that had one: {again}." if again else ""
    left = figure("Samples in their order", numbers, note=note)
    right = figure("By whom", robots, note="The number of the robot that sampled a cell first.")
    return f'<div class="grid2 even maps">{left}{right}</div>'


def _error_note(view: SurveyView, error: FloatArray) -> str:
    """How large, and whether what is stated is right."""
    rms, most = root_mean_square(error), float(np.nanmax(np.abs(error), initial=0.0))
    note = f"Root mean square {number(rms)} {view.unit}, at the most {number(most)} {view.unit}."
    ratio = root_mean_square(error / np.where(view.deviation > 0, view.deviation, np.nan))
    if ratio is not None:
        note += f" In units of the stated deviation {number(ratio, 2)}; 1 if that is right."
    return note


def side_of(view: SurveyView, width: float, height: float) -> float:
    """Pixels of a cell where all have so much room."""
    return min(width / view.grid.columns, height / view.grid.rows)


def _map(
    view: SurveyView,
    title: str,
    matrix: FloatArray,
    paint: Paint,
    draw: Draw | None = None,
    unit: str = "",
) -> str:
    """A matrix as cells, the first row lowest; with a unit its scale stands beside it."""
    rows, columns = view.grid.shape
    side = side_of(view, WIDTH - LEFT - SCALE, HIGHEST)
    width, height = side * columns, side * rows
    whole = TOP + height + BOTTOM
    left = LEFT + (WIDTH - LEFT - SCALE - width) / 2
    parts = [
        (
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {xy(whole)}" role="img" '
            f'aria-label="{escape(title)}, {rows} × {columns} cells">'
            f'<rect class="water" x="{xy(left)}" y="{TOP:g}" width="{xy(width)}" '
            f'height="{xy(height)}"/><g shape-rendering="crispEdges">'
            f'<path class="ground" d="{_ground(matrix, left, side)}"/>'
        )
    ]
    marks = []
    told = rows * columns <= TOLD
    for (row, column), value in _cells(matrix):
        x, y = left + column * side, TOP + (rows - 1 - row) * side
        if told:
            words = escape(_words(view, (row, column)))
            parts.append(
                f'<rect {paint.fill(value)} x="{xy(x)}" y="{xy(y)}" width="{xy(side)}" '
                f'height="{xy(side)}"><title>{words}</title></rect>'
            )
        else:
            parts.append(
                f'<rect {paint.fill(value)} x="{xy(x)}" y="{xy(y)}" width="{xy(side)}" '
                f'height="{xy(side)}"/>'
            )
        if draw is not None:
            marks.append(draw((row, column), x + side / 2, y + side / 2, side))
    parts += ["</g>", '<g class="over">', *marks, "</g>", _axes(view, left, side)]
    if unit and isinstance(paint, Values | Strength):
        parts.append(bar(paint, WIDTH - SCALE + 14, TOP, height, unit))
    return "".join([*parts, "</svg>"])


def _cells(matrix: FloatArray) -> Iterator[tuple[Cell, float]]:
    """Cells with a value."""
    for row, values in enumerate(matrix.tolist()):
        for column, value in enumerate(values):
            if not math.isnan(value):
                yield (row, column), value


def _ground(matrix: FloatArray, left: float, side: float) -> str:
    """What lies under the cells that have a value, so that faint ones are no water."""
    return "".join(
        f"M{xy(left + column * side)},{xy(TOP + (matrix.shape[0] - 1 - row) * side)}"
        f"h{xy(side)}v{xy(side)}h{xy(-side)}z"
        for (row, column), _ in _cells(matrix)
    )


def _axes(view: SurveyView, left: float, side: float) -> str:
    """Numbers of rows and columns, as they are in the records."""
    rows, columns = view.grid.shape
    every = max(1, math.ceil(max(rows, columns) / 12))
    floor = TOP + rows * side
    parts = [
        f'<text class="tick" x="{xy(left + (column + 0.5) * side)}" y="{xy(floor + 15)}" '
        f'text-anchor="middle">{column}</text>'
        for column in range(0, columns, every)
    ]
    parts += [
        f'<text class="tick" x="{xy(left - 6)}" y="{xy(floor - (row + 0.5) * side)}" '
        f'dy=".32em" text-anchor="end">{row}</text>'
        for row in range(0, rows, every)
    ]
    parts.append(
        f'<text class="label" x="{xy(left + columns * side)}" y="{xy(floor + 31)}" '
        'text-anchor="end">column</text>'
        f'<text class="label" x="{xy(left - 6)}" y="{xy(TOP - 8)}" text-anchor="end">row</text>'
    )
    return "".join(parts)


def _words(view: SurveyView, cell: Cell) -> str:
    """All that is known of a cell."""
    found, off = float(view.reconstruction[cell]), float(view.deviation[cell])
    told = f"row {cell[0]}, column {cell[1]}: {number(found, 4)} ± {number(off, 2)} {view.unit}"
    if view.field is not None:
        told += f", true {number(float(view.field[cell]), 4)}"
    order = int(view.order[cell])
    if order:
        sample = view.samples[order - 1]
        return f"{told}; sample {order}, robot {sample.robot}, {sample.time_s:.0f} s"
    return f"{told}; {'given up' if cell in view.given_up else 'not sampled'}"


def _dots(view: SurveyView, paint: Paint) -> Draw:
    """Which cells were sampled, which were given up."""
    lost = set(view.given_up)

    def draw(cell: Cell, x: float, y: float, side: float) -> str:
        style = paint.mark(float(view.reconstruction[cell]))
        if cell in lost:
            arm = 0.25 * side
            return (
                f'<path class="{style} stroke" d="M{xy(x - arm)},{xy(y - arm)}l{xy(2 * arm)},'
                f'{xy(2 * arm)}m0,{xy(-2 * arm)}l{xy(-2 * arm)},{xy(2 * arm)}"/>'
            )
        if not view.order[cell]:
            return ""
        radius = max(0.8, min(3.0, 0.1 * side))
        return f'<circle class="{style}" cx="{xy(x)}" cy="{xy(y)}" r="{xy(radius)}"/>'

    return draw


def _numbers(values: FloatArray) -> Draw:
    """The value of each cell, as large as the longest of all allows."""
    finite = values[np.isfinite(values)]
    longest = len(str(int(finite.max()))) if finite.size else 1

    def draw(cell: Cell, x: float, y: float, side: float) -> str:
        if side < LEGIBLE:
            return ""
        size = min(LARGEST_TYPE, 0.84 * side / (0.6 * longest), 0.6 * side)
        return (
            f'<text x="{xy(x)}" y="{xy(y)}" dy=".36em" text-anchor="middle" '
            f'style="font-size:{xy(size)}px">{int(values[cell])}</text>'
        )

    return draw
