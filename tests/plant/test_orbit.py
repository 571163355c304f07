"""The steady motion found by shooting is the one that simulating ends in, and stable as it says."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.arrays import FloatArray
from plant.errors import InvalidParameterError, NoOrbitError, PlantError
from plant.integrate import simulate
from plant.layout import Column, Drive, State
from plant.metrics import steady_motion
from plant.no_orbit import not_closed
from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.packing import pack
from plant.parameters import Hydrodynamics, Linkage, PlantParameters, Servo, Tail, Walls, Water
from plant.rigid_tail import rates
from plant.robots import COEFFICIENT_SETS, fishbed_robot, flexible_tail, wang2014, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme

VELOCITIES = slice(Column.U, Column.R + 1)
TURNING = TailBeat.degrees(20, 15, 0.9)


def deviation(orbit: PeriodicOrbit, row: FloatArray) -> float:
    """Largest deviation of velocities from the orbit's begin, as a share of what they reach."""
    velocities = orbit.trajectory.rows[:, VELOCITIES]
    reached = np.abs(velocities).max(axis=0)
    reached[:2] = reached[:2].max()
    return float(np.max(np.abs(row[VELOCITIES] - velocities[0]) / reached))


def swim(p: PlantParameters, orbit: PeriodicOrbit, beats: int) -> FloatArray:
    """Rows at the beginnings of beats, simulated from rest on the orbit's grid."""
    steps = orbit.trajectory.time_s.size - 1
    duration = beats / orbit.beat.frequency_hz
    programme = TailProgramme.steady(orbit.beat)
    return simulate(p, programme, duration, orbit.step_s, save_every=steps).rows


# Published


def test_published_radius_and_thrust() -> None:
    turning = periodic_orbit(wang2014(), TURNING)
    assert turning.turn_radius_m == pytest.approx(0.2746, abs=5e-5)  # an independent program's
    straight = periodic_orbit(wang2014(), TailBeat.degrees(0, 15, 0.9))
    assert straight.mean_thrust_n == pytest.approx(0.755e-3, abs=0.5e-6)
    assert straight.turn_radius_m is None
    assert straight.turn_period_s is None
    assert straight.turn_rate_rad_s == 0.0


@pytest.mark.parametrize(
    ("frequency", "amplitude", "published"),
    [(3.1181, 18.7749, 0.112114), (1.0955, 17.6312, 0.036991), (3.8507, 24.1873, 0.178275)],
)
def test_speeds_of_table_5_2(frequency: float, amplitude: float, published: float) -> None:
    p = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-5"])
    orbit = periodic_orbit(p, TailBeat.degrees(0, amplitude, frequency))
    assert abs(round(orbit.speed_m_s * 1e6) - round(published * 1e6)) <= 1  # of the last digit


# Against simulation


@pytest.mark.parametrize("name", COEFFICIENT_SETS)
@pytest.mark.parametrize(
    "beat",
    [
        TailBeat.degrees(0, 15, 0.9),
        TailBeat.degrees(-20, 15, 0.9),
        TailBeat.degrees(50, 40, 0.5),
        TailBeat.degrees(5, 5, 5.0),
    ],
)
def test_simulating_ends_on_the_orbit(name: str, beat: TailBeat) -> None:
    p = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS[name])
    orbit = periodic_orbit(p, beat, 1.0 / (60 * beat.frequency_hz), tolerance=1e-10)
    assert orbit.stable
    rows = swim(p, orbit, math.ceil(100 + 25 * orbit.settling_beats))  # e⁻²⁵ is 1e-11
    assert deviation(orbit, rows[-1]) < 1e-9
    # and it did not begin there
    assert deviation(orbit, rows[0]) > 0.1


def test_with_its_servo_too() -> None:
    p = fishbed_robot()
    orbit = periodic_orbit(p, TURNING, 5e-3, tolerance=1e-10)
    rows = swim(p, orbit, 250)
    assert deviation(orbit, rows[-1]) < 1e-9
    tail = [Column.ALPHA, Column.ALPHA_DOT, Column.ALPHA_MEAN]
    assert rows[-1, tail] == pytest.approx(orbit.trajectory.rows[0, tail], rel=1e-9)
    assert orbit.floquet_multipliers.size == 6
    # the running mean of the tail angle forgets with its time constant, whatever the water does
    forgets = math.exp(-1.0 / (0.9 * p.hydrodynamics.bias_memory_s))
    assert np.min(np.abs(orbit.floquet_multipliers - forgets)) < 1e-6


