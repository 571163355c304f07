"""The numbers of a diagnosis: ranked causes, estimates with evidence, held-out errors, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from tools.diagnosis.result import Diagnosis, NamedCause, Ranked, Report

SHOWN = 12
"""Candidates that the ranking shows."""
KINDS = {"cause": "", "force": "force without a name", "sensor": "sensor error without a name"}


def ranking(diagnosis: Diagnosis) -> str:
    """Return the best candidates as bars, with the threshold that chance alone would not pass."""
    rows = [row for row in diagnosis.ranking if row.gain > 0.0][:SHOWN]
    if not rows:
        return '<p class="said">No candidate explains anything.</p>'
    named = {cause.name for cause in diagnosis.report.causes}
    most = max(rows[0].gain, 1.15 * diagnosis.threshold)
    left, step, width = 190.0, 22.0, 640.0
    scale = (width - left - 70.0) / math.sqrt(most)
    height = step * len(rows) + 34.0
    edge = left + scale * math.sqrt(diagnosis.threshold)
    parts = [
        f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img" '
        'aria-label="Evidence for each candidate">'
    ]
    for i, row in enumerate(rows):
        parts.append(_bar(row, left, step * i, scale * math.sqrt(row.gain), row.name in named))
    foot = step * len(rows)
    parts.append(
        f'<line class="moment" x1="{edge:g}" x2="{edge:g}" y1="0" y2="{foot + 6:g}"></line>'
        f'<text class="note" x="{edge:g}" y="{foot + 20:g}" text-anchor="middle">'
        "healthy data stay left of this</text></svg>"
    )
    return "".join(parts)


def _bar(row: Ranked, left: float, y: float, length: float, named: bool) -> str:
    what = KINDS.get(row.kind, "")
    name = escape(row.name) + (f" <title>{escape(what)}</title>" if what else "")
    colour = "c2" if named else ("truth" if what else "c1")
    return (
        f'<text x="{left - 8:g}" y="{y + 15:g}" text-anchor="end">{name}</text>'
        f'<rect class="{colour}" x="{left:g}" y="{y + 4:g}" width="{max(length, 0.5):g}" '
        'height="13" rx="2"></rect>'
        f'<text class="note" x="{left + length + 6:g}" y="{y + 15:g}">{row.gain:.0f}</text>'
    )


def estimates(report: Report) -> str:
    """Return the causes with their numbers, what speaks for each, and what looks alike."""
    if not report.causes:
        return ""
    rows = "".join(_estimate(report, cause) for cause in report.causes)
    return (
        '<div class="panel tablet"><table><tr><th>cause</th><th>parameter</th>'
        '<th class="n">estimate</th><th class="n">± standard error</th>'
        '<th class="n">chance in healthy data</th><th>looks alike</th></tr>'
        f"{rows}</table></div>"
    )


def _estimate(report: Report, cause: NamedCause) -> str:
    alike = sorted(
        {name for group in report.confusable if cause.name in group for name in group}
        - {cause.name}
    )
    rows = []
    for i, (name, value) in enumerate(cause.parameters.items()):
        first = i == 0
        unit = f" {value.unit}" if value.unit else ""
        rows.append(
            f"<tr><td>{escape(cause.name) if first else ''}</td><td><code>{escape(name)}</code></td>"
            f'<td class="n">{value.estimate:.4g}{escape(unit)}</td>'
            f'<td class="n">{value.standard_error:.2g}</td>'
            f'<td class="n">{chance(cause.p_value) if first else ""}</td>'
            f'<td class="soft">{escape(", ".join(alike)) if first else ""}</td></tr>'
        )
    return "".join(rows)


def chance(p_value: float) -> str:
    """Return a probability as people say it."""
    if p_value <= 1e-6:
        return "below 1 in a million"
    if p_value < 0.01:
        return f"1 in {1.0 / p_value:,.0f}".replace(",", " ")
    return f"{100.0 * p_value:.0f} %"


def held_out(report: Report) -> str:
    """Return the errors on the held-out runs before and after, beside what noise leaves."""
    held = report.held_out
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td>{_cells(before, held.rmse_after, held.noise_floor, name)}"
        "</tr>"
        for name, before in held.rmse_before.items()
    )
    return (
        '<div class="panel tablet"><table class="dense"><tr><th>channel</th>'
        '<th class="n">believed model</th><th class="n">extended model</th>'
        f'<th class="n">a true model</th></tr>{rows}</table></div>'
    )


def _cells(before: float, after: dict[str, float], floor: dict[str, float], name: str) -> str:
    numbers = (before, after.get(name), floor.get(name))
    return "".join(
        f'<td class="n">{"" if number is None else f"{number:.3g}"}</td>' for number in numbers
    )


def limits(report: Report, units: dict[str, str]) -> str:
    """Return the smallest effect of each cause that these data would have shown."""
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{_size(size, units.get(name, ""))}</td></tr>'
        for name, size in report.smallest_detectable.items()
    )
    return (
        '<div class="panel tablet"><table class="dense columns"><tr><th>cause</th>'
        f'<th class="n">smallest that would show</th></tr>{rows}</table></div>'
    )


def _size(size: float | None, unit: str) -> str:
    return "no size would" if size is None else escape(f"{size:.3g} {unit}".rstrip())


def notes(lines: Sequence[str]) -> str:
    """Return remarks as a list."""
    if not lines:
        return ""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"
