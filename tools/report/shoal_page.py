"""report.html of a shoal: one page, complete in itself, in the manner of that of one robot."""

from __future__ import annotations

from tools.records.shoal_data import ShoalData
from tools.report.page import page, section
from tools.report.shoal_links import links_figures
from tools.report.shoal_paths import paths_figure
from tools.report.shoal_tables import (
    commands_summary,
    energy_figure,
    robots_table,
    shoal_tiles,
)
from tools.report.survey_page import survey_first, survey_sections
from tools.report.survey_view import SurveyView
from tools.report.tables import events_table


def render_shoal(data: ShoalData, survey: SurveyView | None = None) -> str:
    """The whole page as text; of a shoal that surveys, with its survey first."""
    parents = () if survey is None else survey.parents
    links = f'<div class="rows">{links_figures(data, parents)}{commands_summary(data)}</div>'
    heard = (
        "A frame is heard where the receiver found its beginning: not by one that was off, that "
        "sent itself, or was busy with another frame."
    )
    first = ""
    surveyed: tuple[str, ...] = ()
    if survey is not None:
        first, surveyed = survey_first(survey), survey_sections(survey)
    sections = (
        *surveyed,
        section("Motion", "", f'<div class="rows">{paths_figure(data)}</div>'),
        section("Who heard whom", heard, links),
        section("Energy", "", energy_figure(data)),
        section("Robots", "As in summary.json, there in SI units.", robots_table(data)),
        section("Events", "", events_table(data)),
    )
    return page(data, first + shoal_tiles(data), sections)