def test_scipy_ends_on_the_orbit() -> None:
    packed, omega = pack(wang2014()), 2 * math.pi * 0.9
    drive = Drive(TURNING.bias_rad, TURNING.amplitude_rad, omega, 0.0, math.inf)

    def rhs(t: float, z: FloatArray) -> tuple[float, float, float]:
        state = State(0.0, 0.0, 0.0, float(z[0]), float(z[1]), float(z[2]), 0.0, 0.0, 0.0)
        got = rates(packed, drive, t, state)
        return got.u_dot, got.v_dot, got.r_dot

    orbit = periodic_orbit(wang2014(), TURNING)
    end = solve_ivp(
        rhs, (0.0, 100 / 0.9), [0.02, 0.0, 0.0], method="DOP853", rtol=1e-10, atol=1e-12
    )
    assert orbit.trajectory.rows[0, VELOCITIES] == pytest.approx(end.y[:, -1], rel=1e-7)


def test_metrics_are_those_of_a_long_simulation() -> None:
    orbit = periodic_orbit(wang2014(), TURNING, 2e-3)
    assert orbit.turn_period_s is not None
    assert orbit.turn_radius_m is not None
    duration = 100 / 0.9 + 2 * orbit.turn_period_s
    run = simulate(wang2014(), TailProgramme.steady(TURNING), duration, orbit.step_s)
    beats = math.floor(2 * orbit.turn_period_s * 0.9)
    long = steady_motion(run.time_s, run.x_m, run.y_m, run.heading_rad, 0.9, beats)
    # averaging over a beat takes the circle's own curvature along: its radius shrinks by ψ²/24
    psi = orbit.turn_rate_rad_s / 0.9
    shrunk = math.sin(psi / 2) / (psi / 2)
    assert shrunk * orbit.turn_radius_m == pytest.approx(long.turn_radius_m, rel=1e-5)
    assert orbit.turn_period_s == pytest.approx(long.turn_period_s, rel=1e-6)
    assert orbit.turn_rate_rad_s == pytest.approx(long.turn_rate_rad_s, rel=1e-6)
    assert shrunk * orbit.path_speed_m_s == pytest.approx(long.path_speed_m_s, rel=1e-5)
    # and a beat's net way is the chord of its arc
    assert orbit.speed_m_s == pytest.approx(shrunk * orbit.path_speed_m_s, rel=1e-9)


# Closed forms


def test_multipliers_meet_liouvilles_formula() -> None:
    # det P′ = exp ∫ tr ∂f/∂z dt, whatever the single multipliers are
    packed, omega = pack(wang2014()), 2 * math.pi * 0.9
    drive = Drive(TURNING.bias_rad, TURNING.amplitude_rad, omega, 0.0, math.inf)
    orbit = periodic_orbit(wang2014(), TURNING, 1 / (0.9 * 600))
    time_s, rows = orbit.trajectory.time_s, orbit.trajectory.rows
    traces = []
    for t, row in zip(time_s[:-1], rows[:-1], strict=True):
        trace = 0.0
        for i, name in enumerate(("u_dot", "v_dot", "r_dot")):
            ends = []
            for sign in (1.0, -1.0):
                z = row[VELOCITIES].copy()
                z[i] += sign * 1e-6
                state = State(0.0, 0.0, 0.0, float(z[0]), float(z[1]), float(z[2]), 0.0, 0.0, 0.0)
                ends.append(getattr(rates(packed, drive, float(t), state), name))
            trace += (ends[0] - ends[1]) / 2e-6
        traces.append(trace)
    determinant = math.exp(float(np.mean(traces)) / 0.9)
    product = np.prod(orbit.floquet_multipliers)
    assert product.imag == pytest.approx(0.0, abs=1e-12)
    assert product.real == pytest.approx(determinant, rel=2e-4)


