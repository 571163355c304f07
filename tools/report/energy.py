"""Where the energy went: a bar for each consumer, divided by state, and the table behind it."""

from __future__ import annotations

from html import escape

from tools.records.data import EnergyState, RunData
from tools.report.charts import xy
from tools.report.scale import number

WIDTH, ROW, NAME, VALUE = 520.0, 27.0, 128.0, 84.0
STYLES = ("c1", "c3", "c6", "c4", "c5", "c2")


def energy_panels(data: RunData) -> str:
    """Bars and table side by side."""
    used = [row for row in data.energy if row.joules > 0 or row.seconds > 0]
    if not used:
        return '<p class="soft">The run keeps no account of its energy.</p>'
    totals: dict[str, float] = {}
    for row in used:
        totals[row.consumer] = totals.get(row.consumer, 0.0) + row.joules
    order = sorted(totals, key=lambda name: (-totals[name], name))
    whole = sum(totals.values())
    power = whole / data.duration_s if data.duration_s > 0 else 0.0
    caption = f"{number(whole)} J in {data.duration_s:g} s: {number(power)} W on average"
    bars = _bars(order, totals, used, whole)
    return (
        '<div class="grid2"><figure><div class="head"><h3>Energy by consumer</h3></div>'
        f'<div class="scroll">{bars}</div><figcaption>{caption}</figcaption></figure>'
        f'<div class="panel">{_table(order, used, whole)}</div></div>'
    )


def _bars(order: list[str], totals: dict[str, float], used: list[EnergyState], whole: float) -> str:
    height = ROW * len(order) + 6
    room = WIDTH - NAME - VALUE
    longest = max(totals.values()) or 1.0
    box = f'viewBox="0 0 {WIDTH:g} {height:g}"'
    parts = [f'<svg class="chart" {box} role="img" aria-label="energy by consumer">']
    for place, name in enumerate(order):
        y = place * ROW + 5
        x = NAME
        states = sorted((row for row in used if row.consumer == name), key=lambda row: -row.joules)
        for number_, row in enumerate(states):
            width = row.joules / longest * room
            if width < 0.05:
                continue
            hint = escape(f"{name}, {row.state}: {number(row.joules)} J in {number(row.seconds)} s")
            opacity = max(0.25, 1 - 0.28 * number_)
            parts.append(
                f'<rect class="{STYLES[place % len(STYLES)]}" x="{xy(x)}" y="{xy(y)}" '
                f'width="{xy(max(width - 0.8, 0.4))}" height="16" rx="2" opacity="{opacity:.2f}">'
                f"<title>{hint}</title></rect>"
            )
            x += width
        share = 100 * totals[name] / whole if whole else 0.0
        parts.append(
            f'<text class="note" x="{NAME - 8:g}" y="{xy(y + 12)}" text-anchor="end">'
            f"{escape(name)}</text>"
            f'<text class="note" x="{xy(x + 7)}" y="{xy(y + 12)}">'
            f"{number(totals[name])} J · {number(share, 2)} %</text>"
        )
    return "".join(parts) + "</svg>"


def _table(order: list[str], used: list[EnergyState], whole: float) -> str:
    heads = ("time", "energy", "mean power")
    right = "".join(f'<th class="n">{head}</th>' for head in heads)
    rows = [f"<table><tr><th>consumer</th><th>state</th>{right}</tr>"]
    for name in order:
        states = sorted((row for row in used if row.consumer == name), key=lambda row: -row.joules)
        for place, row in enumerate(states):
            power = 1000 * row.joules / row.seconds if row.seconds > 0 else 0.0
            rows.append(
                f"<tr><td>{escape(name) if place == 0 else ''}</td>"
                f'<td class="soft">{escape(row.state)}</td>'
                f'<td class="n">{number(row.seconds)} s</td>'
                f'<td class="n">{number(row.joules)} J</td>'
                f'<td class="n soft">{number(power)} mW</td></tr>'
            )
    rows.append(
        f'<tr class="total"><td>all</td><td></td><td></td>'
        f'<td class="n">{number(whole)} J</td><td></td></tr></table>'
    )
    return "".join(rows)
