"""Swimming with the models of chapter 5: paths from a programme of beats, and steady motion.

``swim`` follows changing beats on a fixed grid. ``steady_turn`` needs no long record: it goes from
beat to beat until the velocities come back to what they were, and measures that beat. In the frame
that turns with the mean rate Ω the velocity is then periodic, w(t) = e^{iΩt} p(t), and its mean p̄
makes a circle of radius |p̄|/|Ω|: what is left of the path when its ripples are taken away. The
plotted path reaches further out, by the size of the ripples, and its length is greater still. The
source does not say how it took a radius from a path with ripples. Its numbers fit the outer radius
(half the width of the plotted path) within 0.8 %, so that is what they are compared with
(docs/averaging.md).
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.averaging.average import forcing
from plant.averaging.dynamics import (
    FORCING,
    MOTION,
    ORIGINAL,
    REDUCED,
    Dynamics,
    Forcing,
    Motion,
    Reduced,
    motion_rates,
    motion_step,
    reduced,
)
from plant.checks import check_number
from plant.compiled import compiled, fixed_tuple
from plant.elementary import sincos as _sincos
from plant.errors import DivergedError, InvalidParameterError, PlantError
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme, spans
from plant.trajectory import Start

sincos = compiled(_sincos)

LEAST_TURN = 1e-8
"""Turn of one beat, rad, below which a steady motion counts as straight."""

_SPEED_BOUND = 100.0  # m/s; no swimmer comes near
_RATE_BOUND = 1.0e4  # rad/s


@dataclass(frozen=True, slots=True)
class Path:
    """Saved grid points: ``time_s`` (n,), ``rows`` (n, 6) of x, y, ψ, u, v, r (m, rad, s)."""

    time_s: FloatArray
    rows: FloatArray

    @property
    def x_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.rows[:, 0]

    @property
    def y_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.rows[:, 1]

    @property
    def heading_rad(self) -> FloatArray:
        """Heading counter-clockwise from +x, unwrapped, rad."""
        return self.rows[:, 2]

    @property
    def velocity(self) -> FloatArray:
        """u, v (m/s) and r (rad/s), shape (n, 3)."""
        return self.rows[:, 3:]


@dataclass(frozen=True, slots=True)
class SteadyTurn:
    """A steady motion, from one beat of it. Radii and period are None where it does not turn.

    ``speed_m_s``: |p̄|, along the path without ripples. ``path_speed_m_s``: mean of √(u² + v²).
    ``turn_radius_m``: |p̄|/|Ω|, the circle without the ripples. ``outer_radius_m``: greatest
    distance of the path from its centre. ``path_radius_m``: path length of one turn / 2π.
    ``velocity``: mean u, v (m/s), r (rad/s). ``settled``: u, v, r at the beginning of a beat.
    ``beats``: until then.
    """

    speed_m_s: float
    path_speed_m_s: float
    turn_rate_rad_s: float
    turn_radius_m: float | None
    turn_period_s: float | None
    outer_radius_m: float | None
    path_radius_m: float | None
    velocity: tuple[float, float, float]
    settled: tuple[float, float, float]
    beats: int


@compiled
def march_motion(
    constants: FloatArray,
    forces: FloatArray,
    first: int,
    last: int,
    h: float,
    state: FloatArray,
    rows: FloatArray,
    stride: int,
    phase_time_s: float,
) -> int:
    """Take ``state`` in place from grid point ``first`` to ``last``; return the point reached.

    Row k/stride of ``rows`` takes grid point k where that divides. The tail's time is
    ``phase_time_s`` at ``first``. A return below ``last``: the next step left all bounds.
    """
    p = Reduced(*fixed_tuple(constants, REDUCED))
    f = Forcing(*fixed_tuple(forces, FORCING))
    s = Motion(*fixed_tuple(state, MOTION))
    k = first
    while True:
        if k % stride == 0:
            for column in range(MOTION):
                rows[k // stride, column] = s[column]
        if k == last:
            break
        after = motion_step(p, f, phase_time_s + (k - first) * h, h, s)
        if not (
            abs(after.u) < _SPEED_BOUND
            and abs(after.v) < _SPEED_BOUND
            and abs(after.r) < _RATE_BOUND
        ):
            break
        s = after
        k += 1
    for column in range(MOTION):
        state[column] = s[column]
    return k


@compiled
def settle(
    constants: FloatArray,
    forces: FloatArray,
    steps: int,
    most_beats: int,
    tolerance: float,
    state: FloatArray,
    means: FloatArray,
) -> int:
    """Go from beat to beat until u, v, r come back; then measure one beat into ``means`` (8,).

    Each component's change over a beat is held against ``tolerance`` times the size of its forcing
    (speeds: V, rate: ω). ``means``: turn of the beat, mean u, v, mean cos and sin part of the
    velocity in the turning frame, mean √(u² + v²), mean r, outer radius (0 where it does not turn).
    Returns the beats; −1 where they were too few, −2 where the motion left all bounds (``state``
    is the last good one, ``means[0]`` its time).
    """
    p = Reduced(*fixed_tuple(constants, REDUCED))
    f = Forcing(*fixed_tuple(forces, FORCING))
    s = Motion(*fixed_tuple(state, MOTION))
    period = 2.0 * math.pi / f.omega
    h = period / steps
    beats = 0
    while True:
        if beats == most_beats:
            return -1
        before = s
        s = Motion(0.0, 0.0, 0.0, s.u, s.v, s.r)
        for k in range(steps):
            s = motion_step(p, f, k * h, h, s)
        beats += 1
        speed = math.sqrt(s.u * s.u + s.v * s.v)
        if not (speed < _SPEED_BOUND and abs(s.r) < _RATE_BOUND):
            state[3], state[4], state[5] = before.u, before.v, before.r
            means[0] = (beats - 1) * period
            return -2
        change = abs(s.u - before.u) + abs(s.v - before.v)
        if change <= tolerance * speed and abs(s.r - before.r) <= tolerance * f.omega:
            break
    rate = s.psi / period
    state[3] = s.u
    state[4] = s.v
    state[5] = s.r
    s = Motion(0.0, 0.0, 0.0, s.u, s.v, s.r)
    means[:] = 0.0
    x, y = np.empty(steps), np.empty(steps)
    for k in range(steps):
        x[k], y[k] = s.x, s.y
        # by the trapezoidal rule over a period, so each point has the same weight
        time_s = k * h
        now = motion_rates(p, f, time_s, Motion(0.0, 0.0, s.psi - rate * time_s, s.u, s.v, s.r))
        means[1] += s.u / steps
        means[2] += s.v / steps
        means[3] += now.x / steps
        means[4] += now.y / steps
        means[5] += math.sqrt(s.u * s.u + s.v * s.v) / steps
        s = motion_step(p, f, time_s, h, s)
    means[0] = s.psi
    means[6] = rate
    if abs(s.psi) > LEAST_TURN:
        # a beat turns the path about its centre by s.psi, from the origin to (s.x, s.y)
        sine, cosine = sincos(s.psi)
        lever = sine / (1.0 - cosine)
        centre_x, centre_y = 0.5 * (s.x - lever * s.y), 0.5 * (s.y + lever * s.x)
        for k in range(steps):
            reach = math.sqrt((x[k] - centre_x) ** 2 + (y[k] - centre_y) ** 2)
            if reach > means[7]:
                means[7] = reach
    return beats


def _diverged(time_s: float, state: FloatArray) -> DivergedError:
    return DivergedError(
        time_s,
        tuple(float(value) for value in state),
        "the step is too long for this robot, or the model does not hold so far from swimming "
        "forward (5.18 divides by u)",
    )


def swim(
    parameters: PlantParameters,
    programme: TailProgramme,
    duration_s: float,
    dynamics: Dynamics = ORIGINAL,
    step_s: float = 5e-3,
    start: Start | None = None,
    save_every: int = 1,
) -> Path:
    """Follow a programme and return every ``save_every``-th grid point, the first one included.

    A change takes effect at the first grid point at or after its time. Raises
    ``InvalidParameterError`` (a beat that cannot be averaged among them) and ``DivergedError``.
    """
    check_number("swim.duration_s", duration_s, least=0.0)
    check_number("swim.step_s", step_s, above=0.0, most=1.0)
    if save_every < 1:
        raise InvalidParameterError("swim.save_every", f"must be at least 1, got {save_every}")
    steps = math.floor(duration_s / step_s + 0.5)
    begin = start or Start()
    state = np.array(
        [begin.x_m, begin.y_m, begin.heading_rad, begin.u_m_s, begin.v_m_s, begin.r_rad_s],
        dtype=np.float64,
    )
    rows = np.empty((steps // save_every + 1, MOTION))
    for drive, first, last in spans(programme.segments(step_s), steps):
        beat = TailBeat(drive.bias, drive.amplitude, drive.omega / (2.0 * math.pi))
        constants = np.array(reduced(parameters, beat.bias_rad, dynamics))
        forces = np.array(forcing(parameters, beat, dynamics))
        phase_time_s = drive.phase / drive.omega
        reached = march_motion(
            constants, forces, first, last, step_s, state, rows, save_every, phase_time_s
        )
        if reached != last:
            raise _diverged(reached * step_s, state)
    return Path(np.arange(rows.shape[0], dtype=np.float64) * (save_every * step_s), rows)


def steady_turn(
    parameters: PlantParameters,
    beat: TailBeat,
    dynamics: Dynamics = ORIGINAL,
    steps_per_beat: int = 128,
    tolerance: float = 1e-10,
    most_beats: int = 20_000,
) -> SteadyTurn:
    """Steady motion of a beat, started from slow forward swimming.

    Raises ``PlantError`` where the motion has not come back to itself after ``most_beats`` beats.
    """
    if steps_per_beat < 8:
        raise InvalidParameterError("steps_per_beat", f"must be at least 8, got {steps_per_beat}")
    constants = np.array(reduced(parameters, beat.bias_rad, dynamics))
    forces = np.array(forcing(parameters, beat, dynamics))
    state = np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    means = np.empty(8)
    beats = settle(constants, forces, steps_per_beat, most_beats, tolerance, state, means)
    if beats == -2:
        raise _diverged(float(means[0]), state)
    if beats < 0:
        raise PlantError(f"no steady motion after {most_beats} beats")
    turn, u, v, real, imaginary, path_speed, rate, outer = (float(value) for value in means)
    speed = math.hypot(real, imaginary)
    turns = abs(turn) > LEAST_TURN
    return SteadyTurn(
        speed_m_s=speed,
        path_speed_m_s=path_speed,
        turn_rate_rad_s=rate,
        turn_radius_m=speed / abs(rate) if turns else None,
        turn_period_s=2.0 * math.pi / abs(rate) if turns else None,
        outer_radius_m=outer if turns else None,
        path_radius_m=path_speed / abs(rate) if turns else None,
        velocity=(u, v, rate),
        settled=(float(state[3]), float(state[4]), float(state[5])),
        beats=beats,
    )
