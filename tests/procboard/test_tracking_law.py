"""The tracking law against the average model (5.30), integrated here on its own by scipy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from procboard.applications.tracking_law import (
    Mode,
    Motion,
    SwimModel,
    TrackingGains,
    TrackingLaw,
)
from procboard.errors import ProcConfigError

AMPLITUDE, FREQUENCY = math.radians(15), 1.0
LAW = TrackingLaw(AMPLITUDE, FREQUENCY)

# Table 3.1 and chapter 5, typed from the source and not from the module.
M1, M2 = 0.311 + 0.0621, 0.311 + 0.2299
C1, C2 = 0.5 * 1000 * 0.0108 * 0.386, 0.5 * 1000 * 0.0108 * 4.50
J3, K_D, HINGE = 0.311 * 0.14**2 / 12 + 1.0413e-4, 7.82e-4, 0.07
ML2 = 0.25 * math.pi * 1000 * 0.025**2 * 0.08**2
OMEGA = 2 * math.pi * FREQUENCY


def average_model(_time, state, bias):
    """(5.30) and the kinematics: x, y, ψ, V_x, V_y, ω."""
    _, _, psi, u, v, w = state
    speed, beta = math.hypot(u, v), math.atan2(v, u)
    q = ML2 * OMEGA**2 * AMPLITUDE**2
    thrust = 0.8485 * q / (12 * M1) * (3 - 1.5 * bias**2 - 0.375 * AMPLITUDE**2)
    side = 0.8485 * q / (4 * M2) * bias
    moment = (-0.0074 + 0.4831 * abs(bias)) * q * HINGE * bias / (4 * J3)
    return (
        u * math.cos(psi) - v * math.sin(psi),
        u * math.sin(psi) + v * math.cos(psi),
        w,
        M2 / M1 * v * w - C1 / M1 * u * speed + C2 / M1 * v * speed * beta + thrust,
        -M1 / M2 * u * w - C1 / M2 * v * speed - C2 / M2 * u * speed * beta + side,
        -K_D / J3 * w * abs(w) - moment,
    )


def motion_of(state):
    """Polar coordinates of the origin (5.35)."""
    x, y, psi, u, v, w = state
    bearing = math.atan2(-y, -x)
    error = (psi - bearing + math.pi) % (2 * math.pi) - math.pi
    return Motion(math.hypot(x, y), error, u, v, w)


def z1_at(time, state, bias):
    if time == 0:
        return z1_at_zero(state)
    solution = solve_ivp(average_model, (0, time), state, args=(bias,), rtol=1e-12, atol=1e-14)
    r, theta, u, v, _ = motion_of(solution.y[:, -1])
    return LAW.gains.approach_per_s * r - u * math.cos(theta) + v * math.sin(theta)


@given(
    st.floats(0.05, 0.5), st.floats(-0.69, 0.69), st.floats(0.005, 0.06), st.floats(-0.01, 0.01),
    st.floats(-0.2, 0.2), st.floats(-0.6, 0.6),
)  # fmt: skip
def test_the_quadratic_is_what_z1_lacks(r, theta, u, v, w, bias):
    """A α₀² + B α₀ + C = ż₁ + k₁ z₁ on the average model, for any bias: ż₁ by differences."""
    psi = 0.4
    bearing = psi - theta
    state = (-r * math.cos(bearing), -r * math.sin(bearing), psi, u, v, w)
    h = 1e-4
    rate = (-3 * z1_at(0, state, bias) + 4 * z1_at(h, state, bias) - z1_at(2 * h, state, bias)) / (
        2 * h
    )
    a, b, c = LAW.quadratic(motion_of(state))
    lacks = rate + LAW.gains.speed_per_s * z1_at(0, state, bias)
    assert a * bias**2 + b * bias + c == pytest.approx(lacks, rel=1e-5, abs=1e-7)


def z1_at_zero(state):  # solve_ivp wants a span
    r, theta, u, v, _ = motion_of(state)
    return LAW.gains.approach_per_s * r - u * math.cos(theta) + v * math.sin(theta)


def test_the_lyapunov_function_falls_where_the_law_has_a_root():
    """V₂ = ½r² + ½λz₁² falls on the average model under the unlimited root."""
    scale = 2.0  # λ > 1/(4 k_r k₁) = 1
    for r, theta in ((0.08, 0.2), (0.05, -0.3), (0.03, 0.5)):
        state = (-r, 0.0, theta, 0.03, 0.0, 0.0)
        motion = motion_of(state)
        a, b, c = LAW.quadratic(motion)
        assert c < 0
        root = (-b + math.copysign(math.sqrt(b * b - 4 * a * c), theta)) / (2 * a)
        k_1, k_r = LAW.gains.speed_per_s, LAW.gains.approach_per_s
        z1 = z1_at_zero(state)
        assert a * root**2 + b * root + c == pytest.approx(0.0, abs=1e-12)
        falls = -k_r * r**2 + r * z1 - scale * k_1 * z1**2
        assert falls < 0


def test_the_root_turns_the_robot_to_the_target_and_keeps_its_limits():
    for theta in (0.3, 0.02, -0.02, -0.3):
        bias = LAW.approach_bias_rad(Motion(0.06, theta, 0.03, 0.0, 0.0))
        assert math.copysign(1.0, bias) == math.copysign(1.0, theta)
        assert abs(bias) <= LAW.gains.bias_max_rad
    # It brakes: the root from the quadratic, where that is within the limits.
    motion = Motion(0.119, 0.05, 0.0306, 0.0, 0.0)
    a, b, c = LAW.quadratic(motion)
    assert c < 0
    root = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
    steering = LAW.gains.bias_max_rad * LAW.ahead_rad(motion) / LAW.gains.turn_above_rad
    assert LAW.approach_bias_rad(motion) == pytest.approx(min(root, LAW.gains.bias_max_rad))
    assert root > steering


def test_where_thrust_lacks_the_bias_only_steers():
    """Complex roots, or two on the wrong side: proportional up to the turning controller's."""
    gains = LAW.gains
    for theta in (0.2, -0.2, 0.6, -0.6):
        motion = Motion(2.0, theta, 0.0, 0.0, 0.0)
        assert LAW.quadratic(motion).c > 0
        wanted = gains.bias_max_rad * theta / gains.turn_above_rad
        assert LAW.approach_bias_rad(motion) == pytest.approx(wanted)
    edge = Motion(2.0, gains.turn_above_rad, 0.0, 0.0, 0.0)
    assert LAW.approach_bias_rad(edge) == pytest.approx(gains.bias_max_rad)


