"""A stable integrator for stiff, damped tails: Radau IIA, three stages, order 5, fixed step.

The joints of a flexible tail are damped so strongly that the fastest rate is κω² of its last mode
(1e4/s for five segments, growing as N⁴), while the motion of interest has the period of the beat.
Radau IIA (Hairer & Wanner, *Solving ODEs II*, IV.8) is L-stable and of order 5 at its grid points.

Grid and rows are those of ``integrate.march``. To keep its promise, that pieces equal the whole to
the bit, a step may depend on nothing but the state and the drive. So the stages are solved by
Newton's method with *one* inverse of I − hA ⊗ J for all steps, taken at a reference state (straight
tail, slow swimming); the iteration goes on to 1e-11, far below the error of the step, so that the
result does not hang on J. Where it does not converge, J is taken anew at the step's own state, for
this step only. The first guess extrapolates the polynomial of the step before, which is part of the
state ("memory"); after a start it is zero, which costs some iterations and nothing else. With the
step's own J the guess is a tail that turns with its base as if it were rigid: the stiffer the
joints, the truer.

x, y and ψ, and the servo's state where the servo is ideal, drive nothing stiff: they follow by
fixed-point iteration, and the inverse is that much smaller.
"""

import math
from typing import Any

from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.flexible.layout import (
    ALPHA,
    ALPHA_DDOT,
    ALPHA_DOT,
    FORCE_X,
    FORCE_Y,
    HINGE_MOMENT,
    LOOSE,
    MEAN,
    SERVO,
)
from plant.flexible.rates import flexible_rates
from plant.layout import DRIVE, PACKED, ROW, STATE, Drive, Packed

_S6 = math.sqrt(6.0)
C1, C2 = (4.0 - _S6) / 10.0, (4.0 + _S6) / 10.0
A11, A12, A13 = (88 - 7 * _S6) / 360, (296 - 169 * _S6) / 1800, (-2 + 3 * _S6) / 225
A21, A22, A23 = (296 + 169 * _S6) / 1800, (88 + 7 * _S6) / 360, (-2 - 3 * _S6) / 225
A31, A32, A33 = (16 - _S6) / 36, (16 + _S6) / 36, 1.0 / 9.0


def _extrapolation() -> tuple[tuple[float, float, float], ...]:
    """Weights that take the increments of one step to a guess for those of the next.

    The cubic through (0, 0), (c₁, Z₁), (c₂, Z₂), (1, Z₃) at 1 + c_i, less Z₃.
    """
    nodes = (0.0, C1, C2, 1.0)
    rows = []
    for at in (1.0 + C1, 1.0 + C2, 2.0):
        row = []
        for j in range(1, 4):
            weight = 1.0
            for k in range(4):
                if k != j:
                    weight *= (at - nodes[k]) / (nodes[j] - nodes[k])
            row.append(weight - (1.0 if j == 3 else 0.0))
        rows.append((row[0], row[1], row[2]))
    return tuple(rows)


(E11, E12, E13), (E21, E22, E23), (E31, E32, E33) = _extrapolation()

_TOLERANCE = 1e-11
"""Largest change in the last iteration, in units of ``scales``; what is left is smaller still."""

_FLOOR = 1e-8
"""Below this a change that shrinks no more is rounding: absurdly stiff joints have no better
(``segments.stiffest_joint``)."""

_ITERATIONS = 12  # with the inverse of the reference state
_MORE_ITERATIONS = 40  # with that of the step's own
_SPEED_BOUND = 100.0  # m/s, and
_RATE_BOUND = 1.0e4  # rad/s, as in ``integrate``


