"""Which initial velocities come to the equilibrium of the average model, and how soon.

Local stability (5.31) says nothing of how far it reaches. Each start of a grid is followed by
Runge–Kutta steps whose length adapts to the fastest rate at that speed (drag and lift grow with the
speed, so a fast start is stiff and a slow one is not), until it is near the equilibrium, where the
linearisation takes over, or time is up. Position and heading do not act back and are left out.
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.averaging.average import forcing
from plant.averaging.dynamics import (
    FORCING,
    PUBLISHED,
    REDUCED,
    Dynamics,
    Forcing,
    Reduced,
    Scaling,
    hull,
    reduced,
)
from plant.averaging.equilibrium import Equilibrium, equilibrium
from plant.checks import check_number
from plant.compiled import compiled, fixed_tuple
from plant.errors import InvalidParameterError
from plant.metrics import LEAST_TURN_RATE_RAD_S
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat

NEAR = 1e-3
"""Distance to the equilibrium, as a share of its speed and rate, that counts as there.

Where it does not turn, a rate below ``LEAST_TURN_RATE_RAD_S`` counts.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Basin:
    """``time_s`` (n,) until each start was near ``at``, else infinite; ``last`` (n, 3): u, v, r."""

    at: Equilibrium
    starts: FloatArray
    time_s: FloatArray
    last: FloatArray

    @property
    def converged(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Which starts came to the equilibrium, shape (n,)."""
        return np.isfinite(self.time_s)


@compiled
def _follow(
    constants: FloatArray,
    forces: FloatArray,
    starts: FloatArray,
    target: FloatArray,
    near: FloatArray,
    duration_s: float,
    times: FloatArray,
    last: FloatArray,
) -> None:
    p = Reduced(*fixed_tuple(constants, REDUCED))
    f = Forcing(*fixed_tuple(forces, FORCING))
    stiff = (p.c1 + math.pi * p.c2) / min(p.m1, p.m2)
    for i in range(starts.shape[0]):
        u, v, r = starts[i, 0], starts[i, 1], starts[i, 2]
        time_s = 0.0
        times[i] = math.inf
        while time_s < duration_s:
            if (
                abs(u - target[0]) < near[0]
                and abs(v - target[1]) < near[1]
                and abs(r - target[2]) < near[2]
            ):
                times[i] = time_s
                break
            fastest = stiff * math.sqrt(u * u + v * v) + (2.0 * p.c4 + 2.0) * abs(r) + 0.5
            h = 0.5 / fastest
            sum_u, sum_v, sum_r = u, v, r
            ku, kv, kr = 0.0, 0.0, 0.0
            for stage in range(4):
                part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                du, dv, dr = hull(p, u + part * ku, v + part * kv, r + part * kr)
                ku, kv, kr = du + f.x, dv + f.y, dr + f.z
                weight = h / 6.0 if stage in (0, 3) else h / 3.0
                sum_u += weight * ku
                sum_v += weight * kv
                sum_r += weight * kr
            u, v, r = sum_u, sum_v, sum_r
            time_s += h
        last[i, 0], last[i, 1], last[i, 2] = u, v, r


def grid_of_starts(most_speed_m_s: float, most_rate_rad_s: float, points: int = 11) -> FloatArray:
    """Initial u, v (each −most…most) and r, points³ rows (n, 3); rest itself is left out."""
    check_number("basin.most_speed_m_s", most_speed_m_s, above=0.0, most=50.0)
    check_number("basin.most_rate_rad_s", most_rate_rad_s, above=0.0, most=1e3)
    if points < 2:
        raise InvalidParameterError("basin.points", f"must be at least 2, got {points}")
    axis = np.linspace(-1.0, 1.0, points)
    u, v, r = np.meshgrid(
        most_speed_m_s * axis, most_speed_m_s * axis, most_rate_rad_s * axis, indexing="ij"
    )
    return np.column_stack((u.ravel(), v.ravel(), r.ravel()))


def basin(
    parameters: PlantParameters,
    beat: TailBeat,
    starts: FloatArray,
    scaling: Scaling = PUBLISHED,
    duration_s: float = 300.0,
) -> Basin:
    """Follow (5.30) from ``starts`` (n, 3) of u, v (m/s), r (rad/s) to its forward equilibrium."""
    if starts.ndim != 2 or starts.shape[1] != 3 or not np.all(np.isfinite(starts)):
        raise InvalidParameterError("basin.starts", f"must be rows of u, v, r, got {starts.shape}")
    check_number("basin.duration_s", duration_s, above=0.0)
    dynamics = Dynamics(full_tail=False, scaling=scaling)
    p = reduced(parameters, beat.bias_rad, dynamics)
    at = equilibrium(parameters, beat, scaling)
    target = np.array([at.u_m_s, at.v_m_s, at.r_rad_s])
    near = NEAR * np.array([at.speed_m_s, at.speed_m_s, abs(at.r_rad_s)])
    if at.r_rad_s == 0.0:
        # it dies as 1/(c₄t), so a share of nothing is never reached; the sway follows it
        near[2] = LEAST_TURN_RATE_RAD_S
        near[1] += p.m1 * LEAST_TURN_RATE_RAD_S / (p.c1 + p.c2)
    times, last = np.empty(len(starts)), np.empty((len(starts), 3))
    _follow(
        np.array(p),
        np.array(forcing(parameters, beat, dynamics)),
        np.ascontiguousarray(starts, dtype=np.float64),
        target,
        near,
        duration_s,
        times,
        last,
    )
    return Basin(at, starts, times, last)
