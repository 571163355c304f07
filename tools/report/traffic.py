"""Frames on the wires and in the air over time.

Each medium is seen twice: the whole run as a rate, a bar for each slice of time and each failure
over it at full height, because failures are what one looks for; and a short window in which every
frame has its true length and the colour of its kind. The window is where most went wrong.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from tools.records.data import RunData
from tools.report.charts import Chart, figure, xy
from tools.report.marks import label_events, shade
from tools.report.scale import nice_step, number

WIDE, LEFT = 1080.0, 140.0
LANE, CLOSE_LANE = 40.0, 30.0
SLICES = 110
"""About as many slices of a round length; a busy lane is drawn in them."""
SPI_BIT_S = 1 / 262_144
"""Bit time of the link's clock, SMCLK / 16: for the length of frames in the close view."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """One frame: when and how long, in which lane, of which kind, and what became of it."""

    time_s: float
    length_s: float
    lane: str
    kind: str
    outcome: str

    @property
    def failed(self) -> bool:
        """Whether it is drawn over the rest."""
        return self.outcome in OUTCOMES


@dataclass(frozen=True, slots=True)
class Medium:
    """What the two views of a medium need."""

    head: str
    lanes: tuple[tuple[str, str], ...]
    """Name and colour."""
    strokes: tuple[Stroke, ...]
    quiet_window_s: float
    """Length of the close view where nothing failed."""
    rough_window_s: float
    """Length of the close view around failures."""


SPI_LANES = ("processing board", "navigation board")
OUTCOMES = {
    "retransmission": ("c6", "sent again"),
    "duplicate": ("c4", "duplicate"),
    "crc-error": ("bad", "damaged"),
    "lost": ("bad", "not acknowledged"),
    "collided": ("bad", "collided"),
}
"""What can go wrong with a frame: colour and words."""
KIND_STYLES = ("c1", "c2", "c3", "c4", "c5", "c6")


def spi_figure(data: RunData) -> str:
    """Frames by direction."""
    strokes = tuple(
        Stroke(
            frame.time_s,
            frame.octets * 8 * SPI_BIT_S,
            SPI_LANES[0] if frame.from_master else SPI_LANES[1],
            frame.kind,
            frame.outcome,
        )
        for frame in data.spi_frames
    )
    lanes = ((SPI_LANES[0], "c1"), (SPI_LANES[1], "c3"))
    return _figures(Medium("Frames on the SPI wires", lanes, strokes, 0.6, 0.3), data)


def radio_figure(data: RunData) -> str:
    """Frames by sender; acknowledgements in a lane of their own."""
    lanes: list[tuple[str, str]] = []
    for place, sender in enumerate(sorted({frame.source for frame in data.radio_frames})):
        kinds = {frame.kind for frame in data.radio_frames if frame.source == sender}
        if kinds - {"ack"}:
            lanes.append((_sender(sender), ("c1", "c3", "c4", "c5")[place % 4]))
        if "ack" in kinds:
            lanes.append((f"{_sender(sender)}, ack", "truth"))
    strokes = tuple(
        Stroke(
            frame.time_s,
            frame.duration_s,
            _sender(frame.source) + (", ack" if frame.kind == "ack" else ""),
            frame.kind,
            frame.outcome,
        )
        for frame in data.radio_frames
    )
    return _figures(Medium("Frames in the air", tuple(lanes), strokes, 2.0, 0.25), data)


def _sender(source: str) -> str:
    return "base station" if source == "base" else source


def link_table(data: RunData) -> str:
    """What both ends of the link counted."""
    if not data.links:
        return ""
    heads = ("sent", "acknowledged", "sent again", "damaged", "duplicates dropped", "lost")
    cells = "".join(f'<th class="n">{head}</th>' for head in heads)
    rows = "".join(
        f"<tr><td>{escape(end.name)}</td>"
        + "".join(
            f'<td class="n{style}">{number(count)}</td>'
            for count, style in (
                (end.messages_sent, ""),
                (end.messages_acknowledged, ""),
                (end.retransmissions, ""),
                (end.damaged, ""),
                (end.duplicates, ""),
                (end.lost, " bad" if end.lost else ""),
            )
        )
        + "</tr>"
        for end in data.links
    )
    waiting = sum(end.messages_sent - end.messages_acknowledged for end in data.links)
    said = "Every message was acknowledged."
    if waiting:
        cause = "the end of the run" if not data.outages else "the cuts and the end of the run"
        said = f"{waiting} not acknowledged: on their way at {cause}."
    return (
        '<div class="panel scroll"><h3>Messages between the boards</h3>'
        f'<table class="dense"><tr><th>by the</th>{cells}</tr>{rows}</table>'
        f'<p class="foot">{said} '
        "Damaged frames and duplicates are counted where they arrive, "
        "the rest where it is sent.</p></div>"
    )


