"""What may be off without anything being wrong: tolerances of robot and instruments.

The robot's own numbers (mass, inertia, areas, coefficients) are known to ±3 % each, uniformly, so
their standard deviation is 3 %/√3; the figure can be changed. Instruments are calibrated as a
careful user does it:

- gyro: 0.5 °/s of zero rate is left over after the board's own calibration
  (``navboard.chips.lpy503al``), its sensitivity is good to 1 %;
- compass: aligned by eye with the hull, 1°;
- camera: scale from a ruler of 1 m read to 2 mm, frame turned by 0.3° at most against the tank's
  edge, stamps good to 3 ms (a tenth of a frame);
- commands: stamped 3 ms early or late against the measurements (they wait for a step of a
  programme, or for the next pulse of a servo);
- accelerometer: the LSM303DLH's ±20 mg of zero-g offset, taken as two standard deviations;
- clocks: crystals of 20 ppm on either side (30 ppm together).

The boards of the robot have more: compass and accelerometer are read after a control tick and
stamped at the next (``sample_age_s``, good to 1 ms); and gyro and accelerometer have another bias
each time they are switched on.

A cause is a change beyond these: it is judged after they have been fitted, with these priors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from plant.parameters import PlantParameters
from tools.diagnosis.fish.setup import Setup, beside
from tools.diagnosis.model import Parameter

TOLERANCE = 0.03
"""Of each of the robot's numbers, to both sides."""

ROBOT: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "mass": ("body", ("mass_kg",)),
    "inertia": ("body", ("yaw_inertia_kg_m2",)),
    "added_mass_surge": ("body", ("added_mass_surge_kg",)),
    "added_mass_sway": ("body", ("added_mass_sway_kg",)),
    "added_inertia_yaw": ("body", ("added_inertia_yaw_kg_m2",)),
    "area": ("body", ("wetted_area_m2",)),
    "hinge": ("body", ("hinge_distance_m",)),
    "tail_length": ("tail", ("length_m",)),
    "tail_depth": ("tail", ("depth_m",)),
    "drag": ("hydrodynamics", ("drag", "drag_per_bias_squared")),
    "lift": ("hydrodynamics", ("lift", "lift_per_bias")),
    "yaw_drag": ("hydrodynamics", ("yaw_drag_n_m_s2", "yaw_drag_per_bias_n_m_s2")),
}
"""Tolerance → section of the plant's parameters and the fields that it scales."""

STRAIGHT: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "drag_straight": ("hydrodynamics", ("drag",)),
    "yaw_drag_straight": ("hydrodynamics", ("yaw_drag_n_m_s2",)),
}
"""The same for what matters only where drag depends on bias: see ``straight``."""

STRAIGHT_SD = 0.20
"""How far the resistance at no bias may lie from a constant that was identified at some bias: at
20°, as those of the source were, its (3.32, 3.33) lie 13 and 14 % below."""

_INSTRUMENTS: tuple[tuple[str, str, str, float], ...] = (
    ("gyro_bias", "rad/s", "gyro_bias_rad_s", math.radians(0.5)),
    ("gyro_scale", "", "gyro_scale", 0.01),
    ("compass_offset", "rad", "compass_offset_rad", math.radians(1.0)),
    ("camera_scale", "", "camera_scale", 0.002),
    ("camera_rotation", "rad", "camera_rotation_rad", math.radians(0.3)),
    ("camera_delay", "s", "camera_delay_s", 0.003),
    ("command_time", "s", "command_late_s", 0.003),
    ("clock", "", "clock_drift", 3e-5),
)
"""Tolerance, unit, field of the setup that it adds to, standard deviation."""

ACCEL_BIAS_M_S2 = 0.010 * 9.80665
"""Standard deviation of an accelerometer's bias, and of what it has anew in each run."""

_ACCELEROMETER: tuple[tuple[str, str, str, float], ...] = (
    ("accel_x_bias", "m/s²", "accel_x_bias_m_s2", ACCEL_BIAS_M_S2),
    ("accel_y_bias", "m/s²", "accel_y_bias_m_s2", ACCEL_BIAS_M_S2),
)
"""The same where an accelerometer was recorded."""

