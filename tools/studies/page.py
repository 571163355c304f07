"""report.html: every published figure computed again, with the printed numbers in it.

One page, complete in itself, in the style of a run's report. The first screen says in a sentence
how many figures agree and lists what parts for a known reason; below, a block for each study: its
pictures, beside them the numbers, under them what the source leaves open and how it was settled.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from tools.studies.account import (
    Account,
    error_text,
    pair,
    state,
    tolerance_text,
)
from tools.studies.drawing import COLOURS, draw
from tools.studies.study import Check, Figure, Panel, Surface
from tools.studies.workers import Outcome

STYLE = Path(__file__).resolve().parents[1] / "report"
WORDS = {
    "agrees": "agrees",
    "off": "off",
    "differs": "known difference",
    "drawn": "no number printed",
    "failed": "failed",
}


def render(account: Account, version: str) -> str:
    """The whole page as text."""
    style = "".join(
        (STYLE / name).read_text(encoding="utf-8") for name in ("style.css", "reproduction.css")
    )
    blocks = "".join(_study(outcome) for outcome in account.outcomes)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>reproduction · fishbed</title><style>{style}</style></head><body><main>"
        f"{_header(account)}{_differences(account)}{blocks}"
        f"<footer>Made by fishbed {escape(version)} with <code>fishbed reproduce</code>. Curves "
        "are computed here; diamonds and shaded bands are what the source prints. It is: J. Wang, "
        "Robotic Fish: Development, Modeling, and Application to Mobile Sensing, PhD dissertation, "
        "Michigan State University, 2014.</footer></main></body></html>\n"
    )


def _header(account: Account) -> str:
    chapters: dict[str, list[Outcome]] = {}
    for outcome in account.outcomes:
        chapters.setdefault(_chapter(outcome.row.name), []).append(outcome)
    listed = "".join(
        f'<h3>{escape(chapter)}</h3><nav class="chapters">{"".join(map(_link, outcomes))}</nav>'
        for chapter, outcomes in chapters.items()
    )
    good = sum(check.ok for _, check in account.checks)
    count = len(account.checks)
    facts = f"{good} of {count} printed numbers within their tolerance" if count else ""
    return (
        "<header><h1>Published figures, computed again</h1>"
        f'<p class="verdict">{escape(account.sentence())}</p>'
        f'<p class="facts">{facts}</p></header><div class="over">{listed}</div>'
    )


def _chapter(name: str) -> str:
    found = re.search(r"-(\d+)\.", name)
    return f"Chapter {found[1]}" if found else "More"


def _link(outcome: Outcome) -> str:
    name = outcome.row.name
    says = escape(f"{outcome.row.description}: {WORDS[state(outcome)]}", quote=True)
    return f'<a class="{state(outcome)}" href="#{name}" title="{says}">{_number(name)}</a>'


def _number(name: str) -> str:
    """`fig-3.4` as people write it."""
    kind, _, rest = name.partition("-")
    return escape(f"{ {'fig': 'Fig.', 'table': 'Table'}.get(kind, kind) } {rest}")


def _differences(account: Account) -> str:
    if not account.differences:
        return ""
    rows = "".join(
        f'<tr><td><a href="#{name}">{_number(name)}</a></td><td>{escape(check.what)}</td>'
        f'{_values(check)}<td class="reason">{escape(check.known_difference)}</td></tr>'
        for name, check in account.differences
    )
    head = "".join(
        f"<th{side}>{word}</th>"
        for word, side in (
            ("where", ""),
            ("what", ""),
            ("published", ' class="n"'),
            ("computed", ' class="n"'),
            ("error", ' class="n"'),
            ("reason", ""),
        )
    )
    return (
        '<section><h2>Known differences</h2><p class="intro">What is printed and what the '
        "published equations and parameters give part here, and why. None of it is tuned away."
        f'</p><div class="panel tablet"><table class="reasons"><tr>{head}</tr>{rows}</table></div>'
        "</section>"
    )


def _values(check: Check) -> str:
    published, computed = pair(check)
    unit = f" {check.unit}" if check.unit else ""
    return (
        f'<td class="n">{escape(published + unit)}</td><td class="n">{escape(computed + unit)}</td>'
        f'<td class="n">{escape(error_text(check))}</td>'
    )


def _study(outcome: Outcome) -> str:
    name, result = outcome.row.name, outcome.result
    said = state(outcome)
    says = f"{_number(name)}<small>{escape(outcome.row.description)}</small>"
    head = f'<div class="head"><h2>{says}</h2><span class="chip {said}">{WORDS[said]}</span></div>'
    if result is None:
        body = f'<div class="panel"><pre class="note">{escape(outcome.failure.strip())}</pre></div>'
        return f'<section class="study" id="{name}">{head}{body}</section>'
    compact = sum(len(figure.panels) for figure in result.figures) > 2
    plots = [
        _plot(panel, figure, f"{name}/{number}/{index}", compact)
        for number, figure in enumerate(result.figures)
        for index, panel in enumerate(figure.panels)
    ]
    captions = "".join(
        f'<p class="note">{escape(figure.name)}. {escape(figure.caption)}</p>'
        for figure in result.figures
    )
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in result.notes)
    numbers = _numbers(result.checks)
    drawn = f'<div class="plots">{"".join(plots)}</div>' if plots else ""
    words = captions + notes
    if len(plots) == 1:
        body = f'<div class="with">{drawn}<div>{numbers}{words}</div></div>'
    else:
        body = drawn + numbers + words
    return f'<section class="study" id="{name}">{head}{body}</section>'


def _numbers(checks: Iterable[Check]) -> str:
    rows = "".join(_row(check) for check in checks)
    if not rows:
        return ""
    head = (
        '<tr><th>what</th><th class="n">published</th><th class="n">computed</th>'
        '<th class="n">error</th><th class="n">tolerance</th><th></th></tr>'
    )
    return f'<div class="panel tablet"><table class="dense">{head}{rows}</table></div>'


def _row(check: Check) -> str:
    verdict, kind = ("ok", "ok") if check.ok else ("off", "off")
    if check.known_difference:
        verdict, kind = "known", "soft"
    return (
        f"<tr><td>{escape(check.what)}</td>{_values(check)}"
        f'<td class="n soft">{escape(tolerance_text(check))}</td>'
        f'<td class="{kind}">{verdict}</td></tr>'
    )


def _plot(panel: Panel | Surface, figure: Figure, salt: str, compact: bool) -> str:
    title = panel.title or figure.name
    legend = "" if isinstance(panel, Surface) else _legend(panel)
    head = f'<div class="head"><h3>{escape(title)}</h3>{legend}</div>'
    return f"<figure>{head}{draw(panel, salt, compact=compact)}</figure>"


def _legend(panel: Panel) -> str:
    keys: list[str] = []
    shapes = {"line": "", "dashed": " dash", "dotted": " dotted", "marks": " dot"}
    for index, curve in enumerate(panel.curves):
        if curve.label:
            colour = COLOURS[index % len(COLOURS)]
            keys.append(_key(curve.label, f"swatch{shapes[curve.style]}", colour))
    if panel.marks:
        keys.append(_key("published", "swatch diamond"))
    if panel.bands:
        keys.append(_key("published range", "swatch shade"))
    return f'<div class="legend">{"".join(_once(keys))}</div>' if keys else ""


def _key(label: str, swatch: str, colour: str = "") -> str:
    return f'<span class="key {colour}"><i class="{swatch}"></i>{escape(label)}</span>'


def _once(keys: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(keys))