def commands_table(data: RunData) -> str:
    """Commands from the base station, each with its way there."""
    if not data.commands:
        return ""
    rows = []
    ends = [command.sent_s for command in data.commands[1:]] + [math.inf]
    for place, (command, end) in enumerate(zip(data.commands, ends, strict=True), start=1):
        frames = sum(
            frame.kind == "command" and command.sent_s <= frame.time_s < end
            for frame in data.radio_frames
        )
        after = "—"
        if command.answered_s is not None:
            after = f"{1e3 * (command.answered_s - command.sent_s):.0f} ms"
        style = "bad" if command.outcome.startswith("no answer") else ""
        rows.append(
            f'<tr><td class="n">{place}</td><td class="n">{command.sent_s:g} s</td>'
            f'<td>{escape(command.what)}</td><td class="n">{command.attempts}</td>'
            f'<td class="n">{frames}</td><td class="{style}">{escape(command.outcome)}</td>'
            f'<td class="n">{after}</td></tr>'
        )
    return (
        '<div class="panel scroll"><h3>Commands by radio</h3><table class="dense">'
        '<tr><th class="n">no.</th><th class="n">sent at</th><th>command</th>'
        '<th class="n">attempts</th><th class="n">frames</th><th>outcome</th>'
        f'<th class="n">answered after</th></tr>{"".join(rows)}</table>'
        '<p class="foot">An attempt is a message; the radio sends it in up to four frames until '
        "one is acknowledged.</p></div>"
    )


def log_sentence(data: RunData) -> str:
    """Whether the log kept what it reported as stored."""
    stored, found = data.metrics.get("samples_stored"), data.metrics.get("samples_recovered")
    if stored is None or found is None:
        return ""
    kept = "every one of them" if stored == found else f"{number(abs(found - stored))} differ"
    said = f"{number(stored)} records reported as stored, {number(found)} recovered: {kept}."
    boots = len(data.mounts)
    if boots > 1:
        said += f" The log was mounted {boots} times: empty at first, then "
        said += ", ".join(
            f"{number(mount.records)} records at {mount.time_s:.1f} s" for mount in data.mounts[1:]
        )
        said += "."
    style = "said" if stored == found else "said bad"
    return f'<div class="panel"><h3>Log on the flash</h3><p class="{style}">{said}</p></div>'


# --- the two views ------------------------------------------------------------------------------


def _figures(medium: Medium, data: RunData) -> str:
    if not medium.strokes:
        return figure(medium.head, '<p class="soft">none in this run</p>')
    found = Counter(stroke.outcome for stroke in medium.strokes)
    entries = [
        (f"{style} box", f"{words}: {number(found[key])}")
        for key, (style, words) in OUTCOMES.items()
        if found[key]
    ]
    rates = f"{number(len(medium.strokes))} frames; bars are frames a second, with the mean beside"
    note = rates + (", failures at full height." if entries else ".")
    return figure(medium.head, _overview(medium, data), entries=entries, note=note) + _close(
        medium, data
    )


def _overview(medium: Medium, data: RunData) -> str:
    span = (0.0, max(data.duration_s, 1e-9))
    chart = _lanes_chart(medium, span, LANE)
    shade(chart, data, "supply off")
    for place, (name, style) in enumerate(medium.lanes):
        floor = len(medium.lanes) - 1 - place
        mine = [stroke for stroke in medium.strokes if stroke.lane == name]
        chart.text(LEFT - 12, chart.y(floor + 0.5), name, "note", "end")
        chart.text(
            LEFT - 12, chart.y(floor + 0.5) + 13, f"{len(mine) / span[1]:.1f} /s", "label", "end"
        )
        _rate(chart, [stroke.time_s for stroke in mine if not stroke.failed], floor, style, span)
        _failures(chart, [stroke for stroke in mine if stroke.failed], floor)
    label_events(chart, data)
    return _svg(chart)


