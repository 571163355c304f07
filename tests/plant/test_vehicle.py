"""Looks and inputs in any legal order give one truth; power loss; the past is closed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.arrays import FloatArray
from plant.errors import DivergedError, InvalidParameterError, LookBackError, PlantError
from plant.flexible.shape import tail_points
from plant.integrate import simulate
from plant.layout import Column
from plant.parameters import PlantParameters, Servo, Tail
from plant.robots import wang2014
from plant.servo import supply_current_a
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from plant.vehicle import BEND_COLUMN, FS_PER_S, TRUTH_COLUMNS, Vehicle

MS = FS_PER_S // 1000
BEAT = TailBeat.degrees(20, 15, 0.9)


def ideal(beat: TailBeat = BEAT, start: Start | None = None) -> Vehicle:
    vehicle = Vehicle(wang2014(), start)
    vehicle.set_tail_beat(0, beat)
    return vehicle


def test_on_the_grid_it_is_the_plain_simulation_to_the_bit() -> None:
    vehicle = ideal()
    run = simulate(wang2014(), TailProgramme.steady(BEAT), 3.0)
    for k in range(0, 3000, 7):
        assert vehicle.x(k * MS) == run.x_m[k]
        assert vehicle.heading(k * MS) == run.heading_rad[k]
        assert vehicle.tail_angle(k * MS) == run.tail_angle_rad[k]


def test_between_grid_points_it_is_a_finer_simulation() -> None:
    vehicle = ideal()
    fine = simulate(wang2014(), TailProgramme.steady(BEAT), 2.0, 1e-4)
    for k in range(10003, 20000, 37):
        t = k * (MS // 10)
        row = fine.rows[k]
        assert vehicle.x(t) == pytest.approx(row[Column.X], abs=1e-11)
        assert vehicle.y(t) == pytest.approx(row[Column.Y], abs=1e-11)
        assert vehicle.heading(t) == pytest.approx(row[Column.PSI], abs=1e-10)
        assert vehicle.u(t) == pytest.approx(row[Column.U], abs=1e-10)
        assert vehicle.v(t) == pytest.approx(row[Column.V], abs=1e-10)
        assert vehicle.r(t) == pytest.approx(row[Column.R], abs=1e-9)
        assert vehicle.tail_angle(t) == pytest.approx(row[Column.ALPHA], abs=1e-10)
        assert vehicle.tail_rate(t) == pytest.approx(row[Column.ALPHA_DOT], abs=1e-9)
        assert vehicle.ground_velocity_x(t) == pytest.approx(row[Column.X_DOT], abs=1e-6)
        assert vehicle.ground_velocity_y(t) == pytest.approx(row[Column.Y_DOT], abs=1e-6)
        assert vehicle.hinge_moment(t) == pytest.approx(row[Column.HINGE_MOMENT], abs=1e-8)


def test_proper_acceleration_is_the_second_derivative_of_the_path() -> None:
    vehicle = ideal()
    h = 1e-3
    for k in range(100, 3000, 97):
        t = k * MS + MS // 3
        x = [vehicle.x(t + i * MS) for i in (0, 1, 2)]
        # start over for y and the rest: looks must not go back
        other = ideal()
        y = [other.y(t + i * MS) for i in (0, 1, 2)]
        ax, ay = ((c[2] - 2 * c[1] + c[0]) / h**2 for c in (x, y))
        third = ideal()
        psi = third.heading(t + MS)
        body_x = ax * math.cos(psi) + ay * math.sin(psi)
        body_y = ay * math.cos(psi) - ax * math.sin(psi)
        assert third.body_acceleration_x(t + MS) == pytest.approx(body_x, abs=1e-4)
        assert third.body_acceleration_y(t + MS) == pytest.approx(body_y, abs=1e-4)


def servo_run(looks: list[int]) -> tuple[dict[int, tuple[float, ...]], FloatArray]:
    """Drive a servo with fixed inputs; look where told; return what was seen, and the truth."""
    vehicle = Vehicle(PlantParameters())
    inputs: list[tuple[int, str, float]] = []
    for frame in range(15):
        t = frame * 20 * MS + 123_456_789
        inputs.append((t, "target", 0.3 * math.sin(0.11 * frame)))
        inputs.append((t + 7 * MS, "supply", 7.4 - 0.05 * frame))
    events = sorted(
        [(t, 0, kind, value) for t, kind, value in inputs] + [(t, 1, "", 0.0) for t in looks]
    )
    seen: dict[int, tuple[float, ...]] = {}
    for t, _, kind, value in events:
        if kind == "target":
            vehicle.set_servo_target(t, value)
        elif kind == "supply":
            vehicle.set_supply(t, value)
        else:
            seen[t] = (
                vehicle.x(t),
                vehicle.r(t),
                vehicle.tail_angle(t),
                vehicle.body_acceleration_y(t),
                vehicle.servo_current(t),
            )
    return seen, vehicle.truth(310 * MS)


LOOKS = st.lists(st.integers(0, 300 * MS), max_size=25, unique=True)


@given(one=LOOKS, other=LOOKS)
@settings(max_examples=40)
def test_what_is_seen_does_not_depend_on_who_else_looks(one: list[int], other: list[int]) -> None:
    seen, truth = servo_run(one)
    seen_too, truth_too = servo_run(sorted({*one, *other}))
    assert np.array_equal(truth, truth_too)
    assert all(seen_too[t] == values for t, values in seen.items())


def test_left_and_right_targets_give_mirrored_runs_to_the_bit() -> None:
    truths = []
    for side in (1.0, -1.0):
        vehicle = Vehicle(PlantParameters())
        for frame in range(50):
            t = frame * 20 * MS
            vehicle.set_servo_target(t, side * (0.2 + 0.26 * math.sin(0.113 * frame)))
            vehicle.advance(t)
        truths.append(vehicle.truth(FS_PER_S))
    left, right = truths
    for name in ("y_m", "heading_rad", "v_m_s", "r_rad_s", "tail_angle_rad", "hinge_moment_n_m"):
        i = TRUTH_COLUMNS.index(name)
        assert np.array_equal(left[:, i], -right[:, i])
        assert np.any(left[:, i] != 0.0)
    for name in ("x_m", "u_m_s", "servo_current_a"):
        i = TRUTH_COLUMNS.index(name)
        assert np.array_equal(left[:, i], right[:, i])


def test_an_input_between_grid_points_waits_for_the_next() -> None:
    between, at = Vehicle(PlantParameters()), Vehicle(PlantParameters())
    between.set_servo_target(4 * MS + 1, 0.2)
    at.set_servo_target(5 * MS, 0.2)
    assert between.tail_angle(5 * MS) == 0.0
    assert [between.tail_angle(k * MS) for k in range(5, 60)] == [
        at.tail_angle(k * MS) for k in range(5, 60)
    ]
    assert at.tail_angle(60 * MS) > 0.1


def test_looks_may_go_back_within_a_step_only() -> None:
    vehicle = ideal()
    late = vehicle.x(10 * MS + 900)
    early = vehicle.x(10 * MS + 100)
    assert early == ideal().x(10 * MS + 100)
    assert vehicle.x(10 * MS + 900) == late
    with pytest.raises(LookBackError):
        vehicle.x(10 * MS - 1)
    vehicle.x(500 * MS)
    with pytest.raises(LookBackError):
        vehicle.x(10 * MS)


def test_inputs_may_not_change_what_was_seen() -> None:
    vehicle = Vehicle(PlantParameters())
    vehicle.x(10 * MS + 500)
    vehicle.set_servo_target(10 * MS + 200, 0.1)  # takes effect at 11 ms: nobody has seen that
    with pytest.raises(LookBackError):
        vehicle.set_servo_target(10 * MS, 0.1)
    vehicle.set_servo_target(30 * MS, 0.2)
    with pytest.raises(LookBackError):
        vehicle.set_supply(20 * MS, 7.0)


def test_without_power_the_tail_stops_and_stays_until_told_anew() -> None:
    vehicle = Vehicle(PlantParameters())
    vehicle.set_servo_target(0, 0.5)
    moving = vehicle.tail_rate(50 * MS)
    assert moving > 1.0
    vehicle.set_supply(50 * MS, 0.0)
    stopped = vehicle.tail_angle(300 * MS)
    assert 0.0 < stopped < 0.5
    assert vehicle.servo_current(300 * MS) == 0.0
    assert vehicle.tail_rate(300 * MS) == pytest.approx(0.0, abs=1e-9)
    vehicle.set_servo_target(310 * MS, 0.4)  # nobody hears that
    vehicle.set_supply(400 * MS, 7.4)
    assert vehicle.tail_angle(700 * MS) == pytest.approx(stopped, abs=1e-9)
    assert vehicle.servo_current(700 * MS) == pytest.approx(4.5e-3, abs=1e-3)
    vehicle.set_servo_target(700 * MS, 0.4)
    assert vehicle.tail_angle(1200 * MS) == pytest.approx(0.4, abs=5e-3)
    vehicle.set_servo_target(1200 * MS, None)
    assert vehicle.tail_angle(1500 * MS) == pytest.approx(0.4, abs=5e-3)


def test_power_that_comes_back_does_not_bring_the_target_back() -> None:
    vehicle = Vehicle(PlantParameters())
    vehicle.set_servo_target(0, 0.5)
    vehicle.set_supply(50 * MS, 0.0)
    vehicle.set_supply(200 * MS, 7.4)
    assert 0.0 < vehicle.tail_angle(900 * MS) < 0.4


def test_a_servo_that_heard_no_pulse_is_limp() -> None:
    assert Vehicle(PlantParameters()).truth(FS_PER_S)[:, 1:10] == pytest.approx(0.0)


def test_truth_is_sampled_on_its_grid() -> None:
    vehicle = Vehicle(PlantParameters(), Start(x_m=1.0, u_m_s=0.1))
    vehicle.set_servo_target(0, 0.3)
    truth = vehicle.truth(255 * MS)
    assert truth.shape == (26, len(TRUTH_COLUMNS))
    assert truth[:, 0].tolist() == [k / 100 for k in range(26)]
    assert truth[0, 1:5].tolist() == [1.0, 0.0, 0.0, 0.1]
    last = dict(zip(TRUTH_COLUMNS, truth[-1], strict=True))
    same = Vehicle(PlantParameters(), Start(x_m=1.0, u_m_s=0.1))
    same.set_servo_target(0, 0.3)
    assert last["x_m"] == same.x(250 * MS)
    assert last["tail_rate_rad_s"] == same.tail_rate(250 * MS)
    assert last["servo_current_a"] == same.servo_current(250 * MS)
    assert last["servo_current_a"] == supply_current_a(
        Servo(), 7.4, last["tail_rate_rad_s"], last["hinge_moment_n_m"]
    )
    # asking again, later, only adds
    assert np.array_equal(vehicle.truth(300 * MS)[:26], truth)


def test_an_ideal_tail_keeps_its_phase_across_beats() -> None:
    vehicle = ideal(TailBeat(0.0, 0.2, 0.9))
    vehicle.set_tail_beat(700 * MS, TailBeat(0.0, 0.2, 1.5))
    phase = 2 * math.pi * (0.9 * 0.7 + 1.5 * 0.3)
    assert vehicle.tail_angle(FS_PER_S) == pytest.approx(0.2 * math.sin(phase), abs=1e-12)


def test_each_kind_of_tail_takes_its_own_inputs() -> None:
    with pytest.raises(PlantError, match="beat"):
        ideal().set_servo_target(0, 0.1)
    with pytest.raises(PlantError, match="targets"):
        Vehicle(PlantParameters()).set_tail_beat(0, BEAT)


@pytest.mark.parametrize(
    "options", [{"step_fs": 0}, {"history_fs": 1_500_000_000_000}, {"supply_v": -1.0}]
)
def test_nonsense_is_refused(options: dict[str, float]) -> None:
    with pytest.raises(InvalidParameterError):
        Vehicle(PlantParameters(), **options)  # type: ignore[arg-type]
    with pytest.raises(InvalidParameterError, match="servo target"):
        Vehicle(PlantParameters()).set_servo_target(0, math.nan)


def test_divergence_stops_the_vehicle_with_its_time() -> None:
    vehicle = Vehicle(replace(wang2014(), servo=Servo(motor_lag_s=1e-4)))
    vehicle.set_servo_target(0, 0.3)
    with pytest.raises(DivergedError, match="too long") as caught:
        vehicle.advance(FS_PER_S)
    assert caught.value.time_s < 1.0


def test_a_divergence_ahead_of_the_looks_is_told_when_they_come_to_it() -> None:
    plant = wang2014()
    plant = replace(plant, hydrodynamics=replace(plant.hydrodynamics, lift=1000.0))
    vehicle = Vehicle(plant)
    vehicle.set_tail_beat(0, TailBeat.degrees(20, 40, 5))
    with pytest.raises(DivergedError) as caught:
        vehicle.advance(FS_PER_S)
    last = round(caught.value.time_s * 1000)
    vehicle = Vehicle(plant)
    vehicle.set_tail_beat(0, TailBeat.degrees(20, 40, 5))
    run = simulate(plant, TailProgramme.steady(TailBeat.degrees(20, 40, 5)), (last - 1) / 1000)
    for k in range(last):
        assert vehicle.u(k * MS) == run.u_m_s[k]
    for _ in range(2):
        with pytest.raises(DivergedError):
            vehicle.u(last * MS)


def test_a_tail_that_bends_shows_its_points_and_a_rigid_one_its_ends() -> None:
    soft = replace(
        PlantParameters(),
        servo=Servo(ideal=True),
        tail=Tail(segments=3, modulus_pa=1.48e9, thickness_m=3e-4, damping_s=0.079),
    )
    beat = TailBeat(0.1, 0.26, 0.9)
    vehicle = Vehicle(soft)
    vehicle.set_tail_beat(0, beat)
    assert vehicle.truth_columns == (*TRUTH_COLUMNS, BEND_COLUMN)
    truth = vehicle.truth(1500 * MS)
    points = vehicle.tail_points(1500 * MS, 100)
    assert points.shape == (100, 4, 2)
    # the same swim on the same grid, made by the integrator alone
    alone = simulate(soft, TailProgramme.steady(beat), 1.5, save_every=10)
    assert np.allclose(points, tail_points(soft, alone)[-100:], atol=1e-12)
    # every piece has its length; the base turns by α; the tip stands off the base's line
    pieces = np.linalg.norm(np.diff(points, axis=1), axis=2)
    assert np.allclose(pieces, soft.tail.length_m / 3, atol=1e-12)
    alpha = truth[-100:, TRUTH_COLUMNS.index("tail_angle_rad")]
    assert np.allclose(np.arctan2(-points[:, 1, 1], -points[:, 1, 0]), alpha, atol=1e-12)
    along = points[:, 1] / pieces[:, :1]
    off = along[:, 0] * points[:, -1, 1] - along[:, 1] * points[:, -1, 0]
    assert np.allclose(truth[-100:, -1], off, atol=1e-12)
    assert 1e-3 < np.abs(off).max() < 0.02
    rigid = ideal(beat)
    assert rigid.truth_columns == TRUTH_COLUMNS
    (joint, tip) = rigid.tail_points(0, 1)[0]
    assert joint.tolist() == [0.0, 0.0]
    assert np.allclose(tip, [-0.08 * np.cos(0.1), -0.08 * np.sin(0.1)], atol=1e-12)