FAR = 2.0
HYSTERESIS = [
    (Mode.TURNING, 19.9, Mode.APPROACHING),
    (Mode.TURNING, 20.1, Mode.TURNING),
    (Mode.TURNING, 39.9, Mode.TURNING),
    (Mode.APPROACHING, 20.1, Mode.APPROACHING),
    (Mode.APPROACHING, 39.9, Mode.APPROACHING),
    (Mode.APPROACHING, 40.1, Mode.TURNING),
    (Mode.TURNING, 179.0, Mode.TURNING),
]


@pytest.mark.parametrize(("before", "degrees", "after"), HYSTERESIS)
@pytest.mark.parametrize("side", [1, -1])
def test_hysteresis_of_figure_5_18(before, degrees, after, side):
    motion = Motion(FAR, side * math.radians(degrees), 0.03, 0.0, 0.0)
    mode, bias = LAW.step(before, motion)
    assert mode is after
    if mode is Mode.TURNING:
        assert bias == side * LAW.gains.bias_max_rad


def test_a_target_within_the_turning_circle_is_left_and_come_back_to():
    radius = LAW.turn_radius_m
    beside = math.radians(90)
    assert LAW.step(Mode.TURNING, Motion(1.9 * radius, beside, 0.03, 0, 0)) == (Mode.LEAVING, 0.0)
    assert LAW.next_mode(Mode.TURNING, Motion(2.1 * radius, beside, 0.03, 0, 0)) is Mode.TURNING
    behind = math.radians(170)
    assert LAW.next_mode(Mode.TURNING, Motion(1.9 * radius, behind, 0.03, 0, 0)) is Mode.LEAVING
    # It goes on to leave until there is room, whatever the heading.
    for error in (0.0, 1.0, 3.0):
        inside = Motion(2.4 * radius, error, 0.03, 0, 0)
        assert LAW.next_mode(Mode.LEAVING, inside) is Mode.LEAVING
    assert LAW.next_mode(Mode.LEAVING, Motion(2.6 * radius, 3.0, 0.03, 0, 0)) is Mode.TURNING
    stubborn = TrackingLaw(AMPLITUDE, FREQUENCY, TrackingGains(leave_radii=0.0))
    assert stubborn.step(Mode.TURNING, Motion(radius, beside, 0.03, 0, 0)).mode is Mode.TURNING