_BOARDS: tuple[tuple[str, str, str, float], ...] = (
    ("compass_late", "s", "compass_late_s", 0.001),
    ("accel_late", "s", "accel_late_s", 0.001),
)
"""The same of the robot's boards."""

_EACH_RUN: tuple[tuple[str, str, str, float], ...] = (
    ("run_gyro_bias", "rad/s", "gyro_bias_rad_s", math.radians(0.5)),
    ("run_accel_x_bias", "m/s²", "accel_x_bias_m_s2", ACCEL_BIAS_M_S2),
    ("run_accel_y_bias", "m/s²", "accel_y_bias_m_s2", ACCEL_BIAS_M_S2),
)
"""The same, of each run its own."""

PREFIX = "tolerance."
_FARTHEST = 6.0
"""Standard deviations within which a tolerance is fitted."""


def tolerances(
    robot: float = TOLERANCE, *, accelerometer: bool = False, boards: bool = False
) -> tuple[Parameter, ...]:
    """Return the tolerances as parameters; ``robot``: half width of the robot's own."""
    instruments = _INSTRUMENTS + (_ACCELEROMETER if accelerometer else ())
    instruments += _BOARDS if boards else ()
    sd = robot / math.sqrt(3.0)
    own = tuple(
        Parameter(PREFIX + name, "", -min(0.5, _FARTHEST * sd), min(0.5, _FARTHEST * sd), sd, sd)
        for name in ROBOT
    )
    return own + _parameters(instruments)


def sample_age_s(control_hz: float) -> float:
    """Return how old a compass's or accelerometer's sample is when the boards stamp it.

    The control task asks for it a quarter of a millisecond after its tick (measured on the bundled
    firmware: 0.25 ± 0.1 ms), and takes it at the next.
    """
    return 1.0 / control_hz - 0.25e-3


def of_each_run(*, accelerometer: bool) -> tuple[Parameter, ...]:
    """Return what the robot's boards have anew in each run."""
    return _parameters(_EACH_RUN if accelerometer else _EACH_RUN[:1])


def _parameters(table: tuple[tuple[str, str, str, float], ...]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(PREFIX + name, unit, -_FARTHEST * sd, _FARTHEST * sd, sd, sd)
        for name, unit, _, sd in table
    )


def straight() -> tuple[Parameter, ...]:
    """Return how far the resistance at no bias is from the believed constants.

    A constant is identified at some bias. Whoever then says that resistance depends on bias has no
    claim to the constant at no bias: it is another number, which only the data tell.
    """
    sd = STRAIGHT_SD
    return tuple(Parameter(PREFIX + name, "", -0.5, 0.5, sd, sd) for name in STRAIGHT)


def made_straight(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Apply ``straight``; to be done only where drag depends on bias."""
    return replace(setup, plant=_scaled(setup.plant, STRAIGHT, values))


def within_tolerances(setup: Setup, values: Mapping[str, float]) -> Setup:
    """Apply the tolerances among some values; without one it returns the very setup given."""
    plant = _scaled(setup.plant, ROBOT, values)
    if plant is not setup.plant:
        setup = replace(setup, plant=plant)
    for name, _, field, _ in _INSTRUMENTS + _ACCELEROMETER + _BOARDS + _EACH_RUN:
        error = values.get(PREFIX + name, 0.0)
        if error != 0.0:
            setup = beside(setup, {field: error})
    return setup


def _scaled(
    plant: PlantParameters,
    table: Mapping[str, tuple[str, tuple[str, ...]]],
    values: Mapping[str, float],
) -> PlantParameters:
    """Return the plant with the fields of a table scaled; the very one where none is off."""
    for name, (section, fields) in table.items():
        error = values.get(PREFIX + name, 0.0)
        if error != 0.0:
            part = getattr(plant, section)
            scaled = {field: getattr(part, field) * (1.0 + error) for field in fields}
            plant = replace(plant, **{section: replace(part, **scaled)})
    return plant
