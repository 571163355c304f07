"""The confusability map: how alike the causes are to these data, as squares."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from tools.diagnosis.model import FloatArray

CELL, LEFT, TOP = 17.0, 150.0, 132.0
ALIKE = 0.9


def confusability_map(names: Sequence[str], cosines: FloatArray, alike: float = ALIKE) -> str:
    """Return the map as inline SVG: the darker, the harder to tell apart; framed from ``alike``."""
    count = len(names)
    if count < 2:
        return ""
    width, height = LEFT + CELL * count + 8.0, TOP + CELL * count + 8.0
    head = f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img" '
    size = f'style="max-width:{1.25 * width:.0f}px" aria-label="How alike the causes are">'
    parts = [head + size]
    for i, name in enumerate(names):
        y, x = TOP + CELL * (i + 0.72), LEFT + CELL * (i + 0.68)
        parts.append(f'<text x="{LEFT - 6:g}" y="{y:g}" text-anchor="end">{escape(name)}</text>')
        parts.append(
            f'<text transform="translate({x:g} {TOP - 6:g}) rotate(-60)">{escape(name)}</text>'
        )
    for i in range(count):
        parts += [_cell(names, cosines, i, k, alike) for k in range(count)]
    return "".join(parts) + "</svg>"


def _cell(names: Sequence[str], cosines: FloatArray, i: int, k: int, alike: float) -> str:
    value = 1.0 if i == k else float(cosines[i, k])
    x, y = LEFT + CELL * k, TOP + CELL * i
    frame = ' class="alike"' if i != k and value >= alike else ""
    colour = "var(--truth)" if i == k else "var(--c1)"
    said = f"{names[i]} and {names[k]}: {value:.2f}" if i != k else names[i]
    return (
        f'<rect x="{x + 0.5:g}" y="{y + 0.5:g}" width="{CELL - 1:g}" height="{CELL - 1:g}"{frame} '
        f'style="fill:{colour};fill-opacity:{value * value:.3f}"><title>{escape(said)}</title>'
        "</rect>"
    )
