"""The report: complete in itself, small, well-formed, and true to its numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.records.data import RunData, Series, TailShape
from tools.report.control import control_figure
from tools.report.motion import tail_lag_s
from tools.report.page import render
from tools.report.path import path_picture
from tools.report.scale import Scale, decimate, limits, nice_step, number, tick_text, ticks

MakeRun = Callable[..., RunData]
VOID = {"meta", "br", "link", "img", "hr", "input"}


class Balance(HTMLParser):
    """Checks that every element is closed, and collects references to other places."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.references += [value or "" for key, value in attrs if key in ("src", "href")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for key, value in attrs if key in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize(("turn", "rough"), [(0.0, False), (0.16, True)])
def test_the_page_is_complete_in_itself_and_below_two_megabytes(
    make_run: MakeRun, turn: float, rough: bool
) -> None:
    page = render(make_run(200.0, turn, rough=rough))
    checker = Balance()
    checker.feed(page)
    assert checker.open == []
    assert checker.references == []
    assert "@import" not in page
    assert "url(" not in page.replace("url(#view)", "")
    assert len(page.encode()) < 2_000_000
    assert "prefers-color-scheme: dark" in page
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        ElementTree.fromstring(svg)
    assert "nan" not in re.sub(r"<script.*|<style.*?</style>", "", page, flags=re.DOTALL)


def test_the_page_says_what_happened(make_run: MakeRun) -> None:
    data = replace(make_run(40.0, 0.16, rough=True), interrupted=True)
    page = render(data)
    assert "interrupted" in page
    assert "cut for 0.5 s" in page
    assert number(100 * (data.metrics["turn_radius_m"] or 0)) in page
    for part in ("Gyro", "servo", "plant alone, ideal servo", "whole tank", "not acknowledged:"):
        assert part in page


def test_text_from_scenarios_is_escaped(make_run: MakeRun) -> None:
    page = render(replace(make_run(5.0), description="<script>alert(1)</script>"))
    assert "<script>alert" not in page


def test_runs_of_any_length_and_without_parts_are_shown(make_run: MakeRun) -> None:
    empty = replace(
        make_run(2.0),
        duration_s=0.0,
        truth={name: values[:0] for name, values in make_run(2.0).truth.items()},
        channels={},
        spi_frames=(),
        radio_frames=(),
        energy=(),
        comparison=(),
        events=(),
        metrics={},
        beat_frequency_hz=0.0,
    )
    for data in (empty, make_run(0.1), make_run(1.0)):
        checker = Balance()
        checker.feed(render(data))
        assert checker.open == []
    assert "No instrument is fitted." in render(empty)


def test_the_picture_stands_alone(make_run: MakeRun) -> None:
    picture = ElementTree.fromstring(path_picture(make_run(30.0, 0.16)))
    assert picture.tag == "{http://www.w3.org/2000/svg}svg"


def test_a_tail_that_bends_is_drawn_and_a_rigid_one_is_not(make_run: MakeRun) -> None:
    data = make_run(10.0)
    time = data.truth["time_s"][-56:]
    swing = np.sin(2 * math.pi * 0.9 * time)[:, np.newaxis]
    along = np.linspace(0.0, 0.08, 4)
    points = np.stack((-along + 0.0 * swing, -0.5 * along**2 / 0.08 * swing), axis=2)
    truth = {**data.truth, "tail_tip_m": 0.01 * np.sin(5.0 * data.truth["time_s"])}
    page = render(replace(data, truth=truth, tail_shape=TailShape(time, points)))
    assert "Shape of the tail over its last beat" in page
    assert "At most 1.00 cm; the tip sweeps 8.0 cm" in page
    assert "Shape of the tail" not in render(data)
    one = TailShape(time[:1], points[:1])
    assert "sweeps 0 cm" in render(replace(data, truth=truth, tail_shape=one))


def test_a_target_to_starboard_is_a_heading_error_above_zero(make_run: MakeRun) -> None:
    data = make_run(10.0)
    time = np.array([1.0, 5.0, 9.0])
    # what the controller recorded: the target's direction is 0.4 rad clockwise of the heading
    steered = {
        "control_error_rad": Series(time, np.full(3, -0.4)),
        "control_bias_rad": Series(time, np.full(3, 0.2)),
    }
    page = control_figure(
        replace(
            data,
            channels={**data.channels, **steered},
            tank=replace(data.tank, target_m=(1.0, -0.5)),
        )
    )
    scale = re.findall('data-y="([^"]*)"', page)[0]
    low, high, bottom, top = (float(part) for part in scale.split())
    drawn = re.findall('data-label="heading error" d="M[0-9.]+,([0-9.]+)', page)[0]
    value = low + (float(drawn) - bottom) / (top - bottom) * (high - low)
    assert value == pytest.approx(math.degrees(0.4), abs=0.2)
    assert "the target lies to starboard; bias &gt; 0 turns the robot there" in page


def test_the_tail_lag_is_that_of_the_made_up_servo(make_run: MakeRun) -> None:
    assert tail_lag_s(make_run(30.0)) == pytest.approx(0.35 / (2 * math.pi * 0.9), rel=3e-3)
    assert tail_lag_s(replace(make_run(30.0), beat_frequency_hz=0.0)) is None
    silent = make_run(3.0)  # a real board whose first pulse came late
    silent.truth["tail_command_rad"][:900] = np.nan
    assert tail_lag_s(silent) is None


numbers = st.floats(-1e6, 1e6)


# Spans that a double can still divide at such a distance from zero.
@given(numbers, st.floats(1e-3, 1e6), st.integers(2, 10))
def test_ticks_are_round_inside_and_about_as_many_as_wanted(
    low: float, span: float, count: int
) -> None:
    step = nice_step(span, count)
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - wanted) for wanted in (1, 2, 5, 10)) < 1e-6
    found = ticks(low, low + span, step)
    assert len(found) <= count + 1
    slack = 1e-6 * step + 4 * math.ulp(abs(low) + span)  # what `low + span` itself loses
    assert all(low - slack <= value <= low + span + slack for value in found)


def test_numbers_are_written_as_people_do() -> None:
    assert [number(v) for v in (0.049612, 1234567, 0, None, math.nan, -2.5, 1e-9)] == [
        "0.0496",
        "1\u202f234\u202f567",
        "0",
        "—",
        "—",
        "−2.50",
        "1.00e−09",
    ]
    assert [tick_text(v, s) for v, s in ((0.1, 0.1), (-5.0, 5.0), (1e-12, 0.2))] == [
        "0.1",
        "−5",
        "0.0",
    ]


def test_decimation_keeps_spikes_and_order() -> None:
    x = np.linspace(0, 100, 50_001)
    y = np.zeros_like(x)
    y[31_337] = 7.0
    y[44_444] = -3.0
    short_x, short_y = decimate(x, y, 300)
    assert short_x.size <= 1300
    assert (short_y.max(), short_y.min()) == (7.0, -3.0)
    assert np.all(np.diff(short_x) >= 0)
    assert (short_x[0], short_x[-1]) == (0.0, 100.0)


def test_scales_and_limits() -> None:
    scale = Scale(0.0, 10.0, 100.0, 0.0)
    assert scale(2.5) == 75.0
    assert scale.pixels(np.array([0.0, 10.0])).tolist() == [100.0, 0.0]
    assert limits(np.array([1.0, 3.0]), zero=True)[0] == 0.0
    low, high = limits(np.array([2.0, 2.0]), least=1.0)
    assert high - low == pytest.approx(1.12)
    assert limits(np.array([math.nan])) == (0.0, 1.0)
