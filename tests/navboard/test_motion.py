"""Tail-beat generator: the beat, continuity under any change of command, limits, fail-safe."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navboard.errors import ConfigurationError
from navboard.motion import ONE_RAD, MotionLimits, TailBeatGenerator, sine_q15

HZ = 50.0
LIMITS = MotionLimits()
TURN = 1 << 32


def generator(limits=LIMITS):
    return TailBeatGenerator(limits, HZ)


def settled(bias, amplitude, frequency):
    g = generator()
    g.command(1, bias, amplitude, frequency, 1000.0)
    for _ in range(200):
        g.step()
    return g


def test_sine_table_is_good_to_a_ten_thousandth():
    worst = max(
        abs(sine_q15(phase) / 32767 - math.sin(2 * math.pi * phase / TURN))
        for phase in range(0, TURN, TURN // 4099)
    )
    assert worst < 1.1e-4


@pytest.mark.parametrize("frequency", [0.5, 0.9, 2.0, 3.7])
def test_beat_is_the_sine_that_was_asked_for(frequency):
    g = settled(0.3, 0.25, frequency)
    phase0 = g.phase * 2 * math.pi / TURN
    for n in range(500):
        g.step()
        phase = phase0 + 2 * math.pi * frequency * n / HZ
        assert g.alpha_rad == pytest.approx(0.3 + 0.25 * math.sin(phase), abs=6e-5)


def test_frequency_has_no_error_that_accumulates():
    g = settled(0.0, 0.25, 0.9)
    start = g.phase
    for _ in range(50 * 100):  # 100 s: 90 beats
        g.step()
    drift = (g.phase - start + TURN // 2) % TURN - TURN // 2
    assert abs(drift) / TURN < 2e-6


def test_first_beat_starts_at_phase_zero_from_rest():
    g = generator()
    g.command(1, 0.0, 0.25, 0.9, 10.0)
    g.step()
    assert g.alpha == 0
    g.step()
    assert 0 < g.alpha_rad < 0.01


COMMANDS = st.tuples(
    st.floats(-2.0, 2.0),
    st.floats(-0.5, 2.0),
    st.floats(-1.0, 8.0),
    st.floats(0.0, 2.0),
    st.integers(1, 60),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(COMMANDS, min_size=1, max_size=12))
def test_any_commands_leave_the_tail_continuous_and_in_its_limits(commands):
    """No step is larger than the slews and this tick's turn of the phase allow."""
    g = generator()
    slews = (LIMITS.bias_slew_rad_s + LIMITS.amplitude_slew_rad_s) / HZ
    alpha, phase, amplitude = 0.0, 0, 0
    for i, (bias, amplitude_rad, frequency, valid_s, ticks) in enumerate(commands):
        g.command(i, bias, amplitude_rad, frequency, valid_s)
        for _ in range(ticks):
            turn = 2 * math.pi * ((g.phase - phase) % TURN) / TURN if amplitude else 0.0
            assert turn <= 2 * math.pi * LIMITS.frequency_hz / HZ + 1e-6
            phase = g.phase
            g.step()
            assert abs(g.alpha_rad - alpha) <= slews + amplitude / ONE_RAD * turn + 5e-4
            assert abs(g.alpha_rad) <= LIMITS.angle_rad + 1e-4
            alpha, amplitude = g.alpha_rad, g.amplitude


def test_change_of_frequency_moves_no_phase():
    g = settled(0.1, 0.25, 0.9)
    phase = g.phase
    g.command(2, 0.1, 0.25, 2.5, 10.0)
    assert g.phase == phase
    g.step()
    assert (g.phase - phase) % TURN == round(2.5 / HZ * TURN)


def test_limits_clip_bias_first_then_amplitude():
    g = generator()
    g.command(1, 5.0, 5.0, 50.0, 1000.0)
    for _ in range(500):
        g.step()
    assert g.bias / ONE_RAD == pytest.approx(LIMITS.bias_rad, abs=1e-4)
    assert (g.bias + g.amplitude) / ONE_RAD == pytest.approx(LIMITS.angle_rad, abs=1e-4)
    assert g.frequency_hz == LIMITS.frequency_hz


def test_fail_safe_centres_smoothly_and_a_command_ends_it():
    g = generator()
    assert g.command(1, 0.4, 0.2, 1.0, 1.0)
    came = [g.step() for _ in range(50)]
    assert not any(came)
    assert g.step()
    assert g.fail_safe
    before = g.alpha_rad
    for _ in range(100):
        assert not g.step()
        assert abs(g.alpha_rad - before) < 0.1
        before = g.alpha_rad
    assert g.alpha == 0
    assert g.phase == 0
    assert g.command(2, 0.1, 0.0, 0.0, 1.0)


def test_limits_must_be_positive():
    with pytest.raises(ConfigurationError):
        MotionLimits(frequency_hz=0.0)
