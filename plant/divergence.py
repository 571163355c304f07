"""Why a march left all bounds, and what to do: found by marching on from the last good point.

A motion can be lost in four ways that look the same from outside. The step may be too long for the
fastest part; something may be so stiff that no usable step resolves it; a tail that bends may have
folded up; or the equations themselves run away. Only a trial tells: where shorter steps get beyond
the place, the step was too long; where only absurdly short ones do, it is stiffness; where none
does, the step is not to blame.
"""

import math

import numpy as np

from plant.arrays import FloatArray
from plant.errors import DivergedError
from plant.integrate import motion_of
from plant.layout import STATE, Drive
from plant.parameters import PlantParameters
from plant.trajectory import Trajectory

_FINER = (2, 8, 32)
_FAR_FINER = (128, 1024, 32768)  # not for Radau's method, which is stable with any step
_FEW = 8  # steps of those: stiff drag has braked by then
_LEAST_STEP_S = 1e-5  # shorter ones are no advice: beyond what scenarios allow
_LEAST_AHEAD, _MOST_AHEAD = 100, 1000  # steps, where a beat is shorter or longer
_FOLDED_DEG = 90.0
_FOLDED_SHARE = 0.5  # of a beam's length; linear theory holds far below


def diverged(
    parameters: PlantParameters,
    drive: FloatArray,
    drive_start: int,
    k: int,
    h: float,
    state: FloatArray,
) -> DivergedError:
    """Say where a march stopped and why: trials from the last good point ``state`` tell."""
    cause = _too_stiff(parameters, h) or _by_trial(parameters, drive, k - drive_start, h, state)
    return DivergedError(k * h, tuple(float(value) for value in state[:STATE]), cause)


def _too_stiff(parameters: PlantParameters, h: float) -> str:
    """Joints beyond the arithmetic, which need no trial."""
    if parameters.tail.segments < 2:
        return ""
    from plant.flexible.segments import stiffest_joint

    stiffness, most = stiffest_joint(parameters, h)
    if stiffness <= most:
        return ""
    return (
        f"a joint's stiffness of {stiffness:.3g} N·m/rad is more than the arithmetic bears at a "
        f"step of {h:g} s ({most:.3g} N·m/rad): the rounding of its angle moves the body; make "
        "the tail softer, or rigid (segments = 1), or the step shorter"
    )


def _by_trial(
    parameters: PlantParameters, drive: FloatArray, since: int, h: float, state: FloatArray
) -> str:
    """``since``: steps from the drive's beginning to the last good point."""

    def passes(finer: int, steps: int) -> bool:
        motion = motion_of(parameters, h / finer)
        scratch, probe = np.empty((1, motion.whole_width)), state.copy()
        first, count = since * finer, steps * finer
        reached = motion.march(drive, 0, first, first + count, probe, scratch, first, count + 1)
        return reached == first + count

    omega = Drive(*drive.tolist()).omega
    beat = math.ceil(2.0 * math.pi / (omega * h)) if omega > 0.0 else _LEAST_AHEAD
    ahead = min(max(beat, _LEAST_AHEAD), _MOST_AHEAD)
    tries = [(finer, ahead) for finer in _FINER]
    if not parameters.tail.flexible:
        tries += [(finer, _FEW) for finer in _FAR_FINER]
    for finer, steps in tries:
        if passes(finer, steps):
            if h / finer >= _LEAST_STEP_S or finer == _FINER[0]:
                return (
                    f"the step of {h:g} s is too long for the fastest part; from there the motion "
                    f"goes on with steps of {h / finer:g} s: try these"
                )
            return (
                f"something is far too stiff for the step of {h:g} s: the motion goes on only with "
                f"steps of {h / finer:.1g} s or less; check the size of drag, yaw drag and the "
                "servo's lag, or start slower"
            )
    folded = _folded(parameters, drive, since, h, state)
    if folded:
        return (
            f"the tail has folded up ({folded}): its stroke is too large or too fast for its "
            "stiffness, and a finer step does not help; make the tail stiffer or the stroke smaller"
        )
    return (
        "the equations themselves run away here, shorter steps from there do as well; check drag, "
        "added masses and the commanded tail motion (run it with half the step to be sure: the "
        "time of the divergence then stays)"
    )


def _folded(
    parameters: PlantParameters, drive: FloatArray, since: int, h: float, state: FloatArray
) -> str:
    """How far a tail is bent that is bent beyond its model; empty where it is not."""
    tail = parameters.tail
    if not tail.flexible:
        return ""
    from plant.flexible.shape import bend, segment_angles

    motion = motion_of(parameters, h)
    row = np.empty((1, motion.whole_width))
    motion.march(drive, 0, since, since, state.copy(), row, since, 1)
    now = Trajectory(np.zeros(1), row[:, : motion.width])
    if tail.modes == 0:
        angles = segment_angles(parameters, now)[0]
        most = math.degrees(float(np.abs(angles - angles[0]).max()))
        return f"a segment stands {most:.0f}° from its base" if most > _FOLDED_DEG else ""
    most = float(np.abs(bend(parameters, now)[0]).max())
    if most <= _FOLDED_SHARE * tail.length_m:
        return ""
    return f"the beam is bent by {100.0 * most:.2g} cm"
