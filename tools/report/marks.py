"""What all charts over time share: times without supply as bands, and labelled events as rules."""

from __future__ import annotations

from tools.records.data import RunData
from tools.records.metrics import last_motion
from tools.report.charts import Chart

ROOM = 62.0
"""Pixels that a label takes: one that stands nearer to the one before is left out."""


def shade(chart: Chart, data: RunData, words: str = "") -> None:
    """Bands where the robot had no supply; draw them first, so that curves stand over them."""
    for begin, end in data.outages:
        low, high = max(begin, chart.x_range[0]), min(end, chart.x_range[1])
        if low < high:
            chart.span(low, high, "outage", f"no supply from {begin:.2f} s to {end:.2f} s")
            if words:
                chart.text(chart.x(low) - 4, 9, words, "note bad", "end")


def label_events(chart: Chart, data: RunData) -> None:
    """A dotted rule and a word at each event that has one."""
    free = 0.0
    for event in data.events:
        if not event.label or not chart.x_range[0] <= event.time_s <= chart.x_range[1]:
            continue
        x = chart.x(event.time_s)
        chart.rule_x(event.time_s, "moment", event.what)
        if x >= free:
            chart.text(x + 4, 9, event.label)
            free = x + ROOM


def last_motion_s(data: RunData) -> float:
    """The last time at which the tail moved: where a close look at the beat should end."""
    time = data.truth["time_s"]
    return float(time[last_motion(data.truth["tail_rate_rad_s"])]) if time.size else 0.0
