"""How a march over a beat depends on its start: the derivative of every Radau step, multiplied.

The derivative of a step is that of its stage equations, which are linear in it:

    (I − h (A ⊗ 1) diag J_i) δZ = h (A ⊗ 1) (J_1, J_2, J_3)ᵀ δy,      δy′ = δy + δZ_3

with J_i the Jacobian of the right-hand side at stage i. The march leaves the stages in its whole
rows, so one march gives the derivative by all coordinates at once. Differences of whole marches
would take one more for each, solved to the last digit; this takes about as long as four.

It is the derivative of a march that meets no jump of a rate: play and a tracking ideal servo have
such jumps, and are left to differences.
"""

from typing import Any

import numpy as np

from plant.arrays import FloatArray
from plant.compiled import compiled_apart, fixed_tuple
from plant.flexible.radau import A11, A12, A13, A21, A22, A23, A31, A32, A33, C1, C2
from plant.flexible.rates import flexible_rates
from plant.layout import DRIVE, PACKED, ROW, STATE, STATE_COLUMNS, Drive, Packed

_WIDTH = 1e-7  # of one-sided differences, in SI units: joints move by 0.1 rad, modes by 1 mm
_COLUMNS = STATE_COLUMNS
_A = np.array([[A11, A12, A13], [A21, A22, A23], [A31, A32, A33]])


@compiled_apart
def stage_slopes(
    packed: Any,
    drive: Any,
    h: float,
    rows: Any,
    parts: Any,
    modes: int,
    active: Any,
    result: Any,
    probe: Any,
    out: Any,
    work: Any,
) -> None:
    """Jacobians at the stages of a march from the drive's beginning, into (steps, 3, E, E).

    ``rows``: its whole rows; ``probe`` (n,), ``out`` (2, n + LOADS), ``work``: scratch space.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    n, count = probe.shape[0], active.shape[0]
    memory = ROW + n - STATE
    for k in range(result.shape[0]):
        for stage in range(3):
            part = C1 if stage == 0 else (C2 if stage == 1 else 1.0)
            time_s = (k + part) * h
            for i in range(n):
                column = _COLUMNS[i] if i < STATE else ROW + i - STATE
                probe[i] = rows[k, column] + rows[k + 1, memory + stage * n + i]
            flexible_rates(p, d, time_s, probe, out[0], parts, modes, work)
            for j in range(count):
                keep = probe[active[j]]
                probe[active[j]] = keep + _WIDTH
                width = probe[active[j]] - keep
                flexible_rates(p, d, time_s, probe, out[1], parts, modes, work)
                probe[active[j]] = keep
                for i in range(count):
                    at = active[i]
                    result[k, stage, i, j] = (out[1, at] - out[0, at]) / width


def propagated(slopes: FloatArray, h: float) -> FloatArray:
    """Derivative of the state after the march by that before it, (E, E)."""
    steps, _, count, _ = slopes.shape
    # h A_st J_t in block row s, block column t
    blocks = (h * _A)[None, :, None, :, None] * slopes.transpose(0, 2, 1, 3)[:, None]
    right = blocks.sum(axis=3).reshape(steps, 3 * count, count)
    left = -blocks.reshape(steps, 9 * count * count)
    left[:, :: 3 * count + 1] += 1.0
    gained = np.linalg.solve(left.reshape(steps, 3 * count, 3 * count), right)[:, 2 * count :]
    result = np.eye(count)
    for step in gained:
        result += step @ result
    return result
