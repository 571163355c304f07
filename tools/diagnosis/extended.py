"""The extended model: the believed scenario with what was found, as `fishbed run` takes it.

Causes become their sections of `[effects]`, beside what is believed there already; so do the
coefficients of an unexplained force, but for those of a sheared current: these are the water's.
Tolerances that were fitted are part of the numbers that a report gives: the robot's own scale the
numbers of `[plant]`, those of the instruments add to the sections of `[effects]`. What a scenario
cannot say is named: errors of sensors without a name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from tools import scenario
from tools.configuration import Scenario
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.causes.unknown import SHEARS
from tools.diagnosis.fish.nuisances import PREFIX, ROBOT, STRAIGHT
from tools.diagnosis.fish.setup import loss, product, short, total
from tools.diagnosis.model import Cause
from tools.effects import ALL, INSTRUMENTS

_INSTRUMENTS: Mapping[str, tuple[str, str]] = {
    "gyro_bias": ("gyro_bias", "b_rad_s"),
    "gyro_scale": ("gyro_scale", "k"),
    "compass_offset": ("compass_offset", "delta_rad"),
    "camera_scale": ("camera_scale", "k"),
    "camera_rotation": ("camera_rotation", "delta_rad"),
    "camera_delay": ("camera_delay", "delay_s"),
    "clock": ("clock_drift", "k"),
}
"""Tolerance of an instrument → section and key of `[effects]`."""


def _turn(a: float, b: float) -> float:
    """Return the sum of two angles, a turn less where it is beyond half a turn."""
    both = a + b
    return both if abs(both) <= math.pi else math.remainder(both, 2.0 * math.pi)


_SCALES = (
    "tail_gain",
    "drag_scale",
    "yaw_drag_scale",
    "lift_scale",
    "added_mass_surge",
    "added_mass_sway",
    "added_inertia_yaw",
    "gyro_scale",
    "camera_scale",
    "clock_drift",
)
_TOGETHER: Mapping[str, Callable[[float, float], float]] = {
    **dict.fromkeys(_SCALES, product),
    "compass_offset": _turn,
    "camera_rotation": _turn,
    "fin_damage": loss,
    "dropped_commands": loss,
}
"""How an effect that is believed and one that was found make one; others add."""


@dataclass(frozen=True, slots=True)
class Extended:
    """The scenario, and the names of what it cannot say."""

    config: Scenario
    left_out: tuple[str, ...]

    def to_toml(self) -> str:
        """Write it, with what is left out as remarks on top."""
        remarks = [f"# left out, for no scenario can say it: {name}\n" for name in self.left_out]
        return "".join(remarks) + scenario.to_toml(self.config)


def extended(believed: Scenario, values: Mapping[str, float], name: str = "") -> Extended:
    """Return the believed scenario with some values of parameters (causes and tolerances).

    Raises ``ScenarioError`` where they make an impossible robot.
    """
    data: dict[str, Any] = msgspec.to_builtins(believed)
    left_out: list[str] = []
    for parameter, (section, fields) in ROBOT.items():
        error = values.get(PREFIX + parameter, 0.0)
        for field in fields if error != 0.0 else ():
            data["plant"][section][field] *= 1.0 + error
    if any(name.startswith("drag_vs_bias.") and x != 0.0 for name, x in values.items()):
        for parameter, (section, fields) in STRAIGHT.items():
            for field in fields:
                data["plant"][section][field] *= 1.0 + values.get(PREFIX + parameter, 0.0)
    found: dict[tuple[str, str], float] = {}
    for parameter, place in _INSTRUMENTS.items():
        error = values.get(PREFIX + parameter, 0.0)
        if error != 0.0:
            found[place] = error
    for cause_name, row in CAUSES.items():
        cause = row.cause
        own = [float(values.get(p.name, 0.0)) for p in cause.parameters]
        if not any(own):
            continue
        if cause_name not in ALL:
            left_out.append(cause_name)
            continue
        for p, number in zip(cause.reported, _reported(cause, own, data), strict=True):
            place = cause_name, short(p.name)
            if place[1] in SHEARS:
                data["plant"]["water"][SHEARS[place[1]]] += number
                continue
            found[place] = _TOGETHER.get(cause_name, total)(found.get(place, 0.0), number)
    left_out += [n for n, x in values.items() if x != 0.0 and not _sayable(n)]
    for (section, key), number in found.items():
        there = data["effects"][section]
        together = _TOGETHER.get(section, total)(there.get(key, 0.0), number)
        there[key] = _within(section, key, together)
    if name:
        data["scenario"]["name"] = name
    return Extended(scenario.from_mapping(_plain(data), "extended"), tuple(left_out))


def _reported(cause: Cause, own: Sequence[float], data: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the numbers to add to what is believed, whose parts add where the numbers do not."""
    if cause.read is None:
        return cause.report(own)
    there = [data["effects"][cause.name][short(p.name)] for p in cause.reported]
    both = cause.report([a + b for a, b in zip(cause.read(there), own, strict=True)])
    return tuple(a - b for a, b in zip(both, there, strict=True))


def _sayable(name: str) -> bool:
    """Whether a value's name is that of a tolerance or of a cause, and not of a sensor's error."""
    return name.startswith(PREFIX) or name.partition(".")[0] in CAUSES


def _within(section: str, key: str, number: float) -> float:
    """Return a number within its bounds: a tolerance may lie just beyond (a delay below zero)."""
    bounds = next(p for p in ALL[section].parameters if p.name == key)
    if section in INSTRUMENTS:
        return min(max(number, bounds.least), bounds.most)
    return number


def _plain(data: Any) -> Any:
    """Return the data without what is None: TOML has no word for it."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items() if value is not None}
    if isinstance(data, (list, tuple)):
        return [_plain(value) for value in data]
    return data
