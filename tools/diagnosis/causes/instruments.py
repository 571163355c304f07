"""The instruments on board: gyro and compass."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from tools.diagnosis.fish.setup import Change, Row, Setup, added
from tools.diagnosis.model import Cause, Parameter


def polar(numbers: Sequence[float]) -> tuple[float, ...]:
    """Return amplitude and phase of cosine and sine parts."""
    cosine, sine = numbers
    return math.hypot(cosine, sine), math.atan2(sine, cosine)


def parts(numbers: Sequence[float]) -> tuple[float, ...]:
    """Return cosine and sine parts of amplitude and phase."""
    size, phase = numbers
    return size * math.cos(phase), size * math.sin(phase)


def _iron(name: str, change: Change, error: str, words: tuple[str, str]) -> Row:
    """An error with amplitude and phase, estimated as two parts: at zero no phase is defined."""
    description, statement = words
    return Row(
        Cause(
            name,
            description,
            (
                Parameter(f"{name}.cos_rad", "rad", -1.0, 1.0, scale=3e-3),
                Parameter(f"{name}.sin_rad", "rad", -1.0, 1.0, scale=3e-3),
            ),
            statement + error,
            shown=(
                Parameter(f"{name}.a", "rad", 0.0, math.sqrt(2.0)),
                Parameter(f"{name}.phi_rad", "rad", -math.pi, math.pi),
            ),
            show=polar,
            read=parts,
        ),
        change,
    )


def _hard(setup: Setup, values: Mapping[str, float]) -> Setup:
    c, s = setup.hard_iron_rad
    return replace(setup, hard_iron_rad=(c + values["cos_rad"], s + values["sin_rad"]))


def _soft(setup: Setup, values: Mapping[str, float]) -> Setup:
    c, s = setup.soft_iron_rad
    return replace(setup, soft_iron_rad=(c + values["cos_rad"], s + values["sin_rad"]))


def _one(
    name: str,
    parameter: tuple[str, str, float, float, float],
    change: Callable[..., Setup],
    words: tuple[str, str],
) -> Row:
    short, unit, least, most, scale = parameter
    declared = Parameter(f"{name}.{short}", unit, least, most, scale=scale)
    return Row(Cause(name, words[0], (declared,), words[1]), change)


ROWS = (
    _one(
        "gyro_bias",
        ("b_rad_s", "rad/s", -1.0, 1.0, 0.01),
        added(b_rad_s="gyro_bias_rad_s"),
        (
            "the gyro shows a turn rate where there is none",
            "The gyro reads {b_rad_s:+.4f} rad/s too much, also when the robot stands still.",
        ),
    ),
    _one(
        "gyro_scale",
        ("k", "", -0.9, 2.0, 0.03),
        added(k="gyro_scale"),
        (
            "the gyro's scale is wrong",
            "The gyro shows (1 {k:+.3f}) times the true turn rate.",
        ),
    ),
    _one(
        "compass_offset",
        ("delta_rad", "rad", -math.pi, math.pi, 0.03),
        added(delta_rad="compass_offset_rad"),
        (
            "the compass is off by a constant angle",
            "The compass reads {delta_rad:+.3f} rad too much, whatever the heading.",
        ),
    ),
    _iron(
        "compass_hard_iron",
        _hard,
        "sin(heading − {phi_rad:+.2f} rad).",
        (
            "magnetised parts near the compass bend its reading",
            "Something magnetic travels with the compass: its error is {a:.3f} rad × ",
        ),
    ),
    _iron(
        "compass_soft_iron",
        _soft,
        "sin(2 × heading − {phi_rad:+.2f} rad).",
        (
            "iron near the compass bends the earth's field",
            "Iron near the compass bends the earth's field: its error is {a:.3f} rad × ",
        ),
    ),
)
