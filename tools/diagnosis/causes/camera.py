"""The overhead camera: its scale, its frame, its delay, and frames that it shows again."""

import math

from tools.diagnosis.fish.setup import Row, added
from tools.diagnosis.model import Cause, Parameter

ROWS = (
    Row(
        Cause(
            "camera_scale",
            "the camera's scale is wrong",
            (Parameter("camera_scale.k", "", -0.5, 1.0, scale=0.05),),
            "The camera's scale is wrong: its distances are (1 {k:+.4f}) times the true ones.",
        ),
        added(k="camera_scale"),
    ),
    Row(
        Cause(
            "camera_rotation",
            "the camera's frame is turned against the tank's",
            (Parameter("camera_rotation.delta_rad", "rad", -math.pi, math.pi, scale=0.03),),
            "The camera is turned by {delta_rad:+.4f} rad against the tank.",
        ),
        added(delta_rad="camera_rotation_rad"),
    ),
    Row(
        Cause(
            "camera_delay",
            "the camera shows where the robot was some time before",
            (Parameter("camera_delay.delay_s", "s", 0.0, 1.0, scale=0.06),),
            "The camera's poses are {delay_s:.3f} s older than their time stamps say.",
        ),
        added(delay_s="camera_delay_s"),
    ),
    Row(
        Cause(
            "stale_samples",
            "the camera shows its last pose again for a while",
            (Parameter("stale_samples.hold_s", "s", 0.0, 3.0, scale=0.2),),
            "The camera stalls now and then and repeats its last pose for up to {hold_s:.2f} s.",
        ),
        added(hold_s="hold_s"),
    ),
)
