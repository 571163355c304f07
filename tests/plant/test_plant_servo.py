"""The servo's loop against closed forms, its limits and its current."""

import math
from dataclasses import replace

import numpy as np
import pytest

from plant.integrate import simulate
from plant.parameters import Servo
from plant.robots import wang2014
from plant.servo import current_slopes, supply_current_a
from plant.tail_input import TailBeat, TailProgramme
from plant.vehicle import FS_PER_S, Vehicle

MS = FS_PER_S // 1000


def step_response(servo: Servo, target: float, volts: float, until_ms: int) -> list[float]:
    vehicle = Vehicle(replace(wang2014(), servo=servo), supply_v=volts)
    vehicle.set_servo_target(0, target)
    return [vehicle.tail_angle(k * MS) for k in range(until_ms)]


def test_a_small_step_is_that_of_the_second_order_loop() -> None:
    # without limit and dead band: α̈ = (k_p(target − α) − α̇)/τ_m
    servo = Servo(dead_band_rad=0.0)
    damping = 0.5 / math.sqrt(servo.position_gain_per_s * servo.motor_lag_s)
    natural = math.sqrt(servo.position_gain_per_s / servo.motor_lag_s)
    damped = natural * math.sqrt(1 - damping**2)
    t = np.arange(200) * 1e-3
    decay = np.exp(-damping * natural * t)
    swing = np.cos(damped * t) + damping * natural / damped * np.sin(damped * t)
    got = step_response(servo, 0.1, 7.4, 200)
    assert got == pytest.approx(0.1 * (1 - decay * swing), abs=1e-7)


def test_beats_are_followed_with_the_loops_gain_and_lag() -> None:
    servo = Servo(dead_band_rad=0.0)
    run = simulate(
        replace(wang2014(), servo=servo), TailProgramme.steady(TailBeat(0.0, 0.26, 0.9)), 20.0
    )
    omega = 2 * math.pi * 0.9
    kept = run.time_s > 20 - 5 / 0.9
    phasor = np.exp(-1j * omega * run.time_s[kept]) * run.tail_angle_rad[kept]
    got = 2j * phasor.mean() / 0.26
    kp, lag = servo.position_gain_per_s, servo.motor_lag_s
    assert got == pytest.approx(kp / (kp - lag * omega**2 + 1j * omega), abs=2e-3)


@pytest.mark.parametrize(("volts", "seconds"), [(6.0, 0.20), (7.4, 0.18)])
def test_sixty_degrees_take_the_published_time(volts: float, seconds: float) -> None:
    # at full speed, that is, between start and stop: 20° to 80° of a 100° move
    angles = np.degrees(step_response(Servo(), math.radians(100), volts, 500))
    first = int(np.argmax(angles >= 20.0))
    last = int(np.argmax(angles >= 80.0))
    assert (last - first) * 1e-3 == pytest.approx(seconds, abs=2e-3)


def test_the_dead_band_leaves_the_tail_beside_the_target() -> None:
    servo = Servo()
    settled = step_response(servo, 0.3, 7.4, 600)[-1]
    assert 0.3 - servo.dead_band_rad - 1e-4 < settled < 0.3
    within = step_response(servo, 0.9 * servo.dead_band_rad, 7.4, 300)
    assert within == [0.0] * 300


def test_current_meets_the_published_points() -> None:
    servo = Servo()
    assert supply_current_a(servo, 7.4, 0.0, 0.0) == 4.5e-3
    full = servo.speed_limit_rad_s(7.4)
    assert supply_current_a(servo, 7.4, full, 0.0) == pytest.approx(0.330 + 4.5e-3)
    stall = servo.stall_torque_n_m(7.4)
    assert supply_current_a(servo, 7.4, 0.0, stall) == pytest.approx(2.1)
    assert supply_current_a(servo, 7.4, full, 2 * stall) == 2.1
    assert supply_current_a(servo, 2.0, 1.0, 0.1) == 0.0
    assert current_slopes(servo, 2.0) == (0.0, 0.0, 0.0)


def test_published_speed_torque_and_current() -> None:
    servo = Servo()
    assert math.radians(60) / servo.low_voltage_speed_rad_s == pytest.approx(0.20)
    assert math.radians(60) / servo.high_voltage_speed_rad_s == pytest.approx(0.18)
    assert servo.low_voltage_stall_torque_n_m == pytest.approx(1.108, abs=1e-3)
    assert servo.high_voltage_stall_torque_n_m == pytest.approx(1.265, abs=1e-3)
    assert (servo.idle_current_a, servo.running_current_a, servo.stall_current_a) == (
        4.5e-3,
        0.330,
        2.1,
    )
