"""All named effects of a scenario: the plant's own, those of instruments, clock and link, a force.

The physics of a plant's effect is in the plant; that of an instrument's in ``tools.bench.wrong``. A
row here only declares name, numbers and bounds, as ``plant.effects`` does. Names, numbers and
meanings are those of the causes that a diagnosis can find, so what it finds can be run again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from plant.effects import EFFECTS, Effect, EffectParameter
from plant.extra_force import AXES, LARGEST, TERMS


@dataclass(frozen=True, slots=True)
class InstrumentEffect:
    """What may be wrong with an instrument, the clock or the link; neutral at zero."""

    name: str
    description: str
    parameters: tuple[EffectParameter, ...]

    @property
    def part(self) -> str:
        """Its parameters in words, for `fishbed list`."""
        return ", ".join(str(item) for item in self.parameters)


@dataclass(frozen=True, slots=True)
class ForceEffect:
    """A force that no other row explains: coefficients by name, those of zero left out."""

    name: str
    description: str
    parameters: tuple[EffectParameter, ...]

    @property
    def part(self) -> str:
        """How its coefficients are called, for `fishbed list`."""
        axes = " or ".join(axis for axis, _ in AXES)
        return f'"AXIS:TERM" = number; {axes}: {", ".join(term for term, _ in TERMS)}'


def _iron(name: str, description: str) -> InstrumentEffect:
    return InstrumentEffect(
        name,
        description,
        (
            EffectParameter("a", "rad", 0.0, math.pi),
            EffectParameter("phi_rad", "rad", -2.0 * math.pi, 2.0 * math.pi),
        ),
    )


def _one(
    name: str, description: str, key: str, unit: str, least: float, most: float
) -> InstrumentEffect:
    return InstrumentEffect(name, description, (EffectParameter(key, unit, least, most),))


_ROWS = (
    _one("gyro_bias", "the gyro reads b more", "b_rad_s", "rad/s", -10.0, 10.0),
    _one("gyro_scale", "the gyro reads (1 + k) times the rate", "k", "", -1.0, 10.0),
    _one("compass_offset", "the compass reads delta more", "delta_rad", "rad", -math.pi, math.pi),
    _iron("compass_hard_iron", "the compass reads a sin(heading − phi) more"),
    _iron("compass_soft_iron", "the compass reads a sin(2 heading − phi) more"),
    _one("camera_scale", "the camera shows (1 + k) times the distances", "k", "", -0.9, 10.0),
    _one(
        "camera_rotation",
        "the camera's frame is turned by delta",
        "delta_rad",
        "rad",
        -math.pi,
        math.pi,
    ),
    _one("camera_delay", "the camera shows poses of some time before", "delay_s", "s", 0.0, 10.0),
    _one("clock_drift", "recorded time = (1 + k) × true time", "k", "", -0.5, 0.5),
    _one(
        "stale_samples",
        "the camera repeats its last sample for up to hold_s, again and again",
        "hold_s",
        "s",
        0.0,
        60.0,
    ),
    _one(
        "dropped_commands",
        "share of tail-beat commands that never reach an ideal tail, or the robot of a real servo",
        "p",
        "",
        0.0,
        1.0,
    ),
)

INSTRUMENTS: dict[str, InstrumentEffect] = {row.name: row for row in _ROWS}
"""Effects of instruments, clock and link, by name."""

UNKNOWN_FORCE = ForceEffect(
    "unknown_force",
    "a force that nothing else explains, a sum of terms in motion, tail, time and place",
    tuple(
        EffectParameter(
            f"{axis}:{term}", f"{force} / ({unit})" if unit else force, -LARGEST, LARGEST
        )
        for axis, force in AXES
        for term, unit in TERMS
    ),
)

ALL: dict[str, Effect | InstrumentEffect | ForceEffect] = {
    **EFFECTS,
    **INSTRUMENTS,
    UNKNOWN_FORCE.name: UNKNOWN_FORCE,
}
"""Every named effect: the sections of `[effects]`."""