@given(st.floats(0.01, 3.0), st.floats(-3.1, 3.1), st.floats(-0.05, 0.1), st.floats(-0.3, 0.3))
def test_left_and_right_are_the_same(r, theta, u, w):
    for mode in Mode:
        one = LAW.step(mode, Motion(r, theta, u, 0.01, w))
        other = LAW.step(mode, Motion(r, -theta, u, -0.01, -w))
        assert one.mode is other.mode
        if theta != 0.0:
            assert one.bias_rad == pytest.approx(-other.bias_rad, abs=1e-12)


def test_the_models_circle_is_the_published_one():
    """The source: 0.26776 m for (5.18) at 20°, 15°, 1 Hz, and its average model 'matches well'."""
    radius = SwimModel().turn_radius_m(math.radians(20), AMPLITUDE, FREQUENCY)
    assert radius == pytest.approx(0.26776, rel=0.03)
    start = (0.0, 0.0, 0.0, 0.02, 0.0, -0.1)
    settled = solve_ivp(
        average_model, (0, 200), start, args=(math.radians(20),), rtol=1e-10, atol=1e-12
    )
    u, v, w = settled.y[3:, -1]
    assert radius == pytest.approx(math.hypot(u, v) / abs(w), rel=2e-3)
    assert SwimModel().turn_radius_m(0.0, AMPLITUDE, FREQUENCY) == math.inf
    assert SwimModel().turn_radius_m(0.01, AMPLITUDE, FREQUENCY) == math.inf  # K_moment < 0 there


def test_the_lead_is_the_rate_of_the_error():
    """θ̇ (5.36) against differences along a path of the average model."""
    state, bias, h = (-0.4, 0.1, 0.5, 0.03, 0.004, -0.15), 0.3, 1e-4
    ends = solve_ivp(average_model, (0, h), state, args=(bias,), rtol=1e-12, atol=1e-14).y[:, -1]
    rate = (motion_of(ends).error_rad - motion_of(state).error_rad) / h
    motion = motion_of(state)
    ahead = LAW.ahead_rad(motion)
    assert ahead == pytest.approx(motion.error_rad + LAW.gains.lead_s * rate, rel=1e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"approach_per_s": 0.0},
        {"speed_per_s": -1.0},
        {"arrival_m": 0.0},
        {"bias_max_rad": 2.0},
        {"approach_below_rad": 0.8, "turn_above_rad": 0.7},
        {"lead_s": -0.1},
        {"leave_radii": 1.0},
    ],
)
def test_impossible_gains_are_refused(wrong):
    with pytest.raises(ProcConfigError):
        TrackingGains(**wrong)


def test_a_tail_that_does_not_beat_is_refused():
    with pytest.raises(ProcConfigError):
        TrackingLaw(0.0, 1.0)
    with pytest.raises(ProcConfigError):
        TrackingLaw(AMPLITUDE, 0.0)


def test_nothing_is_ever_undefined():
    for r in (1e-9, 0.02, 5.0):
        for theta in np.linspace(-math.pi, math.pi, 25, endpoint=False):
            for mode in Mode:
                bias = LAW.step(mode, Motion(r, float(theta), 0.0, 0.0, 0.0)).bias_rad
                assert abs(bias) <= LAW.gains.bias_max_rad
