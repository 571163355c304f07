"""The report of a shoal that surveys: its survey first, then what every shoal has."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from tools.records.data import EnergyState, TankView
from tools.records.shoal_data import Hearing, ShoalData, SwumRobot
from tools.report.shoal_links import links_figures
from tools.report.shoal_page import render_shoal
from tools.report.shoal_tables import energy_figure
from tools.report.survey_view import SurveyView

VOID = {"meta", "br", "input"}
ENERGY = (
    EnergyState("HS-5646WP", "on", 9.0, 50.0, "tail"),
    EnergyState("CC2420", "rx", 8.0, 20.0, "processing board"),
    EnergyState("CC2420", "tx", 1.0, 1.0, "processing board"),
    EnergyState("MSP430F1611", "active", 9.0, 4.0, "processing board"),
    EnergyState("dsPIC30F6014A", "active", 9.0, 8.0, "navigation board"),
    EnergyState("regulators", "loss", 9.0, 2.0, "power supply"),
)


class Page(HTMLParser):
    """Checks that every element is closed, and collects the sections' heads."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.heads: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Nothing stays open."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1:] == ["h2"]:
            self.heads.append(data)


@pytest.fixture
def data(view: SurveyView) -> ShoalData:
    """The same robots as a run of a shoal has them."""
    robots = tuple(
        SwumRobot(
            robot.name,
            robot.address,
            {"energy_j": 85.0},
            {
                "time_s": robot.time_s,
                "x_m": robot.x_m,
                "y_m": robot.y_m,
                "heading_rad": np.zeros_like(robot.x_m),
                "tail_angle_rad": np.zeros_like(robot.x_m),
            },
            {},
            0.9,
            ENERGY,
            (),
            (),
            (),
        )
        for robot in view.robots
    )
    return ShoalData(
        "survey-tank",
        "",
        1,
        view.duration_s,
        60.0,
        "1",
        "0" * 64,
        TankView((-1.0, -1.0), (4.0, 4.0), base_station_m=view.base_m),
        robots,
        {},
        Hearing(
            ("fish01", "fish02", "base"),
            np.array([10, 10, 10]),
            np.array([[0, 9, 8], [9, 0, 0], [8, 0, 0]]),
        ),
    )


def test_the_survey_stands_first_and_the_page_is_whole(data: ShoalData, view: SurveyView) -> None:
    page = render_shoal(data, view)
    parser = Page()
    parser.feed(page)
    assert parser.open == []
    survey = ["The mission", "The field", "Samples", "Over time"]
    shoal = ["Motion", "Who heard whom", "Energy", "Robots", "Events"]
    assert parser.heads == [*survey, *shoal]
    assert page.index("surveyed by 2 robots") < page.index('class="tiles"')
    assert "http" not in page.replace("http://www.w3.org", "")
    parser = Page()
    parser.feed(render_shoal(data))
    assert parser.heads == shoal


def test_words_from_a_scenario_are_escaped(data: ShoalData, view: SurveyView) -> None:
    odd = replace(view, quantity="<b>salt</b>", unit="<i>g</i>")
    page = render_shoal(data, odd)
    assert "<b>" not in page.lower()
    assert "<i>" not in page


def test_the_map_has_the_tree_of_several_hops(data: ShoalData) -> None:
    assert "sends on to" not in links_figures(data)
    tree = links_figures(data, ((2, 1), (1, 0), (7, 1)))
    assert re.findall(r"<title>(\w+ sends on to \w+)", tree) == [
        "fish02 sends on to fish01",
        "fish01 sends on to base",
    ]
    # from the child to its parent: the base lies at lower x than where the first robot ended
    turns = [float(turn) for turn in re.findall(r'class="filled".*?rotate\((-?\d+)\)', tree)]
    assert abs(turns[1]) > 90


def test_the_radio_has_its_own_part_of_the_energy(data: ShoalData) -> None:
    drawn = energy_figure(data)
    told = dict(re.findall(r"<title>fish01, ([\w ]+): ([\d.]+) J", drawn))
    assert {part: float(joules) for part, joules in told.items()} == {
        "tail": 50.0,
        "navigation board": 8.0,
        "processing board": 4.0,
        "radio": 21.0,
        "power supply": 2.0,
    }