@compiled_apart
def invert(matrix: Any, result: Any) -> None:
    """Inverse of ``matrix`` by Gauss–Jordan with row pivots; ``matrix`` is overwritten."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            result[i, j] = 1.0 if i == j else 0.0
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if best != i:
            for j in range(n):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
                result[i, j], result[best, j] = result[best, j], result[i, j]
        inverse = 1.0 / matrix[i, i]
        for j in range(n):
            matrix[i, j] *= inverse
            result[i, j] *= inverse
        for k in range(n):
            factor = matrix[k, i]
            if k != i and factor != 0.0:
                for j in range(n):
                    matrix[k, j] -= factor * matrix[i, j]
                    result[k, j] -= factor * result[i, j]


@compiled_apart
def newton_inverse(
    p: Packed,
    drive: Drive,
    time_s: float,
    h: float,
    y: Any,
    parts: Any,
    modes: int,
    active: Any,
    result: Any,
    matrix: Any,
    probe: Any,
    out: Any,
    work: Any,
) -> None:
    """Transposed inverse of I − hA ⊗ J for the active components, J by central differences.

    Transposed, because the iteration adds up columns. ``probe``: (n,), ``out``: (2, n + LOADS).
    """
    count = active.shape[0]
    for i in range(y.shape[0]):  # an assignment to a slice compiles for seconds
        probe[i] = y[i]
    for column in range(count):
        at = active[column]
        width = 1e-5
        probe[at] = y[at] + width
        flexible_rates(p, drive, time_s, probe, out[0], parts, modes, work)
        probe[at] = y[at] - width
        flexible_rates(p, drive, time_s, probe, out[1], parts, modes, work)
        probe[at] = y[at]
        for row in range(count):
            slope = h * (out[0, active[row]] - out[1, active[row]]) / (2.0 * width)
            # transposed on the way in: the inverse of the transpose is what is wanted
            matrix[column, row] = -A11 * slope
            matrix[column + count, row] = -A12 * slope
            matrix[column + 2 * count, row] = -A13 * slope
            matrix[column, row + count] = -A21 * slope
            matrix[column + count, row + count] = -A22 * slope
            matrix[column + 2 * count, row + count] = -A23 * slope
            matrix[column, row + 2 * count] = -A31 * slope
            matrix[column + count, row + 2 * count] = -A32 * slope
            matrix[column + 2 * count, row + 2 * count] = -A33 * slope
    for i in range(3 * count):
        matrix[i, i] += 1.0
    invert(matrix, result)


@compiled
def iterate(
    p: Packed,
    drive: Drive,
    time_s: float,
    h: float,
    y: Any,
    z: Any,
    parts: Any,
    modes: int,
    active: Any,
    passive: Any,
    scales: Any,
    inverse: Any,
    most: int,
    probe: Any,
    out: Any,
    residual: Any,
    change: Any,
    work: Any,
) -> bool:
    """Solve for the stage increments ``z`` (3, n) in place; whether that converged."""
    n, count = y.shape[0], active.shape[0]
    before = math.inf
    for _ in range(most):
        for stage in range(3):
            part = C1 if stage == 0 else (C2 if stage == 1 else 1.0)
            for i in range(n):
                probe[i] = y[i] + z[stage, i]
            flexible_rates(p, drive, time_s + part * h, probe, out[stage], parts, modes, work)
        for k in range(count):
            i = active[k]
            f1, f2, f3 = h * out[0, i], h * out[1, i], h * out[2, i]
            residual[k] = A11 * f1 + A12 * f2 + A13 * f3 - z[0, i]
            residual[count + k] = A21 * f1 + A22 * f2 + A23 * f3 - z[1, i]
            residual[2 * count + k] = A31 * f1 + A32 * f2 + A33 * f3 - z[2, i]
        for k in range(passive.shape[0]):
            i = passive[k]
            f1, f2, f3 = h * out[0, i], h * out[1, i], h * out[2, i]
            z[0, i] = A11 * f1 + A12 * f2 + A13 * f3
            z[1, i] = A21 * f1 + A22 * f2 + A23 * f3
            z[2, i] = A31 * f1 + A32 * f2 + A33 * f3
        for k in range(3 * count):
            change[k] = 0.0
        for j in range(3 * count):
            value = residual[j]
            for k in range(3 * count):
                change[k] += value * inverse[j, k]
        largest = 0.0
        finite = True
        for stage in range(3):
            for k in range(count):
                step = change[stage * count + k]
                z[stage, active[k]] += step
                size = abs(step) * scales[k]
                if not size < 1e12:  # a NaN, too
                    finite = False
                largest = max(largest, size)
        if not finite:
            return False
        if largest < _TOLERANCE or (largest < _FLOOR and largest > 0.5 * before):
            return True
        before = largest
    return False


@compiled_apart
def turn_along(
    p: Packed,
    drive: Drive,
    time_s: float,
    h: float,
    y: Any,
    z: Any,
    parts: Any,
    modes: int,
    out: Any,
    work: Any,
) -> None:
    """First guess of ``z`` (3, n) without a memory: nothing moves, but segments turn as their base.

    If they stayed behind, the iteration would begin with the torques of bent joints, and those of
    very stiff ones throw the body further than Newton's method can bring it back.
    """
    n = y.shape[0]
    bend = (n - STATE) // 2
    for stage in range(3):
        for i in range(n):
            z[stage, i] = 0.0
    if modes > 0:
        return
    flexible_rates(p, drive, time_s, y, out[0], parts, modes, work)
    angle, rate = out[0, n + ALPHA], out[0, n + ALPHA_DOT]
    for stage in range(3):
        part = C1 if stage == 0 else (C2 if stage == 1 else 1.0)
        flexible_rates(p, drive, time_s + part * h, y, out[stage], parts, modes, work)
        for i in range(STATE, STATE + bend):
            z[stage, i] = out[stage, n + ALPHA] - angle
            z[stage, bend + i] = out[stage, n + ALPHA_DOT] - rate


@compiled_apart
def march_flexible(
    packed: Any,
    drive: Any,
    drive_start: int,
    first: int,
    last: int,
    h: float,
    state: Any,
    rows: Any,
    base: int,
    stride: int,
    parts: Any,
    modes: int,
    active: Any,
    passive: Any,
    scales: Any,
    inverse: Any,
    own: Any,
    matrix: Any,
    stages: Any,
    vectors: Any,
    work: Any,
) -> int:
    """As ``integrate.march``, for a tail that bends: ``state`` is [state | memory].

    ``inverse``: from ``newton_inverse`` at the reference state; ``own``, ``matrix``: room for
    another; ``stages`` (7, n + LOADS), ``vectors`` (2, 3 · active), ``work``: scratch space. Rows
    that are wide enough take the memory as well.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    n = state.shape[0] // 4
    bend = n - STATE
    keep = rows.shape[1] >= ROW + bend + 3 * n
    y, probe = state[:n], stages[6, :n]
    z, out = stages[3:6], stages[0:3]
    k = first
    while True:
        time_s = (k - drive_start) * h
        if (k - base) % stride == 0:
            row = rows[(k - base) // stride]
            now = out[0]
            flexible_rates(p, d, time_s, y, now, parts, modes, work)
            for i in range(6):
                row[i] = y[i]
            row[6] = now[n + ALPHA]
            row[7] = now[n + ALPHA_DOT]
            row[8] = now[n + MEAN]
            row[9] = now[0]
            row[10] = now[1]
            row[11] = now[3]
            row[12] = now[4]
            row[13] = now[5]
            row[14] = now[n + ALPHA_DDOT]
            row[15] = now[n + FORCE_X]
            row[16] = now[n + FORCE_Y]
            row[17] = now[n + HINGE_MOMENT]
            row[18] = now[n + SERVO]
            row[19] = now[6]
            row[20] = now[n + LOOSE]
            row[21] = now[9]
            for i in range(bend):
                row[ROW + i] = y[STATE + i]
            if keep:
                for i in range(3 * n):
                    row[ROW + bend + i] = state[n + i]
        if k == last:
            return k
        for i in range(n):
            z1, z2, z3 = state[n + i], state[2 * n + i], state[3 * n + i]
            z[0, i] = E11 * z1 + E12 * z2 + E13 * z3
            z[1, i] = E21 * z1 + E22 * z2 + E23 * z3
            z[2, i] = E31 * z1 + E32 * z2 + E33 * z3
        chosen = inverse
        most = _ITERATIONS
        for attempt in range(2):
            done = iterate(
                p,
                d,
                time_s,
                h,
                y,
                z,
                parts,
                modes,
                active,
                passive,
                scales,
                chosen,
                most,
                probe,
                out,
                vectors[0],
                vectors[1],
                work,
            )
            if done or attempt == 1:
                break
            newton_inverse(
                p, d, time_s + h, h, y, parts, modes, active, own, matrix, probe, out, work
            )
            chosen, most = own, _MORE_ITERATIONS
            turn_along(p, d, time_s, h, y, z, parts, modes, out, work)
        good = done
        for i in range(3, n):
            # written so that a NaN fails, too
            bound = _SPEED_BOUND if i < 5 else _RATE_BOUND
            if not abs(y[i] + z[2, i]) < bound:
                good = False
        if not good:
            return k
        for i in range(n):
            y[i] += z[2, i]
            state[n + i], state[2 * n + i], state[3 * n + i] = z[0, i], z[1, i], z[2, i]
        k += 1
