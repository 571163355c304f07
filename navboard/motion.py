"""Tail-beat generator in fixed point: α(t) = bias + amplitude · sin φ, as dsPIC firmware does it.

The phase is a 32-bit accumulator, so a change of frequency never moves it; bias and amplitude are
slewed towards their targets, so a change of command never makes the tail jump. Angles are Q16.16
radians, the sine is a table of 256 entries in Q15 with linear interpolation. All of it is integer
arithmetic: the same on every machine.

A command holds for a number of ticks. When it has run out, the fail-safe slews bias and amplitude
to zero, and the phase starts from zero with the next command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from navboard.errors import ConfigurationError

ONE_RAD = 1 << 16
_PHASE_TURN = 1 << 32
_PHASE_MASK = _PHASE_TURN - 1
_SINE = tuple(round(32767 * math.sin(2 * math.pi * i / 256)) for i in range(257))


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What the generator lets through; slew rates are choices of this firmware."""

    angle_rad: float = math.radians(60.0)
    """Largest |bias| + amplitude: the servo's travel."""
    bias_rad: float = math.radians(50.0)
    frequency_hz: float = 4.0
    bias_slew_rad_s: float = 2.0
    amplitude_slew_rad_s: float = 1.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0.0:
                raise ConfigurationError(f"motion limit {name} must be positive")


def sine_q15(phase: int) -> int:
    """Return sin(2π phase / 2³²) × 32767, from the table."""
    index = phase >> 24
    low = _SINE[index]
    return low + ((_SINE[index + 1] - low) * (phase >> 8 & 0xFFFF) >> 16)


class TailBeatGenerator:
    """One step a control tick; every attribute is an integer."""

    __slots__ = (
        "_amplitude_step",
        "_bias_step",
        "_increment",
        "_limits",
        "_target_amplitude",
        "_target_bias",
        "_ticks_left",
        "_travel",
        "alpha",
        "amplitude",
        "bias",
        "command_id",
        "fail_safe",
        "frequency_hz",
        "phase",
        "tick_hz",
    )

    def __init__(self, limits: MotionLimits, tick_hz: float) -> None:
        self._limits = limits
        self.tick_hz = tick_hz
        self._bias_step = max(1, round(limits.bias_slew_rad_s / tick_hz * ONE_RAD))
        self._amplitude_step = max(1, round(limits.amplitude_slew_rad_s / tick_hz * ONE_RAD))
        self._travel = round(limits.angle_rad * ONE_RAD)
        self._target_bias = 0
        self._target_amplitude = 0
        self._increment = 0
        self._ticks_left = 0
        self.bias = 0
        """Present bias, Q16.16 rad."""
        self.amplitude = 0
        """Present amplitude, Q16.16 rad."""
        self.phase = 0
        """Present phase, 2³² a turn."""
        self.alpha = 0
        """Present tail command, Q16.16 rad."""
        self.frequency_hz = 0.0
        self.command_id: int | None = None
        """The latest command; None before the first."""
        self.fail_safe = True
        """Whether no command is valid."""

    def command(
        self,
        command_id: int,
        bias_rad: float,
        amplitude_rad: float,
        frequency_hz: float,
        valid_for_s: float,
    ) -> bool:
        """Follow a new beat from the next step on; return whether it ended the fail-safe.

        Values beyond the limits are clipped: the bias first, then the amplitude to what is left.
        """
        limits = self._limits
        bias = min(max(bias_rad, -limits.bias_rad), limits.bias_rad)
        amplitude = min(max(amplitude_rad, 0.0), limits.angle_rad - abs(bias))
        self.frequency_hz = min(max(frequency_hz, 0.0), limits.frequency_hz)
        self._target_bias = round(bias * ONE_RAD)
        self._target_amplitude = round(max(amplitude, 0.0) * ONE_RAD)
        self._increment = round(self.frequency_hz / self.tick_hz * _PHASE_TURN)
        self._ticks_left = max(1, round(valid_for_s * self.tick_hz))
        self.command_id = command_id
        ended, self.fail_safe = self.fail_safe, False
        return ended

    def step(self) -> bool:
        """Advance one tick and compute `alpha`; return whether the fail-safe came on."""
        came_on = False
        if not self.fail_safe:
            self._ticks_left -= 1
            if self._ticks_left < 0:
                came_on = self.fail_safe = True
                self._target_bias = self._target_amplitude = 0
        bias, amplitude = self.bias, self.amplitude
        if bias != self._target_bias:
            self.bias = bias = _slew(bias, self._target_bias, self._bias_step)
        if amplitude != self._target_amplitude:
            amplitude = _slew(amplitude, self._target_amplitude, self._amplitude_step)
            self.amplitude = amplitude
        if amplitude == 0 and self._target_amplitude == 0:
            self.phase = 0  # a beat starts from rest at φ = 0
            self.alpha = bias
        else:
            alpha = bias + (amplitude * sine_q15(self.phase) >> 15)
            # Bias and amplitude on their way to a new beat may together ask for more.
            self.alpha = max(-self._travel, min(self._travel, alpha))
            self.phase = (self.phase + self._increment) & _PHASE_MASK
        return came_on

    @property
    def alpha_rad(self) -> float:
        """Present tail command, rad."""
        return self.alpha / ONE_RAD


def _slew(value: int, target: int, step: int) -> int:
    if value < target:
        return min(value + step, target)
    return max(value - step, target)
