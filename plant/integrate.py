"""Classical Runge–Kutta of order four on a fixed grid, compiled; saving stands apart from stepping.

The grid points are k·h from the start, whoever looks and whenever: a look between them is answered
by interpolation (``vehicle``), never by a shorter step. So advancing in pieces and advancing at
once perform the same operations in the same order and agree to the bit. Inputs change at grid
points only, so that no step crosses a jump and the order is kept.

A fixed step suits this system: it is not stiff (the fastest rate is the servo's, 1/τ_m = 100/s)
and it is forced at a known frequency, so an adaptive step would settle at one size anyhow, and
would make the grid depend on the last bits of the error estimate.

A state that leaves every physical bound, or is not a number, stops the run at the last good point.
"""

import math

import numpy as np

from plant.compiled import compiled
from plant.errors import DivergedError, InvalidParameterError
from plant.layout import ROW, STATES, Column
from plant.parameters import FloatArray, PlantParameters, check_number, pack
from plant.rigid_tail import rates
from plant.tail_input import TailProgramme
from plant.trajectory import Start, Trajectory

_SPEED_BOUND = 100.0  # m/s; no swimmer comes near
_RATE_BOUND = 1.0e4  # rad/s

_RATES = ROW - STATES


@compiled
def rk4_step(
    p: FloatArray,
    drive: FloatArray,
    time_s: float,
    h: float,
    s: FloatArray,
    k1: FloatArray,
    work: FloatArray,
) -> bool:
    """Take the state ``s`` one step on, in place, given the rates ``k1`` at its start.

    ``work`` is (4, ROW) scratch. False, with ``s`` untouched, where the result is out of bounds.
    """
    y, k2, k3, k4 = work[0], work[1], work[2], work[3]
    half = 0.5 * h
    for i in range(STATES):
        y[i] = s[i] + half * k1[i]
    rates(p, drive, time_s + half, y, k2)
    for i in range(STATES):
        y[i] = s[i] + half * k2[i]
    rates(p, drive, time_s + half, y, k3)
    for i in range(STATES):
        y[i] = s[i] + h * k3[i]
    rates(p, drive, time_s + h, y, k4)
    sixth = h / 6.0
    for i in range(STATES):
        y[i] = s[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    # written so that a NaN fails, too
    if not (
        abs(y[Column.U]) < _SPEED_BOUND
        and abs(y[Column.V]) < _SPEED_BOUND
        and abs(y[Column.R]) < _RATE_BOUND
        and abs(y[Column.ALPHA_DOT]) < _RATE_BOUND
    ):
        return False
    for i in range(STATES):
        s[i] = y[i]
    return True


@compiled
def march(
    p: FloatArray,
    drive: FloatArray,
    drive_start: int,
    first: int,
    last: int,
    h: float,
    s: FloatArray,
    rows: FloatArray,
    base: int,
    stride: int,
) -> int:
    """Advance ``s`` from grid point ``first`` to ``last``; return the point reached.

    The drive's time is counted from grid point ``drive_start``. Row (k − base)/stride of ``rows``
    takes grid point k where that divides. A return below ``last`` means divergence in the next
    step.
    """
    work = np.empty((4, ROW))
    k1 = np.empty(_RATES)
    k = first
    while True:
        time_s = (k - drive_start) * h
        rates(p, drive, time_s, s, k1)
        if (k - base) % stride == 0:
            row = rows[(k - base) // stride]
            for i in range(STATES):
                row[i] = s[i]
            for i in range(_RATES):
                row[STATES + i] = k1[i]
        if k == last:
            return k
        if not rk4_step(p, drive, time_s, h, s, k1, work):
            return k
        k += 1


def diverged(
    p: FloatArray, drive: FloatArray, drive_start: int, k: int, h: float, state: FloatArray
) -> DivergedError:
    """Say where a march stopped and why: a finer step from the last good point tells."""
    finer = 32
    scratch = np.empty((1, ROW))
    probe = state.copy()
    shift = (k - drive_start) * finer
    reached = march(p, drive, 0, shift, shift + finer, h / finer, probe, scratch, 0, 2**62)
    if reached == shift + finer:
        cause = f"the step of {h:g} s is too long for the fastest part; {h / finer:g} s passes"
    else:
        cause = (
            "the equations themselves run away here, a finer step does not help; "
            "check drag, added masses and the commanded tail motion"
        )
    return DivergedError(k * h, tuple(float(value) for value in state), cause)


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
    without a speed limit (``comparison`` samples it as a board does). ``duration_s`` is rounded to
    whole steps. Raises ``InvalidParameterError`` and ``DivergedError``.
    """
    check_number("simulate.duration_s", duration_s, least=0.0)
    check_number("simulate.step_s", step_s, above=0.0, most=1.0)
    if save_every < 1:
        raise InvalidParameterError("simulate.save_every", f"must be at least 1, got {save_every}")
    steps = math.floor(duration_s / step_s + 0.5)
    p = pack(parameters)
    state = (start or Start()).vector()
    rows = np.empty((steps // save_every + 1, ROW))
    segments = [item for item in programme.segments(step_s) if item[0] <= steps]
    ends = [*(index for index, _ in segments[1:]), steps]
    for (first, drive), last in zip(segments, ends, strict=True):
        reached = march(p, drive, first, first, last, step_s, state, rows, 0, save_every)
        if reached != last:
            raise diverged(p, drive, first, reached, step_s, state)
    time_s = np.arange(rows.shape[0], dtype=np.float64) * (save_every * step_s)
    return Trajectory(time_s, rows)
