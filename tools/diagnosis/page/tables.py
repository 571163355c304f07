"""The numbers of a diagnosis: ranked causes, estimates with evidence, held-out errors, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from tools.diagnosis.page import words
from tools.diagnosis.result import Diagnosis, Estimate, NamedCause, Ranked, Report

SHOWN = 12
"""Candidates that the ranking shows."""
SURE = 1.96
"""Half width of a 95 % interval, in standard deviations."""
KINDS = {"cause": "", "force": "force without a name", "sensor": "sensor error without a name"}


def ranking(diagnosis: Diagnosis) -> str:
    """Return the best candidates as bars, with the threshold that chance alone would not pass."""
    rows = [row for row in diagnosis.ranking if row.gain > 0.0][:SHOWN]
    if not rows:
        return '<p class="said">No candidate explains anything.</p>'
    named = {cause.name for cause in diagnosis.report.causes}
    most = max(rows[0].gain, 1.15 * diagnosis.threshold)
    left, step, width = 190.0, 22.0, 640.0
    scale = (width - left - 70.0) / (math.sqrt(most) + SURE)
    height = step * len(rows) + 34.0
    edge = left + scale * math.sqrt(diagnosis.threshold)
    head = f'<svg class="chart" viewBox="0 0 {width:g} {height:g}" role="img" '
    parts = [head + 'aria-label="Evidence for each candidate">']
    for i, row in enumerate(rows):
        parts.append(_bar(row, left, step * i, scale, named=row.name in named))
    foot = step * len(rows)
    parts.append(
        f'<line class="moment" x1="{edge:g}" x2="{edge:g}" y1="0" y2="{foot + 6:g}"></line>'
        f'<text class="note" x="{edge:g}" y="{foot + 20:g}" text-anchor="middle">'
        "healthy data stay left of this</text></svg>"
    )
    return "".join(parts)


def _bar(row: Ranked, left: float, y: float, scale: float, *, named: bool) -> str:
    """A bar as long as the root of the gain, whose standard deviation is one; its 95 % interval."""
    what = KINDS.get(row.kind, "")
    colour = "c2" if named else ("truth" if what else "c1")
    root = math.sqrt(row.gain)
    length, low, high = scale * root, scale * max(root - SURE, 0.0), scale * (root + SURE)
    middle = y + 10.5
    title = f"<title>{escape(what)}</title>" if what else ""
    return (
        f'<text x="{left - 8:g}" y="{y + 15:g}" text-anchor="end">{title}{escape(row.name)}</text>'
        f'<rect class="{colour}" x="{left:g}" y="{y + 4:g}" width="{max(length, 0.5):.4g}" '
        'height="13" rx="2"></rect>'
        f'<line class="whisker" x1="{left + low:.4g}" x2="{left + high:.4g}" y1="{middle:g}" '
        f'y2="{middle:g}"></line>'
        f'<text class="note" x="{left + high + 6:.4g}" y="{y + 15:g}">{row.gain:.0f}</text>'
    )


def estimates(diagnosis: Diagnosis) -> str:
    """Return a card for each cause: its numbers, what speaks for it and against, what is alike."""
    return "".join(_card(diagnosis, cause) for cause in diagnosis.report.causes)


def _card(diagnosis: Diagnosis, cause: NamedCause) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td>"
        f'<td class="n">{value.estimate:.4g} ± {value.standard_error:.2g}'
        f"{escape(' ' + value.unit if value.unit else '')}</td>"
        f'<td class="n soft">{_range(value)}</td></tr>'
        for name, value in cause.parameters.items()
    )
    speaks, doubts = words.evidence(diagnosis, cause)
    return (
        f'<div class="panel cause"><h3>{escape(cause.name)}</h3>'
        f'<p class="said">{escape(cause.statement)}</p>'
        '<div class="tablet"><table class="dense small"><tr><th>parameter</th>'
        '<th class="n">estimate ± standard error</th><th class="n">95 % interval</th></tr>'
        f'{rows}</table></div><div class="sides"><div><h4>For it</h4>{_list(speaks)}</div>'
        f"<div><h4>Against it</h4>{_list(doubts or ['Nothing that these data show.'])}</div>"
        "</div></div>"
    )


def _range(value: Estimate) -> str:
    low = value.estimate - SURE * value.standard_error
    high = value.estimate + SURE * value.standard_error
    return escape(f"{low:.3g} … {high:.3g}")


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def held_out(report: Report) -> str:
    """Return the errors on the held-out runs before and after, beside what noise leaves."""
    held = report.held_out
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code></td>"
        f"{_cells(before, held.rmse_after, held.noise_floor, name)}</tr>"
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
        '<div class="panel tablet limits"><table class="dense columns"><tr><th>cause</th>'
        f'<th class="n">smallest that would show</th></tr>{rows}</table></div>'
    )


def _size(size: float | None, unit: str) -> str:
    return "no size would" if size is None else escape(f"{size:.3g} {unit}".rstrip())


def notes(lines: Sequence[str]) -> str:
    """Return remarks as a list."""
    return _list(lines) if lines else ""
