"""Panels as inline SVG, drawn with Matplotlib and dressed like the report of a run.

Matplotlib lays out axes, ticks and contours; what it draws is then made a part of the page: its
colours become the style sheet's variables, so that one picture serves light and dark, and its
texts stay text. Legends are left to the page, where they cannot cover a curve. The bytes depend on
the numbers only: no date, no random identifiers.
"""

from __future__ import annotations

import io
import re
from functools import cache
from typing import Any

from tools.studies.study import Band, Cells, Curve, Mark, Panel, Result, Surface

SIZE_IN = (5.2, 3.35)
COMPACT_IN = (3.9, 2.75)
"""Sizes for two pictures in a row and for three: their letters are then equally large."""

_LABEL_PAD_PT = 9.0
"""Between ticks and the label of the y axis: on narrow screens letters are a fifth larger."""
_NEAR = (0.35, 0.12)
"""Shares of the axes' width and height within which labels of two marks would meet."""

COLOURS = ("c1", "c2", "c3", "c4", "c5", "c6")
"""Classes of the style sheet in the order in which curves take them."""

_INK = {
    "c1": "#1f6db0",
    "c2": "#cf5f14",
    "c3": "#12876a",
    "c4": "#a8518a",
    "c5": "#3e9bd0",
    "c6": "#a67c00",
    "soft": "#5d6975",
    "faint": "#8b95a0",
    "truth": "#9aa3ac",
    "grid": "#ecebe6",
    "ink": "#1b2530",
    "card": "#fffffd",
}
_RC: dict[str, Any] = {
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.unicode_minus": True,
    "axes.edgecolor": _INK["truth"],
    "axes.labelcolor": _INK["soft"],
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": _INK["grid"],
    "grid.linewidth": 0.8,
    "xtick.color": _INK["truth"],
    "ytick.color": _INK["truth"],
    "xtick.labelcolor": _INK["soft"],
    "ytick.labelcolor": _INK["soft"],
    "text.color": _INK["soft"],
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "lines.solid_capstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
}


def draw_all(name: str, result: Result) -> tuple[str, ...]:
    """A picture of every panel of a study's figures, in order."""
    panels = [panel for figure in result.figures for panel in figure.panels]
    compact = len(panels) > 2
    return tuple(
        draw(panel, f"{name}/{index}", compact=compact) for index, panel in enumerate(panels)
    )


def draw(panel: Panel | Surface, salt: str, *, compact: bool = False) -> str:
    """One panel as an `<svg>` element; `salt` tells its identifiers from other panels'."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    text = io.StringIO()
    settings: Any = {**_RC, "svg.hashsalt": salt}
    with mpl.rc_context(settings):
        figure = Figure(figsize=COMPACT_IN if compact else SIZE_IN, layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.add_subplot()
        if isinstance(panel, Surface):
            _surface(figure, axes, panel)
        else:
            _panel(axes, panel)
        axes.set_xlabel(panel.x_label)
        axes.set_ylabel(panel.y_label, labelpad=_LABEL_PAD_PT)
        blank = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", metadata=blank)
    return _dress(text.getvalue(), panel.title or panel.y_label)


def _panel(axes: Any, panel: Panel) -> None:
    for band in panel.bands:
        _band(axes, band)
    for ribbon in panel.ribbons:
        axes.fill_between(
            ribbon.x, ribbon.low, ribbon.high, color=_INK["truth"], alpha=0.25, linewidth=0
        )
    for index, curve in enumerate(panel.curves):
        _curve(axes, curve, _INK[COLOURS[index % len(COLOURS)]])
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    axes.margins(x=0.03, y=0.2 if panel.equal and panel.marks else 0.08)
    axes.xaxis.set_major_locator(_ticks(8))
    axes.yaxis.set_major_locator(_ticks(7))
    if not panel.equal:
        _room(axes, panel)
    for mark in panel.marks:
        _mark(axes, mark, panel)


def _ticks(most: int) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=most, steps=[1, 2, 5, 10])


def _room(axes: Any, panel: Panel) -> None:
    """Make the axes wide enough for what is published; begin at zero where that is near."""
    low, high = axes.get_ylim()
    published = [mark.y for mark in panel.marks]
    published += [value for band in panel.bands for value in (band.low, band.high)]
    for value in published:
        low, high = min(low, value), max(high, value)
    if panel.marks:
        span = high - low
        low, high = low - 0.04 * span, high + 0.1 * span
    if 0 < low < 0.35 * high:
        low = 0.0
    axes.set_ylim(*(panel.y_range or (low, high)))
    left, right = axes.get_xlim()
    span = right - left
    for mark in panel.marks:
        left, right = min(left, mark.x - 0.04 * span), max(right, mark.x + 0.04 * span)
    axes.set_xlim(left, right)


def _curve(axes: Any, curve: Curve, colour: str) -> None:
    if curve.error is not None:
        axes.errorbar(
            curve.x, curve.y, curve.error, fmt="none", ecolor=colour, elinewidth=1.2, capsize=2.5
        )
    if curve.style == "marks":
        axes.plot(curve.x, curve.y, "o", color=colour, markersize=4.2, markeredgewidth=0)
    else:
        dashes = {"line": "-", "dashed": "--", "dotted": ":"}
        axes.plot(curve.x, curve.y, dashes[curve.style], color=colour, linewidth=1.7)


def _band(axes: Any, band: Band) -> None:
    axes.axhspan(band.low, band.high, color=_INK["truth"], alpha=0.18, linewidth=0)
    axes.annotate(
        band.label,
        (0.985, band.low),
        xycoords=("axes fraction", "data"),
        xytext=(0, -3),  # below the band: a curve and marks lie in it
        textcoords="offset points",
        ha="right",
        va="top",
        color=_INK["soft"],
        fontsize=8.5,
    )


def _mark(axes: Any, mark: Mark, panel: Panel) -> None:
    axes.plot(
        [mark.x],
        [mark.y],
        "D",
        markersize=6,
        markerfacecolor=_INK["card"],
        markeredgecolor=_INK["ink"],
        markeredgewidth=1.3,
        zorder=5,
    )
    across, up = _side(axes, mark, panel.curves)
    up = _beside(axes, mark, panel.marks) or up
    axes.annotate(
        mark.label,
        (mark.x, mark.y),
        xytext=(8 * across, 5 * up),
        textcoords="offset points",
        ha="left" if across > 0 else "right",
        va="bottom" if up > 0 else "top",
        color=_INK["ink"],
        fontsize=8.5,
        zorder=6,
    )


def _side(axes: Any, mark: Mark, curves: tuple[Curve, ...]) -> tuple[int, int]:
    """Where a mark's label goes, right or left and up or down: off the curve, inside the axes."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    place = (mark.x - left) / (right - left)
    top = mark.y > low + 0.93 * (high - low)
    slope = max((_slope(curve, mark) for curve in curves), key=abs, default=0.0)
    steep = slope * (right - left) / (high - low)
    if steep > 0.2:  # rising: upper left or lower right are free
        return (1, -1) if place < 0.3 or top else (-1, 1)
    if steep < -0.2:  # falling: upper right or lower left
        return (-1, -1) if place > 0.7 or top else (1, 1)
    return (-1 if place > 0.6 else 1, -1 if top else 1)


