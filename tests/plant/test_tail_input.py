"""Beats and programmes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.errors import InvalidParameterError
from plant.layout import Drive
from plant.tail_input import TailBeat, TailProgramme, beat


@given(
    bias=st.floats(-1, 1), amplitude=st.floats(0, 1), frequency=st.floats(0.1, 5), t=st.floats(0, 9)
)
def test_rates_are_the_derivatives(
    bias: float, amplitude: float, frequency: float, t: float
) -> None:
    drive = Drive(bias, amplitude, 2 * math.pi * frequency, 0.3, 0.0)
    h = 1e-4
    before, now, after = beat(drive, t - h), beat(drive, t), beat(drive, t + h)
    scale = (2 * math.pi * frequency) ** 4 + 1.0
    assert now[1] == pytest.approx((after[0] - before[0]) / (2 * h), abs=h * h * scale + 1e-9)
    assert now[2] == pytest.approx((after[1] - before[1]) / (2 * h), abs=h * h * scale * 30 + 1e-9)


def test_angle_is_that_of_3_25() -> None:
    drive = Drive(0.35, 0.26, 2 * math.pi * 0.9, 0.0, 0.0)
    assert beat(drive, 1.7)[0] == pytest.approx(0.35 + 0.26 * math.sin(2 * math.pi * 0.9 * 1.7))
    assert beat(Drive(0.35, 0.0, 0.0, 0.0, 0.0), 1.7) == (0.35, 0.0, 0.0)


def test_changes_take_effect_at_the_grid_point_at_or_after() -> None:
    one = TailBeat(0.0, 0.1, 1.0)
    programme = TailProgramme((one, one, one), (0.0, 0.0305, 0.06))
    assert [index for index, _ in programme.segments(1e-3)] == [0, 31, 60]


@pytest.mark.parametrize(
    ("beats", "starts"), [(0, ()), (2, (0.0,)), (1, (0.5,)), (2, (0.0, 0.0)), (3, (0.0, 2.0, 1.0))]
)
def test_disordered_programmes_are_refused(beats: int, starts: tuple[float, ...]) -> None:
    with pytest.raises(InvalidParameterError, match="starts_s"):
        TailProgramme((TailBeat(),) * beats, starts)


@pytest.mark.parametrize("bad", [(4.0, 0, 1), (0, -0.1, 1), (0, 0.1, -1), (0, 0.1, math.nan)])
def test_impossible_beats_are_refused(bad: tuple[float, float, float]) -> None:
    with pytest.raises(InvalidParameterError, match="tail_beat"):
        TailBeat(*bad)
