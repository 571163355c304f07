"""All that a cause may change: the robot in its water, its instruments, its clock, its link.

Plain numbers, neutral at zero beside the plant's own parameters; imports nothing compiled, so that
`fishbed list causes` is quick.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from plant.effects import EFFECTS
from plant.parameters import PlantParameters
from tools.diagnosis.model import Cause


@dataclass(frozen=True, slots=True)
class Setup:
    """A robot as a model believes it to be, or as a cause makes it.

    ``accel_late_s``, ``compass_late_s``: how old a sample is when it is stamped.
    ``command_late_s``: how much later than stamped commands come, against all measurements.
    ``hard_iron``, ``soft_iron``: cosine and sine parts of the compass's error, rad:
    c sin ψ − s cos ψ = a sin(ψ − φ) with c = a cos φ, s = a sin φ (2ψ for soft iron).
    ``force``: coefficients of the library of unexplained forces by (axis, term).
    """

    plant: PlantParameters
    gyro_bias_rad_s: float = 0.0
    gyro_scale: float = 0.0
    compass_offset_rad: float = 0.0
    hard_iron_rad: tuple[float, float] = (0.0, 0.0)
    soft_iron_rad: tuple[float, float] = (0.0, 0.0)
    camera_scale: float = 0.0
    camera_rotation_rad: float = 0.0
    camera_delay_s: float = 0.0
    accel_x_bias_m_s2: float = 0.0
    accel_y_bias_m_s2: float = 0.0
    accel_late_s: float = 0.0
    compass_late_s: float = 0.0
    command_late_s: float = 0.0
    clock_drift: float = 0.0
    hold_s: float = 0.0
    dropped: float = 0.0
    force: Mapping[tuple[int, int], float] = field(default_factory=dict)


def total(a: float, b: float) -> float:
    """Return two changes that add up."""
    return a + b


def product(a: float, b: float) -> float:
    """Return the error of two scales, one after the other, each 1 + error."""
    return a + b + a * b


def loss(a: float, b: float) -> float:
    """Return the share that is lost by two losses, one after the other."""
    return a + b - a * b


_TOGETHER: Mapping[str, Callable[[float, float], float]] = {
    "gyro_scale": product,
    "camera_scale": product,
    "clock_drift": product,
    "dropped": loss,
}
"""How two changes of a field make one; others add."""


def beside(setup: Setup, changes: Mapping[str, float]) -> Setup:
    """Return a setup with changes of its fields, beside what is wrong there already."""
    made = {
        field: _TOGETHER.get(field, total)(getattr(setup, field), change)
        for field, change in changes.items()
    }
    return _with(setup, **made)


_MANY = 8
"""More parameters than these are counted, not named."""

Change = Callable[[Setup, Mapping[str, float]], Setup]


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table of causes. ``change`` takes values by their short names."""

    cause: Cause
    change: Change

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.cause.name

    @property
    def description(self) -> str:
        """What it is, in a few words."""
        return self.cause.description

    @property
    def part(self) -> str:
        """Its parameters in words, for `fishbed list`."""
        if len(self.cause.parameters) > _MANY:
            return f"{len(self.cause.parameters)} coefficients"
        return ", ".join(
            f"{short(p.name)} {p.least:g} … {p.most:g}{f' {p.unit}' if p.unit else ''}"
            for p in self.cause.reported
        )

    def apply(self, setup: Setup, values: Mapping[str, float]) -> Setup:
        """Return the changed setup; neutral values return the very one that was given."""
        own = {short(p.name): float(values.get(p.name, 0.0)) for p in self.cause.parameters}
        if not any(own.values()):
            return setup
        return self.change(setup, own)


def short(name: str) -> str:
    """Return the part of a parameter's name after its cause's."""
    return name.partition(".")[2]


def physical(name: str) -> Change:
    """Make the change of a row of the plant's own table of effects."""
    effect = EFFECTS[name]

    def change(setup: Setup, values: Mapping[str, float]) -> Setup:
        return _with(setup, plant=effect.apply(setup.plant, values))

    return change


def added(**fields: str) -> Change:
    """Make a change by each parameter of a field of the setup."""

    def change(setup: Setup, values: Mapping[str, float]) -> Setup:
        return beside(setup, {field: values[name] for name, field in fields.items()})

    return change


def _with(setup: Setup, **changes: Any) -> Setup:
    return replace(setup, **changes)
