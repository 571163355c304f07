"""Frames on the wires and in the air over time.

Each lane is a sender. Where there are few frames every one is a stroke; where there are many, a
stroke stands for a slice of time and is as high as the slice is busy. Failures are drawn over it,
each one, at full height: they are what one looks for.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tools.records.data import RunData
from tools.report.charts import Chart, figure, xy
from tools.report.scale import nice_step

WIDE = 1080.0
LANE = 40.0
SLICES = 110
"""About as many slices of a round length; a busy lane is drawn in them."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """One frame: when, in which lane, in which colour, and whether it failed."""

    time_s: float
    lane: str
    style: str
    failed: bool


SPI_LANES = ("processing board", "navigation board")
GOOD = ("ok", "received")
OUTCOME_STYLES = {
    "retransmission": "c6",
    "duplicate": "c4",
    "crc-error": "bad",
    "lost": "bad",
    "collided": "bad",
}
OUTCOME_WORDS = {
    "retransmission": "sent again",
    "duplicate": "duplicate",
    "crc-error": "damaged",
    "lost": "lost",
    "collided": "collided",
}


def spi_figure(data: RunData) -> str:
    """Frames by direction."""
    strokes = [
        Stroke(
            frame.time_s,
            SPI_LANES[0] if frame.from_master else SPI_LANES[1],
            OUTCOME_STYLES.get(frame.outcome, "c1" if frame.from_master else "c3"),
            frame.outcome not in GOOD,
        )
        for frame in data.spi_frames
    ]
    found = Counter(frame.outcome for frame in data.spi_frames)
    lanes = [(SPI_LANES[0], "c1"), (SPI_LANES[1], "c3")]
    kinds = Counter(frame.kind for frame in data.spi_frames)
    return _figure("Frames on the SPI wires", data, strokes, lanes, found, kinds)


def radio_figure(data: RunData) -> str:
    """Frames by sender; acknowledgements in a lane of their own."""
    senders = list(dict.fromkeys(frame.source for frame in data.radio_frames))
    colours = ("c1", "c3", "c4", "c5")
    lanes: list[tuple[str, str]] = []
    for number, sender in enumerate(sorted(senders)):
        if any(f.source == sender and f.kind != "ack" for f in data.radio_frames):
            lanes.append((sender, colours[number % len(colours)]))
        if any(f.source == sender and f.kind == "ack" for f in data.radio_frames):
            lanes.append((f"{sender}, ack", "truth"))
    styles = dict(lanes)
    strokes = []
    for frame in data.radio_frames:
        lane = f"{frame.source}, ack" if frame.kind == "ack" else frame.source
        style = OUTCOME_STYLES.get(frame.outcome, styles[lane])
        strokes.append(Stroke(frame.time_s, lane, style, frame.outcome not in GOOD))
    found = Counter(frame.outcome for frame in data.radio_frames)
    kinds = Counter(frame.kind for frame in data.radio_frames)
    return _figure("Frames in the air", data, strokes, lanes, found, kinds)


def _figure(
    head: str,
    data: RunData,
    strokes: Sequence[Stroke],
    lanes: Sequence[tuple[str, str]],
    found: Counter[str],
    kinds: Counter[str],
) -> str:
    if not strokes:
        return figure(head, '<p class="soft">none in this run</p>')
    height = 24 + LANE * len(lanes) + 34
    span = (0.0, max(data.duration_s, 1e-9))
    chart = Chart(WIDE, height, span, (0.0, float(len(lanes))), left=124.0, y_ticks=1)
    chart.title = f"{head} over time"
    for event in data.events:
        if event.severity == "fault":
            chart.span(event.time_s, event.time_s, "outage", event.what)
    for place, (name, style) in enumerate(lanes):
        floor = len(lanes) - 1 - place
        chart.text(112, chart.y(floor + 0.42), name, "note", "end")
        mine = [stroke for stroke in strokes if stroke.lane == name]
        _lane(chart, mine, floor, style, span)
    svg = chart.svg()
    # Lanes have names, not values: their axis needs no numbers.
    svg = svg.replace('class="tick" x="117"', 'class="tick" display="none" x="117"')
    entries = [(f"{style} box", name) for name, style in lanes]
    entries += [
        (f"{OUTCOME_STYLES[key]} box", f"{OUTCOME_WORDS[key]}: {found[key]}")
        for key in OUTCOME_STYLES
        if found[key]
    ]
    listed = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(8))
    note = f"{sum(found.values())} frames: {listed}."
    return figure(head, svg, entries=entries, note=note)


def _lane(
    chart: Chart, strokes: Sequence[Stroke], floor: int, style: str, span: tuple[float, float]
) -> None:
    low, high = floor + 0.12, floor + 0.82
    good = [stroke.time_s for stroke in strokes if not stroke.failed]
    if len(good) <= 2 * SLICES:
        d = "".join(f"M{xy(chart.x(time))},{xy(chart.y(low))}V{xy(chart.y(high))}" for time in good)
        chart.raw(f'<path class="line thin {style}" d="{d}"/>')
    else:
        width = nice_step(span[1] - span[0], SLICES)
        number = math.ceil((span[1] - span[0]) / width - 1e-9)
        counts, edges = np.histogram(np.array(good), bins=number, range=(0.0, number * width))
        top = max(1, int(counts.max()))
        bars = []
        for count, start, end in zip(
            counts.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True
        ):
            if count:
                a, b = chart.x(start), chart.x(min(end, span[1]))
                y0, y1 = chart.y(low), chart.y(low + (high - low) * count / top)
                bars.append(f"M{xy(a + 0.4)},{xy(y0)}V{xy(y1)}H{xy(b - 0.4)}V{xy(y0)}Z")
        shape = "".join(bars)
        chart.raw(f'<path class="{style} filled" d="{shape}"/>')
    for failed_style in dict.fromkeys(stroke.style for stroke in strokes if stroke.failed):
        foot, head = xy(chart.y(floor + 0.04)), xy(chart.y(floor + 0.92))
        d = "".join(
            f"M{xy(chart.x(stroke.time_s))},{foot}V{head}"
            for stroke in strokes
            if stroke.failed and stroke.style == failed_style
        )
        chart.raw(f'<path class="line {failed_style}" d="{d}"/>')
