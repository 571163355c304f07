"""From what an operator does to what the fish is told: targets, bounds, rates; no clock, no port.

Inputs change a target; the setpoint follows it within rates, so that a stick pushed to its end does
not tear the fish round. To stop needs no patience: it is at once. Bias is to the left of the fish
negative, because a tail that points to one side turns the fish to the other (the emulated one, by
its scenario, turns clockwise with a positive bias).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import Final

LEFT: Final = -1.0
"""Sign of the bias that turns the fish to its left."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What the tail is to do: α(t) = bias + amplitude · sin φ."""

    frequency_hz: float = 0.0
    amplitude_rad: float = 0.0
    bias_rad: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves: no beat, tail straight."""
        return self == NEUTRAL


NEUTRAL: Final = Setpoint()
"""The tail straight and still."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """How far and how fast an operator may go (all assumed; the boards' own limits are wider)."""

    frequency_hz: float = 2.0
    amplitude_rad: float = math.radians(30.0)
    bias_rad: float = math.radians(30.0)
    frequency_hz_s: float = 2.0
    amplitude_rad_s: float = math.radians(60.0)
    bias_rad_s: float = math.radians(120.0)

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name)} is not above 0")

    def within(self, wanted: Setpoint) -> Setpoint:
        """Return the nearest setpoint that is allowed."""
        return Setpoint(
            min(max(wanted.frequency_hz, 0.0), self.frequency_hz),
            min(max(wanted.amplitude_rad, 0.0), self.amplitude_rad),
            min(max(wanted.bias_rad, -self.bias_rad), self.bias_rad),
        )


@dataclass(frozen=True, slots=True)
class Hold:
    """Set targets; None leaves one as it is."""

    frequency_hz: float | None = None
    amplitude_rad: float | None = None
    bias_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Nudge:
    """Change targets by so much."""

    frequency_hz: float = 0.0
    amplitude_rad: float = 0.0
    bias_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Stop:
    """Rest now: no beat, tail straight. The amplitude is kept for the next start."""


@dataclass(frozen=True, slots=True)
class End:
    """The operator is done, or his input is gone: the fish has to stop."""

    reason: str


Input = Hold | Nudge | Stop | End


class Helm:
    """Holds the target and lets the setpoint follow."""

    def __init__(
        self, bounds: Bounds | None = None, amplitude_rad: float = math.radians(15)
    ) -> None:
        self.bounds = bounds or Bounds()
        self.ended: End | None = None
        """Why there will be no more input."""
        self._target = self.bounds.within(Setpoint(amplitude_rad=amplitude_rad))
        self._now = replace(self._target, frequency_hz=0.0)
        self._at_s: float | None = None

    @property
    def target(self) -> Setpoint:
        """What the operator wants."""
        return self._target

    def take(self, what: Input) -> None:
        """Take an input; after the end nothing counts."""
        if self.ended is not None:
            return
        target = self._target
        match what:
            case Hold():
                target = Setpoint(
                    target.frequency_hz if what.frequency_hz is None else what.frequency_hz,
                    target.amplitude_rad if what.amplitude_rad is None else what.amplitude_rad,
                    target.bias_rad if what.bias_rad is None else what.bias_rad,
                )
            case Nudge():
                target = Setpoint(
                    target.frequency_hz + what.frequency_hz,
                    target.amplitude_rad + what.amplitude_rad,
                    target.bias_rad + what.bias_rad,
                )
            case Stop() | End():
                target = Setpoint(0.0, target.amplitude_rad, 0.0)
                self._now = target
                if isinstance(what, End):
                    self.ended = what
        self._target = _rounded(self.bounds.within(target))

    def setpoint(self, now_s: float) -> Setpoint:
        """Return what the fish is to be told at a time; times do not go back.

        Without a beat the amplitude is zero, too: else the tail would stand still anywhere.
        """
        elapsed_s = 0.0 if self._at_s is None else max(0.0, now_s - self._at_s)
        self._at_s = now_s
        bounds, now, target = self.bounds, self._now, self._target
        self._now = now = Setpoint(
            _towards(now.frequency_hz, target.frequency_hz, bounds.frequency_hz_s * elapsed_s),
            _towards(now.amplitude_rad, target.amplitude_rad, bounds.amplitude_rad_s * elapsed_s),
            _towards(now.bias_rad, target.bias_rad, bounds.bias_rad_s * elapsed_s),
        )
        return now if now.frequency_hz > 0.0 else replace(now, amplitude_rad=0.0)


def _rounded(value: Setpoint) -> Setpoint:
    """Take off what many small steps leave behind: twelve digits are a setpoint."""
    return Setpoint(*(round(each, 12) for each in astuple(value)))


def _towards(value: float, target: float, most: float) -> float:
    return target if abs(target - value) <= most else value + math.copysign(most, target - value)
