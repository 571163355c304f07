"""The stiff integrator: order, agreement with SciPy, pieces equal to the whole, divergence."""

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.arrays import FloatArray
from plant.effects import with_effects
from plant.errors import DivergedError
from plant.flexible import segments
from plant.flexible.layout import LOADS, work_shape
from plant.flexible.rates import flexible_rates
from plant.integrate import motion_of, simulate
from plant.layout import ROW, STATE
from plant.packing import pack
from plant.parameters import PlantParameters, Servo, Tail
from plant.robots import flexible_tail, wang2014, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start, Trajectory
from plant.vehicle import FS_PER_S, Vehicle

Robot = Callable[..., PlantParameters]
Distance = Callable[[Trajectory, Trajectory], float]
TURN = TailProgramme.steady(TailBeat.degrees(20.0, 13.6, 0.9))
AHEAD = TailProgramme.steady(TailBeat.degrees(0.0, 13.6, 0.9))


def smooth(p: PlantParameters) -> PlantParameters:
    """Without r|r|, whose kink costs order at every change of sign."""
    return replace(p, hydrodynamics=replace(p.hydrodynamics, yaw_drag_n_m_s2=0.0))


def order(p: PlantParameters, steps_s: tuple[float, float], distance: Distance) -> float:
    paths = [simulate(p, TURN, 2.0, h, save_every=round(0.1 / h)) for h in (*steps_s, 5e-4)]
    errors = [distance(path, paths[2]) for path in paths[:2]]
    return math.log(errors[0] / errors[1]) / math.log(steps_s[0] / steps_s[1])


def test_order_five_where_nothing_is_stiff(robot: Robot, distance: Distance) -> None:
    soft = replace(flexible_tail(3), modulus_pa=2e8, damping_s=0.01)
    assert order(smooth(robot(soft)), (0.02, 0.01), distance) == pytest.approx(5.0, abs=0.25)


@pytest.mark.parametrize("tail", [flexible_tail(5), flexible_tail(1, 4)])
def test_order_about_four_on_the_stiff_tails(tail: Tail, robot: Robot, distance: Distance) -> None:
    # the stage order plus one is 4, the classical order 5: stiff theory puts it between. The fast
    # modes of the beam, still dying out, keep it at the lower end
    assert 3.7 < order(smooth(robot(tail)), (0.01, 0.005), distance) < 5.1


def test_ten_milliseconds_are_accurate_to_a_millionth(robot: Robot, distance: Distance) -> None:
    p = robot(flexible_tail(5))
    coarse = simulate(p, AHEAD, 30.0, 0.01, save_every=10)
    fine = simulate(p, AHEAD, 30.0, 0.001, save_every=100)
    assert distance(coarse, fine) < 3e-7


def test_agrees_with_scipy_at_tight_tolerance(robot: Robot) -> None:
    # DOP853 shares nothing with a collocation method; three segments let it keep up
    p = smooth(robot(flexible_tail(3)))
    path = simulate(p, TURN, 4.0, 0.002)
    parts, packed, drive = segments.table(p), pack(p), TURN.segments(1e-3)[0][1]
    out, work = np.zeros(STATE + 4 + LOADS), np.zeros(work_shape(2))

    def rhs(t: float, y: FloatArray) -> FloatArray:
        flexible_rates(packed, drive, t, y, out, parts, 0, work)
        return out[: STATE + 4].copy()

    start = np.concatenate((path.rows[0, :6], np.zeros(STATE - 6), path.rows[0, ROW:]))
    reference = solve_ivp(rhs, (0.0, 4.0), start, method="DOP853", rtol=1e-11, atol=1e-14)
    got = path.rows[-1, [*range(6), *range(ROW, ROW + 4)]]
    kept = [*range(6), *range(STATE, STATE + 4)]
    scale = np.abs(reference.y[kept]).max(axis=1)
    assert np.abs(got - reference.y[kept, -1]) / scale == pytest.approx(np.zeros(10), abs=1e-9)


@pytest.mark.parametrize("tail", [flexible_tail(4), flexible_tail(1, 2)])
@pytest.mark.parametrize("servo", [Servo(ideal=True), Servo()])
def test_advancing_in_pieces_is_advancing_at_once_to_the_bit(tail: Tail, servo: Servo) -> None:
    motion = motion_of(replace(wang2014_flexible(tail), servo=servo), 2e-3)
    drive = np.array(TURN.segments(2e-3)[0][1])
    start = motion.state(np.array(Start(u_m_s=0.1).state()))
    motion.straighten(drive, start)
    whole, pieces = (np.empty((301, motion.whole_width)) for _ in range(2))
    assert motion.march(drive, 0, 0, 300, start.copy(), whole, 0, 1) == 300
    state = start.copy()
    cuts = [0, 1, 37, 38, 200, 300]
    for first, last in pairwise(cuts):
        assert motion.march(drive, 0, first, last, state, pieces, 0, 1) == last
        # from the row alone, as a vehicle goes on
        state = np.full_like(state, np.nan)
        motion.resume(pieces[last], state)
    assert np.array_equal(whole, pieces)


