"""Command → delay → lag → servo → play → linkage → tail, against closed forms of each piece."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.arrays import FloatArray
from plant.errors import InvalidParameterError
from plant.integrate import simulate
from plant.layout import Column
from plant.orbit import periodic_orbit
from plant.parameters import PlantParameters
from plant.robots import fishbed_robot, wang2014
from plant.servo import supply_current_a
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Trajectory
from plant.vehicle import FS_PER_S, TRUTH_COLUMNS, Vehicle

MS = FS_PER_S // 1000
BEAT = TailBeat.degrees(20, 15, 0.9)
OMEGA = 2 * math.pi * 0.9
AMPLITUDE, BIAS = math.radians(15), math.radians(20)
STEADY = TailProgramme.steady(BEAT)
CHANGING = TailProgramme(
    (BEAT, TailBeat.degrees(-10, 20, 1.3), TailBeat.degrees(5, 0, 0)), (0.0, 1.7, 3.2)
)


def changed(plant: PlantParameters, **fields: float) -> PlantParameters:
    """The plant with fields of its servo or linkage set."""
    servo = {name: value for name, value in fields.items() if hasattr(plant.servo, name)}
    linkage = {name: value for name, value in fields.items() if name not in servo}
    return replace(
        plant,
        servo=replace(plant.servo, **servo),
        linkage=replace(plant.linkage, **linkage),
    )


def swum(duration_s: float = 5.0, programme: TailProgramme = STEADY, **fields: float) -> Trajectory:
    return simulate(changed(wang2014(), **fields), programme, duration_s)


def command(time_s: FloatArray) -> FloatArray:
    return BIAS + AMPLITUDE * np.sin(OMEGA * time_s)


# Delay and lag


def test_a_lag_has_the_amplitude_and_phase_of_a_first_order_system() -> None:
    tau = 0.12
    run = swum(command_lag_s=tau)
    gain, late = 1 / math.hypot(1, OMEGA * tau), math.atan(OMEGA * tau)
    expected = BIAS + gain * AMPLITUDE * np.sin(OMEGA * run.time_s - late)
    np.testing.assert_allclose(run.tail_angle_rad, expected, atol=1e-14)
    rate = gain * AMPLITUDE * OMEGA * np.cos(OMEGA * run.time_s - late)
    np.testing.assert_allclose(run.column(Column.ALPHA_DOT), rate, atol=1e-13)


def test_across_changes_a_lag_is_the_differential_equation() -> None:
    tau = 0.2
    run = swum(programme=CHANGING, command_lag_s=tau)

    def told(t: float) -> float:
        if t < 1.7:
            return BIAS + AMPLITUDE * math.sin(OMEGA * t)
        if t < 3.2:
            phase = OMEGA * 1.7 + 2 * math.pi * 1.3 * (t - 1.7)
            return math.radians(-10) + math.radians(20) * math.sin(phase)
        return math.radians(5)

    value = float(run.tail_angle_rad[0])
    for begin, end in ((0.0, 1.7), (1.7, 3.2), (3.2, 5.0)):
        inside = (run.time_s >= begin - 1e-9) & (run.time_s < end - 1e-9)
        times = np.append(run.time_s[inside], end)
        solved = solve_ivp(
            lambda t, y, e=end: (told(min(t, e - 1e-12)) - y) / tau,
            (times[0], end),
            [value],
            t_eval=times,
            rtol=1e-10,
            atol=1e-12,
        )
        np.testing.assert_allclose(run.tail_angle_rad[inside], solved.y[0, :-1], atol=3e-7)
        value = float(solved.y[0, -1])
    alpha, rate = run.tail_angle_rad, run.column(Column.ALPHA_DOT)
    inner = run.time_s[1:-1]
    smooth = (np.abs(inner - 1.7) > 2e-3) & (np.abs(inner - 3.2) > 2e-3)
    slope = (alpha[2:] - alpha[:-2]) / 2e-3
    np.testing.assert_allclose(slope[smooth], rate[1:-1][smooth], atol=1e-4)


@pytest.mark.parametrize("name", ["command_lag_s", "command_delay_s"])
def test_a_lag_or_delay_near_zero_is_near_the_baseline(name: str) -> None:
    plain = swum().rows[-1, : Column.R + 1]
    small, half = (swum(**{name: value}).rows[-1, : Column.R + 1] for value in (1e-5, 5e-6))
    np.testing.assert_allclose(small, plain, atol=1e-4)
    np.testing.assert_allclose(small - plain, 2 * (half - plain), atol=1e-7)
    assert np.all(np.isfinite(swum(programme=CHANGING, **{name: 1e-12}).rows))


def test_a_delay_moves_a_steady_beat_in_time_and_each_change_to_the_next_grid_point() -> None:
    delay = 0.0413
    run = swum(programme=CHANGING, command_delay_s=delay)
    t = run.time_s - delay
    steady = t < 1.7 - 1e-9
    np.testing.assert_allclose(run.tail_angle_rad[steady], command(t[steady]), atol=1e-14)
    second = (t >= 1.7 - 1e-9) & (t < 3.2 - 1e-9)
    phase = OMEGA * 1.7 + 2 * math.pi * 1.3 * (t[second] - 1.7)
    expected = math.radians(-10) + math.radians(20) * np.sin(phase)
    np.testing.assert_allclose(run.tail_angle_rad[second], expected, atol=1e-13)
    last = t >= 3.2 - 1e-9
    assert last.sum() > 1000
    assert np.all(run.tail_angle_rad[last] == math.radians(5))


# The servo


def test_a_rate_limit_makes_a_triangle() -> None:
    speed = 0.3 * AMPLITUDE * OMEGA
    run = swum(12.0, slowness_s_rad=1 / speed)
    late = run.time_s > 12.0 - 2 / 0.9
    angle, rate = run.tail_angle_rad[late], run.column(Column.ALPHA_DOT)[late]
    assert np.max(np.abs(run.column(Column.ALPHA_DOT))) <= speed * (1 + 1e-12)
    # it runs at its limit, but for some motor lags at each end
    assert np.mean(np.abs(rate) > 0.999 * speed) > 0.92
    # half a period up, half a period down
    assert np.ptp(angle) == pytest.approx(speed * 0.5 / 0.9, rel=0.02)
    assert 0.5 * (angle.max() + angle.min()) == pytest.approx(BIAS, abs=2e-3)


def test_a_servo_that_is_not_bound_is_the_ideal_one() -> None:
    plain = swum()
    unbound = swum(slowness_s_rad=0.5 / (AMPLITUDE * OMEGA))
    np.testing.assert_allclose(unbound.tail_angle_rad, plain.tail_angle_rad, atol=1e-9)
    np.testing.assert_allclose(
        unbound.rows[:, : Column.R + 1], plain.rows[:, : Column.R + 1], atol=5e-8
    )


@pytest.mark.parametrize("make", [wang2014, fishbed_robot])
def test_a_dead_band_cuts_the_peaks_and_then_follows_at_its_distance(
    make: Callable[[], PlantParameters],
) -> None:
    band = 0.05
    plant = changed(make(), extra_dead_band_rad=band)
    run, plain = (simulate(p, STEADY, 8.0) for p in (plant, make()))
    late = run.time_s > 8.0 - 2 / 0.9
    reach = 0.5 * np.ptp(run.tail_angle_rad[late])
    assert reach == pytest.approx(0.5 * np.ptp(plain.tail_angle_rad[late]) - band, abs=2e-3)
    if make is wang2014:
        moving = np.abs(run.column(Column.ALPHA_DOT)) > 0.3 * AMPLITUDE * OMEGA
        distance = np.abs(command(run.time_s) - run.tail_angle_rad)[moving & (run.time_s > 1)]
        ahead = plant.servo.motor_lag_s * AMPLITUDE * OMEGA  # at first a motor lag ahead
        np.testing.assert_allclose(distance, band, atol=ahead)
        assert np.median(distance) == pytest.approx(band, abs=1e-5)
        rests = np.abs(run.column(Column.ALPHA_DOT)[late]) < 1e-4
        assert np.mean(rests) > 0.1  # at the peaks


EDGES = [
    ({"extra_dead_band_rad": 0.02}, 4e-7),
    ({"play_rad": 0.04}, 4e-7),
    ({"slowness_s_rad": 0.8}, 4e-7),
    ({"slowness_s_rad": 1.2, "play_rad": 0.05, "extra_dead_band_rad": 0.02}, 1e-6),
]


@pytest.mark.parametrize(("fields", "error"), EDGES)
def test_the_edges_of_band_play_and_limit_cost_no_more_than_kinks(
    fields: dict[str, float], error: float
) -> None:
    plant = changed(wang2014(), **fields)
    exact = simulate(plant, STEADY, 10.0, 5e-5, save_every=200).rows[-1, : Column.R + 1]
    for step_s, most in ((1e-3, error), (2e-3, 5 * error), (5e-3, 100 * error)):
        reached = simulate(plant, STEADY, 10.0, step_s).rows[-1, : Column.R + 1]
        assert np.max(np.abs(reached - exact)) < most


@pytest.mark.parametrize("name", ["extra_dead_band_rad", "play_rad"])
@pytest.mark.parametrize("programme", [STEADY, CHANGING])
def test_a_small_band_or_play_changes_the_motion_in_proportion(
    name: str, programme: TailProgramme
) -> None:
    plain = swum(5.0, programme).rows[-1, : Column.R + 1]
    change = [
        float(np.max(np.abs(swum(5.0, programme, **{name: x}).rows[-1, : Column.R + 1] - plain)))
        for x in (1e-3, 1e-4, 1e-5, 1e-6)
    ]
    for larger, smaller in itertools.pairwise(change):
        assert smaller == pytest.approx(0.1 * larger, rel=0.5)


@pytest.mark.parametrize("make", [wang2014, fishbed_robot])
def test_play_makes_the_hysteresis_loop_of_its_width(make: Callable[[], PlantParameters]) -> None:
    play = 0.1
    run = simulate(changed(make(), play_rad=play), STEADY, 8.0)
    late = run.time_s > 8.0 - 1 / 0.9 - 1e-9
    servo, tail = run.column(Column.SERVO)[late], run.tail_angle_rad[late]
    half = 0.5 * np.ptp(servo)
    assert 0.5 * np.ptp(tail) == pytest.approx(half - play / 2, abs=1e-3)
    area = abs(np.trapezoid(tail, servo))  # a parallelogram: play wide, 2 (A − play/2) high
    assert area == pytest.approx(play * 2 * (half - play / 2), rel=0.03)
    assert np.max(np.abs(servo - tail)) < play / 2 * 1.1


def test_without_a_largest_speed_a_jump_of_the_command_takes_all_along() -> None:
    programme = TailProgramme((TailBeat(0.0), TailBeat(0.5)), (0.0, 0.01))
    plain = swum(0.02, programme)
    held = swum(0.02, programme, extra_dead_band_rad=0.03, play_rad=0.02)
    assert plain.tail_angle_rad[10] == 0.5
    assert held.tail_angle_rad[10] == pytest.approx(0.5 - 0.03 - 0.01)
    limited = swum(0.02, programme, slowness_s_rad=0.1)
    # up to speed within half a motor lag; a sweep of 50 ms is none that jumps
    gone = 0.01 - 0.005 * (1.0 - math.exp(-0.01 / 0.005))
    assert limited.tail_angle_rad[20] == pytest.approx(10.0 * gone, rel=2e-3)


SWEPT = ["command_lag_s", "slowness_s_rad"]


@pytest.mark.parametrize("name", SWEPT)
@pytest.mark.parametrize("value", [1e-4, 1e-3, 3e-3, 0.01, 0.03])
def test_what_a_tail_does_at_a_jump_knows_no_step(name: str, value: float) -> None:
    plant = changed(wang2014(), **{name: value})
    exact, *coarse = (
        simulate(plant, CHANGING, 5.0, step_s).rows[-1, : Column.R + 1]
        for step_s in (1e-4, 5e-4, 1e-3, 2e-3)
    )
    for reached in coarse:
        np.testing.assert_allclose(reached, exact, atol=2e-3)


@pytest.mark.parametrize("name", SWEPT)
def test_with_the_sweep_its_impulse_vanishes(name: str) -> None:
    plain = swum(5.0, CHANGING).rows[-1, : Column.R + 1]
    change = [
        float(np.max(np.abs(swum(5.0, CHANGING, **{name: x}).rows[-1, : Column.R + 1] - plain)))
        for x in (3e-3, 1e-3, 3e-4, 1e-4, 1e-5)
    ]
    assert change == sorted(change, reverse=True)
    assert change[-1] < 1e-4


# The linkage


def test_offset_gain_and_fade_act_on_the_deflection_with_exact_derivatives() -> None:
    g, k, delta = 0.2, 0.15, -0.07
    run = swum(8.0, gain_error=g, fade_per_s=k, offset_rad=delta)
    t = run.time_s
    left = np.maximum(0.0, 1 - k * t)
    np.testing.assert_allclose(run.tail_angle_rad, (1 + g) * left * command(t) + delta, atol=1e-13)
    h = 1e-3
    inside = slice(1, 6600)  # the fade ends at 6.67 s
    alpha = run.tail_angle_rad
    slope = (alpha[2:] - alpha[:-2]) / (2 * h)
    bend = (alpha[2:] - 2 * alpha[1:-1] + alpha[:-2]) / h**2
    np.testing.assert_allclose(run.column(Column.ALPHA_DOT)[1:-1][inside], slope[inside], atol=1e-4)
    np.testing.assert_allclose(run.column(Column.ALPHA_DDOT)[1:-1][inside], bend[inside], atol=1e-3)
    assert np.all(alpha[6700:] == delta)


def test_the_fade_counts_from_the_beginning_of_the_run_not_of_a_beat() -> None:
    split = TailProgramme((BEAT, BEAT), (0.0, 2.0))
    one, two = swum(fade_per_s=0.05), swum(programme=split, fade_per_s=0.05)
    np.testing.assert_allclose(two.tail_angle_rad, one.tail_angle_rad, atol=1e-13)


def test_an_offset_is_the_bias_that_the_adapted_drag_sees() -> None:
    hydro = replace(wang2014().hydrodynamics, drag_per_bias_squared=0.5)
    moved = replace(changed(wang2014(), offset_rad=0.3), hydrodynamics=hydro)
    told = replace(wang2014(), hydrodynamics=hydro)
    one = simulate(moved, TailProgramme.steady(TailBeat(0.1, AMPLITUDE, 0.9)), 3.0)
    other = simulate(told, TailProgramme.steady(TailBeat(0.4, AMPLITUDE, 0.9)), 3.0)
    np.testing.assert_allclose(one.rows[:, :18], other.rows[:, :18], atol=1e-13)


# The steady motion


@pytest.mark.parametrize(
    "fields",
    [
        {"command_lag_s": 0.1},
        {"slowness_s_rad": 1.5},
        {"extra_dead_band_rad": 0.04},
        {"play_rad": 0.08},
        {"offset_rad": 0.05, "gain_error": -0.1},
        {"slowness_s_rad": 1.2, "play_rad": 0.05, "extra_dead_band_rad": 0.02},
    ],
)
@pytest.mark.parametrize("make", [wang2014, fishbed_robot])
def test_simulating_ends_on_the_orbit(
    make: Callable[[], PlantParameters], fields: dict[str, float]
) -> None:
    plant = changed(make(), **fields)
    steps = 500
    step_s = 1 / (0.9 * steps)
    orbit = periodic_orbit(plant, BEAT, step_s * 1.0000001)
    run = simulate(plant, STEADY, 400 / 0.9, step_s, save_every=steps)
    motion = slice(int(Column.U), int(Column.ALPHA_DOT) + 1)
    one, other = orbit.trajectory.rows[0, motion], run.rows[-1, motion]
    np.testing.assert_allclose(other, one, atol=1e-7)
    plain = periodic_orbit(make(), BEAT, step_s)
    assert orbit.turn_period_s != pytest.approx(plain.turn_period_s, rel=1e-3)


def test_what_depends_on_place_or_time_has_no_orbit() -> None:
    with pytest.raises(InvalidParameterError, match=r"linkage\.fade_per_s"):
        periodic_orbit(changed(wang2014(), fade_per_s=0.01), BEAT)


# In the emulation

ALL: dict[str, float] = {
    "command_delay_s": 0.0437,
    "command_lag_s": 0.05,
    "slowness_s_rad": 0.8,
    "extra_dead_band_rad": 0.02,
    "gain_error": -0.1,
    "fade_per_s": 0.02,
    "offset_rad": 0.05,
    "play_rad": 0.03,
}
TAIL = TRUTH_COLUMNS.index("tail_angle_rad")


@pytest.mark.parametrize("name", [*ALL, "all"])
def test_the_vehicle_is_the_plain_simulation_to_the_bit(name: str) -> None:
    fields = ALL if name == "all" else {name: ALL[name]}
    plant = changed(wang2014(), **fields)
    run = simulate(plant, CHANGING, 5.0)
    vehicle = Vehicle(plant, history_fs=MS)
    for start, beat in zip(CHANGING.starts_s, CHANGING.beats, strict=True):
        t_fs = round(start * 1000) * MS
        vehicle.advance(t_fs)
        vehicle.set_tail_beat(t_fs, beat)
        vehicle.heading(t_fs + 3 * MS + 17)
    truth = vehicle.truth(5000 * MS)
    np.testing.assert_array_equal(truth[:, 1:9], run.rows[:, :8])


def targets(plant: PlantParameters, looks_ms: tuple[int, ...] = ()) -> FloatArray:
    vehicle = Vehicle(plant, history_fs=MS)
    vehicle.set_servo_target(0, 0.2)
    for frame in range(1, 60):
        at = 20 * frame * MS
        for look in looks_ms:
            vehicle.x(at - 20 * MS + look * MS)
        vehicle.set_servo_target(at, 0.2 + 0.25 * math.sin(OMEGA * 0.02 * frame))
    return vehicle.truth(1200 * MS)


@pytest.mark.parametrize("name", [*ALL, "all"])
def test_looks_change_nothing_and_the_real_servo_feels_every_effect(name: str) -> None:
    fields = ALL if name == "all" else {name: ALL[name]}
    plant = changed(fishbed_robot(), **fields)
    seen = targets(plant)
    np.testing.assert_array_equal(seen, targets(plant, (1, 7, 19)))
    assert np.max(np.abs(seen[:, TAIL] - targets(fishbed_robot())[:, TAIL])) > 2e-3


def test_a_delayed_servo_does_the_same_later() -> None:
    late = targets(changed(fishbed_robot(), command_delay_s=0.033))
    plain = targets(fishbed_robot())
    np.testing.assert_array_equal(late[33:, TAIL], plain[:-33, TAIL])
    assert np.all(late[:33, TAIL] == 0.0)


def test_a_real_servo_is_no_faster_than_the_effect_allows() -> None:
    rate = TRUTH_COLUMNS.index("tail_rate_rad_s")
    assert np.max(np.abs(targets(changed(fishbed_robot(), slowness_s_rad=1.5))[:, rate])) < 1 / 1.5
    assert fishbed_robot().servo.speed_limit_rad_s(7.4) > 5.0


def test_a_largest_speed_does_not_make_the_motor_draw_more() -> None:
    slow = changed(fishbed_robot(), slowness_s_rad=1.5).servo
    ours, plain = (supply_current_a(s, 7.4, 0.5, 1e-3) for s in (slow, fishbed_robot().servo))
    assert ours == plain


def test_behind_a_lag_the_real_servo_gets_the_filtered_targets() -> None:
    tau = 0.08
    plant = changed(fishbed_robot(), command_lag_s=tau)
    seen = targets(plant)[:, TAIL]
    # the same servo, given a millisecond-by-millisecond filtered target
    vehicle = Vehicle(fishbed_robot(), history_fs=MS)
    value = 0.0
    for k in range(1200):
        frame = k // 20
        target = 0.2 + (0.25 * math.sin(OMEGA * 0.02 * frame) if frame else 0.0)
        middle = target + (value - target) * math.exp(-0.0005 / tau)
        value = target + (value - target) * math.exp(-0.001 / tau)
        vehicle.set_servo_target(k * MS, middle)
        vehicle.advance(k * MS)
    np.testing.assert_allclose(vehicle.truth(1200 * MS)[:, TAIL], seen, atol=2e-5)
