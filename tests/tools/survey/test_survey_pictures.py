"""Pictures of a survey: what is on them is what was measured, for all eyes, and always the same.

Oracles: matplotlib's own scale of colours, the contrast of WCAG, and the numbers themselves.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from dataclasses import replace
from itertools import accumulate
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest

from tests.tools.survey.made import drawn, nothing
from tools.records.survey_data import Happening, SurveyEvent
from tools.report.survey_colours import VIRIDIS, Values
from tools.report.survey_film import LETTERS, UNKNOWN, film_figure
from tools.report.survey_maps import field_figures, sample_figures
from tools.report.survey_page import survey_first, survey_sections
from tools.report.survey_scene import thin_ways, ways_figure
from tools.report.survey_time import time_figures
from tools.report.survey_view import SurveyView
from tools.report.survey_words import happened_table, shares_table, survey_words


def pictures(html: str) -> dict[str, ElementTree.Element]:
    """Each picture by what it says to those who cannot see it."""
    found = [ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", html, re.DOTALL)]
    assert all(svg.get("role") == "img" and svg.get("aria-label") for svg in found)
    return {svg.get("aria-label", "").partition(",")[0]: svg for svg in found}


def told_cells(svg: ElementTree.Element) -> list[ElementTree.Element]:
    return [rect for rect in svg.iter("rect") if rect.find("title") is not None]


def film_of(html: str) -> dict[str, Any]:
    (text,) = re.findall(r'<script type="application/json">(.*?)</script>', html)
    found: dict[str, Any] = json.loads(text)
    return found


def luminance(colour: str) -> float:
    """WCAG 2.2, relative luminance."""
    parts = [int(colour[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_colours_are_those_of_matplotlib_and_grow_lighter_evenly() -> None:
    theirs = mpl.colormaps["viridis"](np.linspace(0.0, 1.0, len(VIRIDIS)))
    assert [mpl.colors.to_hex(colour)[1:] for colour in theirs] == list(VIRIDIS)
    light = [luminance(colour) for colour in VIRIDIS]
    assert light == sorted(light)


def test_marks_on_cells_have_contrast_at_every_value() -> None:
    scale = Values(0.0, 1.0)
    marks = {"ondark": 1.0, "onbright": luminance("10161c")}
    for value in np.linspace(0.0, 1.0, 100).tolist():
        cell, mark = luminance(VIRIDIS[scale.index(value)]), marks[scale.mark(value)]
        assert (max(cell, mark) + 0.05) / (min(cell, mark) + 0.05) > 3.6  # 3 for graphics, 1.4.11


def test_the_maps_have_every_cell_and_one_scale(view: SurveyView) -> None:
    found = pictures(field_figures(view))
    assert list(found) == [
        "true temperature",
        "reconstructed temperature",
        "error of the reconstruction",
        "stated deviation",
    ]
    assert all(len(told_cells(svg)) == 25 for svg in found.values())
    assert view.field is not None
    low, high = view.span
    for name, matrix in (("true", view.field), ("reconstructed", view.reconstruction)):
        fills = [rect.get("fill") for rect in told_cells(found[f"{name} temperature"])]
        levels = np.rint((matrix - low) / (high - low) * 32).astype(int).ravel()
        assert fills == [f"#{VIRIDIS[level]}" for level in levels]
    dots = list(found["reconstructed temperature"].iter("circle"))
    assert len(dots) == view.sampled


def test_row_zero_is_lowest_and_column_zero_leftmost(view: SurveyView) -> None:
    places = {}
    for rect in told_cells(pictures(field_figures(view))["true temperature"]):
        row, column = re.findall(r"\d+", (rect.findtext("title") or ""))[:2]
        places[int(row), int(column)] = float(rect.get("x", "")), float(rect.get("y", ""))
    assert places[0, 0][1] == max(y for _, y in places.values())
    assert places[0, 0][0] == min(x for x, _ in places.values())
    assert places[0, 1][0] > places[0, 0][0]
    assert places[1, 0][1] < places[0, 0][1]


def test_a_cell_says_its_figures(view: SurveyView) -> None:
    sample = view.samples[4]
    row, column = sample.cell
    words = f"row {row}, column {column}: "
    (title,) = [
        text
        for rect in told_cells(pictures(field_figures(view))["reconstructed temperature"])
        if (text := rect.findtext("title") or "").startswith(words)
    ]
    assert title.endswith(f"sample 5, robot {sample.robot}, {sample.time_s:.0f} s")
    assert view.field is not None
    assert f"true {view.field[sample.cell]:.2f}" in title


def test_samples_are_numbered_in_their_order_and_by_robot(view: SurveyView) -> None:
    found = pictures(sample_figures(view))
    order, whom = found["order of the samples"], found["who sampled"]
    numbers = [int(text.text or "") for text in order.findall("g[@class='over']/text")]
    assert numbers == [int(number) for number in view.order.ravel() if number]
    robots = [int(text.text or "") for text in whom.findall("g[@class='over']/text")]
    assert Counter(robots) == Counter(sample.robot for sample in view.samples)
    assert "100%" not in "".join(order.itertext())


def test_without_the_truth_only_what_was_found_is_shown(view: SurveyView) -> None:
    blind = replace(view, field=None)
    assert list(pictures(field_figures(blind))) == ["reconstructed temperature", "stated deviation"]
    assert "What was there is not known" in survey_words(blind)
    assert "Error of the known cells" not in time_figures(blind)


def test_cells_given_up_are_crossed(view: SurveyView) -> None:
    crossed = replace(view, given_up=((1, 2), (3, 3)))
    svg = pictures(field_figures(crossed))["reconstructed temperature"]
    assert len([p for p in svg.iter("path") if "stroke" in (p.get("class") or "")]) == 2
    assert "cells (1,\N{NO-BREAK SPACE}2), (3,\N{NO-BREAK SPACE}3)" in survey_words(crossed)


def test_a_large_grid_says_no_words_and_stays_small() -> None:
    large = drawn(100, 100, 2, 20.0)
    assert not told_cells(pictures(field_figures(large))["true temperature"])
    assert len(field_figures(large)) < 4_500_000


def test_the_film_has_the_ways_as_exactly_as_it_says(view: SurveyView) -> None:
    html = film_figure(view, thin_ways(view))
    film, paths = film_of(html), thin_ways(view).paths
    said = float(re.findall(r"Places are within ([\d.]+) mm", html)[0]) / 1000
    pixels = film["side"] / view.grid.spacing_m
    for robot, told in zip(view.robots, film["robots"], strict=True):
        time, x, y = (np.array(list(accumulate(row))) / 10 for row in told["p"])
        x_m = view.grid.x_m + (x - film["origin"][0]) / pixels - view.grid.spacing_m / 2
        y_m = view.grid.y_m - (y - film["origin"][1]) / pixels - view.grid.spacing_m / 2
        off = np.hypot(
            np.interp(robot.time_s, time, x_m) - robot.x_m,
            np.interp(robot.time_s, time, y_m) - robot.y_m,
        )
        rounding = 0.1 / pixels + 0.05 * 0.03  # tenths of pixels; of seconds, at 3 cm/s
        assert off.max() <= said + rounding
    assert [told["n"] for told in film["robots"]] == [1, 2]
    assert len(paths[0].time_s) < 0.5 * len(view.robots[0].time_s)


def test_the_film_has_every_sample_and_ends_with_the_reconstruction(view: SurveyView) -> None:
    html = film_figure(view, thin_ways(view))
    film = film_of(html)
    assert [(at, cell) for at, cell, _ in film["samples"]] == [
        (round(10 * s.time_s), s.cell[0] * 5 + s.cell[1]) for s in view.samples
    ]
    last = [f"#{film['palette'][LETTERS.index(letter)]}" for letter in film["known"][-1][2]]
    svg = next(svg for name, svg in pictures(html).items() if name.startswith("film"))
    drawn_last = [r.get("fill") for r in svg.findall("g[@class='cells']/rect")]
    assert drawn_last == last
    assert set(film["known"][0][2]) <= {UNKNOWN}  # nothing is known before the first sample
    assert film["robots"][1]["dead"] == [[1000, round(10 * view.duration_s)]]
    assert film["base"] == [[600, 1200]]


def test_the_film_is_marked_and_can_be_worked_without_a_mouse(view: SurveyView) -> None:
    html = film_figure(view, thin_ways(view))
    assert 'type="range"' in html
    assert 'aria-label="time of the mission, s"' in html
    assert "<button type=" in html
    track = pictures(html)["deaths of robots and outages of the base station over time"]
    assert [title.text for title in track.iter("title")] == [
        "base station out of reach, 60 to 120 s",
        "fish02 died at 100 s",
    ]


def test_twenty_robots_for_twenty_minutes_stay_below_a_megabyte_and_a_half() -> None:
    large = drawn(24, 24, 20, 1200.0)
    ways = thin_ways(large)
    assert ways.off_m <= 0.02
    assert sum(path.time_s.size for path in ways.paths) <= 15_000
    film = film_figure(large, ways)
    assert len(film.encode()) < 800_000
    rest = survey_first(large) + field_figures(large) + sample_figures(large) + time_figures(large)
    assert len((film + ways_figure(large, ways) + rest).encode()) < 2_000_000


def test_the_same_survey_makes_the_same_page(view: SurveyView) -> None:
    one, two = (survey_first(v) + "".join(survey_sections(v)) for v in (view, replace(view)))
    assert one == two


def test_nothing_is_fetched_and_no_number_is_none(view: SurveyView) -> None:
    for shown in (view, nothing(3, 4), replace(view, field=None, known=(), events=())):
        html = survey_first(shown) + "".join(survey_sections(shown))
        bare = re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
        assert not re.search(r"\b(src|href|url\(|http|import)", html)
        assert not re.search(r"\bnan\b|\binf\b|None", bare)


def test_ways_have_every_robot_and_all_its_samples(view: SurveyView) -> None:
    (svg,) = pictures(ways_figure(view, thin_ways(view))).values()
    ways = [g for g in svg.iter("g") if g.get("class") == "way"]
    assert [way.findtext("title", "").partition(":")[0] for way in ways] == ["fish01", "fish02"]
    for way, robot in zip(ways, view.robots, strict=True):
        (dots,) = [p for p in way.iter("path") if (p.get("class") or "").startswith("dots")]
        own = sum(sample.robot == robot.address for sample in view.samples)
        assert dots.get("d", "").count("M") == own
    assert "fish dead" in (ElementTree.tostring(ways[1], "unicode"))


def test_over_time_everything_is_where_it_was(view: SurveyView) -> None:
    found = pictures(time_figures(view))
    ticks = list(found["what each robot did over time"].iter("path"))
    counts = [p.get("d", "").count("M") for p in ticks if p.get("class") == "sample"]
    assert counts == [sum(s.robot == r.address for s in view.samples) for r in view.robots]
    titles = [t.text or "" for t in found["what each robot did over time"].iter("title")]
    assert f"fish02 dead, 100 to {view.duration_s:.0f} s" in titles
    chart = found["cells sampled"]
    lines = {p.get("data-label"): p.get("d", "") for p in chart.iter("path")}
    assert {"sampled", "wanted so far", "known"} <= set(lines)
    y0, y1, a, b = (float(word) for word in chart.get("data-y", "").split())
    last = float(lines["sampled"].rpartition(",")[2])
    assert y0 + (last - a) / (b - a) * (y1 - y0) == pytest.approx(view.sampled, abs=0.1)


def test_words_say_what_was_found_and_what_went_wrong(view: SurveyView) -> None:
    text = survey_words(view).replace("\N{NO-BREAK SPACE}", " ")
    assert "Temperature over 5 × 5 cells of 25 cm, surveyed by 2 robots." in text
    assert f"Of 25 cells {view.sampled} were sampled" in text
    assert view.error is not None
    rms = math.sqrt(float(np.mean(view.error**2)))
    assert f"off by {rms:.2g} °C" in text
    assert "Robot 2 died at 1 min 40 s" in text
    assert "From 1 min 0 s to 2 min 0 s nobody could reach the base station." in text
    noticed = next(event for event in view.events if event.what is Happening.MISSED)
    assert noticed.time_s >= 100.0
    assert "the others noticed at" in text


def test_cells_of_the_dead_were_taken_over_by_whom_who_sampled_them(view: SurveyView) -> None:
    cells = (view.samples[-1].cell, view.samples[-2].cell)
    events = (
        SurveyEvent(100.0, Happening.DIED, 2),
        SurveyEvent(150.0, Happening.MISSED, 2),
        SurveyEvent(150.0, Happening.TAKEN_OVER, 2, cells),
    )
    text = survey_words(replace(view, events=events))
    assert "were taken over by robot 1." in text
    assert "its cells taken over" in happened_table(replace(view, events=events))


def test_nothing_wrong_is_said_too() -> None:
    fine = drawn(6, 6, 2, 60.0)
    assert "Nothing went wrong." in survey_words(fine)
    assert shares_table(fine).count("<tr>") == 3
