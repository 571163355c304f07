"""How a robot moves that an extra force pushes: the march of any other, with a push at each end.

The body's velocities are kicked by half a step of the force before the plant's own step and by half
a step after it (Strang's splitting, of second order in the step, its error in proportion to the
force): so the right-hand side stays as it is, bit for bit and at full speed, for robots that
nothing pushes, and this serves tails that bend as well as rigid ones. A step costs some ten
microseconds here. The predictor of the diagnosis pushes in the same way (its halves by Euler's
rule, which at 10 ms is as good as anything that is measured), so what it found swims here.
"""

import numpy as np

from plant.arrays import FloatArray
from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.extra_force import AXES, PLACES, TERMS, ExtraForce
from plant.layout import DRIVE, PACKED, STATE, Column, Drive, Packed, State
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.servo import tail_motion
from plant.tail_input import sincos

TYPE_CHECKING = False
if TYPE_CHECKING:
    from plant.integrate import Motion

_U, _V, _R = (State._fields.index(name) for name in ("u", "v", "r"))
_RATES = [int(column) for column in (Column.U_DOT, Column.V_DOT, Column.R_DOT)]


@compiled
def library(p: Packed, drive: Drive, time_s: float, s: State) -> tuple[float, ...]:
    """The terms, in the order of ``extra_force.TERMS``; ``time_s`` is since the drive began."""
    tail = tail_motion(p, drive, time_s, s)
    a, b = tail.alpha, tail.alpha_dot
    u, v, r = s.u, s.v, s.r
    run_s = drive.start + time_s
    return (
        1.0,
        u,
        v,
        r,
        u * abs(u),
        v * abs(v),
        r * abs(r),
        u * v,
        u * r,
        v * r,
        u * abs(r),
        v * abs(u),
        a,
        b,
        a * abs(a),
        b * abs(b),
        u * a,
        u * b,
        run_s,
        u * run_s,
        r * run_s,
        s.x,
        s.y,
    )


@compiled_apart
def pushes(
    p: Packed, drive: Drive, time_s: float, s: State, force: FloatArray
) -> tuple[float, float, float]:
    """Accelerations (m/s², m/s², rad/s²) by coefficients (axes, terms).

    ``time_s`` counts from the drive's beginning.
    """
    terms = library(p, drive, time_s, s)
    surge = 0.0
    sway = 0.0
    yaw = 0.0
    tank_x = 0.0
    tank_y = 0.0
    for i in range(len(terms)):
        surge += force[0, i] * terms[i]
        sway += force[1, i] * terms[i]
        yaw += force[2, i] * terms[i]
        tank_x += force[3, i] * terms[i]
        tank_y += force[4, i] * terms[i]
    if tank_x != 0.0 or tank_y != 0.0:
        sine, cosine = sincos(s.psi)
        surge += cosine * tank_x + sine * tank_y
        sway += cosine * tank_y - sine * tank_x
    return surge / p.m1, sway / p.m2, yaw / p.j3


@compiled_apart
def kick(
    packed: FloatArray,
    drive: FloatArray,
    time_s: float,
    share_s: float,
    state: FloatArray,
    force: FloatArray,
    rates: FloatArray,
) -> None:
    """Push the velocities of ``state`` for a time, by the midpoint rule; leave the accelerations.

    ``packed``, ``drive``, ``state``: the records of ``layout`` as vectors. ``rates`` are those
    before the push.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    s = State(*fixed_tuple(state, STATE))
    surge, sway, yaw = pushes(p, d, time_s, s, force)
    rates[0] = surge
    rates[1] = sway
    rates[2] = yaw
    half_s = 0.5 * share_s
    halfway = State(
        s.x,
        s.y,
        s.psi,
        s.u + half_s * surge,
        s.v + half_s * sway,
        s.r + half_s * yaw,
        s.servo,
        s.servo_dot,
        s.alpha_mean,
        s.loose,
        s.loose_dot,
    )
    surge, sway, yaw = pushes(p, d, time_s, halfway, force)
    state[3] += share_s * surge
    state[4] += share_s * sway
    state[5] += share_s * yaw


def coefficients(force: ExtraForce) -> FloatArray:
    """Return the coefficients as compiled code takes them (axes, terms)."""
    table = np.zeros((len(AXES), len(TERMS)))
    for name, value in force.coefficients:
        table[PLACES[name]] = value
    return table


class PushedMotion:
    """``integrate.Motion`` of a robot that moves as ``inner`` does but for an extra force."""

    __slots__ = ("_force", "_inner", "_packed", "_rates", "_scratch", "_step_s")

    def __init__(self, parameters: PlantParameters, step_s: float, inner: "Motion") -> None:
        self._packed = np.array(pack(parameters))
        self._force = coefficients(parameters.force)
        self._step_s = step_s
        self._inner = inner
        self._rates = np.zeros(len(_RATES))
        self._scratch = np.empty((1, inner.whole_width))

    @property
    def width(self) -> int:
        """As of the robot without the force."""
        return self._inner.width

    @property
    def whole_width(self) -> int:
        """As of the robot without the force."""
        return self._inner.whole_width

    def state(self, start: FloatArray) -> FloatArray:
        """Make the state from the start (STATE,)."""
        return self._inner.state(start)

    def straighten(self, drive: FloatArray, state: FloatArray) -> None:
        """Lay the tail straight, turning as its base does where the drive begins."""
        self._inner.straighten(drive, state)

    def follow(self, before: Drive, after: Drive, earlier: FloatArray, state: FloatArray) -> None:
        """Have the tail jump with its base where a drive begins; ``earlier``: state before."""
        self._inner.follow(before, after, earlier, state)

    def place(self, state: FloatArray, row: FloatArray) -> None:
        """Put the state into a whole row, and leave the rates in it."""
        self._inner.place(state, row)

    def resume(self, row: FloatArray, state: FloatArray) -> None:
        """Take the state out of a whole row."""
        self._inner.resume(row, state)

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
        """``integrate.march`` with this robot's parameters and step; rows hold the pushed rates."""
        inner, scratch, h = self._inner, self._scratch, self._step_s
        push = self._packed, drive
        k = first
        while True:
            time_s = (k - drive_start) * h
            if (k - base) % stride == 0:
                row = rows[(k - base) // stride]
                inner.march(drive, drive_start, k, k, state, row[None], k, 1)
                kick(*push, time_s, 0.0, state, self._force, self._rates)
                row[_RATES] += self._rates
            if k == last:
                return k
            before = state.copy()
            kick(*push, time_s, 0.5 * h, state, self._force, self._rates)
            if inner.march(drive, drive_start, k, k + 1, state, scratch, k, 2) != k + 1:
                state[:] = before
                return k
            kick(*push, time_s + h, 0.5 * h, state, self._force, self._rates)
            if not abs(state[_U]) + abs(state[_V]) + abs(state[_R]) < 1e4:
                state[:] = before
                return k
            k += 1