def _close(medium: Medium, data: RunData) -> str:
    begin, end = _window(medium)
    chart = _lanes_chart(medium, (begin, end), CLOSE_LANE)
    shade(chart, data)
    kinds = Counter(stroke.kind for stroke in medium.strokes)
    kinds.pop("damaged", None)
    free = iter(KIND_STYLES)
    styles = {
        kind: "truth" if kind == "ack" else next(free, "c6") for kind, _ in kinds.most_common()
    }
    for place, (name, _) in enumerate(medium.lanes):
        floor = len(medium.lanes) - 1 - place
        chart.text(LEFT - 12, chart.y(floor + 0.5) + 4, name, "note", "end")
        for stroke in medium.strokes:
            if stroke.lane != name or not begin <= stroke.time_s <= end:
                continue
            words = OUTCOMES[stroke.outcome][1] if stroke.failed else ""
            hint = f"{stroke.kind}{', ' + words if words else ''}, {stroke.time_s:.4f} s"
            bad = stroke.failed and OUTCOMES[stroke.outcome][0] == "bad"
            style = "bad" if bad else styles[stroke.kind]
            low, high = floor + 0.14, floor + (0.98 if stroke.failed else 0.74)
            last = min(stroke.time_s + stroke.length_s, end)
            chart.bar((stroke.time_s, last, low, high), style, hint)
    entries = [
        (f"{styles[kind]} box", f"{kind}: {number(count)}") for kind, count in kinds.most_common(9)
    ]
    length = 1e3 * (end - begin)
    note = f"{length:.0f} ms of it, every frame in its true length; counts are of the whole run."
    if any(stroke.failed for stroke in medium.strokes):
        note = f"Where most went wrong: {note} What failed or came again stands higher."
    return figure("A closer look", _svg(chart), entries=entries, note=note)


def _window(medium: Medium) -> tuple[float, float]:
    """The part for the close view: where most failed, else just before the end."""
    failed = np.array([stroke.time_s for stroke in medium.strokes if stroke.failed])
    end = max(stroke.time_s + stroke.length_s for stroke in medium.strokes)
    if not failed.size:
        return (max(0.0, end - medium.quiet_window_s), end + 0.01 * medium.quiet_window_s)
    length = medium.rough_window_s
    inside = np.searchsorted(failed, failed + 0.8 * length) - np.arange(failed.size)
    begin = max(0.0, float(failed[int(inside.argmax())]) - 0.08 * length)
    inside_s = [s.time_s + s.length_s for s in medium.strokes if begin <= s.time_s < begin + length]
    end = max(inside_s)
    return (begin, end + 0.04 * (end - begin))


def _lanes_chart(medium: Medium, span: tuple[float, float], lane: float) -> Chart:
    count = len(medium.lanes)
    height = 24 + lane * count + 34
    chart = Chart(WIDE, height, span, (0.0, float(count)), left=LEFT, y_ticks=1)
    chart.title = f"{medium.head} over time"
    return chart


def _svg(chart: Chart) -> str:
    # Lanes have names, not values: their axis needs no numbers.
    place = f'class="tick" x="{xy(LEFT - 7)}"'
    return chart.svg().replace(place, f'display="none" {place}')


def _rate(
    chart: Chart, times: Sequence[float], floor: int, style: str, span: tuple[float, float]
) -> None:
    """Bars of a lane, as high as their slice of time is busy; few frames are strokes."""
    low, high = floor + 0.12, floor + 0.82
    if len(times) <= SLICES:
        d = "".join(
            f"M{xy(chart.x(time))},{xy(chart.y(low))}V{xy(chart.y(high))}" for time in times
        )
        chart.raw(f'<path class="line thin {style}" d="{d}"/>')
        return
    width = nice_step(span[1] - span[0], SLICES)
    slices = math.ceil((span[1] - span[0]) / width - 1e-9)
    counts, edges = np.histogram(np.array(times), bins=slices, range=(0.0, slices * width))
    top = max(1, int(counts.max()))
    bars = []
    for count, start, end in zip(
        counts.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True
    ):
        if count:
            a, b = chart.x(start), chart.x(min(end, span[1]))
            y0, y1 = chart.y(low), chart.y(low + (high - low) * count / top)
            bars.append(f"M{xy(a + 0.4)},{xy(y0)}V{xy(y1)}H{xy(b - 0.4)}V{xy(y0)}Z")
    chart.raw(f'<path class="{style} filled calm" d="{"".join(bars)}"/>')


def _failures(chart: Chart, failed: Sequence[Stroke], floor: int) -> None:
    """Every failure of a lane, the worst on top."""
    foot, head = xy(chart.y(floor + 0.04)), xy(chart.y(floor + 0.92))
    for style in ("c6", "c4", "bad"):
        d = "".join(
            f"M{xy(chart.x(stroke.time_s))},{foot}V{head}"
            for stroke in failed
            if OUTCOMES[stroke.outcome][0] == style
        )
        if d:
            chart.raw(f'<path class="line {style}" d="{d}"/>')
