"""The table of causes, in the order of the contract: adding one is a row here."""

from tools.diagnosis.causes import camera, hull, instruments, links, servo, tail, unknown, water
from tools.diagnosis.fish.setup import Row

_ORDER = (
    "water_current",
    "tail_offset",
    "tail_gain",
    "tail_fade",
    "servo_lag",
    "servo_delay",
    "servo_rate_limit",
    "servo_deadband",
    "servo_backlash",
    "drag_scale",
    "yaw_drag_scale",
    "lift_scale",
    "drag_vs_bias",
    "linear_drag",
    "added_mass_surge",
    "added_mass_sway",
    "added_inertia_yaw",
    "payload",
    "tail_flexibility",
    "fin_damage",
    "tail_body_coupling",
    "wall_effect",
    "gyro_bias",
    "gyro_scale",
    "compass_offset",
    "compass_hard_iron",
    "compass_soft_iron",
    "camera_scale",
    "camera_rotation",
    "camera_delay",
    "clock_drift",
    "stale_samples",
    "dropped_commands",
    "unknown_force",
)

_ALL = {
    row.name: row
    for module in (water, servo, hull, tail, instruments, camera, links, unknown)
    for row in module.ROWS
}

CAUSES: dict[str, Row] = {name: _ALL.pop(name) for name in _ORDER} | _ALL
"""Rows by name; ``unknown_force`` is the library of what no row explains."""