@pytest.mark.parametrize("tail", [flexible_tail(5), flexible_tail(1, 3)])
def test_on_the_grid_a_vehicle_is_the_plain_simulation_to_the_bit(tail: Tail, robot: Robot) -> None:
    p = robot(tail)
    vehicle, other = Vehicle(p), Vehicle(p)
    for one in (vehicle, other):
        one.set_tail_beat(0, TailBeat.degrees(20.0, 13.6, 0.9))
    plain = simulate(p, TURN, 3.0)
    seen = [vehicle.x(k * FS_PER_S // 1000) for k in range(0, 3000, 20)]
    assert seen == plain.x_m[:3000:20].tolist()
    other.advance(2 * FS_PER_S)
    assert other.heading(2 * FS_PER_S) == plain.heading_rad[2000]


def test_inputs_reach_a_vehicle_with_a_flexible_tail() -> None:
    p = replace(wang2014_flexible(), servo=Servo())
    left, right = Vehicle(p), Vehicle(p)
    for k in range(150):
        angle = 0.3 * math.sin(2 * math.pi * 0.9 * k * 0.02)
        left.set_servo_target(k * FS_PER_S // 50, angle)
        right.set_servo_target(k * FS_PER_S // 50, angle + (0.2 if k > 75 else 0.0))
    end = 3 * FS_PER_S
    assert left.x(FS_PER_S) == right.x(FS_PER_S)
    assert abs(left.heading(end) - right.heading(end)) > 0.01
    assert left.u(end) > 0.005
    assert np.isfinite(left.truth(end)).all()


def test_a_tail_that_folds_up_is_named_and_no_step_advised(robot: Robot) -> None:
    wild = TailProgramme.steady(TailBeat.degrees(30.0, 60.0, 4.0))
    for step_s in (1e-3, 1e-4):
        with pytest.raises(
            DivergedError, match=r"folded up .*a finer step does not help"
        ) as caught:
            simulate(robot(flexible_tail(5)), wild, 2.0, step_s)
        assert 0.0 < caught.value.time_s < 1.0
        assert np.isfinite(caught.value.state).all()
        assert "try these" not in caught.value.cause


@pytest.mark.parametrize("servo", [Servo(ideal=True), Servo()])
@pytest.mark.parametrize(("compliance", "step_s"), [(1e-6, 5e-3), (2e-6, 5e-3), (1e-5, 1e-2)])
def test_very_stiff_joints_swim_as_a_rigid_tail_does(
    servo: Servo, compliance: float, step_s: float
) -> None:
    rigid = replace(wang2014(), servo=servo)
    stiff = with_effects(rigid, {"tail_flexibility": {"compliance_rad_n_m": compliance}})
    assert stiff.tail.joint_stiffness_n_m == pytest.approx(1.0 / compliance)
    got = simulate(stiff, TURN, 3.0, step_s).rows[-1, :6]
    wanted = simulate(rigid, TURN, 3.0, 5e-4).rows[-1, :6]
    # the ideal servo's path is smooth; the real one's loop is what 10 ms resolve to 1e-6
    assert np.abs(got - wanted).max() < (5e-8 if servo.ideal else 4e-6)


@pytest.mark.parametrize(
    ("tail", "duration_s"),
    [
        (Tail(segments=20, modulus_pa=7e10, thickness_m=0.01, damping_s=0.079), 2.0),
        (Tail(segments=20, joint_stiffness_n_m=1e6, damping_s=0.079), 2.0),
        (Tail(segments=64, modulus_pa=7e10, thickness_m=3e-3, damping_s=0.079), 0.2),
    ],
)
def test_many_stiff_segments_swim_as_a_rigid_tail_does(tail: Tail, duration_s: float) -> None:
    rigid = replace(wang2014(), servo=Servo(ideal=True))
    got = simulate(replace(rigid, tail=tail), TURN, duration_s, 0.01).rows[-1, :6]
    wanted = simulate(rigid, TURN, duration_s, 5e-4).rows[-1, :6]
    assert np.abs(got - wanted).max() < 1e-5


def test_joints_too_stiff_for_the_arithmetic_are_named() -> None:
    # 1e9 N·m/rad: no material; the bound at 10 ms is 6.7e8
    tail = Tail(segments=5, modulus_pa=7.68e12, thickness_m=0.1, damping_s=0.079)
    with pytest.raises(DivergedError) as caught:
        simulate(replace(wang2014(), tail=tail), TURN, 1.0, 0.01)
    assert "stiffness of 1e+09 N·m/rad" in caught.value.cause
    assert "rigid" in caught.value.cause


def test_a_state_that_is_no_number_stops_at_once() -> None:
    motion = motion_of(wang2014_flexible(), 1e-3)
    drive = np.array(TURN.segments(1e-3)[0][1])
    for place in (3, STATE, STATE + 7):
        state = motion.state(np.array(Start().state()))
        state[place] = np.nan
        rows = np.zeros((11, motion.width))
        assert motion.march(drive, 0, 0, 10, state, rows, 0, 1) == 0


def test_a_rigid_run_loads_nothing_of_this() -> None:
    code = (
        "import sys; from plant.integrate import simulate; from plant.robots import wang2014; "
        "from plant.tail_input import *; from plant.vehicle import Vehicle; "
        "simulate(wang2014(), TailProgramme.steady(TailBeat()), 0.01); Vehicle(wang2014()); "
        "print([name for name in sys.modules if name.startswith('plant.flexible')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
