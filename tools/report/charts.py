"""Charts as inline SVG: axes, lines, points, spans, and nothing that a page would have to load.

Colours are classes (`c1` … `c6`, `truth`, `muted`) whose values the style sheet sets for light and
dark, so one picture serves both. Lines carry their label and their scale, from which the page's
small script reads values under the pointer; without scripts the picture is complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from tools.records.data import FloatArray
from tools.report.scale import Scale, decimate, nice_step, tick_text, ticks

LEFT, RIGHT, TOP, BOTTOM = 52.0, 18.0, 12.0, 34.0


def xy(value: float) -> str:
    """A coordinate with a tenth of a pixel, as short as it can be written."""
    text = f"{value:.1f}"
    return text.removesuffix(".0")


@dataclass(slots=True)
class Chart:
    """One set of axes. Draw onto it in order from back to front, then `svg()`."""

    width: float
    height: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_label: str = "time, s"
    y_label: str = ""
    title: str = ""
    """What the picture shows, for readers who cannot see it."""
    x_ticks: int = 0
    y_ticks: int = 0
    left: float = LEFT
    bottom: float = BOTTOM
    y_unit: str = ""
    step: float = 0.0
    """Distance of ticks on both axes; 0 leaves it to each axis."""
    _items: list[str] = field(default_factory=list)

    @property
    def x(self) -> Scale:
        """Horizontal scale."""
        return Scale(*self.x_range, self.left, self.width - RIGHT)

    @property
    def y(self) -> Scale:
        """Vertical scale; pixels grow downwards."""
        return Scale(*self.y_range, self.height - self.bottom, TOP)

    def line(
        self,
        x: FloatArray,
        y: FloatArray,
        style: str,
        label: str = "",
        *,
        every: bool = False,
    ) -> None:
        """A line through samples; it breaks where a value is not finite.

        `every` keeps all samples, for lines that do not run along x (a path).
        """
        if x.size == 0:
            return
        for start, end in _finite_runs(y):
            px, py = x[start:end], y[start:end]
            if not every:
                px, py = decimate(px, py, int(self.width))
            points = _points(self.x.pixels(px), self.y.pixels(py))
            tag = f' data-label="{escape(label)}"' if label and not every else ""
            self._items.append(f'<path class="line {style}"{tag} d="M{points}"/>')

    def steps(self, x: FloatArray, y: FloatArray, style: str, label: str = "") -> None:
        """A line that holds each value until the next sample."""
        if x.size:
            held_x = np.repeat(x, 2)[1:]
            self.line(held_x, np.repeat(y, 2)[:-1], style, label)

    def points(self, x: FloatArray, y: FloatArray, style: str, radius: float = 1.6) -> None:
        """Dots, as one path of zero-length strokes with round ends: far smaller than circles."""
        inside = np.isfinite(x) & np.isfinite(y)
        px, py = self.x.pixels(x[inside]), self.y.pixels(y[inside])
        pairs = zip(px.tolist(), py.tolist(), strict=True)
        dots = "".join(f"M{xy(a)},{xy(b)}h0" for a, b in pairs)
        self._items.append(f'<path class="dots {style}" stroke-width="{2 * radius}" d="{dots}"/>')

    def span(self, start: float, end: float, style: str, hint: str = "") -> None:
        """A vertical band from one x to another."""
        a, b = self.x(start), self.x(end)
        self._items.append(
            f'<rect class="{style}" x="{xy(a)}" y="{xy(TOP)}" width="{xy(max(b - a, 0.8))}" '
            f'height="{xy(self.height - self.bottom - TOP)}">{_hint(hint)}</rect>'
        )

    def bar(self, box: tuple[float, float, float, float], style: str, hint: str = "") -> None:
        """A rectangle given in data coordinates as (x0, x1, y0, y1)."""
        x0, x1, y0, y1 = box
        left, top = self.x(x0), self.y(y1)
        width, height = max(self.x(x1) - left, 0.8), max(self.y(y0) - top, 0.0)
        self._items.append(
            f'<rect class="{style}" x="{xy(left)}" y="{xy(top)}" width="{xy(width)}" '
            f'height="{xy(height)}">{_hint(hint)}</rect>'
        )

    def rule(self, value: float, style: str = "zero") -> None:
        """A horizontal line at a value, where that is in range."""
        if not self.y_range[0] <= value <= self.y_range[1]:
            return
        y = xy(self.y(value))
        self._items.append(
            f'<path class="{style}" d="M{xy(self.left)},{y}H{xy(self.width - RIGHT)}"/>'
        )

    def rule_x(self, value: float, style: str, hint: str = "") -> None:
        """A vertical line at a value of x."""
        x = xy(self.x(value))
        self._items.append(
            f'<path class="{style}" d="M{x},{xy(TOP)}V{xy(self.height - self.bottom)}">'
            f"{_hint(hint)}</path>"
        )

    def text(self, x: float, y: float, words: str, style: str = "note", anchor: str = "") -> None:
        """Words at a place in pixels."""
        where = f' text-anchor="{anchor}"' if anchor else ""
        self._items.append(
            f'<text class="{style}" x="{xy(x)}" y="{xy(y)}"{where}>{escape(words)}</text>'
        )

    def raw(self, svg: str) -> None:
        """Any SVG, in pixels."""
        self._items.append(svg)

    def ticks_x(self) -> tuple[list[float], float]:
        """Ticks of the horizontal axis, and their distance."""
        return self._ticks(self.x_range, self.x_ticks or max(2, int(self.width / 95)))

    def ticks_y(self) -> tuple[list[float], float]:
        """Ticks of the vertical axis, and their distance."""
        return self._ticks(self.y_range, self.y_ticks or max(2, int(self.height / 46)))

    def _ticks(self, span: tuple[float, float], count: int) -> tuple[list[float], float]:
        step = self.step or nice_step(span[1] - span[0], count)
        return ticks(*span, step), step

    def svg(self) -> str:
        """The whole picture."""
        x_scale, y_scale = self.x, self.y
        data = (
            f'data-x="{x_scale.low:.9g} {x_scale.high:.9g} {x_scale.start:g} {x_scale.end:g}" '
            f'data-y="{y_scale.low:.9g} {y_scale.high:.9g} {y_scale.start:g} {y_scale.end:g}" '
            f'data-unit="{escape(self.y_unit)}"'
        )
        box = f'viewBox="0 0 {self.width:g} {self.height:g}"'
        words = escape(self.title or self.y_label)
        parts = [f'<svg class="chart" {box} role="img" aria-label="{words}" {data}>']
        floor = self.height - self.bottom
        grid = []
        values, step = self.ticks_y()
        for value in values:
            y = xy(y_scale(value))
            grid.append(f"M{xy(self.left)},{y}H{xy(self.width - RIGHT)}")
            parts.append(
                f'<text class="tick" x="{xy(self.left - 7)}" y="{y}" dy=".32em" '
                f'text-anchor="end">{tick_text(value, step)}</text>'
            )
        parts.insert(1, f'<path class="grid" d="{"".join(grid)}"/>')
        values, step = self.ticks_x()
        marks = []
        for value in values if self.bottom > 12 else ():
            x = xy(x_scale(value))
            marks.append(f"M{x},{xy(floor)}v4")
            parts.append(
                f'<text class="tick" x="{x}" y="{xy(floor + 16)}" text-anchor="middle">'
                f"{tick_text(value, step)}</text>"
            )
        axis = f"M{xy(self.left)},{xy(floor)}H{xy(self.width - RIGHT)}"
        parts.append(f'<path class="axis" d="{axis}{"".join(marks)}"/>')
        if self.x_label and self.bottom > 24:
            parts.append(
                f'<text class="label" x="{xy(self.width - RIGHT)}" y="{xy(self.height - 3)}" '
                f'text-anchor="end">{escape(self.x_label)}</text>'
            )
        parts += self._items
        parts.append("</svg>")
        return "".join(parts)


def legend(entries: Sequence[tuple[str, str]]) -> str:
    """Labels with their colours, above a chart, as HTML."""
    items = "".join(
        f'<span class="key"><i class="swatch {style}"></i>{escape(label)}</span>'
        for style, label in entries
    )
    return f'<div class="legend">{items}</div>'


def figure(
    head: str, chart: str, *, entries: Sequence[tuple[str, str]] = (), note: str = ""
) -> str:
    """A titled chart with its legend and a line of explanation."""
    foot = f"<figcaption>{escape(note)}</figcaption>" if note else ""
    keys = legend(entries) if entries else ""
    title = f"<h3>{escape(head)}</h3>" if head else ""
    top = f'<div class="head">{title}{keys}</div>' if title or keys else ""
    return f'<figure>{top}<div class="scroll">{chart}</div>{foot}</figure>'


def _hint(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""


def _points(px: FloatArray, py: FloatArray) -> str:
    return "L".join(f"{xy(a)},{xy(b)}" for a, b in zip(px.tolist(), py.tolist(), strict=True))


def _finite_runs(values: FloatArray) -> list[tuple[int, int]]:
    """Index ranges without gaps."""
    finite = np.isfinite(values)
    if finite.all():
        return [(0, values.size)]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], finite.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
