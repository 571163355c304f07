"""Ranges of a scenario's values, named so that its sections read as tables.

Bounds are physical, not tuned: what lies beyond is absurd, what lies within computes.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

Fraction = Annotated[float, Meta(ge=0, le=1)]
Probability = Fraction
Position = Annotated[float, Meta(ge=-1e3, le=1e3)]
Extent = Annotated[float, Meta(gt=1e-3, le=1e3)]
Mass = Annotated[float, Meta(gt=1e-3, le=1e3)]
AddedMass = Annotated[float, Meta(ge=0, le=1e3)]
Coefficient = Annotated[float, Meta(ge=0, le=1e3)]
Slope = Annotated[float, Meta(ge=-1e3, le=1e3)]
Delay = Annotated[float, Meta(ge=0, le=10)]
Shear = Annotated[float, Meta(ge=-10, le=10)]
TailExtent = Annotated[float, Meta(gt=1e-3, le=10)]
ProfileFactor = Annotated[float, Meta(ge=0, le=1e3)]
Voltage = Annotated[float, Meta(gt=0.1, le=100)]
Torque = Annotated[float, Meta(gt=1e-3, le=1e3)]
TurnRate = Annotated[float, Meta(gt=0.01, le=1e3)]
Current = Annotated[float, Meta(ge=0, le=100)]
NoiseScale = Annotated[float, Meta(ge=0, le=1e3)]
MagneticField = Annotated[float, Meta(ge=-0.01, le=0.01)]  # the LSM303DLH ends at 8.1 gauss
Moment = Annotated[float, Meta(ge=0, le=1e6)]
Duration = Annotated[float, Meta(gt=1e-6, le=1e6)]
Angle = Annotated[float, Meta(ge=-2 * math.pi, le=2 * math.pi)]
TailBias = Annotated[float, Meta(ge=-math.radians(50), le=math.radians(50))]
TailAmplitude = Annotated[float, Meta(ge=0, le=math.pi / 2)]
TailFrequency = Annotated[float, Meta(ge=0, le=4)]
# The motion controller clips what is beyond (`navboard.motion.MotionLimits`): refused instead.
DriftPpm = Annotated[float, Meta(ge=-100_000, le=100_000)]
CrystalPpm = Annotated[float, Meta(ge=-10_000, le=10_000)]  # 1.7 % make the ADC clock too fast
ErrorRate = Annotated[float, Meta(ge=0, le=0.5)]  # beyond, inverted bits are the right ones
BodyRate = Annotated[float, Meta(ge=-50, le=50)]
Seed = Annotated[int, Meta(ge=0, le=2**53)]
PanId = Annotated[int, Meta(ge=0, le=0xFFFF)]
Point = tuple[Position, Position]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the scenario: frozen, and no key that it does not know."""
