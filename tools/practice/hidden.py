"""What can be hidden in an experiment: the named causes, and effects that are in no table.

A row says how an effect of a given ``size`` changes the laboratory. Where an effect has two numbers
or a direction, its ``shape`` is drawn with the experiment, so that a size is always one number, and
zero changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from plant.effects import EFFECTS
from plant.parameters import PlantParameters
from tools.practice.instruments import Instruments
from tools.practice.swim import Unlisted

Shape = tuple[float, ...]
Draw = Callable[[np.random.Generator], Shape]


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The true robot, its water and its instruments; ``dropped``: share of commands lost."""

    parameters: PlantParameters
    instruments: Instruments
    unlisted: Unlisted = field(default_factory=Unlisted)
    dropped: float = 0.0


Change = Callable[[Laboratory, float, Shape], Laboratory]


@dataclass(frozen=True, slots=True)
class Hidden:
    """One effect: ``first`` is a size that one may notice, ``most`` the largest that is credible.

    ``parameters`` names the numbers of a size and a shape, as the table of causes calls them; an
    effect that is in no such table has none.
    """

    name: str
    first: float
    most: float
    draw: Draw
    change: Change
    parameters: Callable[[float, Shape], Mapping[str, float]]

    @property
    def listed(self) -> bool:
        """Whether the table of causes has it."""
        return bool(self.parameters(0.0, self.draw(np.random.default_rng(0))))


def _up(generator: np.random.Generator) -> Shape:
    return (1.0,)


def _down(generator: np.random.Generator) -> Shape:
    return (-1.0,)


def _either(generator: np.random.Generator) -> Shape:
    return (float(generator.choice((-1.0, 1.0))),)


def _direction(generator: np.random.Generator) -> Shape:
    angle = float(generator.uniform(-math.pi, math.pi))
    return math.cos(angle), math.sin(angle)


def _phase(generator: np.random.Generator) -> Shape:
    return (float(generator.uniform(-math.pi, math.pi)),)


def _adapted(generator: np.random.Generator) -> Shape:
    """In proportion to (3.32, 3.33), either sign of neither: cd and kd at a size of one."""
    return 0.1412 / 0.1936, 4.383e-4 / 9.655e-4 * 1.129e-3


