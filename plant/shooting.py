"""Newton's method for the periodic orbit of a beat, compiled whole: coarse grids first.

The relative state z (velocities, and servo states where there are any) does not know position and
heading, so a steady tail beat makes it periodic: z is a fixed point of the map P over one beat.
What costs is P, and P costs as many steps as the beat has. So the work is done where steps are few:

1. some beats from a rough start on the coarsest grid, which the fast transients do not survive;
2. Newton's method there, P′ by differences and then kept up by Broyden's rank-one updates, steps
   halved until the beat closes better;
3. one Newton step on a middle grid, whose P′ also gives the Floquet multipliers;
4. where the full grid is long, one step with that P′ on every other point of it;
5. Broyden steps with that P′ on the full grid: two grids of a method of order four differ by
   little, so every beat gains three digits or so.

The full grid sees one to three beats in all. Where Newton's method does not find the way (the start
was not in its basin), the coarse grid swims on for twice as many beats and tries again: a stable
orbit is reached at last. All numbers depend on the arguments only, and no thread waits for another.
"""

import numpy as np
import numpy.typing as npt

from plant.arrays import FloatArray
from plant.compiled import compiled, compiled_apart
from plant.integrate import march
from plant.layout import ROW

IntArray = npt.NDArray[np.int64]

FOUND, DIVERGED, SINGULAR, NOT_CLOSED = 0, 1, 2, 3
"""What ``shoot`` returns."""

_DIFFERENCE = 1e-6  # of the scales: the third power of rounding, about
_COARSE = 1e-3  # of the scales: about as good as the coarsest grid itself
_MIDDLE = 1e-4  # a Newton step of this size on the middle grid leaves its square
_SLOW = 0.3  # a step that leaves a larger share of the gap calls for P' anew
_HALVINGS = 6
_ATTEMPTS = 7
_NEWTON_STEPS = 25
_STEPS = 20  # on a finer grid


@compiled_apart
def swim_beat(
    packed: FloatArray,
    drive: FloatArray,
    picks: IntArray,
    steps: int,
    h: float,
    z: FloatArray,
    state: FloatArray,
    rows: FloatArray,
    stride: int,
) -> int:
    """Take the relative state ``z`` in place over one beat; return the grid point reached."""
    state[:] = 0.0
    for i in range(picks.size):
        state[picks[i]] = z[i]
    reached = march(packed, drive, 0, 0, steps, h, state, rows, 0, stride)
    for i in range(picks.size):
        z[i] = state[picks[i]]
    return reached


@compiled
def solve_in_place(matrix: FloatArray, right: FloatArray) -> bool:
    """Gaussian elimination with row exchange: ``right`` becomes the solution, ``matrix`` is lost.

    Returns whether the matrix is regular (to 1e-13 of its largest entry).
    """
    n = right.size
    largest = 0.0
    for i in range(n):
        for j in range(n):
            largest = max(largest, abs(matrix[i, j]))
    for column in range(n):
        pivot = column
        for i in range(column + 1, n):
            if abs(matrix[i, column]) > abs(matrix[pivot, column]):
                pivot = i
        if not abs(matrix[pivot, column]) > 1e-13 * largest:
            return False
        if pivot != column:
            for j in range(n):
                keep = matrix[column, j]
                matrix[column, j] = matrix[pivot, j]
                matrix[pivot, j] = keep
            keep = right[column]
            right[column] = right[pivot]
            right[pivot] = keep
        for i in range(column + 1, n):
            factor = matrix[i, column] / matrix[column, column]
            if factor != 0.0:
                for j in range(column + 1, n):
                    matrix[i, j] -= factor * matrix[column, j]
                right[i] -= factor * right[column]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return True


@compiled_apart
def correction(
    monodromy: FloatArray, z: FloatArray, end: FloatArray, scale: FloatArray, step: FloatArray
) -> float:
    """Newton's step (I − P′)⁻¹ (P(z) − z) into ``step``; its size in scales, or −1 if singular."""
    n = z.size
    # in units of the scales, so that pivots compare
    matrix = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            matrix[i, j] = -monodromy[i, j] * scale[j] / scale[i]
        matrix[i, i] += 1.0
        step[i] = (end[i] - z[i]) / scale[i]
    if not solve_in_place(matrix, step):
        return -1.0
    size = 0.0
    for i in range(n):
        size = max(size, abs(step[i]))
        step[i] *= scale[i]
    return size


