"""The page: one file, complete in itself.

The first screen is for everybody: the verdict in a sentence, what it is worth, what to do. Below
stand the runs, measured and simulated, the held-out ones shaded; then the evidence; then what is
left, what could not have been seen, and what was said about the data.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path

from tools.diagnosis.page import tables, words
from tools.diagnosis.page.map import confusability_map
from tools.diagnosis.page.panels import (
    channel_panel,
    cross_panel,
    path_panel,
    steady,
    steady_panel,
    whiteness_panel,
)
from tools.diagnosis.result import Diagnosis
from tools.studies.drawing import COLOURS, draw
from tools.studies.study import Panel

HERE = Path(__file__).resolve().parent
REPORT = HERE.parents[1] / "report"
STYLES = (REPORT / "style.css", REPORT / "reproduction.css", HERE / "diagnosis.css")

BADGES = {
    "nothing_wrong": ("nothing wrong", "agrees"),
    "named": ("named", "off"),
    "ambiguous": ("ambiguous", "off"),
    "unexplained": ("unexplained", "off"),
}


def render(diagnosis: Diagnosis, name: str, believed: str, version: str) -> str:
    """Return the whole page."""
    style = "".join(path.read_text(encoding="utf-8") for path in STYLES)
    report = diagnosis.report
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(name)} · diagnosis · fishbed</title><style>{style}</style></head>"
        f"<body><main>{_header(diagnosis, name, believed)}{''.join(_sections(diagnosis))}"
        f"<footer>Made by fishbed {escape(version)} with <code>fishbed diagnose</code>, seed "
        f"{report.seed}. The same data and seed give the same page.</footer></main></body></html>\n"
    )


def _sections(diagnosis: Diagnosis) -> Iterator[str]:
    report = diagnosis.report
    units = {
        cause.name: cause.parameters[0].unit
        for cause in diagnosis.problem.model.causes
        if cause.parameters
    }
    if steady(diagnosis):
        yield _section(
            "Measured and computed",
            "Dots are rows of the table; the bars are two standard deviations to both sides. The "
            "curves are the steady motion of the models.",
            _columns(diagnosis),
        )
    else:
        yield _section(
            "Measured and simulated",
            "Dots are measured. The simulation replays the commands from the start of each run, so "
            "its errors add up. The grey band of a channel holds 95 % of what the model would "
            "measure in restless water. Shaded runs were held out: no number was fitted to them.",
            _runs(diagnosis),
        )
    if report.causes:
        yield _section(
            "What was found",
            "",
            f'<div class="causes">{tables.estimates(diagnosis)}</div>',
        )
    yield _section(
        "What could explain it",
        "How much better each candidate alone explains the data (twice the logarithm of the "
        "likelihood ratio, made robust; bars are drawn by its root, with a 95 % interval). The "
        "best of all candidates stays left of the dotted line in healthy data: "
        f"{diagnosis.threshold:.0f}, found by simulation.",
        f"<figure>{tables.ranking(diagnosis)}</figure>",
    )
    yield _section(
        "On the held-out runs",
        f"Root mean square difference between simulated and measured in "
        f"{words.listed(report.held_out.runs)}. A true model would still be off by the last column:"
        " noise, and water that is never still.",
        tables.held_out(report),
    )
    yield _section(
        "What remains",
        "If a model is right, its one-step errors are noise: unrelated to those before (first "
        "row) and to everything that is known (second row). Then the curves stay in the band.",
        _remains(diagnosis),
    )
    if len(diagnosis.names) > 1:
        yield _section(
            "What looks alike",
            "The darker a square, the harder these two are to tell apart with these manoeuvres and "
            "channels; framed ones can hardly be told apart at all.",
            '<figure class="scroll alikes">'
            f"{confusability_map(diagnosis.names, diagnosis.cosines)}</figure>",
        )
    yield _section(
        "What would have shown",
        "The smallest effect of each cause that these data would have revealed in nine cases of "
        "ten.",
        tables.limits(report, units),
    )
    if report.notes:
        yield _section("About the data", "", tables.notes(report.notes))


def _header(diagnosis: Diagnosis, name: str, believed: str) -> str:
    report = diagnosis.report
    says, kind = BADGES[report.verdict]
    steps = "".join(f"<li>{escape(step)}</li>" for step in words.next_steps(report))
    worth = words.worth(report)
    tiles = "".join(
        f'<div class="tile"><div class="name">{escape(what)}</div>'
        f'<div class="value">{escape(value)}</div><div class="more">{escape(more)}</div></div>'
        for what, value, more in words.tiles(report)
    )
    return (
        f'<header><h1>{escape(name)} <span class="chip {kind}">{says}</span></h1>'
        f'<p class="facts">{_facts(diagnosis)}, compared with the model '
        f"<code>{escape(believed)}</code></p>"
        f'<p class="verdict">{escape(words.headline(report))}</p>'
        + (f'<p class="worth">{escape(worth)}</p>' if worth else "")
        + (f'<div class="tiles">{tiles}</div>' if tiles else "")
        + f'<h3 class="todo">What to do</h3><ul class="next">{steps}</ul></header>'
    )


def _facts(diagnosis: Diagnosis) -> str:
    runs = diagnosis.problem.runs
    count = len(runs)
    if steady(diagnosis):
        return f"{sum(run.value.size for run in runs)} measurements of steady motion"
    seconds = sum(float(run.time_s[-1] - run.time_s[0]) for run in runs)
    return f"{count} run{'s' if count != 1 else ''}, {seconds:.0f} s in all"


def _columns(diagnosis: Diagnosis) -> str:
    panels = [
        panel
        for index in range(len(diagnosis.problem.model.channels))
        if (panel := steady_panel(diagnosis, index)) is not None
    ]
    drawn = "".join(_figure(panel, f"steady/{panel.title}", panel.title) for panel in panels)
    return f'<div class="runs">{drawn}</div>'


def _runs(diagnosis: Diagnosis) -> str:
    every = "".join(_run(diagnosis, i) for i in range(len(diagnosis.problem.runs)))
    return f'<div class="runs">{every}</div>'


def _run(diagnosis: Diagnosis, run: int) -> str:
    """Show the path of a run; its channels are folded away."""
    unseen = diagnosis.traces.held_out[run]
    name = diagnosis.problem.runs[run].name
    title = f"{escape(name)}{'<small>held out</small>' if unseen else ''}"
    path = path_panel(diagnosis, run)
    channels = [
        (channel.name, panel)
        for channel in diagnosis.problem.model.channels
        if (panel := channel_panel(diagnosis, run, channel.name)) is not None
    ]
    if path is None and channels:
        first, *channels = channels
        path = first[1]
    shown = _figure(path, f"{run}/path", title) if path is not None else ""
    folded = "".join(
        _figure(panel, f"{run}/{channel}", escape(channel)) for channel, panel in channels
    )
    more = f"<details><summary>its channels</summary>{folded}</details>" if folded else ""
    return f'<div class="run{" unseen" if unseen else ""}">{shown}{more}</div>'


def _remains(diagnosis: Diagnosis) -> str:
    rest = diagnosis.report.remaining_structure
    said = f"Structure remains: {rest.where}." if rest.found else "What is left looks like noise."
    drawn = []
    for kind, make in (("white", whiteness_panel), ("cross", cross_panel)):
        panels = [make(diagnosis, i) for i in range(len(diagnosis.problem.model.channels))]
        row = "".join(
            _figure(panel, f"{kind}/{panel.title}", escape(panel.title))
            for panel in panels
            if panel is not None
        )
        if row:
            drawn.append(f'<div class="runs">{row}</div>')
    return f'<p class="said">{escape(said)}</p><div class="rows">{"".join(drawn)}</div>'


def _figure(panel: Panel, salt: str, title: str) -> str:
    keys = []
    shapes = {"line": "", "dashed": " dash", "dotted": " dotted", "marks": " dot"}
    for index, curve in enumerate(panel.curves):
        colour = COLOURS[index % len(COLOURS)]
        keys.append(_key(curve.label, f"swatch{shapes[curve.style]}", colour))
    keys += [_key(ribbon.label, "swatch shade", "") for ribbon in panel.ribbons]
    legend = f'<div class="legend">{"".join(keys)}</div>'
    head = f'<div class="head"><h3>{title}</h3>{legend}</div>'
    return f"<figure>{head}{draw(panel, salt, compact=True)}</figure>"


def _key(label: str, swatch: str, colour: str) -> str:
    return f'<span class="key {colour}"><i class="{swatch}"></i>{escape(label)}</span>'


def _section(head: str, intro: str, body: str) -> str:
    said = f'<p class="intro">{escape(intro)}</p>' if intro else '<div class="air"></div>'
    return f"<section><h2>{escape(head)}</h2>{said}{body}</section>"
