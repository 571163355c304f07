"""What a survey adds to a shoal's report.html: words and figures first, then four sections."""

from __future__ import annotations

from tools.report.page import section
from tools.report.survey_film import film_figure
from tools.report.survey_maps import field_figures, sample_figures
from tools.report.survey_scene import thin_ways, ways_figure
from tools.report.survey_time import time_figures
from tools.report.survey_view import SurveyView
from tools.report.survey_words import happened_table, shares_table, survey_tiles, survey_words


def survey_first(view: SurveyView) -> str:
    """What stands at the head of the page."""
    return survey_words(view) + survey_tiles(view)


def survey_sections(view: SurveyView) -> tuple[str, ...]:
    """The sections, in their order."""
    ways = thin_ways(view)
    film = f'<div class="grid2">{film_figure(view, ways)}{happened_table(view)}</div>'
    swum = f'<div class="grid2">{ways_figure(view, ways)}{shares_table(view)}</div>'
    scale = "True field and reconstruction have one scale, error and stated deviation another."
    samples = f'<div class="rows">{sample_figures(view)}{swum}</div>'
    return (
        section("The mission", "", film),
        section("The field", scale if view.field is not None else "", field_figures(view)),
        section("Samples", "", samples),
        section("Over time", "", time_figures(view)),
    )
