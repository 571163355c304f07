"""Hitec HS-5646WP electronics: the width of a pulse in, a target angle out.

The servo measures the high time of its input and takes it as a target if it lies in its range; a
change below the 4 µs dead band is ignored. Without pulses it lets go after a while, as assumed
here. Speed, torque, current and the loop with its dead band are `plant.parameters.Servo`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_MS, FS_PER_US


@dataclass(frozen=True, slots=True)
class Hs5646wpSpecs:
    """What the electronics make of a pulse: published (Hitec) and assumed."""

    dead_band_s: float = 4e-6
    # Assumed: the range is not published.
    pulse_min_s: float = 900e-6
    pulse_max_s: float = 2100e-6
    travel_rad: float = math.radians(60.0)
    """Angle at the ends of the range, to either side of the middle (1500 µs)."""

    @property
    def rad_per_s(self) -> float:
        """Angle per second of pulse width."""
        return 2.0 * self.travel_rad / (self.pulse_max_s - self.pulse_min_s)


PULSE_MIDDLE_FS = 1500 * FS_PER_US
MARGIN_FS = 100 * FS_PER_US  # assumed: pulses a little out of range are clipped, others ignored
LOST_AFTER_FS = 100 * FS_PER_MS  # assumed: five missing pulses


class Hs5646wp:
    """The input stage on a signal wire.

    Args:
        scheduler: time.
        signal: the control wire.
        on_target: called with (time_fs, angle in rad) at the end of the pulse that changes it, and
            with None when the pulses stop.
        specs: pulse range and dead band.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        signal: Signal[bool],
        on_target: Callable[[int, float | None], None],
        specs: Hs5646wpSpecs | None = None,
    ) -> None:
        self.specs = specs = specs or Hs5646wpSpecs()
        self.powered = True
        self.target_rad: float | None = None
        self.pulses = 0
        self.ignored = 0
        """Pulses out of range."""
        self.listeners: tuple[Callable[[int, int], None], ...] = ()
        """Told of every valid pulse: (time of its rising edge, width), femtoseconds."""
        self._scheduler = scheduler
        self._on_target = on_target
        self._low_fs = round(specs.pulse_min_s * 1e15)
        self._high_fs = round(specs.pulse_max_s * 1e15)
        self._dead_fs = round(specs.dead_band_s * 1e15)
        self._rad_per_fs = specs.rad_per_s / 1e15
        self._rise_fs: int | None = None
        self._last_fs = 0  # end of the latest valid pulse
        self._width_fs: int | None = None  # the one that is followed
        self._event: Event | None = None
        signal.watch(self._edge)

    def power(self, on: bool) -> None:
        """Lose or regain the supply; the target is forgotten."""
        self.powered = on
        self._rise_fs = self._width_fs = None
        if not on:
            self._release()

    def _edge(self, level: bool) -> None:
        now = self._scheduler.now
        if level:
            self._rise_fs = now if self.powered else None
            return
        rise, self._rise_fs = self._rise_fs, None
        if rise is None:
            return
        self._pulse(now - rise)

    def pulse(self, width_fs: int) -> None:
        """Take a pulse that ends now and whose width somebody else has measured."""
        if self.powered:
            self._pulse(width_fs)

    def _pulse(self, width: int) -> None:
        now = self._scheduler.now
        low, high = self._low_fs, self._high_fs
        if not low - MARGIN_FS <= width <= high + MARGIN_FS:
            self.ignored += 1
            return
        self.pulses += 1
        self._last_fs = now
        if self._event is None:
            self._event = self._scheduler.at(now + LOST_AFTER_FS, self._check)
        for listener in self.listeners:
            listener(now - width, width)
        width = low if width < low else min(width, high)
        if self._width_fs is None or abs(width - self._width_fs) >= self._dead_fs:
            self._width_fs = width
            self.target_rad = angle = (width - PULSE_MIDDLE_FS) * self._rad_per_fs
            self._on_target(now, angle)

    def _check(self) -> None:
        """Look whether pulses still come: one event for many pulses."""
        due = self._last_fs + LOST_AFTER_FS
        if due > self._scheduler.now:
            self._event = self._scheduler.at(due, self._check)
        else:
            self._event = None
            self._release()

    def _release(self) -> None:
        self._width_fs = None
        if self.target_rad is not None:
            self.target_rad = None
            self._on_target(self._scheduler.now, None)
