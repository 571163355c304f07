"""Classical Runge–Kutta of order four on a fixed grid, compiled; saving stands apart from stepping.

The grid points are k·h from the start, whoever looks and whenever: a look between them is answered
by interpolation (``vehicle``), never by a shorter step. So advancing in pieces and advancing at
once perform the same operations in the same order and agree to the bit. Inputs change at grid
points only, so that no step crosses a jump and the order is kept.

A fixed step suits this system: it is not stiff (the fastest rate is the servo's, 1/τ_m = 100/s)
and it is forced at a known frequency, so an adaptive step would settle at one size anyhow, and
would make the grid depend on the last bits of the error estimate.

The yaw drag r|r| has a kink in its second derivative where r changes sign; measured, this costs
less than one order, and at 1 ms the state is good to 1e-10 after 2 s (tests/plant).

A state that leaves every physical bound, or is not a number, stops the run at the last good point.
"""

import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.compiled import compiled, fixed_tuple
from plant.errors import InvalidParameterError
from plant.layout import DRIVE, PACKED, ROW, STATE, STATE_COLUMNS, Drive, Packed, Rates, State
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.rigid_tail import rates
from plant.servo import carry_over, lag_share
from plant.tail_input import TailProgramme, spans
from plant.trajectory import Start, Trajectory

_STATE_COLUMNS = list(STATE_COLUMNS)
_SPEED_BOUND = 100.0  # m/s; no swimmer comes near
_RATE_BOUND = 1.0e4  # rad/s
_MOST_ROWS = 10**8  # about 20 GB
_MOST_STEPS = 2**53  # counted exactly, in floats too


@compiled
def shifted(s: State, h: float, k: Rates) -> State:
    """Return s + h·k."""
    return State(
        s.x + h * k.x_dot,
        s.y + h * k.y_dot,
        s.psi + h * k.psi_dot,
        s.u + h * k.u_dot,
        s.v + h * k.v_dot,
        s.r + h * k.r_dot,
        s.servo + h * k.servo_dot,
        s.servo_dot + h * k.servo_ddot,
        s.alpha_mean + h * k.alpha_mean_dot,
        s.loose + h * k.loose_dot,
        s.loose_dot + h * k.loose_ddot,
    )


@compiled
def rk4_step(p: Packed, drive: Drive, time_s: float, h: float, s: State, k1: Rates) -> State:
    """One step of the classical method from ``s``, whose rates ``k1`` are known already.

    The stages stand in a loop so that the right-hand side is compiled in once.
    """
    result = shifted(s, h / 6.0, k1)
    k = k1
    for stage in range(3):
        part = h if stage == 2 else 0.5 * h
        k = rates(p, drive, time_s + part, shifted(s, part, k))
        result = shifted(result, h / 6.0 if stage == 2 else h / 3.0, k)
    return result


