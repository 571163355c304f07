"""``plant.shooting`` for tails that bend: the same search, on the marches of ``FlexibleMotion``.

A step of a flexible tail costs a hundred of a rigid one, so that here the search may stand in
Python, where vectors of any length are at home; what is compiled is the march. The relative state
has the bend and its rates beside the velocities. Most of its multipliers are next to zero: the
joints forget within a fraction of a beat. Which do not, is not guessed: P′ has all columns, and
costs four coarse beats for all of them together (``variation``). Radau IIA is stable and of order
5 with a dozen steps a beat already, so that there the search is done, to what such a grid is worth
and with stages solved to no more than that; a middle grid and the full one see one beat or two.
"""

import numpy as np

from plant.arrays import FloatArray
from plant.flexible.motion import FlexibleMotion
from plant.flexible.variation import propagated
from plant.layout import STATE
from plant.shooting import DIVERGED, FOUND, NOT_CLOSED, SINGULAR, IntArray, solve_in_place

_DIFFERENCE = 1e-5  # of the scales: the stages are solved to 1e-11
_COARSE = 5e-2  # of the scales: a Newton step of this size leaves its square
_LOOSE = 1e4  # stages of the coarsest grid are solved to 1e-7: its own error is 1e-5
_LESS = 1e-1  # as loose is the middle grid
_FOR_TOLERANCE = 1e-10  # wanted error of the orbit that stages solved to 1e-11 are good for
_STEADY = 3e-3  # of the scales: what steps on the coarsest grid may still change
_SLOW = 0.3
_ATTEMPTS = 5
_NEWTON_STEPS = 20
_HALVINGS = 6


class _Grid:
    """The map over one beat on one grid, in scales; None where it diverges."""

    __slots__ = (
        "_drive",
        "_picks",
        "_places",
        "_scale",
        "_steps",
        "_whole",
        "motion",
        "reached",
        "state",
    )

    def __init__(
        self,
        motion: FlexibleMotion,
        drive: FloatArray,
        picks: IntArray,
        steps: int,
        scale: FloatArray,
    ) -> None:
        self.motion = motion
        self._drive, self._picks, self._steps, self._scale = drive, picks, steps, scale
        self._places = np.searchsorted(motion.active, picks)
        self._whole = np.empty((1, motion.whole_width))
        self.state = np.empty(0)
        self.reached = 0

    def swim(self, z: FloatArray, rows: FloatArray | None = None) -> FloatArray | None:
        """P(z); ``rows`` takes every grid point."""
        state = self.motion.state(np.zeros(STATE))
        state[self._picks] = z * self._scale
        place = self._whole if rows is None else rows
        stride = 1 if place.shape[0] > 1 else self._steps + 1
        reached = self.motion.march(self._drive, 0, 0, self._steps, state, place, 0, stride)
        self.state, self.reached = state, reached
        if reached < self._steps:
            return None
        end: FloatArray = state[self._picks] / self._scale
        return end

    def keep(self) -> "_Grid":
        """From now on keep the stages of a beat, for ``linearise``."""
        self._whole = np.empty((self._steps + 1, self.motion.whole_width))
        return self

    def linearise(self, z: FloatArray, end: FloatArray) -> FloatArray | None:
        """P′ at ``z``, from where the last beat swam; None where it cannot be had."""
        if self.motion.jumps:
            return self._differentiated(z, end)
        slopes = self.motion.slopes(self._drive, self._steps, self._whole)
        try:
            whole = propagated(slopes, self.motion.step_s)
        except np.linalg.LinAlgError:
            return None
        places, scale = self._places, self._scale
        slope: FloatArray = whole[np.ix_(places, places)] * scale[None, :] / scale[:, None]
        return slope if bool(np.all(np.isfinite(slope))) else None

    def _differentiated(self, z: FloatArray, end: FloatArray) -> FloatArray | None:
        """P′ by one-sided differences; None where a beat diverges."""
        slope = np.empty((z.size, z.size))
        for j in range(z.size):
            other = z.copy()
            other[j] += _DIFFERENCE
            width = other[j] - z[j]
            other_end = self.swim(other)
            if other_end is None:
                return None
            slope[:, j] = (other_end - end) / width
        return slope


def _newton_step(slope: FloatArray, z: FloatArray, end: FloatArray) -> FloatArray | None:
    matrix = -slope
    matrix.flat[:: z.size + 1] += 1.0
    step = (end - z).astype(np.float64)
    return step if solve_in_place(matrix, step) else None


def _gap(z: FloatArray, end: FloatArray) -> float:
    return float(np.max(np.abs(end - z)))


