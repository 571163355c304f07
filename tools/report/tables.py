"""Tiles, metrics, the comparison with the ideal plant, and the list of events."""

from __future__ import annotations

from html import escape

from tools.records.data import Comparison, RunData
from tools.records.metrics import unsettled
from tools.records.shoal_data import ShoalData
from tools.report.marks import last_motion_s
from tools.report.scale import number

WORDS: dict[str, tuple[str, float, str]] = {
    "speed_m_s": ("speed, net over the last ten beats", 100, "cm/s"),
    "turn_radius_m": ("turning radius", 100, "cm"),
    "turn_period_s": ("turning period", 1, "s"),
    "path_length_m": ("length of the path", 1, "m"),
    "energy_j": ("energy", 1, "J"),
    "spi_frames": ("frames on SPI", 1, ""),
    "spi_crc_errors": ("damaged frames on SPI", 1, ""),
    "spi_lost": ("lost messages on SPI", 1, ""),
    "radio_sent": ("messages sent by radio", 1, ""),
    "radio_received": ("messages received by radio", 1, ""),
    "samples_stored": ("samples stored on flash", 1, ""),
    "samples_lost": ("samples that were not stored", 1, ""),
    "samples_recovered": ("stored samples that the flash holds", 1, ""),
    "telemetry_received": ("telemetry messages at the base station", 1, ""),
    "arrival_s": ("arrival at the target", 1, "s"),
    "targets_reached": ("targets reached", 1, ""),
    "target_nearest_m": ("nearest distance to the target", 100, "cm"),
}
"""Metric → words, factor from SI to the shown unit, unit."""


def tiles(data: RunData) -> str:
    """The figures that one looks at first."""
    m = data.metrics
    arrival = m.get("arrival_s")
    rests = data.truth["time_s"].size and last_motion_s(data) < data.duration_s - 5
    spoken = f"tail at rest since {last_motion_s(data):.0f} s" if rests else "last ten beats"
    shown = []
    if "arrival_s" in m:
        nearest = m.get("target_nearest_m")
        said = f"nearest {number(None if nearest is None else 100 * nearest, 2)} cm"
        value = number(arrival) if arrival is not None else "not"
        shown.append(tile("arrived", value, "s" if arrival is not None else "", said))
    if "targets_reached" in m:
        last = data.targets[-1].reached_s if data.targets else None
        said = f"of {len(_targets_known(data))}" + (f", after {last:.0f} s" if last else "")
        shown.append(tile("targets reached", number(m["targets_reached"]), "", said))
    shown.append(tile("speed", _scaled(data, "speed_m_s"), "cm/s", spoken))
    if m.get("turn_radius_m") is not None:
        period = f"{number(m.get('turn_period_s'))} s a turn"
        moving = unsettled(data.truth, data.beat_frequency_hz)
        shown.append(tile("turning radius", _scaled(data, "turn_radius_m"), "cm", moving or period))
    shown.append(tile("path", _scaled(data, "path_length_m"), "m", f"in {data.duration_s:g} s"))
    energy = m.get("energy_j")
    power = f"{number(energy / data.duration_s)} W mean" if energy is not None else ""
    shown.append(tile("energy", number(energy), "J", power))
    shown.append(
        tile(
            "SPI frames",
            number(m.get("spi_frames")),
            "",
            *_bad(m.get("spi_crc_errors"), "damaged", m.get("spi_lost"), "lost"),
        )
    )
    sent, received = m.get("radio_sent"), m.get("radio_received")
    if sent is not None and received is not None:
        missed = sent - received
        more = (f"{number(missed)} not received", missed > 0) if missed else ("all received", False)
        if missed < 0:  # somebody who is not emulated sent, too
            more = f"{number(received)} received", False
        shown.append(tile("radio messages", number(sent), "", *more))
    stored, lost = m.get("samples_stored"), m.get("samples_lost")
    if stored is not None:
        found = m.get("samples_recovered")
        said, bad = _bad(lost, "lost", None, "")
        if found is not None and not bad:
            said, bad = f"{number(found)} recovered", found < stored
        shown.append(tile("records stored", number(stored), "", said, bad))
    return f'<div class="tiles">{"".join(shown)}</div>'


def _targets_known(data: RunData) -> tuple[object, ...]:
    """The targets of the list, or what was pursued where that is more."""
    return max(data.tank.targets_m, data.targets, key=len)


def tile(name: str, value: str, unit: str, more: str = "", bad: bool = False) -> str:
    """One of the figures that one looks at first."""
    small = f"<small>{unit}</small>" if unit and value != "—" else ""
    style = "more bad" if bad else "more"
    return (
        f'<div class="tile"><div class="name">{name}</div><div class="value">{value}{small}</div>'
        f'<div class="{style}">{escape(more)}</div></div>'
    )


