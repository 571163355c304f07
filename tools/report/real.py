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
    return f'<div class="panel"><table>{rows}</table></div>{_exceedances(data)}'


def _exceedances(data: RunData) -> str:
    """How many events, round trips and acknowledgements took longer than what."""
    kinds = [
        (name, data.hil[key])
        for name, key in (
            ("events begun later than", "lateness"),
            ("round trips longer than", "round_trip"),
            ("acknowledged after more than", "acknowledged"),
            ("samples at the board older than", "sample_age"),
        )
        if data.hil.get(key, {}).get("count")
    ]
    if not kinds:
        return ""
    limits_s = [limit_s for limit_s, _ in kinds[0][1]["above"]]
    head = "".join(f"<th>{1e3 * limit_s:g} ms</th>" for limit_s in limits_s)
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{found['count']}</td>"
        + "".join(f"<td>{_share(count, found['count'])}</td>" for _, count in found["above"])
        + "</tr>"
        for name, found in kinds
    )
    return f'<div class="panel"><table><tr><th></th><th>of</th>{head}</tr>{rows}</table></div>'


def _share(count: int, total: int) -> str:
    """A count as a share of all; what is little and not nothing stays visible."""
    share = 100.0 * count / total
    return "0" if not count else f"{share:.2f} %" if share >= 0.01 else f"{count} ×"


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
