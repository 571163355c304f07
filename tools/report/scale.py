"""Axes: round ticks, numbers as people write them, and long series made short without lies.

Decimation keeps the least and the greatest value of every pixel column, in the order in which they
came, so that a spike of one sample is still seen and an oscillation keeps its envelope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tools.records.data import FloatArray

MINUS = "−"  # a true minus sign lines up with digits, a hyphen does not


def nice_step(span: float, count: int) -> float:
    """The step 1, 2 or 5 · 10^n that divides `span` into about `count` parts."""
    raw = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    for factor in (1.0, 2.0, 5.0, 10.0):
        if raw <= factor * power * (1 + 1e-9):
            return factor * power
    return 10.0 * power


def ticks(low: float, high: float, step: float) -> list[float]:
    """The multiples of `step` within [low, high]."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def tick_text(value: float, step: float) -> str:
    """A tick's label with just the digits that its step needs."""
    digits = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0 else 0
    if abs(value) < step * 1e-6:
        value = 0.0
    if abs(value) >= 1e6 or digits > 5:
        return f"{value:.3g}".replace("-", MINUS)
    return f"{value:.{digits}f}".replace("-", MINUS)


def number(value: float | None, digits: int = 3) -> str:
    """A value for a table: `digits` significant figures, thousands apart, an em dash for none."""
    if value is None or not math.isfinite(value):
        return "—"
    if value == 0:
        return "0"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f").replace("-", MINUS)
    whole = math.floor(math.log10(abs(value))) + 1
    if whole > 6 or whole < -3:
        return f"{value:.{digits - 1}e}".replace("-", MINUS)
    text = f"{value:,.{max(0, digits - whole)}f}"
    return text.replace(",", "\u202f").replace("-", MINUS)


@dataclass(frozen=True, slots=True)
class Scale:
    """A linear axis from data [low, high] to pixels [start, end]."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """The pixel of a value."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def pixels(self, values: FloatArray) -> FloatArray:
        """The pixels of many values."""
        slope = (self.end - self.start) / (self.high - self.low)
        return np.asarray(self.start + (values - self.low) * slope, dtype=np.float64)


def limits(
    *series: FloatArray, margin: float = 0.06, least: float = 1e-9, zero: bool = False
) -> tuple[float, float]:
    """A range that holds all finite values with some air; `zero` makes it reach zero."""
    finite = [values[np.isfinite(values)] for values in series]
    kept = [values for values in finite if values.size]
    if not kept:
        return (0.0, 1.0)
    low = min(float(values.min()) for values in kept)
    high = max(float(values.max()) for values in kept)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
        if low == high:  # nothing but zeros: any range that begins there
            return (0.0, 1.0)
    span = max(high - low, least)
    middle, half = (low + high) / 2, span / 2
    bottom, top = middle - half - margin * span, middle + half + margin * span
    return (0.0 if zero and low == 0.0 else bottom, 0.0 if zero and high == 0.0 else top)


def decimate(x: FloatArray, y: FloatArray, columns: int) -> tuple[FloatArray, FloatArray]:
    """At most about four points a column: the first, least, greatest and last sample of each."""
    if x.size <= 4 * columns:
        return x, y
    edges = np.linspace(float(x[0]), float(x[-1]), columns + 1)
    starts = np.searchsorted(x, edges[:-1])
    keep: list[int] = []
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), x.size], strict=True):
        if end <= start:
            continue
        part = y[start:end]
        low, high = int(part.argmin()) + start, int(part.argmax()) + start
        keep.extend(sorted({start, low, high, end - 1}))
    index = np.array(keep)
    return x[index], y[index]
