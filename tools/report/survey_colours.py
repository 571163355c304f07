"""Colours on a survey's maps, the same on light and dark pages.

Values of the field have the scale *viridis* (S. van der Walt and N. Smith, 2015; in matplotlib,
CC0): its lightness grows evenly, so it says the same to those who tell no colours apart, and in
grey. Errors have a scale of their own, one hue from the page's ground upwards, so that nobody takes
an error for a value. Robots have the page's six colours in turn, and always their number with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Protocol

from tools.report.charts import xy
from tools.report.scale import nice_step, tick_text, ticks

_VIRIDIS = (
    "440154470d6048186a482374472d7b4537814240863e49893b528b375b8d33638d2f6b8e2c728e297a8e26828e"
    "23898e21918c1f988b1fa08822a78528ae8032b67a3fbc734ec36b5ec96270cf5784d44b98d83eaddc30c2df23"
    "d8e219ece51bfde725"
)
VIRIDIS = tuple(_VIRIDIS[place : place + 6] for place in range(0, len(_VIRIDIS), 6))
"""At 0, 1/32 … 1 of the scale."""
BRIGHT = 14
"""From this colour on black marks stand out more than white ones: its luminance is above 0.18,
where the contrasts to both are equal (WCAG 2.2, contrast ratio)."""
ROBOTS = ("c1", "c2", "c3", "c4", "c5", "c6")
STEPS = 24
"""Strengths of the one hue of errors."""
FAINT, STRONG = 0.08, 0.5
"""Opacities under numbers: so that ink on the strongest still has a contrast of 4.5."""
BAR = 12.0


def robot_styles(addresses: tuple[int, ...]) -> dict[int, str]:
    """Colours of robots by address, in turn."""
    return {address: ROBOTS[place % len(ROBOTS)] for place, address in enumerate(addresses)}


class Paint(Protocol):
    """How a cell with a value is filled, and how a mark upon it is to be seen."""

    def fill(self, value: float) -> str:
        """Attributes of the cell's shape."""
        ...

    def mark(self, value: float) -> str:
        """Style of a mark."""
        ...


@dataclass(frozen=True, slots=True)
class Values:
    """Values of the field from ``low`` to ``high``."""

    low: float
    high: float

    def index(self, value: float) -> int:
        """Which of `VIRIDIS`."""
        part = (value - self.low) / (self.high - self.low)
        return round(min(max(part, 0.0), 1.0) * (len(VIRIDIS) - 1))

    def fill(self, value: float) -> str:
        """See `Paint`."""
        return f'fill="#{VIRIDIS[self.index(value)]}"'

    def mark(self, value: float) -> str:
        """See `Paint`."""
        return "onbright" if self.index(value) >= BRIGHT else "ondark"


@dataclass(frozen=True, slots=True)
class Strength:
    """One hue, stronger with the value, from nothing at ``low``."""

    low: float
    high: float
    style: str = "c2"
    faint: float = 0.0
    strong: float = 1.0

    def fill(self, value: float) -> str:
        """See `Paint`."""
        part = min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)
        opacity = self.faint + (self.strong - self.faint) * round(part * STEPS) / STEPS
        return f'class="{self.style} filled" fill-opacity="{opacity:.3g}"'

    def mark(self, value: float) -> str:
        """See `Paint`."""
        return "onpage"


@dataclass(frozen=True, slots=True)
class Whose:
    """The robots' colours, by address."""

    styles: Mapping[int, str]

    def fill(self, value: float) -> str:
        """See `Paint`."""
        style = self.styles.get(round(value), "truth")
        return f'class="{style} filled" fill-opacity="{0.8 * STRONG:g}"'

    def mark(self, value: float) -> str:
        """See `Paint`."""
        return "onpage"


def bar(paint: Values | Strength, left: float, top: float, high: float, unit: str) -> str:
    """A scale beside a map, with ticks and the unit."""
    low, count = paint.low, len(VIRIDIS)
    span = paint.high - low
    parts = ['<g shape-rendering="crispEdges">']
    for place in range(count):
        fill = paint.fill(low + place / (count - 1) * span)
        y = top + high * (count - 1 - place) / count
        parts.append(
            f'<rect {fill} x="{xy(left)}" y="{xy(y)}" width="{BAR:g}" height="{xy(high / count)}"/>'
        )
    parts.append("</g>")
    step = nice_step(span, 5)
    for value in ticks(low, paint.high, step):
        y = top + high * (1.0 - (value - low) / span)
        parts.append(
            f'<text class="tick" x="{xy(left + BAR + 5)}" y="{xy(y)}" dy=".32em">'
            f"{tick_text(value, step)}</text>"
        )
    parts.append(
        f'<text class="label" x="{xy(left + BAR)}" y="{xy(top - 8)}" text-anchor="end">'
        f"{escape(unit)}</text>"
    )
    return "".join(parts)