def _physical(name: str, first: float, most: float, draw: Draw = _either) -> Hidden:
    """A row of the plant's own table; the shape multiplies the size, parameter by parameter."""
    effect = EFFECTS[name]

    def values(size: float, shape: Shape) -> dict[str, float]:
        return {p.name: size * s for p, s in zip(effect.parameters, shape, strict=True)}

    def change(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
        return replace(lab, parameters=effect.apply(lab.parameters, values(size, shape)))

    return Hidden(name, first, most, draw, change, values)


def _instrument(
    name: str, key: str, attribute: str, first: float, most: float, draw: Draw = _either
) -> Hidden:
    """One number of the instruments."""

    def change(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
        changed: dict[str, Any] = {attribute: size * shape[0]}
        return replace(lab, instruments=replace(lab.instruments, **changed))

    return Hidden(
        name, first, most, draw, change, lambda size, shape: {key: size * shape[0]} if key else {}
    )


def _iron(name: str, attribute: str) -> Hidden:
    """An amplitude with a phase."""

    def change(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
        changed: dict[str, Any] = {attribute: (size, shape[0])}
        return replace(lab, instruments=replace(lab.instruments, **changed))

    return Hidden(
        name,
        0.03,
        0.8,
        _phase,
        change,
        lambda size, shape: {"a": size, "phi_rad": shape[0]},
    )


def _dropped(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
    return replace(lab, dropped=size)


def _force(
    name: str, first: float, most: float, draw: Draw, make: Callable[..., Unlisted]
) -> Hidden:
    """An unlisted force; ``make`` takes size and shape."""

    def change(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
        return replace(lab, unlisted=make(size, shape))

    return Hidden(name, first, most, draw, change, lambda size, shape: {})


def _sheared(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
    water = replace(
        lab.parameters.water, shear_x_per_y_s=size * shape[0], shear_y_per_x_s=-size * shape[0]
    )
    return replace(lab, parameters=replace(lab.parameters, water=water))


def _floor_iron(lab: Laboratory, size: float, shape: Shape) -> Laboratory:
    wrong = replace(lab.instruments, iron_rad=size, iron_at_m=(shape[0], shape[1]))
    return replace(lab, instruments=wrong)


def _inlet(generator: np.random.Generator) -> Shape:
    return (*_place(generator), *_phase(generator))


def _place(generator: np.random.Generator) -> Shape:
    return float(generator.uniform(-0.5, 0.5)), float(generator.uniform(-0.5, 0.5))


_ROWS = (
    _physical("water_current", 2e-3, 0.05, _direction),
    _physical("tail_offset", 0.02, 0.35),
    _physical("tail_gain", 0.05, 0.5),
    _physical("tail_fade", 1e-3, 0.012, _up),
    _physical("servo_lag", 0.005, 0.5, _up),
    _physical("servo_delay", 0.02, 0.6, _up),
    _physical("servo_rate_limit", 0.6, 3.0, _up),
    _physical("servo_deadband", 0.03, 0.25, _up),
    _physical("servo_backlash", 0.05, 0.5, _up),
    _physical("drag_scale", 0.1, 0.9),
    _physical("yaw_drag_scale", 0.1, 0.9),
    _physical("lift_scale", 0.1, 0.9),
    _physical("drag_vs_bias", 0.5, 10.0, _adapted),
    _physical("linear_drag", 1e-3, 0.1, _up),
    _physical("added_mass_surge", 0.5, 6.0, _up),
    _physical("added_mass_sway", 0.2, 0.9),
    _physical("added_inertia_yaw", 0.3, 6.0, _up),
    _physical("payload", 0.03, 0.3, _up),
    _physical("tail_flexibility", 10.0, 400.0, _up),
    _physical("fin_damage", 0.05, 0.6, _up),
    _physical("tail_body_coupling", 0.2, 1.0, _down),
    _physical("wall_effect", 0.5, 20.0, _up),
    _instrument("gyro_bias", "b_rad_s", "gyro_bias_rad_s", 0.01, 0.3),
    _instrument("gyro_scale", "k", "gyro_scale", 0.05, 0.5),
    _instrument("compass_offset", "delta_rad", "compass_offset_rad", 0.05, 1.0),
    _iron("compass_hard_iron", "hard_iron"),
    _iron("compass_soft_iron", "soft_iron"),
    _instrument("camera_scale", "k", "camera_scale", 0.02, 0.3),
    _instrument("camera_rotation", "delta_rad", "camera_rotation_rad", 0.05, 0.8),
    _instrument("camera_delay", "delay_s", "camera_delay_s", 0.05, 0.6, _up),
    _instrument("clock_drift", "k", "clock_drift", 1e-3, 0.05),
    _instrument("stale_samples", "hold_s", "hold_s", 0.1, 1.5, _up),
    Hidden("dropped_commands", 0.1, 0.5, _up, _dropped, lambda size, shape: {"p": size}),
    # in no table
    _force(
        "tether",
        1e-5,
        5e-3,
        _place,
        lambda size, at: Unlisted(tether_n_m=size, anchor_x_m=at[0], anchor_y_m=at[1]),
    ),
    _force("slosh", 1e-5, 2e-3, _phase, lambda size, at: Unlisted(slosh_n=size, slosh_rad=at[0])),
    _force(
        "crooked_hull",
        2e-4,
        5e-3,
        _either,
        lambda size, sign: Unlisted(asymmetry_m=size * sign[0]),
    ),
    Hidden("rotating_water", 2e-3, 0.1, _either, _sheared, lambda size, shape: {}),
    _instrument("gyro_drift", "", "gyro_drift_rad_s2", 2e-4, 0.02),
    _instrument("lens", "", "lens_per_m2", 0.01, 0.3, _up),
    Hidden("iron_in_the_floor", 0.1, 1.5, _place, _floor_iron, lambda size, shape: {}),
    _force(
        "jet",
        1e-4,
        5e-3,
        _inlet,
        lambda size, at: Unlisted(jet_n=size, jet_x_m=at[0], jet_y_m=at[1], jet_rad=at[2]),
    ),
    _instrument("gyro_saturation", "", "gyro_limit_s_rad", 0.5, 20.0, _up),
    _instrument("late_compass", "", "compass_delay_s", 0.05, 1.0, _up),
)

HIDDEN: dict[str, Hidden] = {row.name: row for row in _ROWS}
"""Effects by name."""

LISTED = tuple(name for name, row in HIDDEN.items() if row.listed)
UNLISTED = tuple(name for name, row in HIDDEN.items() if not row.listed)
