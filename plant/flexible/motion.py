"""A flexible tail as ``integrate.Motion``: tables and scratch space made once, then one call.

Imported by ``integrate.motion_of`` when a tail bends, so that a rigid one never loads it.
"""

import copy
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from plant.arrays import FloatArray
from plant.flexible import modes, segments
from plant.flexible.layout import ALPHA, ALPHA_DOT, LOADS, work_shape
from plant.flexible.radau import march_flexible, newton_inverse
from plant.flexible.rates import flexible_rates
from plant.flexible.variation import stage_slopes
from plant.layout import ROW, STATE, STATE_COLUMNS, Drive, Packed
from plant.packing import pack
from plant.parameters import PlantParameters

_ANGLE, _TURN, _SPEED, _DEFLECTION = 10.0, 1.0, 10.0, 100.0
"""What counts as one in the convergence test: 0.1 rad, 1 rad/s, 0.1 m/s, 0.01 m (inverted)."""

_STATE_COLUMNS = list(STATE_COLUMNS)
_ROUNDING = 1e-10  # rad, rad/s: the same beat commanded again is no jump


class FlexibleMotion:
    """Parameters, tables and scratch space of one flexible robot at one step; not for threads.

    ``state``: [STATE | bend | bend rates | memory of the integrator], see ``flexible.layout``.
    """

    __slots__ = (
        "_active",
        "_inverse",
        "_matrix",
        "_modes",
        "_own",
        "_packed",
        "_packed_record",
        "_parts",
        "_passive",
        "_scales",
        "_stages",
        "_step_s",
        "_unit",
        "_vectors",
        "_work",
        "bend",
    )

    def __init__(self, parameters: PlantParameters, step_s: float) -> None:
        tail = parameters.tail
        self._modes = tail.modes
        self.bend = tail.modes or tail.segments - 1
        self._step_s = step_s
        make = modes.table if tail.modes else segments.table
        self._parts = make(parameters)
        self._packed_record = Packed(*(float(value) for value in pack(parameters)))
        self._packed = np.array(self._packed_record)
        n = STATE + 2 * self.bend
        record = self._packed_record
        moved = record.servo_ideal == 0.0 or record.servo_tracks != 0.0 or record.play != 0.0
        servo = range(6, STATE) if moved else range(0)
        active = [3, 4, 5, *servo, *range(STATE, n)]
        self._active = np.array(active)
        self._passive = np.array([i for i in range(n) if i not in active])
        coordinate = _DEFLECTION if tail.modes else _ANGLE
        rate = _SPEED if tail.modes else _TURN
        scales = np.full(n, _TURN)
        scales[3:STATE] = (
            _SPEED,
            _SPEED,
            _TURN,
            _ANGLE,
            _TURN,
            _ANGLE,
            _ANGLE,
            _TURN,
        )
        scales[STATE : STATE + self.bend] = coordinate
        scales[STATE + self.bend :] = rate
        self._unit = self._scales = scales[self._active]
        size = 3 * len(active)
        self._inverse, self._own, self._matrix = (np.empty((size, size)) for _ in range(3))
        self._stages = np.zeros((7, n + LOADS))
        self._vectors = np.zeros((2, size))
        self._work = np.zeros(work_shape(self.bend))
        self._refer()

    def _refer(self) -> None:
        """Take the inverse for Newton's method at the reference: straight tail, slow swimming.

        The servo's target stands off its tail, so that its loop is outside its dead band.
        """
        n = STATE + 2 * self.bend
        reference = np.zeros(n)
        reference[3] = 0.05
        newton_inverse(
            self._packed_record,
            Drive(0.1, 0.0, 0.0, 0.0, math.inf),
            0.0,
            self._step_s,
            reference,
            self._parts,
            self._modes,
            self._active,
            self._inverse,
            self._matrix,
            self._stages[6, :n],
            self._stages[0:3],
            self._work,
        )

    def on_grid(self, step_s: float, looseness: float = 1.0) -> "FlexibleMotion":
        """Return the same robot on another grid; tables and scratch space are shared.

        ``looseness``: error of the stages over the usual 1e-11; above 1 for rough searches.
        """
        other = copy.copy(self)
        other._step_s = step_s
        other._scales = self._unit / looseness
        if step_s != self._step_s:
            other._inverse = np.empty_like(self._inverse)
            other._refer()
        return other

    @property
    def jumps(self) -> bool:
        """Whether a rate jumps somewhere, so that a march has no derivative there."""
        return self._packed_record.servo_tracks != 0.0 or self._packed_record.play != 0.0

    @property
    def width(self) -> int:
        """Length of a row without the memory."""
        return ROW + 2 * self.bend

    @property
    def whole_width(self) -> int:
        """Length of a row from which a run can go on."""
        return self.width + 3 * (STATE + 2 * self.bend)

    def state(self, start: FloatArray) -> FloatArray:
        """Make a state with room for the bend and the memory."""
        n = STATE + 2 * self.bend
        state = np.zeros(4 * n)
        state[:STATE] = start
        return state

    def _base(self, drive: Drive, time_s: float, state: FloatArray) -> tuple[float, float]:
        """Angle and rate of the tail's base."""
        n = STATE + 2 * self.bend
        out = self._stages[0]
        flexible_rates(
            self._packed_record,
            drive,
            time_s,
            state[:n],
            out,
            self._parts,
            self._modes,
            self._work,
        )
        return float(out[n + ALPHA]), float(out[n + ALPHA_DOT])

    def straighten(self, drive: FloatArray, state: FloatArray) -> None:
        """Lay the tail straight, turning as its base does where the drive begins."""
        n = STATE + 2 * self.bend
        state[STATE:] = 0.0
        if not self._modes:
            alpha, alpha_dot = self._base(Drive(*drive.tolist()), 0.0, state)
            state[STATE : STATE + self.bend] = alpha
            state[STATE + self.bend : n] = alpha_dot

    def follow(self, before: Drive, after: Drive, earlier: FloatArray, state: FloatArray) -> None:
        """Have the whole tail jump with its base where a drive begins; ``earlier``: state before.

        So a jump gives no impulse, as a rigid ideal tail's gives none. A real servo does not jump,
        and a beam's modes are counted from its base.
        """
        if self._modes or self._packed_record.servo_ideal == 0.0:
            return
        n = STATE + 2 * self.bend
        old = self._base(before, after.start - before.start, earlier)
        new = self._base(after, 0.0, state)
        turn, turn_dot = new[0] - old[0], new[1] - old[1]
        if abs(turn) < _ROUNDING and abs(turn_dot) < _ROUNDING:
            return
        state[STATE : STATE + self.bend] += turn
        state[STATE + self.bend : n] += turn_dot
        state[n:] = 0.0

    def place(self, state: FloatArray, row: FloatArray) -> None:
        """Put the state into a whole row, and leave the rates in it."""
        row[_STATE_COLUMNS], row[ROW:] = state[:STATE], state[STATE:]

    def resume(self, row: FloatArray, state: FloatArray) -> None:
        """Take the state out of a whole row."""
        state[:STATE], state[STATE:] = row[_STATE_COLUMNS], row[ROW:]

    def slopes(self, drive: FloatArray, steps: int, rows: FloatArray) -> FloatArray:
        """∂(rates)/∂(active state) at the stages of a march: (steps, 3, active, active), 1/s.

        ``rows``: whole rows of every grid point, the first of which begins the drive.
        """
        count = self._active.size
        result = np.empty((steps, 3, count, count))
        stage_slopes(
            self._packed,
            drive,
            self._step_s,
            rows,
            self._parts,
            self._modes,
            self._active,
            result,
            self._stages[6, : STATE + 2 * self.bend],
            self._stages[0:2],
            self._work,
        )
        return result

    @property
    def step_s(self) -> float:
        """Step of the grid, s."""
        return self._step_s

    @property
    def active(self) -> npt.NDArray[np.int64]:
        """Elements of the state that the stages' equations are solved for."""
        return self._active

    @property
    def tables(self) -> tuple[Any, ...]:
        """Tables and scratch space, as the last arguments of ``march_flexible``; shared."""
        return (
            self._parts,
            self._modes,
            self._active,
            self._passive,
            self._scales,
            self._inverse,
            self._own,
            self._matrix,
            self._stages,
            self._vectors,
            self._work,
        )

    def march(
        self,
        drive: FloatArray,
        drive_start: int,
        first: int,
        last: int,
        state: FloatArray,
        rows: FloatArray,
        base: int,
        stride: int,
    ) -> int:
        """As ``integrate.march``."""
        return march_flexible(
            self._packed,
            drive,
            drive_start,
            first,
            last,
            self._step_s,
            state,
            rows,
            base,
            stride,
            *self.tables,
        )
