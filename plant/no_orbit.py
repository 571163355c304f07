"""Why there is no steady motion, in words: what a robot lacks, or how far its search came.

A search knows little: that Newton's equations had no one solution, or how far a beat was from
closed in the end. What it does not know it does not say; each reason names all that may be behind
it, of what this robot has.
"""

import math

from plant.parameters import PlantParameters

_CLOSED = 1e-3  # of the scales: a beat that the coarsest grid takes for closed


def is_slowed(parameters: PlantParameters) -> bool:
    """Whether anything but the tail takes energy from a body that glides."""
    water = parameters.hydrodynamics
    return any(
        value != 0.0
        for value in (
            water.drag,
            water.drag_per_bias_squared,
            water.yaw_drag_n_m_s2,
            water.yaw_drag_per_bias_n_m_s2,
            water.linear_drag_n_s_m,
        )
    )


def undecided(parameters: PlantParameters) -> str:
    """Newton's equations are singular."""
    causes = ["too little drag to decide the speed"]
    servo = parameters.servo
    if not servo.ideal or servo.extra_dead_band_rad > 0.0:
        causes.append("a servo that does not move at all for this beat (its dead band)")
    if parameters.tail.flexible:
        causes.append("a tail too stiff for the search's arithmetic (try it rigid)")
    return (
        "a deviation seems to stay as it is from beat to beat, so there is no one steady value; "
        f"behind it may be {', or '.join(causes)}"
    )


def not_closed(gap: float, step_s: float, tolerance: float) -> str:
    """No beat closed. ``gap``: what a beat changed in the end, in scales; NaN is not known."""
    if math.isnan(gap) or gap <= _CLOSED:
        known = "" if math.isnan(gap) else f" (to {gap:.2g} of the scales)"
        return (
            f"a beat closes on a coarse grid{known}, but with steps of {step_s:.3g} s the search "
            f"did not come to its tolerance of {tolerance:g}; try another step or a larger "
            "tolerance, or find the steady motion by simulating"
        )
    if math.isinf(gap):
        return "in the end a beat left all bounds: the motion grows (check the drag)"
    return (
        f"in the end a beat still changed the velocities by {gap:.2g} of their scale: the motion "
        "grows (check the drag), or wanders, or repeats after several beats only"
    )
