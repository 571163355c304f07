"""The hull in the water: its resistance, its lift, its inertia."""

from tools.diagnosis.fish.setup import Row, physical
from tools.diagnosis.model import Cause, Parameter

_LEAST, _MOST = -0.95, 10.0


def _scaled(name: str, scale: float, description: str, statement: str) -> Row:
    parameter = Parameter(f"{name}.k", "", _LEAST, _MOST, scale=scale)
    return Row(Cause(name, description, (parameter,), statement), physical(name))


ROWS = (
    _scaled(
        "drag_scale",
        0.3,
        "the drag is another than believed",
        "The body's drag is (1 {k:+.3f}) times what the model says.",
    ),
    _scaled(
        "yaw_drag_scale",
        0.2,
        "the resistance to turning is another than believed",
        "The resistance to turning is (1 {k:+.3f}) times what the model says.",
    ),
    _scaled(
        "lift_scale",
        0.3,
        "the body's lift is another than believed",
        "The body's lift, the side force of oblique flow, is (1 {k:+.3f}) times what the model "
        "says.",
    ),
    Row(
        Cause(
            "drag_vs_bias",
            "drag and resistance to turning depend on the tail's bias",
            (
                Parameter("drag_vs_bias.cd_per_rad2", "1/rad²", -0.15, 20.0, scale=0.1),
                Parameter("drag_vs_bias.kd_per_rad", "N·m·s²/rad", -8e-4, 0.05, scale=3e-4),
            ),
            "Resistance depends on how far the tail is held to the side: the drag coefficient "
            "grows by {cd_per_rad2:.3f} per rad² of bias, that of turning by {kd_per_rad:.2e} "
            "N·m·s² per rad.",
        ),
        physical("drag_vs_bias"),
    ),
    Row(
        Cause(
            "linear_drag",
            "a resistance in proportion to the speed, beside the quadratic one",
            (Parameter("linear_drag.b_n_s_m", "N·s/m", 0.0, 2.0, scale=2e-3),),
            "Beside the drag that grows with the square of the speed there is one in proportion "
            "to it, {b_n_s_m:.4f} N for each m/s.",
        ),
        physical("linear_drag"),
    ),
    _scaled(
        "added_mass_surge",
        0.6,
        "the water that moves along when the robot speeds up weighs another amount",
        "The water that the body drags along when it speeds up or slows down weighs (1 {k:+.3f}) "
        "times what the model says.",
    ),
    _scaled(
        "added_mass_sway",
        0.2,
        "the water that moves along when the robot moves sideways weighs another amount",
        "The water that the body pushes along when it moves sideways weighs (1 {k:+.3f}) times "
        "what the model says.",
    ),
    _scaled(
        "added_inertia_yaw",
        0.3,
        "the inertia of the water that turns along is another than believed",
        "The water that turns along with the body has (1 {k:+.3f}) times the inertia that the "
        "model says.",
    ),
    Row(
        Cause(
            "payload",
            "the robot carries more, or less, than believed",
            (Parameter("payload.dm_kg", "kg", -0.25, 2.0, scale=0.03),),
            "The robot weighs {dm_kg:+.3f} kg more than the model says.",
        ),
        physical("payload"),
    ),
)
