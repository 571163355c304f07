"""What no row explains: a sparse sum of simple forces on the body.

Terms and units are those of ``plant.extra_force``; a coefficient is in newtons (newton metres for
yaw) per unit of its term.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from plant.extra_force import AXES, TERMS
from tools.diagnosis.fish.setup import Row, Setup
from tools.diagnosis.model import Cause, Parameter

NAME = "unknown_force"

_MOTION = {"1": 1.0, "u": 0.03, "v": 0.02, "r": 0.5, "a": 0.3, "a_dot": 1.5, "t": 30.0}
_SIZES = {**_MOTION, "x": 0.5, "y": 0.5}
"""What the factors of a term usually are, in SI units, for the scales of differences."""

_FORCE = (2e-4, 2e-4, 5e-6, 2e-4, 2e-4)
"""N, N, N·m, N, N that begin to matter to a robot of this size."""

_BODY = 3
_OF_PLACE = ("1", "x", "y")
"""Forces on the body's axes follow its motion, tail and time; on the tank's, its place."""


def _usual(term: str) -> float:
    size = 1.0
    rest = term.replace("|", " ")
    for factor in ("a_dot", "a", "u", "v", "r", "t", "x", "y", "1"):
        size *= _SIZES[factor] ** rest.count(factor)
        rest = rest.replace(factor, "")
    return size


def _parameter(axis: int, term: int) -> Parameter:
    (name, force), (words, unit) = AXES[axis], TERMS[term]
    return Parameter(
        f"{NAME}.{name}:{words}",
        f"{force} / ({unit})" if unit else force,
        scale=_FORCE[axis] / _usual(words),
    )


_LOOKED_FOR = tuple(
    (axis, term)
    for axis in range(len(AXES))
    for term, (words, _) in enumerate(TERMS)
    if (words in _OF_PLACE if axis >= _BODY else words not in ("x", "y"))
)

_FORCES = {_parameter(axis, term): (axis, term) for axis, term in _LOOKED_FOR}

PLACE_OF = {parameter.name: place for parameter, place in _FORCES.items()}
"""Axis and term of ``plant.extra_force`` by the names of their coefficients."""

SHEARS = {"current_x:y": "shear_x_per_y_s", "current_y:x": "shear_y_per_x_s"}
"""A force of the water that moves otherwise from place to place: name → key of `[plant.water]`."""

_SHEAR_S = 2e-4
"""1/s: what carries a robot that crosses a tank by a tenth of a millimetre more every second."""

_FAST_S = 0.5
"""1/s: no robot of this size stays in a tank whose water moves so."""

LIBRARY = (
    *_FORCES,
    *(Parameter(f"{NAME}.{name}", "1/s", -_FAST_S, _FAST_S, scale=_SHEAR_S) for name in SHEARS),
)
"""Coefficients of the terms that are looked for, axis after axis."""


def _change(setup: Setup, values: Mapping[str, float]) -> Setup:
    force = dict(setup.force)
    for parameter, place in _FORCES.items():
        size = values[parameter.name.partition(".")[2]]
        if size != 0.0:
            force[place] = force.get(place, 0.0) + size
    water = setup.plant.water
    moved = {key: getattr(water, key) + values[name] for name, key in SHEARS.items()}
    plant = replace(setup.plant, water=replace(water, **moved))
    return replace(setup, plant=plant, force=force)


ROWS = (
    Row(
        Cause(
            NAME,
            "a force that no row explains, a sparse sum of terms in motion, tail, time and place",
            LIBRARY,
            "A force acts that no named cause explains.",
        ),
        _change,
    ),
)
