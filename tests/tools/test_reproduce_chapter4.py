"""Studies of chapter 4: the printed numbers, the peak of the speed, and shapes of the tail."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from plant.integrate import simulate
from plant.robots import wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from tools.studies import chapter4_speed, chapter4_tail
from tools.studies.study import Panel
from tools.studies.table import STUDIES


def test_all_figures_of_the_chapter_have_a_study() -> None:
    names = {row.name for row in STUDIES}
    assert names >= {f"fig-4.{number}" for number in (7, 8, 9, 10, 11, 13, 14)}


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the frequencies at which the source measured, and fewer steps."""
    monkeypatch.setattr(chapter4_speed, "FREQUENCY_HZ", 0.45 * np.arange(1.0, 7.0))
    monkeypatch.setattr(chapter4_speed, "STEPS_PER_BEAT", 50)


@pytest.mark.usefixtures("coarse")
def test_the_first_tail_is_fastest_at_1_35_hz_and_the_beam_parts_from_the_segments() -> None:
    told: list[float] = []
    result = chapter4_speed.over_frequency(told.append)
    assert [check.what for check in result.checks if check.failed] == []
    assert told[-1] == pytest.approx(1.0)
    (damping,) = [check for check in result.checks if check.known_difference]
    assert damping.published / damping.computed == pytest.approx(10.0, rel=0.01)
    (panel,) = result.figures[0].panels
    assert isinstance(panel, Panel)
    segments, beam, moving, printed = (curve.y for curve in panel.curves)
    # slow: alike; above the peak: apart, as section 4.5.2 says
    assert abs(beam[0] / segments[0] - 1.0) < 0.1
    assert np.all(beam[3:] / segments[3:] < 0.75)
    assert np.all(np.diff(printed) > 0.0)  # no peak with the damping that is printed
    assert np.all(moving < segments)


@pytest.mark.usefixtures("coarse")
def test_the_second_tail_has_its_printed_stiffness() -> None:
    result = chapter4_speed.over_frequency_long(lambda share: None)
    assert [check.what for check in result.checks if check.failed] == []
    assert result.checks[0].computed == pytest.approx(
        1.48e9 * 0.0234 * 0.3e-3**3 / (12.0 * 0.098 / 5), rel=1e-12
    )


def test_the_peak_of_a_parabola_is_exact() -> None:
    x = np.linspace(0.0, 3.0, 11)
    assert chapter4_speed.peak(x, 5.0 - 2.0 * (x - 1.37) ** 2) == pytest.approx((1.37, 5.0))
    assert chapter4_speed.peak(x, 2.0 * x) == (3.0, 6.0)  # no peak: the highest end


def test_tips_come_together_as_segments_are_added() -> None:
    (panel,) = chapter4_tail.tip(lambda share: None).figures[0].panels
    assert isinstance(panel, Panel)
    five, four, three = (curve.y for curve in panel.curves)
    assert [curve.label for curve in panel.curves] == ["5 segments", "4 segments", "3 segments"]
    assert np.abs(five - four).max() < np.abs(four - three).max()
    assert 2.0 < np.abs(five).max() < 3.5  # cm, as the published axis has it


def test_shapes_keep_the_length_and_agree_where_the_tail_hardly_bends() -> None:
    apart = []
    for study in (chapter4_tail.shapes_slow, chapter4_tail.shapes_fast):
        figure = study(lambda share: None).figures[0]
        assert len(figure.panels) == 6
        tips = []
        for panel in figure.panels:
            assert isinstance(panel, Panel)
            segments, beam = panel.curves
            steps = np.hypot(np.diff(segments.x), np.diff(segments.y))
            assert steps == pytest.approx([1.6] * 5)  # cm
            assert (segments.x[0], segments.y[0]) == (0.0, 0.0)
            assert (beam.x[0], beam.y[0]) == pytest.approx((0.0, 0.0), abs=1e-12)
            tips.append(math.hypot(segments.x[-1] - beam.x[-1], segments.y[-1] - beam.y[-1]))
        apart.append(max(tips))
    assert apart[0] < apart[1]  # 0.4 Hz against 0.9 Hz


def test_an_anchored_tail_moves_alike_whatever_the_robot_does() -> None:
    beat = TailProgramme.steady(TailBeat.degrees(0.0, 13.6, 0.9))
    t = simulate(wang2014_flexible(), beat, 2.0, 1e-2)
    published = wang2014_flexible()
    heavy = replace(published, body=replace(published.body, mass_kg=3.0))
    again = simulate(heavy, beat, 2.0, 1e-2)
    assert not np.array_equal(t.x_m, again.x_m)
    assert np.allclose(chapter4_tail._angles(t), chapter4_tail._angles(again), atol=1e-9)
    assert chapter4_tail._angles(t).shape[1] == 5
