"""Heading filter: convergence, gyro bias, wrapping, outliers, GPS course."""

from __future__ import annotations

import math
import random

import pytest

from navboard.heading import HeadingFilter, HeadingTuning, wrap

DT = 0.02


def simulate(rate, bias, seconds, seed=1, start=0.5, turn=None):
    """Run the filter over `seconds`; return it and the errors of its heading."""
    rng = random.Random(seed)
    f = HeadingFilter(HeadingTuning())
    truth = start
    errors = []
    for n in range(round(seconds / DT)):
        omega = rate if turn is None else turn(n * DT)
        truth += omega * DT
        f.predict(omega + bias + rng.gauss(0, 0.004), DT)
        if n * 15 // 50 != (n - 1) * 15 // 50:
            f.compass(wrap(truth + rng.gauss(0, 0.016)))
        if f.heading_rad is not None:
            errors.append(wrap(f.heading_rad - truth))
    return f, errors


@pytest.mark.parametrize("bias", [-0.03, 0.0, 0.02])
def test_gyro_bias_is_found(bias):
    f, errors = simulate(0.3, bias, 120.0)
    assert f.bias_rad_s == pytest.approx(bias, abs=3.5 * f.bias_sigma_rad_s)
    assert abs(f.bias_rad_s - bias) < 1.5e-3
    assert max(abs(e) for e in errors[-1000:]) < 0.02


def test_error_is_smaller_than_the_compass_alone():
    _f, errors = simulate(0.0, 0.01, 120.0, turn=lambda t: 0.5 * math.sin(2 * math.pi * 0.9 * t))
    tail = errors[-3000:]
    rms = math.sqrt(sum(e * e for e in tail) / len(tail))
    assert rms < 0.016 / 3


def test_filter_s_own_sigma_is_honest():
    ends = [simulate(0.1, 0.01, 30.0, seed=s) for s in range(40)]
    rms = math.sqrt(sum(errors[-1] ** 2 for _f, errors in ends) / len(ends))
    assert rms < 1.3 * ends[0][0].sigma_rad


def test_heading_wraps_without_a_jump():
    _f, errors = simulate(1.0, 0.0, 60.0)
    assert max(abs(e) for e in errors[500:]) < 0.03


def test_one_wild_reading_is_dropped():
    f, _errors = simulate(0.0, 0.0, 30.0)
    before = f.heading_rad
    f.compass(wrap(before + 1.0))
    assert f.heading_rad == before


def test_a_second_of_wild_readings_starts_the_filter_again():
    f, _errors = simulate(0.0, 0.0, 30.0)
    target = wrap(f.heading_rad + 1.0)
    for _ in range(HeadingTuning().restart_after):
        f.compass(target)
    assert f.heading_rad == pytest.approx(target)


def test_course_counts_only_when_fast_enough():
    f, _errors = simulate(0.0, 0.0, 5.0)
    before = f.heading_rad
    assert not f.course(before + 0.1, 0.05)
    assert f.heading_rad == before
    assert f.course(before + 0.1, 1.0)
    assert f.heading_rad > before


def test_nothing_is_known_before_the_first_compass_reading():
    f = HeadingFilter(HeadingTuning())
    f.predict(1.0, DT)
    assert f.heading_rad is None
    assert not f.course(0.0, 2.0)


@pytest.mark.parametrize(
    ("angle", "expected"), [(math.pi, -math.pi), (-math.pi, -math.pi), (7.0, 7.0 - 2 * math.pi)]
)
def test_wrap(angle, expected):
    assert wrap(angle) == pytest.approx(expected)