@compiled
def march(
    packed: FloatArray,
    drive: FloatArray,
    drive_start: int,
    first: int,
    last: int,
    h: float,
    state: FloatArray,
    rows: FloatArray,
    base: int,
    stride: int,
) -> int:
    """Take ``state`` in place from grid point ``first`` to ``last``; return the point reached.

    ``packed``, ``drive``, ``state``: the records of ``layout`` as vectors, which cross the border
    from Python faster than named tuples. The drive's time is counted from grid point
    ``drive_start``. Row (k − base)/stride of ``rows`` takes grid point k where that divides. A
    return below ``last`` means that the next step left all bounds; ``state`` is the last good one.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    s = State(*fixed_tuple(state, STATE))
    k = first
    while True:
        time_s = (k - drive_start) * h
        now = rates(p, d, time_s, s)
        if (k - base) % stride == 0:
            i = (k - base) // stride
            rows[i, 0] = s.x
            rows[i, 1] = s.y
            rows[i, 2] = s.psi
            rows[i, 3] = s.u
            rows[i, 4] = s.v
            rows[i, 5] = s.r
            rows[i, 6] = now.alpha
            rows[i, 7] = now.alpha_dot
            rows[i, 8] = now.alpha_mean
            rows[i, 9] = now.x_dot
            rows[i, 10] = now.y_dot
            rows[i, 11] = now.u_dot
            rows[i, 12] = now.v_dot
            rows[i, 13] = now.r_dot
            rows[i, 14] = now.alpha_ddot
            rows[i, 15] = now.force_x
            rows[i, 16] = now.force_y
            rows[i, 17] = now.hinge_moment
            rows[i, 18] = now.servo
            rows[i, 19] = now.servo_dot
            rows[i, 20] = now.loose
            rows[i, 21] = now.loose_dot
        if k == last:
            break
        after = rk4_step(p, d, time_s, h, s, now)
        # written so that a NaN fails, too
        if not (
            abs(after.u) < _SPEED_BOUND
            and abs(after.v) < _SPEED_BOUND
            and abs(after.r) < _RATE_BOUND
            and abs(after.servo_dot) < _RATE_BOUND
            and abs(after.loose_dot) < _RATE_BOUND
        ):
            break
        s = after
        k += 1
    state[0] = s.x
    state[1] = s.y
    state[2] = s.psi
    state[3] = s.u
    state[4] = s.v
    state[5] = s.r
    state[6] = s.servo
    state[7] = s.servo_dot
    state[8] = s.alpha_mean
    state[9] = s.loose
    state[10] = s.loose_dot
    return k


class Motion(Protocol):
    """One robot on one grid: how long its state and its rows are, and how it moves along them.

    The rigid tail and the flexible ones differ in these only; whoever drives a robot asks
    ``motion_of`` and need not know which it has.
    """

    @property
    def width(self) -> int:
        """Length of a row that says all there is about the robot; the first ROW are ``Column``."""

    @property
    def whole_width(self) -> int:
        """Length of a row from which a run can go on."""

    def state(self, start: FloatArray) -> FloatArray:
        """Make the state from the start (STATE,)."""

    def straighten(self, drive: FloatArray, state: FloatArray) -> None:
        """Lay the tail straight, turning as its base does where the drive begins."""

    def follow(self, before: Drive, after: Drive, earlier: FloatArray, state: FloatArray) -> None:
        """Have the tail jump with its base where a drive begins; ``earlier``: state before."""

    def place(self, state: FloatArray, row: FloatArray) -> None:
        """Put the state into a whole row, and leave the rates in it."""

    def resume(self, row: FloatArray, state: FloatArray) -> None:
        """Take the state out of a whole row."""

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
        """``march`` with this robot's parameters and step."""


class RigidMotion:
    """The robot with a rigid tail, on a grid of ``step_s``."""

    __slots__ = ("_packed", "_step_s")

    width = whole_width = ROW

    def __init__(self, parameters: PlantParameters, step_s: float) -> None:
        self._packed = np.array(pack(parameters))
        self._step_s = step_s

    def state(self, start: FloatArray) -> FloatArray:
        """Return the start: a rigid tail has no further state."""
        return start.copy()

    def straighten(self, drive: FloatArray, state: FloatArray) -> None:
        """Leave the tail: it is straight."""

    def follow(self, before: Drive, after: Drive, earlier: FloatArray, state: FloatArray) -> None:
        """Leave the tail: it is its base."""

    def place(self, state: FloatArray, row: FloatArray) -> None:
        """Put the state into a row, and leave the rates in it."""
        row[_STATE_COLUMNS] = state

    def resume(self, row: FloatArray, state: FloatArray) -> None:
        """Take the state out of a row."""
        state[:] = row[_STATE_COLUMNS]

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
        """``march`` with this robot's parameters and step."""
        return march(
            self._packed, drive, drive_start, first, last, self._step_s, state, rows, base, stride
        )