def _beside(axes: Any, mark: Mark, marks: tuple[Mark, ...]) -> int:
    """Up for the upper of two marks that stand close, down for the lower; 0 where none is near."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    near = [
        other.y - mark.y
        for other in marks
        if other is not mark
        and abs(other.x - mark.x) < _NEAR[0] * (right - left)
        and abs(other.y - mark.y) < _NEAR[1] * (high - low)
    ]
    if not near or min(near) < 0.0 < max(near):
        return 0
    return -1 if max(near) > 0.0 else 1


def _slope(curve: Curve, mark: Mark) -> float:
    """Slope of a curve about a mark that it passes; 0 where it is elsewhere."""
    x, y = curve.x, curve.y
    if curve.style == "marks" or x.size < 2 or not (x[1:] > x[:-1]).all():
        return 0.0
    i = int(min(max((x < mark.x).sum(), 1), x.size - 1))
    span = float(y.max() - y.min())
    nearest = min(abs(float(y[i]) - mark.y), abs(float(y[i - 1]) - mark.y))
    if span == 0.0 or nearest > 0.25 * span:
        return 0.0
    return float((y[i] - y[i - 1]) / (x[i] - x[i - 1]))


def _surface(figure: Any, axes: Any, panel: Surface) -> None:
    axes.grid(visible=False)
    if isinstance(panel, Cells):
        drawn = _cells(axes, panel)
    else:
        drawn = axes.contourf(panel.x, panel.y, panel.z, levels=14, cmap="viridis")
    bar = figure.colorbar(drawn, ax=axes, pad=0.02)
    bar.set_label(panel.z_label, labelpad=_LABEL_PAD_PT)
    bar.outline.set_visible(False)


def _cells(axes: Any, panel: Cells) -> Any:
    """Each value as a cell of its own: an image of as many pixels, not hundreds of paths."""
    axes.xaxis.set_major_locator(_ticks(8))
    axes.yaxis.set_major_locator(_ticks(8))
    half_x, half_y = (0.5 * float(at[1] - at[0]) for at in (panel.x, panel.y))
    return axes.imshow(
        panel.z,
        cmap="viridis",
        vmin=panel.z_range[0],
        vmax=panel.z_range[1],
        origin="lower",
        interpolation="none",
        extent=(
            panel.x[0] - half_x,
            panel.x[-1] + half_x,
            panel.y[0] - half_y,
            panel.y[-1] + half_y,
        ),
    )


@cache
def _variables() -> dict[str, str]:
    return {code: f"var(--{name})" for name, code in _INK.items()}


def _dress(text: str, title: str) -> str:
    """Cut the SVG out of its file and hand its colours, fonts and size to the page."""
    from html import escape

    svg = text[text.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style.*?</style>", "", svg, flags=re.DOTALL)  # would rule the whole page
    view = re.search(r'viewBox="([^"]+)"', svg)
    assert view is not None
    body = svg[svg.index(">") + 1 :]
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))
    body = re.sub(r' id="([^"]+)"', lambda found: found[0] if found[1] in used else "", body)
    body = body.replace("xlink:href", "href")
    for code, variable in _variables().items():
        body = body.replace(code, variable)
    body = re.sub(
        r"font(?:-size)?: ([0-9.]+)px[^;\"]*(?:; font-family: [^;\"]*)?", r"font-size: \1px", body
    )
    body = re.sub(r"\n\s*", "\n", body)
    name = escape(title, quote=True)
    return (
        f'<svg class="chart plot" viewBox="{view[1]}" role="img" aria-label="{name}">{body}'.strip()
    )
