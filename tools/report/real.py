"""The part of the report on a real board: how punctual, how quick, and what it reported."""

from __future__ import annotations

from html import escape

import numpy as np

from tools.records.data import RunData
from tools.report.charts import Chart, figure
from tools.report.scale import limits

WIDE = 1090.0
SHOWN = (
    ("tail_command_rad", "Tail command, degrees", 180.0 / np.pi, "°"),
    ("gyro_z_rad_s", "Yaw rate, degrees per second", 180.0 / np.pi, "°/s"),
    ("compass_rad", "Compass, degrees", 180.0 / np.pi, "°"),
    ("battery_v", "Battery, volts", 1.0, "V"),
    ("servo_current_a", "Servo current, amperes", 1.0, "A"),
    ("temperature_c", "Water, °C", 1.0, "°C"),
)
"""Channel, heading, factor to the unit that is shown, unit."""


def real_head(data: RunData) -> str:
    """Who took part: a real board, or others from outside."""
    return "The real board" if "real" in data.hil else "From outside"


def real_table(data: RunData) -> str:
    """Lateness, round trip, clock and outages as a table; empty where all was emulated."""
    if not data.hil:
        return ""
    from tools.hil import words

    rows = "".join(
        f"<tr><th>{escape(line[2:16].strip())}</th><td>{escape(line[16:])}</td></tr>"
        for line in words(data.hil)
    )
    return f'<div class="panel"><table>{rows}</table></div>'


def report_figures(data: RunData) -> str:
    """What the real board reported over time."""
    span = (0.0, max(data.duration_s, 1e-3))
    parts = []
    for name, head, scale, unit in SHOWN:
        series = data.channels.get(name)
        if series is None:
            continue
        value = series.value * scale
        chart = Chart(WIDE, 170, span, limits(value, least=1e-3), y_label=unit)
        chart.y_unit, chart.title = unit, head
        chart.line(series.time_s, value, "c1", "reported")
        parts.append(figure(head, chart.svg(), entries=[("c1 dot", "reported")]))
    return f'<div class="rows wide">{"".join(parts)}</div>'