def motion_of(parameters: PlantParameters, step_s: float) -> Motion:
    """Return how this robot moves; what few robots need is loaded for these only."""
    motion: Motion = RigidMotion(parameters, step_s)
    if parameters.tail.flexible:
        from plant.flexible.motion import FlexibleMotion

        motion = FlexibleMotion(parameters, step_s)
    if parameters.force.acting:
        from plant.pushed import PushedMotion

        motion = PushedMotion(parameters, step_s, motion)
    return motion


def steps_of(name: str, duration_s: float, step_s: float, save_every: int) -> int:
    """Whole steps in a duration; refuses nonsense and what no memory holds (0 saves nothing)."""
    check_number(f"{name}.duration_s", duration_s, least=0.0)
    check_number(f"{name}.step_s", step_s, above=0.0, most=1.0)
    share = duration_s / step_s
    if share > _MOST_STEPS or (save_every > 0 and share / save_every > _MOST_ROWS):
        raise InvalidParameterError(
            f"{name}.duration_s",
            f"makes {share:.3g} steps of {step_s:g} s, more than memory holds; save fewer of them",
        )
    return math.floor(share + 0.5)


def take_over(
    parameters: PlantParameters,
    motion: Motion,
    before: Drive | None,
    drive: Drive,
    state: FloatArray,
) -> FloatArray:
    """Bring the state (in place) to a drive that begins; return the drive as marches take it.

    At the beginning of a run (``before`` None) the tail is laid straight; later it goes on.
    """
    earlier = state.copy()
    carry_over(parameters, before, drive, state)
    vector = np.array(drive)
    if before is None:
        motion.straighten(vector, state)
    else:
        motion.follow(before, drive, earlier, state)
    return vector


def drives(
    parameters: PlantParameters,
    programme: TailProgramme,
    motion: Motion,
    step_s: float,
    steps: int,
    state: FloatArray,
) -> Iterator[tuple[FloatArray, int, int]]:
    """Yield each drive of a programme with its first and last grid point.

    ``state`` (in place) is brought to it; whoever asks takes it to the last point before the next.
    """
    servo = parameters.servo
    segments = programme.segments(
        step_s,
        servo.command_delay_s,
        servo.command_lag_s,
        servo.largest_speed_rad_s,
        lag_share(servo),
    )
    before = None
    for drive, first, last in spans(segments, steps):
        yield take_over(parameters, motion, before, drive, state), first, last
        before = drive


def simulate(
    parameters: PlantParameters,
    programme: TailProgramme,
    duration_s: float,
    step_s: float = 1e-3,
    start: Start | None = None,
    save_every: int = 1,
) -> Trajectory:
    """Swim a tail programme and return every ``save_every``-th grid point, first one included.

    With an ideal servo the tail is the programme; otherwise the servo follows it continuously and
    without a speed limit of its supply (``comparison`` samples it as a board does). The tail beats
    as if the first beat had gone on for ever before the run; ``Start.tail_angle_rad`` is where a
    real servo begins. A flexible tail begins straight, and takes steps of 10 ms as well.
    ``duration_s`` is rounded to whole steps. Raises ``InvalidParameterError`` and
    ``DivergedError``.
    """
    if save_every < 1:
        raise InvalidParameterError("simulate.save_every", f"must be at least 1, got {save_every}")
    steps = steps_of("simulate", duration_s, step_s, save_every)
    motion = motion_of(parameters, step_s)
    state = motion.state(np.array((start or Start()).state()))
    rows = np.empty((steps // save_every + 1, motion.width))
    for drive, first, last in drives(parameters, programme, motion, step_s, steps, state):
        reached = motion.march(drive, first, first, last, state, rows, 0, save_every)
        if reached != last:
            from plant.divergence import diverged  # which marches itself, to find the cause

            raise diverged(parameters, drive, first, reached, step_s, state)
    time_s = np.arange(rows.shape[0], dtype=np.float64) * (save_every * step_s)
    return Trajectory(time_s, rows)
