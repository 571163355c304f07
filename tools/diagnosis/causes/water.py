"""The water: a current, and what the walls of the tank do to the drag."""

from tools.diagnosis.fish.setup import Row, physical
from tools.diagnosis.model import Cause, Parameter

ROWS = (
    Row(
        Cause(
            "water_current",
            "the water of the tank flows steadily",
            (
                Parameter("water_current.cx_m_s", "m/s", -0.5, 0.5, scale=5e-4),
                Parameter("water_current.cy_m_s", "m/s", -0.5, 0.5, scale=5e-4),
            ),
            "The water flows: {cx_m_s:+.4f} m/s along the tank's x axis and {cy_m_s:+.4f} m/s "
            "along its y axis.",
        ),
        physical("water_current"),
    ),
    Row(
        Cause(
            "wall_effect",
            "walls raise the drag of a robot that is near them",
            (Parameter("wall_effect.k", "", 0.0, 50.0, scale=1.0),),
            "Near a wall the robot is held back: at the wall its drag is {k:.2f} times larger "
            "than the model says, on top of what it is elsewhere.",
        ),
        physical("wall_effect"),
    ),
)
