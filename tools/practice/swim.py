"""A robot swims in disturbed water: another integrator than the diagnosis has, and another step.

The right-hand side is the plant's; the method is that of Dormand and Prince (1980), order five, at
2.5 ms (the diagnosis takes Runge and Kutta's at 16 ms). What disturbs it is a force in the tank's
axes and a moment, each white noise behind two equal first-order lags, so that no first-order law
holds of it. Beside it act forces that no table of causes knows (``Unlisted``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.divergence import diverged
from plant.integrate import drives, motion_of, shifted
from plant.layout import DRIVE, PACKED, STATE, Drive, Packed, Rates, State
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.rigid_tail import rates
from plant.tail_input import TailProgramme, exp, sincos
from plant.trajectory import Start

STEP_S = 2.5e-3
PATH_COLUMNS = ("x_m", "y_m", "heading_rad", "u_m_s", "v_m_s", "r_rad_s")
PATH = len(PATH_COLUMNS)

# Dormand and Prince, J. Comput. Appl. Math. 6 (1980), table 2: the fifth-order weights.
_NODES = (0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0)
_STAGES = (
    (0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0 / 5.0, 0.0, 0.0, 0.0, 0.0),
    (3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0),
    (44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0),
    (19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0),
    (9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0),
)
_WEIGHTS = (35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0)


@dataclass(frozen=True, slots=True)
class Water:
    """Stationary standard deviations of the disturbing force on each axis and of the moment.

    ``correlation_s``: time constant of each of the two lags.
    """

    force_n: float
    moment_n_m: float
    correlation_s: float


@dataclass(frozen=True, slots=True)
class Unlisted:
    """Forces that are in no table of causes; zero is none.

    ``tether_n_m``: stiffness of a tether to (``anchor_x_m``, ``anchor_y_m``), N/m. ``slosh_n``:
    amplitude of a force along the tank's direction ``slosh_rad`` at ``slosh_hz``. ``asymmetry_m``:
    yaw moment per ½ρS|u|u of a crooked hull. ``jet_n``: force along ``jet_rad`` beside an inlet at
    (``jet_x_m``, ``jet_y_m``), within ``jet_reach_m``.
    """

    tether_n_m: float = 0.0
    anchor_x_m: float = 0.0
    anchor_y_m: float = 0.0
    slosh_n: float = 0.0
    slosh_rad: float = 0.0
    slosh_hz: float = 0.3
    asymmetry_m: float = 0.0
    jet_n: float = 0.0
    jet_rad: float = 0.0
    jet_x_m: float = 0.0
    jet_y_m: float = 0.0
    jet_reach_m: float = 0.2

    def vector(self) -> FloatArray:
        """Return it as compiled code takes it."""
        return np.array(
            [
                self.tether_n_m,
                self.anchor_x_m,
                self.anchor_y_m,
                self.slosh_n * math.cos(self.slosh_rad),
                self.slosh_n * math.sin(self.slosh_rad),
                2.0 * math.pi * self.slosh_hz,
                self.asymmetry_m,
                self.jet_n * math.cos(self.jet_rad),
                self.jet_n * math.sin(self.jet_rad),
                self.jet_x_m,
                self.jet_y_m,
                self.jet_reach_m,
            ]
        )


@compiled
def push(
    p: Packed, s: State, time_s: float, disturbance: FloatArray, at: float, unlisted: FloatArray
) -> tuple[float, float, float]:
    """Accelerations (surge, sway, yaw) by disturbance and unlisted forces.

    ``disturbance`` (n, 3): force in the tank's axes and moment on the grid, linear between its
    points; ``at``: place on it, in points.
    """
    i = min(int(at), disturbance.shape[0] - 2)
    share = at - i
    fx = disturbance[i, 0] + share * (disturbance[i + 1, 0] - disturbance[i, 0])
    fy = disturbance[i, 1] + share * (disturbance[i + 1, 1] - disturbance[i, 1])
    moment = disturbance[i, 2] + share * (disturbance[i + 1, 2] - disturbance[i, 2])
    fx -= unlisted[0] * (s.x - unlisted[1])
    fy -= unlisted[0] * (s.y - unlisted[2])
    sloshing, _ = sincos(unlisted[5] * time_s)
    fx += unlisted[3] * sloshing
    fy += unlisted[4] * sloshing
    moment += unlisted[6] * p.half_rho_s * abs(s.u) * s.u
    away2 = (s.x - unlisted[9]) ** 2 + (s.y - unlisted[10]) ** 2
    near = exp(-0.5 * away2 / unlisted[11] ** 2)
    fx += unlisted[7] * near
    fy += unlisted[8] * near
    sine, cosine = sincos(s.psi)
    return (
        (fx * cosine + fy * sine) / p.m1,
        (fy * cosine - fx * sine) / p.m2,
        moment / p.j3,
    )


@compiled
def pushed(
    p: Packed,
    drive: Drive,
    time_s: float,
    s: State,
    disturbance: FloatArray,
    at: float,
    unlisted: FloatArray,
) -> Rates:
    """The plant's rates with what disturbs it."""
    k = rates(p, drive, time_s, s)
    surge, sway, yaw = push(p, s, drive.start + time_s, disturbance, at, unlisted)
    return Rates(
        k.x_dot,
        k.y_dot,
        k.psi_dot,
        k.u_dot + surge,
        k.v_dot + sway,
        k.r_dot + yaw,
        k.servo_dot,
        k.servo_ddot,
        k.alpha_mean_dot,
        k.loose_dot,
        k.loose_ddot,
        k.alpha,
        k.alpha_dot,
        k.alpha_ddot,
        k.alpha_mean,
        k.servo,
        k.loose,
        k.force_x,
        k.force_y,
        k.hinge_moment,
    )


