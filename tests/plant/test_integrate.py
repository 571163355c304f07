"""Order, pieces, saving, divergence."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.arrays import FloatArray
from plant.errors import DivergedError, InvalidParameterError, PlantError
from plant.integrate import march, simulate
from plant.layout import ROW
from plant.packing import pack
from plant.parameters import Hydrodynamics, PlantParameters, Servo
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start

BEAT = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
START = Start(u_m_s=0.03, v_m_s=0.005, r_rad_s=-0.1)


def errors_at_two_seconds(parameters: PlantParameters, steps: tuple[float, ...]) -> FloatArray:
    ends = [simulate(parameters, BEAT, 2.0, h, START).rows[-1, :6] for h in (*steps, 1e-4)]
    return np.array([np.linalg.norm(end - ends[-1]) for end in ends[:-1]])


def test_measured_order_is_four() -> None:
    # r|r| has a kink in its second derivative; without it the equations are smooth
    smooth = replace(wang2014(), hydrodynamics=Hydrodynamics(yaw_drag_n_m_s2=0.0))
    errors = errors_at_two_seconds(smooth, (0.02, 0.01, 0.005, 0.0025))
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([4.0, 4.0, 4.0], abs=0.1)


def test_the_kink_of_the_yaw_drag_costs_less_than_one_order() -> None:
    errors = errors_at_two_seconds(wang2014(), (0.02, 0.00125))
    assert math.log(errors[0] / errors[1], 16.0) > 3.0
    assert errors[1] < 1e-10


def test_one_millisecond_is_accurate_to_the_ninth_digit() -> None:
    coarse = simulate(wang2014(), BEAT, 30.0, 1e-3, START).rows[-1, :6]
    fine = simulate(wang2014(), BEAT, 30.0, 1.25e-4, START).rows[-1, :6]
    assert coarse == pytest.approx(fine, rel=1e-9, abs=1e-11)


@given(cuts=st.lists(st.integers(1, 399), max_size=6, unique=True))
@settings(max_examples=30)
def test_advancing_in_pieces_is_advancing_at_once_to_the_bit(cuts: list[int]) -> None:
    p = np.array(pack(wang2014()))
    drive = np.array(BEAT.segments(1e-3)[0][1])
    whole, pieces = np.empty((401, ROW)), np.empty((401, ROW))
    end, state = np.array(START.state()), np.array(START.state())
    assert march(p, drive, 0, 0, 400, 1e-3, end, whole, 0, 1) == 400
    for first, last in zip([0, *sorted(cuts)], [*sorted(cuts), 400], strict=True):
        assert march(p, drive, 0, first, last, 1e-3, state, pieces, 0, 1) == last
    assert np.array_equal(state, end)
    assert np.array_equal(whole, pieces)


def test_saving_less_often_changes_nothing_that_is_saved() -> None:
    every = simulate(wang2014(), BEAT, 5.0)
    tenth = simulate(wang2014(), BEAT, 5.0, save_every=10)
    assert np.array_equal(tenth.rows, every.rows[::10])
    assert tenth.time_s == pytest.approx(every.time_s[::10])


def test_a_changed_beat_keeps_its_phase() -> None:
    slow, fast = TailBeat.degrees(0, 15, 0.9), TailBeat.degrees(0, 15, 1.7)
    programme = TailProgramme((slow, fast, slow), (0.0, 1.3337, 2.1))
    run = simulate(wang2014(), programme, 4.0)
    jumps = np.abs(np.diff(run.tail_angle_rad))
    assert jumps.max() < math.radians(15) * 2 * math.pi * 1.7 * 1e-3 * 1.001
    # φ has advanced by the integral of the frequency
    phase = 2 * math.pi * (0.9 * 1.334 + 1.7 * (2.1 - 1.334) + 0.9 * 1.9)
    assert run.tail_angle_rad[-1] == pytest.approx(math.radians(15) * math.sin(phase), abs=1e-9)


def test_the_first_point_is_the_start() -> None:
    run = simulate(wang2014(), BEAT, 0.0, start=START)
    assert run.time_s.tolist() == [0.0]
    assert run.rows[0, :6].tolist() == [0.0, 0.0, 0.0, 0.03, 0.005, -0.1]


def test_a_step_too_long_for_the_servo_is_said_to_be_that() -> None:
    p = replace(wang2014(), servo=Servo(motor_lag_s=1e-4))
    with pytest.raises(DivergedError, match=r"step of 0\.001 s is too long") as caught:
        simulate(p, BEAT, 5.0)
    assert 0.0 <= caught.value.time_s < 5.0
    assert all(math.isfinite(value) for value in caught.value.state)
    assert isinstance(caught.value, PlantError)
    assert isinstance(caught.value, ArithmeticError)


@pytest.mark.parametrize(
    ("change", "start"),
    [
        ({"drag": 1000.0}, Start(u_m_s=1.0)),
        ({"lift": 1000.0}, Start(u_m_s=1.0)),
    ],
)
def test_the_step_that_is_advised_passes(change: dict[str, float], start: Start) -> None:
    p = replace(wang2014(), hydrodynamics=replace(wang2014().hydrodynamics, **change))
    with pytest.raises(DivergedError, match="too long") as caught:
        simulate(p, BEAT, 2.0, 1e-2, start)
    found = re.search("with steps of ([0-9.e-]+) s: try these", caught.value.cause)
    assert found is not None
    run = simulate(p, BEAT, 2.0, float(found[1]), start, save_every=1000)
    assert np.isfinite(run.rows).all()


@pytest.mark.parametrize(
    ("change", "start"),
    [
        ({"drag": 1000.0}, Start(u_m_s=20.0)),
        ({"yaw_drag_n_m_s2": 1000.0}, Start(r_rad_s=5.0)),
    ],
)
def test_drag_that_only_brakes_is_never_said_to_run_away(
    change: dict[str, float], start: Start
) -> None:
    p = replace(wang2014(), hydrodynamics=replace(wang2014().hydrodynamics, **change))
    with pytest.raises(DivergedError, match=r"in its first step .* far too stiff") as caught:
        simulate(p, BEAT, 3.0, start=start)
    found = re.search("only with steps of ([0-9.e-]+) s or less", caught.value.cause)
    assert found is not None
    step_s = 0.25 * float(found[1])
    run = simulate(p, BEAT, 1000 * step_s, step_s, start, save_every=10)
    assert np.hypot(run.u_m_s, run.v_m_s).max() <= 20.0
    assert np.abs(run.r_rad_s).max() < 30.0


def test_a_motion_that_runs_away_is_said_to_do_so() -> None:
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(drag=0.0, lift=0.0, yaw_drag_n_m_s2=0.0))
    with pytest.raises(DivergedError, match="equations themselves run away"):
        simulate(p, TailProgramme.steady(TailBeat(0.0, 3.0, 100.0)), 60.0, 1e-5, save_every=1000)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"duration_s": -1.0}, "simulate.duration_s"),
        ({"step_s": 0.0}, "simulate.step_s"),
        ({"save_every": 0}, "simulate.save_every"),
    ],
)
def test_nonsense_is_refused(change: dict[str, float], field: str) -> None:
    arguments = {"duration_s": 1.0} | change
    with pytest.raises(InvalidParameterError) as caught:
        simulate(wang2014(), BEAT, **arguments)  # type: ignore[arg-type]
    assert caught.value.field == field