def _newton(grid: _Grid, z: FloatArray) -> tuple[int, FloatArray, FloatArray]:
    """Damped Newton iteration on one grid: whether found, z, and P(z), which it swam last."""
    end = grid.swim(z)
    if end is None:
        return NOT_CLOSED, z, z
    anew, slope = True, np.zeros((z.size, z.size))
    for _ in range(_NEWTON_STEPS):
        if anew:
            fresh = grid.linearise(z, end)
            if fresh is None:
                return NOT_CLOSED, z, end
            slope = fresh
        step = _newton_step(slope, z, end)
        if step is None:
            return SINGULAR, z, end
        gap = _gap(z, end)
        part, trial, trial_end = 1.0, z, None
        for _ in range(_HALVINGS if anew else 1):
            trial = z + part * step
            trial_end = grid.swim(trial)
            if trial_end is not None:
                left = _gap(trial, trial_end)
                if left < (1.0 - 0.25 * part) * gap or left < 1e-2 * _STEADY:
                    break
            trial_end = None
            part *= 0.5
        if trial_end is None:
            if anew:
                return NOT_CLOSED, z, end
            anew = True
            grid.swim(z)  # again, for its derivative
            continue
        anew = part < 1.0 or _gap(trial, trial_end) > _SLOW * gap
        z, end = trial, trial_end
        if part == 1.0:
            if float(np.max(np.abs(step))) <= _COARSE:
                return FOUND, z, end
            if not anew:
                slope = slope + np.outer(end - z, step) / float(step @ step)
    return NOT_CLOSED, z, end


def shoot_flexible(
    motion: FlexibleMotion,
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
    """As ``shooting.shoot``, of ``motion``; ``picks`` may reach into the bend.

    P′, for the last steps and for the Floquet multipliers, is that of the coarsest grid: Radau is
    of order 5.
    """

    def grid_of(steps: int, looseness: float = 1.0) -> _Grid:
        on_it = motion.on_grid(period_s / steps, looseness)
        return _Grid(on_it, drive, picks, int(steps), scale)

    # differences of marches want the last digit
    looseness = 1.0 if motion.jumps else _LOOSE
    grid = grid_of(grids[0], looseness).keep()
    y = z / scale
    beats = transient_beats
    status, end = NOT_CLOSED, y
    for _ in range(_ATTEMPTS):
        for _ in range(beats):
            after = grid.swim(y)
            if after is None:
                state[:] = grid.state
                report[1], report[2] = grid.reached, period_s / grids[0]
                return DIVERGED
            y = after
        status, found, end = _newton(grid, y)
        if status in (FOUND, SINGULAR):
            y = found
            break
        beats = 2 * beats + 8
    if status != FOUND:
        after = grid.swim(y)
        report[0] = np.inf if after is None else _gap(y, after)
        return status

    first = _refined(grid, y, end)
    if first is None:
        return NOT_CLOSED
    y, slope = first
    monodromy[:] = slope * scale[:, None] / scale[None, :]
    for steps in grids[1:-1]:
        after = grid_of(steps, max(1.0, _LESS * looseness)).swim(y)
        step = None if after is None else _newton_step(slope, y, after)
        if step is None:
            return NOT_CLOSED
        y = y + step
    # the first beat on the full grid is never the last
    finer = 1.0 if motion.jumps else max(1.0, tolerance / _FOR_TOLERANCE)
    return _closed(
        (grid_of(grids[-1], finer), grid_of(grids[-1])),
        slope,
        tolerance,
        y,
        z,
        scale,
        monodromy,
        rows,
        report,
    )


def _refined(grid: _Grid, y: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Newton steps with P′ anew each time, until one is small: where it led, and P′ before it."""
    for _ in range(_NEWTON_STEPS):
        slope = grid.linearise(y, end)
        step = None if slope is None else _newton_step(slope, y, end)
        if slope is None or step is None:
            return None
        y = y + step
        if float(np.max(np.abs(step))) <= _STEADY:
            return y, slope
        after = grid.swim(y)
        if after is None:
            return None
        end = after
    return None


def _closed(
    grids: tuple[_Grid, _Grid],
    slope: FloatArray,
    tolerance: float,
    y: FloatArray,
    z: FloatArray,
    scale: FloatArray,
    monodromy: FloatArray,
    rows: FloatArray,
    report: FloatArray,
) -> int:
    """Broyden steps on the full grid, the first beat of which may be solved loosely."""
    loose, grid = grids
    step = np.zeros(y.size)
    before = np.inf
    for _ in range(_NEWTON_STEPS):
        end = loose.swim(y) if before == np.inf else grid.swim(y, rows)
        if end is None:
            return NOT_CLOSED
        if before < np.inf:
            slope = slope + np.outer(end - y, step) / float(step @ step)
        newton_step = _newton_step(slope, y, end)
        if newton_step is None:
            return SINGULAR
        size = float(np.max(np.abs(newton_step)))
        report[0] = size
        if size <= tolerance and before < np.inf:
            z[:] = y * scale
            return FOUND
        if size > _SLOW * before:
            grid.keep().swim(y)
            fresh = grid.linearise(y, end)
            newton_step = None if fresh is None else _newton_step(fresh, y, end)
            if fresh is None or newton_step is None:
                return NOT_CLOSED
            slope = fresh
            monodromy[:] = slope * scale[:, None] / scale[None, :]
        step, before = newton_step, size
        y = y + step
    return NOT_CLOSED
