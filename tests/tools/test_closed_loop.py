"""The plant with somebody at the tail, and the studies of control that rest on it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from plant.errors import InvalidParameterError
from plant.integrate import simulate
from plant.parameters import PlantParameters
from plant.robots import wang2014, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from procboard.applications.tracking_law import Mode, TrackingGains, TrackingLaw
from tools.studies import chapter5_control as control
from tools.studies.closed_loop import Instruments, steer, success_grid, track
from tools.studies.table import STUDIES
from tools.studies.tracking_rates import ROWS, measure

BEAT = control.BEAT
LAW = TrackingLaw(BEAT.amplitude_rad, BEAT.frequency_hz)


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        (control.chapter_5(), (0.2, -0.3, 0.1)),
        (PlantParameters(), (0.0, 0.0, 0.0)),  # a jump would meet the limit that simulate has not
    ],
)
def test_held_biases_are_a_programme(parameters, told):
    """What `simulate` makes of the same beats, told all at once."""
    biases = iter(told)
    steered = steer(parameters, Start(), BEAT, 5.0, 15.0, lambda *_: next(biases))
    programme = TailProgramme(
        tuple(TailBeat(bias, BEAT.amplitude_rad, BEAT.frequency_hz) for bias in steered.bias_rad),
        steered.decided_s,
    )
    plain = simulate(parameters, programme, 15.0, 5e-3)
    assert steered.decided_s == (0.0, 5.0, 10.0)
    assert steered.time_s.shape == plain.time_s.shape
    assert np.abs(steered.rows[:, :6] - plain.rows[:, :6]).max() < 1e-9


def _lagging(**fields):
    return replace(wang2014(), servo=replace(wang2014().servo, **fields))


@pytest.mark.parametrize("parameters", [_lagging(command_lag_s=0.1), wang2014_flexible()])
def test_a_lag_and_a_bending_tail_are_swum_as_in_a_programme(parameters):
    beat = TailBeat.degrees(0, 15, 1.0)
    biases = iter((0.3, 0.3, -0.2, 0.1))
    path = steer(parameters, Start(), beat, 1.0, 4.0, lambda time_s, rows: next(biases))
    beats = tuple(replace(beat, bias_rad=bias) for bias in (0.3, -0.2, 0.1))
    run = simulate(parameters, TailProgramme(beats, (0.0, 2.0, 3.0)), 4.0, 5e-3)
    np.testing.assert_allclose(path.rows[:, :8], run.rows[:, :8], atol=1e-9)


def test_a_delay_is_refused():
    late, beat = _lagging(command_delay_s=0.2), TailBeat.degrees(0, 15, 1.0)
    with pytest.raises(InvalidParameterError, match="command_delay_s"):
        steer(late, Start(), beat, 1.0, 4.0, lambda time_s, rows: 0.3)


def test_who_decides_sees_what_was_swum_and_may_end_it():
    seen = []

    def decide(now_s, rows):
        seen.append((now_s, rows.shape[0], float(rows[-1, 0])))
        return None if now_s >= 2.0 else 0.0

    steered = steer(control.chapter_5(), Start(0.5), BEAT, 1.0, 10.0, decide)
    assert [now_s for now_s, _, _ in seen] == [0.0, 1.0, 2.0]
    assert [count for _, count, _ in seen] == [1, 201, 201]
    assert seen[0][2] == 0.5
    assert steered.time_s[-1] == pytest.approx(2.0)
    assert seen[2][2] == steered.x_m[-1]


@pytest.mark.parametrize("reach_m", [0.6, 0.25])
def test_every_pose_of_the_grid_arrives(reach_m):
    """The first row of the table in docs/tracking.md, with its longest time."""
    told = []
    grid = success_grid(PlantParameters(), LAW, BEAT, reach_m, progress=told.append)
    assert len(grid) == 7 * 7 * 8
    assert all(run.reached_s is not None for run in grid)
    assert max(run.reached_s for run in grid) < 60.0
    # None is faster than 4.5 cm/s: 3 straight ahead, more where it flips its tail.
    assert all(run.reached_s >= math.hypot(run.x_m, run.y_m) / 0.045 - 1 for run in grid)
    assert told[-1] == 1.0


def test_without_leaving_it_circles_round_a_target_in_its_turn():
    stubborn = TrackingLaw(BEAT.amplitude_rad, 1.0, TrackingGains(leave_radii=0.0))
    beside = Start(0.0, -0.12, 0.0)
    circling = track(PlantParameters(), stubborn, BEAT, beside, ((0.0, 0.0),), 150.0)
    assert circling.reached_s == ()
    freed = track(PlantParameters(), LAW, BEAT, beside, ((0.0, 0.0),), 150.0)
    assert len(freed.reached_s) == 1
    assert freed.switches[0][3] is Mode.LEAVING


def test_with_half_of_the_poses_lost_it_arrives_all_the_same():
    lossy = Instruments(lost_poses=0.5)
    for seed in range(4):
        run = track(
            PlantParameters(), LAW, BEAT, Start(-0.5, 0.1), ((0.0, 0.0),), 400.0, seed, lossy
        )
        assert len(run.reached_s) == 1


def test_the_same_seed_is_the_same_run():
    runs = [
        track(PlantParameters(), LAW, BEAT, Start(-0.3), ((0.0, 0.0),), 60.0, seed)
        for seed in (3, 3, 4)
    ]
    assert runs[0].path.bias_rad == runs[1].path.bias_rad
    assert runs[0].path.bias_rad != runs[2].path.bias_rad


def test_figure_5_10_ends_where_the_source_says():
    told = []
    result = control.fig_5_10(told.append)
    assert [check.ok for check in result.checks] == [True] * 4
    assert told[-1] == 1.0
    # The published end points lie 17 cm apart: agreement within 5 cm tells them apart.
    apart = math.dist(control.PUBLISHED_ORIGINAL_M, control.PUBLISHED_AVERAGE_M)
    assert apart > 3 * max(check.tolerance for check in result.checks)
    other = control.proportional(gain=0.6)
    assert math.dist(tuple(other.original[-1]), control.PUBLISHED_ORIGINAL_M) > 0.1


def test_figure_5_21_reaches_its_targets_in_order():
    result = control.fig_5_21(lambda part: None)
    assert result.checks[0].computed == 4.0
    labels = [curve.label for curve in result.figures[0].panels[0].curves]
    assert labels[0] == "path"
    assert "turning from here" in labels
    assert labels[-1] == "targets"


def test_the_rows_of_the_studies_load():
    for row in STUDIES:
        if row.function.startswith("tools.studies.chapter5_control"):
            assert callable(row.load().compute)


def test_the_table_of_rates_has_different_rows():
    assert len({row.what for row in ROWS}) == len(ROWS)
    assert len({(row.gains, row.instruments, row.ideal, row.current_m_s) for row in ROWS}) == len(
        ROWS
    )
    assert callable(measure)