@compiled_apart
def march(
    packed: FloatArray,
    drive: FloatArray,
    begin: int,
    last: int,
    h: float,
    state: FloatArray,
    disturbance: FloatArray,
    unlisted: FloatArray,
    path: FloatArray,
) -> int:
    """Take ``state`` in place from grid point ``begin`` of a drive to ``last``; leave the path.

    Return the point reached: below ``last`` where the speed left all bounds.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    d = Drive(*fixed_tuple(drive, DRIVE))
    s = State(*fixed_tuple(state, STATE))
    k = begin
    while True:
        path[k, 0] = s.x
        path[k, 1] = s.y
        path[k, 2] = s.psi
        path[k, 3] = s.u
        path[k, 4] = s.v
        path[k, 5] = s.r
        if k == last:
            break
        t = (k - begin) * h
        k1 = pushed(p, d, t, s, disturbance, k + 0.0, unlisted)
        k2 = pushed(
            p,
            d,
            t + _NODES[1] * h,
            shifted(s, _STAGES[1][0] * h, k1),
            disturbance,
            k + _NODES[1],
            unlisted,
        )
        y = shifted(shifted(s, _STAGES[2][0] * h, k1), _STAGES[2][1] * h, k2)
        k3 = pushed(p, d, t + _NODES[2] * h, y, disturbance, k + _NODES[2], unlisted)
        y = shifted(shifted(s, _STAGES[3][0] * h, k1), _STAGES[3][1] * h, k2)
        y = shifted(y, _STAGES[3][2] * h, k3)
        k4 = pushed(p, d, t + _NODES[3] * h, y, disturbance, k + _NODES[3], unlisted)
        y = shifted(shifted(s, _STAGES[4][0] * h, k1), _STAGES[4][1] * h, k2)
        y = shifted(shifted(y, _STAGES[4][2] * h, k3), _STAGES[4][3] * h, k4)
        k5 = pushed(p, d, t + _NODES[4] * h, y, disturbance, k + _NODES[4], unlisted)
        y = shifted(shifted(s, _STAGES[5][0] * h, k1), _STAGES[5][1] * h, k2)
        y = shifted(shifted(y, _STAGES[5][2] * h, k3), _STAGES[5][3] * h, k4)
        y = shifted(y, _STAGES[5][4] * h, k5)
        k6 = pushed(p, d, t + h, y, disturbance, k + 1.0, unlisted)
        s = shifted(shifted(s, _WEIGHTS[0] * h, k1), _WEIGHTS[2] * h, k3)
        s = shifted(shifted(s, _WEIGHTS[3] * h, k4), _WEIGHTS[4] * h, k5)
        s = shifted(s, _WEIGHTS[5] * h, k6)
        k += 1
        if not (abs(s.u) < 100.0 and abs(s.v) < 100.0 and abs(s.r) < 1e4):
            break
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


def disturbances(water: Water, steps: int, generator: np.random.Generator) -> FloatArray:
    """Draw force (N, tank axes) and moment (N·m) on the grid (steps + 2, 3), stationary."""
    from scipy.signal import lfilter

    decay = math.exp(-STEP_S / water.correlation_s)
    lead = round(10.0 * water.correlation_s / STEP_S)
    white = generator.standard_normal((lead + steps + 2, 3))
    once = lfilter([1.0], [1.0, -decay], white, axis=0)
    twice = np.asarray(lfilter([1.0], [1.0, -decay], once, axis=0))[lead:]
    # variance of 1/(1 − a z⁻¹)² driven by unit white noise: (1 + a²)/(1 − a²)³
    unit = math.sqrt((1.0 - decay**2) ** 3 / (1.0 + decay**2))
    return np.ascontiguousarray(
        twice * unit * np.array([water.force_n, water.force_n, water.moment_n_m])
    )


def swim(
    parameters: PlantParameters,
    programme: TailProgramme,
    duration_s: float,
    start: Start,
    disturbance: FloatArray,
    unlisted: Unlisted | None = None,
) -> FloatArray:
    """Swim a programme from ``start``; the path (steps + 1, PATH) on the grid of ``STEP_S``.

    Raises ``plant.errors.DivergedError``.
    """
    steps = round(duration_s / STEP_S)
    path = np.zeros((steps + 1, PATH))
    motion = motion_of(parameters, STEP_S)
    state = motion.state(np.array(start.state()))
    packed = np.array(pack(parameters))
    extra = (unlisted or Unlisted()).vector()
    for drive, first, last in drives(parameters, programme, motion, STEP_S, steps, state):
        if parameters.tail.flexible:
            reached = _bend(parameters, drive, first, last, state, disturbance, extra, path)
        else:
            reached = march(packed, drive, first, last, STEP_S, state, disturbance, extra, path)
        if reached != last:
            raise diverged(parameters, drive, first, reached, STEP_S, state)
    return path


def _bend(
    parameters: PlantParameters,
    drive: FloatArray,
    first: int,
    last: int,
    state: FloatArray,
    disturbance: FloatArray,
    unlisted: FloatArray,
    path: FloatArray,
) -> int:
    """``march`` with a flexible tail: the plant's own stiff steps, pushed between them."""
    motion = motion_of(parameters, STEP_S)
    p = Packed(*(float(value) for value in pack(parameters)))
    scratch = np.empty((1, motion.width))
    start_s = float(drive[Drive._fields.index("start")])
    for k in range(first, last):
        path[k] = state[:PATH]
        s = State(*(float(value) for value in state[:STATE]))
        time_s = start_s + (k - first + 0.5) * STEP_S
        kick = push(p, s, time_s, disturbance, k + 0.5, unlisted)
        half = 0.5 * STEP_S * np.array(kick)
        state[3:6] += half
        if motion.march(drive, first, k, k + 1, state, scratch, k + 2, 4) != k + 1:
            return k
        state[3:6] += half
    path[last] = state[:PATH]
    return last