def _scaled(data: RunData, key: str) -> str:
    value = data.metrics.get(key)
    return number(None if value is None else value * WORDS[key][1])


def _bad(first: float | None, word: str, second: float | None, other: str) -> tuple[str, bool]:
    """Words for two counts of failures, and whether there are any."""
    found = [f"{count} {what}" for count, what in ((first, word), (second, other)) if count]
    return (", ".join(found) or f"none {word}", bool(found))


def metrics_table(data: RunData) -> str:
    """All metrics, with the name that each has in summary.json."""
    rows = []
    for key, value in data.metrics.items():
        words, factor, unit = WORDS.get(key, (key.replace("_", " "), 1, ""))
        shown = number(value if value is None or factor == 1 else value * factor, 4)
        unit = unit if value is not None else ""
        rows.append(
            f'<tr><td>{escape(words)}</td><td class="n">{shown}{" " + unit if unit else ""}</td>'
            f'<td class="soft"><code>{escape(key)}</code></td></tr>'
        )
    return f'<div class="panel"><table>{"".join(rows)}</table></div>'


MOST_CHANGES = 30


def changes_list(data: RunData | ShoalData) -> str:
    """How the run's scenario differs from the bundled model, a change a line; nothing if not."""
    if data.changes is None or not data.changes.rows:
        return ""
    model, rows = escape(data.changes.model), data.changes.rows
    items = "".join(
        f'<tr><td>{escape(row.what)}</td><td class="n">{escape(row.value)}</td>'
        f'<td class="soft">instead of {escape(row.usual)}</td>'
        f'<td class="soft"><code>{escape(row.key)}</code></td></tr>'
        for row in rows[:MOST_CHANGES]
    )
    more = len(rows) - MOST_CHANGES
    if more > 0:
        items += f'<tr><td class="soft">and {more} more: see scenario.toml</td></tr>'
    return (
        f'<div class="panel scroll changes"><h3>Changed in the bundled model {model}</h3>'
        f"<table>{items}</table></div>"
    )


def comparison_table(data: RunData) -> str:
    """From the ideal plant to this robot, a step a row; percentages are of the ideal."""
    if not data.comparison:
        why = f": {data.comparison_note}" if data.comparison_note else ""
        return f'<p class="soft">This run was not compared with the ideal plant{escape(why)}.</p>'
    turning = any(row.turn_radius_m is not None for row in data.comparison)
    head = "<tr><th>model</th><th class='n'>speed</th><th class='n'>of ideal</th>"
    if turning:
        head += "<th class='n'>turning radius</th><th class='n'>of ideal</th>"
    head += "<th>what it adds</th></tr>"
    ideal = data.comparison[0]
    body = "".join(_comparison_row(row, ideal, turning) for row in data.comparison)
    return f'<div class="panel scroll"><table>{head}{body}</table></div>'


def _comparison_row(row: Comparison, ideal: Comparison, turning: bool) -> str:
    cells = [f"<td>{escape(row.label)}</td>"]
    pairs = [(row.speed_m_s, ideal.speed_m_s, "cm/s")]
    if turning:
        pairs.append((row.turn_radius_m, ideal.turn_radius_m, "cm"))
    for value, reference, unit in pairs:
        if value is None:
            cells.append('<td class="n">—</td><td class="n soft">—</td>')
            continue
        share = ""
        if reference and row is not ideal:
            share = f"{100 * (value / reference - 1):+.1f} %".replace("-", "−")
        cells.append(
            f'<td class="n">{number(100 * value, 4)} {unit}</td><td class="n soft">{share}</td>'
        )
    cells.append(f'<td class="soft">{escape(row.why)}</td>')
    return f"<tr>{''.join(cells)}</tr>"


def events_table(data: RunData | ShoalData) -> str:
    """Resets, faults, commands, arrivals."""
    if not data.events:
        return '<p class="soft">Nothing out of the ordinary happened.</p>'
    shown = data.events[:200]
    rows = "".join(
        f'<tr><td class="n">{event.time_s:.3f} s</td><td class="soft">{escape(event.where)}</td>'
        f'<td class="{event.severity}">{escape(event.what)}</td></tr>'
        for event in shown
    )
    more = len(data.events) - len(shown)
    foot = f'<tr><td></td><td></td><td class="soft">and {more} more</td></tr>' if more else ""
    return (
        '<div class="panel"><table><tr><th class="n">time</th><th>where</th><th>what</th></tr>'
        f"{rows}{foot}</table></div>"
    )