@compiled
def update(
    monodromy: FloatArray, z: FloatArray, end: FloatArray, scale: FloatArray, step: FloatArray
) -> None:
    """Broyden's update of P′ after a full Newton step ``step`` that led to ``z``, ``end`` P(z).

    The least change (in scales) with which P′ explains what the step did: what P(z) − z is not
    zero by is what P′ had wrong along the step.
    """
    n = z.size
    square = 0.0
    for j in range(n):
        square += (step[j] / scale[j]) ** 2
    if square > 0.0:
        for i in range(n):
            for j in range(n):
                part = step[j] / (scale[j] * scale[j] * square)
                monodromy[i, j] += (end[i] - z[i]) * part


@compiled
def closure(z: FloatArray, end: FloatArray, scale: FloatArray) -> float:
    """Largest |P(z) − z| in scales."""
    worst = 0.0
    for i in range(z.size):
        gap = abs(end[i] - z[i]) / scale[i]
        if not gap <= worst:  # a NaN counts as the worst
            worst = gap
    return worst


@compiled_apart
def linearise(
    packed: FloatArray,
    drive: FloatArray,
    picks: IntArray,
    steps: int,
    h: float,
    z: FloatArray,
    end: FloatArray,
    scale: FloatArray,
    state: FloatArray,
    rows: FloatArray,
    monodromy: FloatArray,
) -> bool:
    """P′ at ``z`` by one-sided differences, ``end`` being P(z); tell whether all beats passed."""
    n = z.size
    other = np.empty(n)
    passed = True
    for j in range(n):
        other[:] = z
        other[j] += _DIFFERENCE * scale[j]
        width = other[j] - z[j]
        if swim_beat(packed, drive, picks, steps, h, other, state, rows, steps + 1) < steps:
            passed = False
        for i in range(n):
            monodromy[i, j] = (other[i] - end[i]) / width
    return passed


@compiled_apart
def newton(
    packed: FloatArray,
    drive: FloatArray,
    picks: IntArray,
    steps: int,
    h: float,
    z: FloatArray,
    scale: FloatArray,
    state: FloatArray,
    monodromy: FloatArray,
) -> int:
    """Damped Newton iteration on one grid, ``z`` in place: FOUND with z to _COARSE, or why not."""
    n = z.size
    nothing = np.empty((1, ROW))
    end, step, trial, trial_end = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    end[:] = z
    if swim_beat(packed, drive, picks, steps, h, end, state, nothing, steps + 1) < steps:
        return DIVERGED
    gap = closure(z, end, scale)
    anew = True
    for _ in range(_NEWTON_STEPS):
        if anew and not linearise(
            packed, drive, picks, steps, h, z, end, scale, state, nothing, monodromy
        ):
            return NOT_CLOSED
        size = correction(monodromy, z, end, scale, step)
        if size < 0.0:
            return SINGULAR
        part, trial_gap = 1.0, np.inf
        for _ in range(_HALVINGS if anew else 1):
            for i in range(n):
                trial[i] = z[i] + part * step[i]
            trial_end[:] = trial
            reached = swim_beat(
                packed, drive, picks, steps, h, trial_end, state, nothing, steps + 1
            )
            if reached == steps:
                trial_gap = closure(trial, trial_end, scale)
                if trial_gap < (1.0 - 0.25 * part) * gap or trial_gap < 1e-3 * _COARSE:
                    break
            trial_gap = np.inf
            part *= 0.5
        if trial_gap == np.inf:
            if anew:
                return NOT_CLOSED
            anew = True
            continue
        anew = part < 1.0 or trial_gap > _SLOW * gap
        z[:] = trial
        end[:] = trial_end
        gap = trial_gap
        if part == 1.0:
            if size <= _COARSE:
                return FOUND
            if not anew:
                update(monodromy, z, end, scale, step)
    return NOT_CLOSED


