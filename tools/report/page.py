"""report.html: one page, complete in itself, that shows a run."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from pathlib import Path

from tools.records.data import RunData
from tools.records.shoal_data import ShoalData
from tools.report.control import control_figure
from tools.report.energy import energy_panels
from tools.report.motion import heading_figure, speed_figure, tail_figures
from tools.report.path import is_wide, path_figure
from tools.report.real import real_head, real_table, report_figures
from tools.report.sensors import BEATS, sensor_figures
from tools.report.tables import changes_list, comparison_table, events_table, metrics_table, tiles
from tools.report.traffic import (
    commands_table,
    link_table,
    log_sentence,
    radio_figure,
    spi_figure,
)

HERE = Path(__file__).resolve().parent


def render(data: RunData) -> str:
    """The whole page as text."""
    if not data.truth["time_s"].size and data.hil:
        return page(data, tiles(data), _real_sections(data))
    path, curves = path_figure(data), speed_figure(data) + heading_figure(data)
    if is_wide(data):
        motion = f'<div class="rows">{path}<div class="grid2 even">{curves}</div></div>'
    else:
        motion = f'<div class="grid2">{path}<div class="stack">{curves}</div></div>'
    control = control_figure(data)
    real = real_table(data)
    sections = (
        section(real_head(data), "", real) if real else "",
        section("Motion", "", motion),
        section("Control", "", f'<div class="rows wide">{control}</div>') if control else "",
        section("Tail", "", tail_figures(data)),
        section(
            "Sensors against the truth",
            "Above, what the instrument said and what was, for those that swing with the tail over "
            f"the last {BEATS} beats; below, the difference over the whole run.",
            sensor_figures(data),
        ),
        _links(data),
        section("Energy", "", energy_panels(data)),
        section(
            "What makes the difference to the ideal plant",
            "The plant alone with an ideal servo, then one part of the robot after another.",
            comparison_table(data),
        ),
        section("Metrics", "As in summary.json, there in SI units.", metrics_table(data)),
        section("Events", "", events_table(data)),
    )
    return page(data, tiles(data), sections)


def _real_sections(data: RunData) -> tuple[str, ...]:
    """Sections of a run whose fish is real: nothing true is known of it, only what it reports."""
    return (
        section("The real board", "", real_table(data)),
        section("What it reported", "", report_figures(data)),
        _links(data),
        section("Energy", "Of the emulated board alone.", energy_panels(data))
        if data.energy
        else "",
        section("Events", "", events_table(data)),
    )


def _links(data: RunData) -> str:
    boards = bool(data.spi_frames) or not data.hil  # else there is no robot here
    spi = spi_figure(data) if boards else ""
    words = (link_table(data) if boards else "") + commands_table(data)
    words += log_sentence(data) if boards else ""
    traffic = f'<div class="rows wide">{spi}{radio_figure(data)}{words}</div>'
    said = "Between the boards, and by radio with the base station." if boards else "By radio."
    return section("Links", said, traffic)


def page(data: RunData | ShoalData, tiles: str, sections: Iterable[str]) -> str:
    """Head, tiles, what was changed in the model, and the sections of a report."""
    style = (HERE / "style.css").read_text(encoding="utf-8")
    script = (HERE / "script.js").read_text(encoding="utf-8")
    again = "The same scenario and seed give the same trace; <code>fishbed replay</code> checks it."
    if data.hil:
        again = "Somebody from outside took part: no other run will be the same."
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(data.scenario)} · fishbed</title><style>{style}</style></head>"
        f"<body><main>{_header(data)}{tiles}{changes_list(data)}{''.join(sections)}"
        f"<footer>Made by fishbed {escape(data.version)}. {again}</footer></main>"
        f"<script>{script}</script></body></html>\n"
    )


def _header(data: RunData | ShoalData) -> str:
    badge = '<span class="badge">interrupted</span>' if data.interrupted else ""
    ratio = data.duration_s / data.wall_s if data.wall_s > 0 else 0.0
    pace = f"{ratio:.{0 if ratio >= 10 else 1}f} × real time" if ratio else ""
    facts = [
        f"seed {data.seed}",
        f"{data.duration_s:g} s simulated in {data.wall_s:.1f} s" + (f", {pace}" if pace else ""),
        f"trace <code>{escape(data.trace_sha256[:16])}</code>",
    ]
    if data.lateness:
        facts.append(
            f"late by at most {1e3 * data.lateness['maximum_s']:.1f} ms, "
            f"99 % within {1e3 * data.lateness['p99_s']:.1f} ms"
        )
    return (
        f"<header><h1>{escape(data.scenario)}{badge}</h1>"
        f'<p class="lead">{escape(data.description)}</p>'
        f'<p class="facts">{" · ".join(facts)}</p></header>'
    )


def section(head: str, intro: str, body: str) -> str:
    """One section of a report."""
    said = f'<p class="intro">{escape(intro)}</p>' if intro else '<div class="air"></div>'
    return f"<section><h2>{escape(head)}</h2>{said}{body}</section>"