def test_a_deviation_shrinks_by_the_largest_multiplier() -> None:
    orbit = periodic_orbit(wang2014(), TURNING, 5e-3)
    rows = swim(wang2014(), orbit, 60)
    ratio = deviation(orbit, rows[55]) / deviation(orbit, rows[45])
    assert ratio ** (1 / 10) == pytest.approx(abs(orbit.floquet_multipliers[0]), rel=1e-3)
    assert orbit.settling_beats == pytest.approx(-1 / math.log(ratio ** (1 / 10)), rel=0.01)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_without_a_clock_in_the_water_speed_grows_with_frequency(share: float) -> None:
    # all forces of an ideal tail are of second order in velocities: time can be scaled
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(body_motion_in_tail=share))
    slow, fast = (
        periodic_orbit(p, TailBeat.degrees(20, 15, f), 1 / (200 * f), tolerance=1e-11)
        for f in (0.7, 2.8)
    )
    assert fast.speed_m_s == pytest.approx(4 * slow.speed_m_s, rel=1e-9)
    assert fast.turn_rate_rad_s == pytest.approx(4 * slow.turn_rate_rad_s, rel=1e-9)
    assert fast.turn_radius_m == pytest.approx(slow.turn_radius_m, rel=1e-9)
    assert fast.mean_thrust_n == pytest.approx(16 * slow.mean_thrust_n, rel=1e-9)
    assert fast.mean_abs_beta_rad == pytest.approx(slow.mean_abs_beta_rad, rel=1e-9)
    assert fast.floquet_multipliers == pytest.approx(slow.floquet_multipliers, rel=1e-6)


def test_left_and_right_turns_mirror_each_other() -> None:
    right, left = (
        periodic_orbit(wang2014(), TailBeat.degrees(b, 15, 0.9), tolerance=1e-11) for b in (30, -30)
    )
    assert right.turn_rate_rad_s < 0.0
    assert left.turn_rate_rad_s == pytest.approx(-right.turn_rate_rad_s, rel=1e-9)
    assert left.turn_radius_m == pytest.approx(right.turn_radius_m, rel=1e-9)
    assert left.speed_m_s == pytest.approx(right.speed_m_s, rel=1e-9)


def test_a_small_bias_turns_in_a_wide_circle() -> None:
    straight = periodic_orbit(wang2014(), TailBeat.degrees(0, 15, 0.9), 5e-3)
    wide = [periodic_orbit(wang2014(), TailBeat.degrees(b, 15, 0.9), 5e-3) for b in (0.01, 0.02)]
    assert wide[0].turn_radius_m is not None
    assert wide[0].turn_radius_m > 100.0
    assert wide[0].turn_radius_m == pytest.approx(2 * (wide[1].turn_radius_m or 0.0), rel=1e-3)
    assert wide[0].speed_m_s == pytest.approx(straight.speed_m_s, rel=1e-5)


def test_a_beat_from_its_start_is_the_orbit() -> None:
    orbit = periodic_orbit(wang2014(), TURNING)
    first, last = orbit.trajectory.rows[0], orbit.trajectory.rows[-1]
    assert last[VELOCITIES] == pytest.approx(first[VELOCITIES], rel=1e-7)
    assert first[:3].tolist() == [0.0, 0.0, 0.0]
    again = simulate(
        wang2014(), TailProgramme.steady(TURNING), 1 / 0.9, orbit.step_s, start=orbit.start
    )
    assert np.array_equal(again.rows, orbit.trajectory.rows)


@pytest.mark.parametrize(
    "change",
    [
        {"servo": Servo(ideal=True, command_delay_s=0.1, command_lag_s=0.05)},
        {"servo": Servo(ideal=True, slowness_s_rad=0.8, extra_dead_band_rad=0.02)},
        {"servo": Servo(extra_dead_band_rad=0.02, slowness_s_rad=0.8)},
        {"linkage": Linkage(gain_error=0.1, offset_rad=0.1, play_rad=0.05)},
    ],
)
def test_whatever_is_wrong_with_the_servo(change: dict[str, Any]) -> None:
    p = replace(wang2014(), **change)
    orbit = periodic_orbit(p, TURNING, 2e-3, tolerance=1e-10)
    rows = swim(p, orbit, math.ceil(100 + 25 * orbit.settling_beats))
    assert deviation(orbit, rows[-1]) < 1e-9
    # and it moves the tail
    assert orbit.turn_radius_m != pytest.approx(0.2746, rel=1e-4)


