"""The plant's own right-hand sides in the form that SciPy's ``solve_ivp`` wants: f(t, y) → dy/dt.

Compiled, and entered with vectors only, so that SciPy is not made to pay for a conversion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from plant.arrays import FloatArray
from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.flexible import segments
from plant.flexible.layout import LOADS, work_shape
from plant.flexible.rates import flexible_rates
from plant.integrate import motion_of
from plant.layout import DRIVE, PACKED, ROW, STATE, Drive, Packed, State
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.rigid_tail import rates
from plant.tail_input import TailBeat, TailProgramme

RightHandSide = Callable[[float, FloatArray], FloatArray]

POSE_AND_VELOCITIES = 6
"""x, y, heading, u, v, r: the first of every state, and of every saved row."""


@compiled_apart
def _rigid(time_s: float, y: Any, packed: Any, drive: Any, out: Any) -> None:
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    now = rates(p, d, time_s, State(y[0], y[1], y[2], y[3], y[4], y[5], 0.0, 0.0, 0.0, 0.0, 0.0))
    out[0], out[1], out[2] = now.x_dot, now.y_dot, now.psi_dot
    out[3], out[4], out[5] = now.u_dot, now.v_dot, now.r_dot


@compiled
def _flexible(
    time_s: float, y: Any, packed: Any, drive: Any, out: Any, parts: Any, work: Any
) -> None:
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    flexible_rates(p, d, time_s, y, out, parts, 0, work)


def rigid_model(parameters: PlantParameters, beat: TailBeat) -> tuple[RightHandSide, FloatArray]:
    """Pose and velocities of a rigid tail with an ideal servo, and its start at rest."""
    packed, drive = np.array(pack(parameters)), _drive(beat)

    def rhs(time_s: float, y: FloatArray) -> FloatArray:
        out = np.empty(POSE_AND_VELOCITIES)
        _rigid(time_s, y, packed, drive, out)
        return out

    return rhs, np.zeros(POSE_AND_VELOCITIES)


def segment_model(parameters: PlantParameters, beat: TailBeat) -> tuple[RightHandSide, FloatArray]:
    """State of a tail of segments with an ideal servo, and its start at rest, straight."""
    packed, drive = np.array(pack(parameters)), _drive(beat)
    motion = motion_of(parameters, 1e-3)
    state = motion.state(np.zeros(STATE))
    motion.straighten(drive, state)
    n = STATE + motion.width - ROW
    parts = segments.table(parameters)
    work = np.zeros(work_shape((n - STATE) // 2))

    def rhs(time_s: float, y: FloatArray) -> FloatArray:
        out = np.empty(n + LOADS)
        _flexible(time_s, y, packed, drive, out, parts, work)
        return out[:n]

    return rhs, state[:n].copy()


def _drive(beat: TailBeat) -> FloatArray:
    return np.array(TailProgramme.steady(beat).segments(1e-3)[0][1])
