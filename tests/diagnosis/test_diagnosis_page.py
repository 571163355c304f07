"""The page of every verdict, of a linear model that is quickly diagnosed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import msgspec
import pytest

from tests.diagnosis.test_engine import diagnosed
from tools.diagnosis.page import words
from tools.diagnosis.page.page import render
from tools.diagnosis.result import Diagnosis, ProposedExperiment

VOID = {"meta", "br"}
PROPOSED = ProposedExperiment("10 s straight.", "separating.toml", 30.0)


class Balanced(HTMLParser):
    """Every tag that is opened is closed, in its place."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@cache
def case(name: str) -> Diagnosis:
    if name == "healthy":
        return diagnosed(0)
    if name == "unexplained":
        return diagnosed(14, hidden=2.0)
    found = diagnosed(21, a_k=0.7)
    if name == "ambiguous":  # as it would stand if nothing told a from b
        other = msgspec.structs.replace(found.report.causes[0], name="b", statement="b is <0.7>.")
        report = msgspec.structs.replace(
            found.report,
            verdict="ambiguous",
            causes=[*found.report.causes, other],
            confusable=[["a", "b"]],
            proposed_experiment=PROPOSED,
            notes=["run0: a gap & more"],
        )
        return replace(found, report=report)
    return found


@pytest.mark.parametrize("name", ["healthy", "named", "ambiguous", "unexplained"])
def test_the_page_is_whole_and_says_the_verdict(name: str) -> None:
    found = case(name)
    page = render(found, "tank <3>", "wang2014", "1.0")
    parser = Balanced()
    parser.feed(page)
    assert parser.open == []
    assert "tank &lt;3&gt;" in page
    for cause in found.report.causes:
        assert f"<h3>{cause.name}</h3>" in page
    assert page.index('class="verdict"') < page.index("<section")
    assert ("What was found" in page) == bool(found.report.causes)
    assert page == render(found, "tank <3>", "wang2014", "1.0")


def test_held_out_runs_are_shaded() -> None:
    found = case("named")
    page = render(found, "x", "y", "1.0")
    assert page.count('class="run unseen"') == sum(found.traces.held_out) > 0


def test_the_first_screen_says_what_is_gained() -> None:
    found = case("named")
    assert words.headline(found.report).startswith("A is 0.")
    names = [name for name, _, _ in words.tiles(found.report)]
    assert names[0] == "error that is explained"
    assert "chance of a false alarm" in names


def test_an_ambiguous_page_tells_what_to_swim() -> None:
    page = render(case("ambiguous"), "x", "y", "1.0")
    assert "it is a or b: these data cannot tell which" in page
    assert "swim separating.toml" in page
    assert "explained as well by b" in page
    assert "b is &lt;0.7&gt;." in page
    assert "a gap &amp; more" in page


def test_evidence_weighs_what_stands_for_and_against() -> None:
    found = case("named")
    speaks, doubts = words.evidence(found, found.report.causes[0])
    assert any("above the" in line for line in speaks)
    assert any("held-out" in line for line in speaks)
    weak = msgspec.structs.replace(
        found.report,
        held_out=msgspec.structs.replace(found.report.held_out, gain_ci95=(-0.1, 0.3)),
    )
    _, more = words.evidence(replace(found, report=weak), found.report.causes[0])
    assert len(more) == len(doubts) + 1