@pytest.mark.parametrize("tail", [flexible_tail(5), flexible_tail(1, 3)], ids=["segments", "beam"])
def test_a_swim_with_a_flexible_tail_settles_by_the_largest_multiplier(tail: Tail) -> None:
    # the multipliers come from the derivative of the steps; the swim knows nothing of it
    robot, beat, steps = wang2014_flexible(tail), TailBeat.degrees(20.0, 13.6, 0.9), 200
    step_s = 1.0 / (0.9 * steps)
    orbit = periodic_orbit(robot, beat, step_s)
    swim = simulate(robot, TailProgramme.steady(beat), 40.0 / 0.9, step_s, save_every=steps)
    at_start = orbit.trajectory.u_m_s[0]
    deviation = np.abs(swim.u_m_s - at_start)
    ratio = (deviation[35] / deviation[20]) ** (1.0 / 15.0)
    assert ratio == pytest.approx(abs(orbit.floquet_multipliers[0]), rel=3e-3)


@pytest.mark.parametrize("tail", [flexible_tail(3), flexible_tail(1, 2)], ids=["segments", "beam"])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_flexible_tail_has_its_orbit_too(tail: Tail, share: float) -> None:
    published = wang2014_flexible(tail)
    moving = replace(published.hydrodynamics, body_motion_in_tail=share)
    p = replace(published, hydrodynamics=moving)
    orbit = periodic_orbit(p, TURNING, 1 / (0.9 * 40))
    assert orbit.stable
    assert orbit.trajectory.rows.shape == (41, 22 + 4)
    rows = swim(p, orbit, math.ceil(60 + 25 * orbit.settling_beats))
    assert deviation(orbit, rows[-1]) < 1e-8
    assert rows[-1, 21:] == pytest.approx(orbit.trajectory.rows[0, 21:], rel=1e-7, abs=1e-9)
    # velocities, and of each joint or mode its bend and its rate, which are forgotten at once
    assert orbit.floquet_multipliers.size == 3 + 4
    assert abs(orbit.floquet_multipliers[-1]) < 1e-2


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"water": Water(shear_x_per_y_s=0.1)}, "water.shear_x_per_y_s"),
        ({"walls": Walls(drag_rise=1.0, x_min_m=0.0)}, "walls.drag_rise"),
        ({"linkage": Linkage(fade_per_s=0.01)}, "linkage.fade_per_s"),
    ],
)
def test_a_motion_that_knows_place_or_time_is_never_steady(
    change: dict[str, Any], field: str
) -> None:
    with pytest.raises(InvalidParameterError, match="no motion is steady") as caught:
        periodic_orbit(replace(wang2014(), **change), TURNING)
    assert caught.value.field == field


def test_a_current_changes_nothing() -> None:
    still = periodic_orbit(wang2014(), TURNING, 5e-3)
    flow = replace(wang2014(), water=Water(current_x_m_s=0.1, current_y_m_s=-0.2))
    assert np.array_equal(
        periodic_orbit(flow, TURNING, 5e-3).trajectory.rows, still.trajectory.rows
    )


# Every beat of chapters 3 to 5; and what has no steady motion


@pytest.mark.parametrize("name", COEFFICIENT_SETS)
@pytest.mark.parametrize("robot", [wang2014, fishbed_robot])
def test_every_combination_has_its_orbit(name: str, robot: object) -> None:
    assert callable(robot)
    p = replace(robot(), hydrodynamics=COEFFICIENT_SETS[name])
    for frequency in (0.5, 1.6, 5.0):
        for amplitude in (5, 15, 40):
            for bias in (-50, 0, 10, 30, 50):
                beat = TailBeat.degrees(bias, amplitude, frequency)
                orbit = periodic_orbit(p, beat, 1 / (30 * frequency))
                assert orbit.stable, beat
                assert orbit.error <= 1e-8
                assert np.mean(orbit.trajectory.u_m_s) > 0.0
                assert (orbit.turn_radius_m is None) == (bias == 0)


