"""``plant.shooting`` for tails that bend: the same search, on the marches of ``FlexibleMotion``.

A step of a flexible tail costs a hundred of a rigid one, so that here the search may stand in
Python, where vectors of any length are at home; what is compiled is the march. The relative state
has the bend and its rates beside the velocities. Most of its multipliers are next to zero: the
joints forget within a fraction of a beat.
"""

import numpy as np

from plant.arrays import FloatArray
from plant.integrate import Motion, motion_of
from plant.layout import STATE
from plant.parameters import PlantParameters
from plant.shooting import DIVERGED, FOUND, NOT_CLOSED, SINGULAR, IntArray

_DIFFERENCE = 1e-5  # of the scales: the stages are solved to 1e-11
_COARSE = 1e-3  # of the scales, as in ``shooting``
_SLOW = 0.3
_ATTEMPTS = 5
_NEWTON_STEPS = 20
_HALVINGS = 6


class _Grid:
    """The map over one beat on one grid, in scales; None where it diverges."""

    __slots__ = ("_drive", "_nothing", "_picks", "_scale", "_steps", "motion", "reached", "state")

    def __init__(
        self,
        motion: Motion,
        drive: FloatArray,
        picks: IntArray,
        steps: int,
        scale: FloatArray,
    ) -> None:
        self.motion = motion
        self._drive, self._picks, self._steps, self._scale = drive, picks, steps, scale
        self._nothing = np.empty((1, motion.width))
        self.state = np.empty(0)
        self.reached = 0

    def swim(self, z: FloatArray, rows: FloatArray | None = None) -> FloatArray | None:
        """P(z); ``rows`` takes every grid point."""
        state = self.motion.state(np.zeros(STATE))
        state[self._picks] = z * self._scale
        place, stride = (self._nothing, self._steps + 1) if rows is None else (rows, 1)
        reached = self.motion.march(self._drive, 0, 0, self._steps, state, place, 0, stride)
        self.state, self.reached = state, reached
        if reached < self._steps:
            return None
        end: FloatArray = state[self._picks] / self._scale
        return end

    def linearise(self, z: FloatArray, end: FloatArray) -> FloatArray | None:
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
    """Damped Newton iteration on one grid: whether found, and z."""
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
                if left < (1.0 - 0.25 * part) * gap or left < 1e-3 * _COARSE:
                    break
            trial_end = None
            part *= 0.5
        if trial_end is None:
            if anew:
                return NOT_CLOSED, z
            anew = True
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
    of order 5, and a linearisation costs a beat for every element of z.
    """

    def grid_of(steps: int) -> _Grid:
        return _Grid(motion_of(parameters, period_s / steps), drive, picks, int(steps), scale)

    grid = grid_of(grids[0])
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

    fresh = grid.linearise(y, end)
    if fresh is None:
        return NOT_CLOSED
    monodromy[:] = fresh * scale[:, None] / scale[None, :]
    slope = fresh
    grid = grid_of(grids[-1])
    step = np.zeros(z.size)
    for attempt in range(_NEWTON_STEPS):
        end = grid.swim(y, rows)
        if end is None:
            return NOT_CLOSED
        if attempt > 0:
            slope = slope + np.outer(end - y, step) / float(step @ step)
        newton_step = _newton_step(slope, y, end)
        if newton_step is None:
            return SINGULAR
        step = newton_step
        report[0] = float(np.max(np.abs(step)))
        if report[0] <= tolerance:
            z[:] = y * scale
            return FOUND
        y = y + step
    return NOT_CLOSED