@compiled_apart
def shoot(
    packed: FloatArray,
    drive: FloatArray,
    picks: IntArray,
    grids: IntArray,
    period_s: float,
    transient_beats: int,
    tolerance: float,
    z: FloatArray,
    scale: FloatArray,
    monodromy: FloatArray,
    rows: FloatArray,
    state: FloatArray,
    report: FloatArray,
) -> int:
    """Find the periodic orbit; FOUND, or why not.

    ``picks``: which elements of the state make z. ``grids``: steps per beat, coarse to fine.
    ``z`` (n,): rough start, becomes the orbit's relative state at the beat's beginning; ``scale``
    (n,): what counts as one; ``tolerance``: wanted error of z in scales. ``monodromy`` (n, n): P′
    on the second grid. ``rows`` (grids[-1] + 1, ROW): the beat, from the origin. ``state``:
    the last state reached. ``report`` (3,): estimated error of z in scales (or, of no orbit, how
    far from closed it is, where that is known); where a beat diverged, the grid point reached and
    the step (s).
    """
    n = z.size
    nothing = np.empty((1, ROW))
    end, step, start = np.empty(n), np.empty(n), np.empty(n)
    steps = grids[0]
    h = period_s / steps
    beats = transient_beats
    status = NOT_CLOSED
    for _ in range(_ATTEMPTS):
        for _ in range(beats):
            reached = swim_beat(packed, drive, picks, steps, h, z, state, nothing, steps + 1)
            if reached < steps:
                report[1], report[2] = reached, h
                return DIVERGED
        start[:] = z
        status = newton(packed, drive, picks, steps, h, z, scale, state, monodromy)
        if status in (FOUND, SINGULAR):
            break
        z[:] = start
        beats = 2 * beats + 8
    if status != FOUND:
        end[:] = z
        swim_beat(packed, drive, picks, steps, h, end, state, nothing, steps + 1)
        report[0] = closure(z, end, scale)
        return status

    # the middle grid: Newton steps until one is small enough to leave nothing of its own
    level = 0 if grids.size == 1 else 1
    steps = grids[level]
    h = period_s / steps
    for _ in range(_STEPS):
        end[:] = z
        if swim_beat(packed, drive, picks, steps, h, end, state, nothing, steps + 1) < steps:
            return NOT_CLOSED
        if not linearise(packed, drive, picks, steps, h, z, end, scale, state, nothing, monodromy):
            return NOT_CLOSED
        size = correction(monodromy, z, end, scale, step)
        if size < 0.0:
            return SINGULAR
        for i in range(n):
            z[i] += step[i]
        if size <= _MIDDLE:
            break

    # grids between: one step each, so that the full grid begins the nearer
    for between in range(level + 1, grids.size - 1):
        steps = grids[between]
        h = period_s / steps
        end[:] = z
        if swim_beat(packed, drive, picks, steps, h, end, state, nothing, steps + 1) < steps:
            return NOT_CLOSED
        if correction(monodromy, z, end, scale, step) < 0.0:
            return SINGULAR
        for i in range(n):
            z[i] += step[i]

    # the full grid, every beat of which leaves its rows
    steps = grids[-1]
    h = period_s / steps
    slope = monodromy.copy()
    before = np.inf
    for _ in range(_STEPS):
        end[:] = z
        if swim_beat(packed, drive, picks, steps, h, end, state, rows, 1) < steps:
            return NOT_CLOSED
        if before < np.inf:
            update(slope, z, end, scale, step)
        size = correction(slope, z, end, scale, step)
        if size < 0.0:
            return SINGULAR
        report[0] = size
        if size <= tolerance:
            return FOUND
        if size > _SLOW * before:
            if not linearise(packed, drive, picks, steps, h, z, end, scale, state, nothing, slope):
                return NOT_CLOSED
            monodromy[:] = slope
            size = correction(slope, z, end, scale, step)
            if size < 0.0:
                return SINGULAR
        before = size
        for i in range(n):
            z[i] += step[i]
    return NOT_CLOSED