def test_a_heavy_hull_steers_no_steady_course_and_its_orbit_says_so() -> None:
    p = replace(wang2014(), body=replace(wang2014().body, mass_kg=30.0))
    orbit = periodic_orbit(p, TURNING, 5e-3)
    assert not orbit.stable
    assert orbit.settling_beats == math.inf
    assert deviation(orbit, swim(p, orbit, 3000)[-1]) > 0.1


STEPS_S = (0.1, 1e-2, 5e-3, 2e-3, 1e-3)
NO_DRAG = {"drag": 0.0, "lift": 0.0, "yaw_drag_n_m_s2": 0.0}


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize("bias_deg", [0.0, 20.0])
def test_a_body_that_nothing_slows_has_no_steady_motion_on_any_grid(
    bias_deg: float, step_s: float
) -> None:
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(body_motion_in_tail=0.0, **NO_DRAG))
    for tail in (p.tail, flexible_tail(5)):
        with pytest.raises(NoOrbitError, match="nothing slows the body") as caught:
            periodic_orbit(replace(p, tail=tail), TailBeat.degrees(bias_deg, 15, 0.9), step_s)
        assert caught.value.closure > 0.0
    assert isinstance(caught.value, PlantError)
    assert isinstance(caught.value, ArithmeticError)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_what_only_the_tail_slows_is_refused_where_it_wanders_and_found_where_it_settles(
    step_s: float,
) -> None:
    p = replace(wang2014(), hydrodynamics=Hydrodynamics(**NO_DRAG))
    straight, turning = TailBeat.degrees(0, 15, 0.9), TailBeat.degrees(20, 15, 0.9)
    # it wanders: after 400 beats it still swims forwards and backwards in turn
    with pytest.raises(NoOrbitError):
        periodic_orbit(p, straight, step_s)
    orbit = periodic_orbit(p, turning, step_s)
    assert orbit.stable
    assert orbit.speed_m_s == pytest.approx(0.06002, rel=1e-3)


def test_a_beat_within_the_dead_band_moves_nothing() -> None:
    with pytest.raises(NoOrbitError, match="a servo that does not move at all"):
        periodic_orbit(fishbed_robot(), TailBeat.degrees(20, 0.1, 0.9))


def test_a_beam_too_stiff_for_the_search_is_named_and_not_said_to_grow() -> None:
    beam = Tail(modes=6, modulus_pa=1e13, thickness_m=1.0)
    beat = TailBeat.degrees(20, 15, 0.9)
    orbit = periodic_orbit(replace(wang2014(), tail=beam), beat, 5e-3)
    rigid = periodic_orbit(wang2014(), beat, 5e-3)
    assert orbit.speed_m_s == pytest.approx(rigid.speed_m_s, rel=1e-3)
    with pytest.raises(NoOrbitError, match="too stiff") as caught:
        periodic_orbit(replace(wang2014(), tail=replace(beam, damping_s=0.079)), beat, 5e-3)
    assert "grows" not in caught.value.reason


@pytest.mark.parametrize(
    ("gap", "said", "unsaid"),
    [
        (math.nan, "coarse grid, but with steps of 0.005 s", "grows"),
        (3.2e-32, "(to 3.2e-32 of the scales)", "grows"),
        (math.inf, "left all bounds", "closes"),
        (0.5, "still changed the velocities by 0.5", "closes"),
    ],
)
def test_a_reason_never_contradicts_its_number(gap: float, said: str, unsaid: str) -> None:
    words = not_closed(gap, 5e-3, 1e-8)
    assert said in words
    assert unsaid not in words


@pytest.mark.parametrize(
    ("beat", "change", "field"),
    [
        (TailBeat.degrees(20, 0, 0.9), {}, "periodic_orbit.beat.amplitude_rad"),
        (TailBeat.degrees(20, 15, 0.0), {}, "periodic_orbit.beat.frequency_hz"),
        (TURNING, {"step_s": 0.0}, "periodic_orbit.step_s"),
        (TURNING, {"tolerance": 0.0}, "periodic_orbit.tolerance"),
        (TURNING, {"speed_limit_rad_s": 0.0}, "periodic_orbit.speed_limit_rad_s"),
    ],
)
def test_nonsense_is_refused(beat: TailBeat, change: dict[str, float], field: str) -> None:
    with pytest.raises(InvalidParameterError) as caught:
        periodic_orbit(wang2014(), beat, **change)
    assert caught.value.field == field
