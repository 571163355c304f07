"""``plant.shooting`` for tails that bend: the same search, on the marches of ``FlexibleMotion``.

A step of a flexible tail costs a hundred of a rigid one, so that here the search may stand in
Python, where vectors of any length are at home; what is compiled is the march. The relative state
has the bend and its rates beside the velocities. Most of its multipliers are next to zero: the
joints forget within a fraction of a beat. Which do not, is not guessed: P′ has all columns, and
costs two or three beats for all of them together (``variation``). Radau IIA is stable and of order
5 with a dozen steps a beat already, so that there the search is done, to what such a grid is worth
and with stages solved to no more than that; a middle grid and the full one see one beat or two.
"""

import numpy as np

from plant.arrays import FloatArray
from plant.flexible.motion import FlexibleMotion
from plant.flexible.variation import propagated
from plant.layout import STATE
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.shooting import DIVERGED, FOUND, NOT_CLOSED, SINGULAR, IntArray

_DIFFERENCE = 1e-5  # of the scales: the stages are solved to 1e-11
_COARSE = 1e-2  # of the scales: a Newton step of this size leaves its square
_LOOSE = 1e4  # stages of the coarsest grid are solved to 1e-7: its own error is 1e-5
_STEADY = 1e-3  # of the scales: what steps on the coarsest grid may still change
_SLOW = 0.3
_ATTEMPTS = 5
_NEWTON_STEPS = 20
_HALVINGS = 6


class _Grid:
    """The map over one beat on one grid, in scales; None where it diverges."""

    __slots__ = (
        "_differences",
        "_drive",
        "_picks",
        "_places",
        "_scale",
        "_steps",
        "_step_s",
        "_whole",
        "motion",
        "reached",
        "state",
    )

    def __init__(
        self,
        parameters: PlantParameters,
        drive: FloatArray,
        picks: IntArray,
        steps: int,
        period_s: float,
        scale: FloatArray,
        looseness: float = 1.0,
    ) -> None:
        packed = pack(parameters)
        # a rate that jumps leaves the derivative to differences, and those want the last digit
        self._differences = packed.servo_tracks != 0.0 or packed.play != 0.0
        self._step_s = period_s / steps
        self.motion = FlexibleMotion(
            parameters, self._step_s, 1.0 if self._differences else looseness
        )
        self._drive, self._picks, self._steps, self._scale = drive, picks, steps, scale
        self._places = np.searchsorted(self.motion.active, picks)
        self._whole = np.empty((steps + 1, self.motion.whole_width))
        self.state = np.empty(0)
        self.reached = 0

    def swim(self, z: FloatArray, rows: FloatArray | None = None) -> FloatArray | None:
        """P(z); ``rows`` takes every grid point."""
        state = self.motion.state(np.zeros(STATE))
        state[self._picks] = z * self._scale
        place = self._whole if rows is None else rows
        reached = self.motion.march(self._drive, 0, 0, self._steps, state, place, 0, 1)
        self.state, self.reached = state, reached
        if reached < self._steps:
            return None
        end: FloatArray = state[self._picks] / self._scale
        return end

    def linearise(self, z: FloatArray, end: FloatArray) -> FloatArray | None:
        """P′ at ``z``, from where the last beat swam; None where it cannot be had."""
        if self._differences:
            return self._differentiated(z, end)
        slopes = self.motion.slopes(self._drive, self._steps, self._whole)
        try:
            whole = propagated(slopes, self._step_s)
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
    try:
        step = np.linalg.solve(np.eye(z.size) - slope, end - z).astype(np.float64)
    except np.linalg.LinAlgError:
        return None
    return step if bool(np.all(np.isfinite(step))) else None


def _gap(z: FloatArray, end: FloatArray) -> float:
    return float(np.max(np.abs(end - z)))


def _newton(grid: _Grid, z: FloatArray) -> tuple[int, FloatArray]:
    """Damped Newton iteration on one grid: whether found, and z, with which it swam last."""
    end = grid.swim(z)
    if end is None:
        return NOT_CLOSED, z
    anew, slope = True, np.zeros((z.size, z.size))
    for _ in range(_NEWTON_STEPS):
        if anew:
            fresh = grid.linearise(z, end)
            if fresh is None:
                return NOT_CLOSED, z
            slope = fresh
        step = _newton_step(slope, z, end)
        if step is None:
            return SINGULAR, z
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
                return NOT_CLOSED, z
            anew = True
            grid.swim(z)  # again, for its derivative
            continue
        anew = part < 1.0 or _gap(trial, trial_end) > _SLOW * gap
        z, end = trial, trial_end
        if part == 1.0:
            if float(np.max(np.abs(step))) <= _COARSE:
                return FOUND, z
            if not anew:
                slope = slope + np.outer(end - z, step) / float(step @ step)
    return NOT_CLOSED, z


def shoot_flexible(
    parameters: PlantParameters,
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
    """As ``shooting.shoot``, of ``parameters``; ``picks`` may reach into the bend behind STATE.

    P′, for the last steps and for the Floquet multipliers, is that of the coarsest grid: Radau is
    of order 5.
    """

    def grid_of(steps: int, looseness: float = 1.0) -> _Grid:
        return _Grid(parameters, drive, picks, int(steps), period_s, scale, looseness)

    grid = grid_of(grids[0], _LOOSE)
    y = z / scale
    beats = transient_beats
    status = NOT_CLOSED
    for _ in range(_ATTEMPTS):
        for _ in range(beats):
            end = grid.swim(y)
            if end is None:
                state[:] = grid.state
                report[1], report[2] = grid.reached, period_s / grids[0]
                return DIVERGED
            y = end
        status, found = _newton(grid, y)
        if status in (FOUND, SINGULAR):
            y = found
            break
        beats = 2 * beats + 8
    end = grid.swim(y)
    if status != FOUND or end is None:
        report[0] = np.inf if end is None else _gap(y, end)
        return status if status != FOUND else NOT_CLOSED

    slope = np.eye(0)
    for _ in range(_NEWTON_STEPS):
        fresh = grid.linearise(y, end)
        step = None if fresh is None else _newton_step(fresh, y, end)
        if fresh is None or step is None:
            return NOT_CLOSED if fresh is None else SINGULAR
        slope = fresh
        y = y + step
        if float(np.max(np.abs(step))) <= _STEADY:
            break
        end = grid.swim(y)
        if end is None:
            return NOT_CLOSED
    monodromy[:] = slope * scale[:, None] / scale[None, :]
    for steps in grids[1:-1]:
        end = grid_of(steps).swim(y)
        step = None if end is None else _newton_step(slope, y, end)
        if step is None:
            return NOT_CLOSED
        y = y + step
    grid = grid_of(grids[-1])
    before = np.inf
    for _ in range(_NEWTON_STEPS):
        end = grid.swim(y, rows)
        if end is None:
            return NOT_CLOSED
        if before < np.inf:
            slope = slope + np.outer(end - y, step) / float(step @ step)
        step = _newton_step(slope, y, end)
        if step is None:
            return SINGULAR
        report[0] = float(np.max(np.abs(step)))
        if report[0] <= tolerance:
            z[:] = y * scale
            return FOUND
        if report[0] > _SLOW * before:
            grid.swim(y)
            fresh = grid.linearise(y, end)
            step = None if fresh is None else _newton_step(fresh, y, end)
            if fresh is None or step is None:
                return NOT_CLOSED if fresh is None else SINGULAR
            slope = fresh
            monodromy[:] = slope * scale[:, None] / scale[None, :]
        before = report[0]
        y = y + step
    return NOT_CLOSED
