"""Where the energy of a flexible tail goes: water, springs, heat, wake, body.

Along the tail the power of the water's forces on it is, term by term from the equations of motion,

    Σ ∫ f·V dτ + F_c·V_L = −dT/dt − W,     T = ½ ∫ m v⊥² dτ

with W what is convected away past joints and tip,

    segments:  W = −Σ v∥ᵢ Ωᵢ (wᵢ M0ᵢ + Ωᵢ M1ᵢ) − ½ m_L v_L² v∥_N
    beam:      W = −v∥ (∫ m v⊥ (Ω + ẇ′) dτ + ½ m_L v_L²)

(v∥ is about −u, so that W is positive at the tip of a swimmer: half of ½ m_L v_L² u is Lighthill's
wake, the rest belongs to the source's way of distributing the force along the tail.) A tail without
mass passes that power on: to the body through the joint A, F_h·V_A + M_A (r + α̇), into springs, and
into their damping D,

    F_h·V_A + M_A (r + α̇) + dU/dt + D + dT/dt + W = 0.

With the body's motion (share 1) V is the true velocity and this is the energy balance of the robot;
anchored, it holds with V_A = 0 and Ω = α̇ for the tail alone.
"""

from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.flexible import modes, segments
from plant.flexible.beam import MATRICES
from plant.flexible.shape import bend, segment_angles
from plant.layout import Column
from plant.packing import virtual_mass_kg_m
from plant.parameters import PlantParameters
from plant.profile import factor_at
from plant.trajectory import Trajectory

_NODES = 80  # Gauss points between two kinks of the depth


@dataclass(frozen=True, slots=True)
class TailEnergy:
    """At each saved grid point, (n,): energies in J, powers in W."""

    water_j: FloatArray  # T
    spring_j: FloatArray  # U
    damping_w: FloatArray  # D
    wake_w: FloatArray  # W
    body_w: FloatArray  # what the tail passes on to body and servo

    def unbalance_j(self, time_s: FloatArray) -> float:
        """What is left of the balance over the whole span, J; Simpson's rule, an odd (n,)."""
        power = self.damping_w + self.wake_w + self.body_w
        step = (time_s[-1] - time_s[0]) / (time_s.size - 1)
        weights = np.ones(time_s.size)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        stored = self.water_j + self.spring_j
        return float(stored[-1] - stored[0] + step / 3.0 * (weights @ power))


def tail_energy(parameters: PlantParameters, trajectory: Trajectory) -> TailEnergy:
    """Follow the energy along a trajectory of ``simulate`` with the same parameters."""
    share, hinge = parameters.hydrodynamics.body_motion_in_tail, parameters.body.hinge_distance_m
    vx = share * trajectory.u_m_s
    vy = share * (trajectory.v_m_s - hinge * trajectory.r_rad_s)
    turn = share * trajectory.r_rad_s
    follow = _beam if parameters.tail.modes else _segments
    water, spring, damping, wake = follow(parameters, trajectory, (vx, vy, turn))
    body = trajectory.tail_force_x_n * vx + trajectory.tail_force_y_n * vy
    body = body + trajectory.hinge_moment_n_m * (turn + trajectory.column(Column.ALPHA_DOT))
    return TailEnergy(water, spring, damping, wake, body)


_Motion = tuple[FloatArray, FloatArray, FloatArray]
_Four = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _segments(parameters: PlantParameters, path: Trajectory, motion: _Motion) -> _Four:
    vx, vy, turn = motion
    parts = segments.table(parameters)
    count = parameters.tail.segments
    length, tip = parts[count, 0], parts[count, 1]
    angles = segment_angles(parameters, path)
    rates = np.column_stack((path.column(Column.ALPHA_DOT), bend(parameters, path)[1]))
    stiffness, damping = parts[1:count, segments.STIFFNESS], parts[1:count, segments.DAMPING]
    water, wake = np.zeros(len(angles)), np.zeros(len(angles))
    for i in range(count):
        m0, m1, m2 = parts[i, :3]
        sine, cosine = np.sin(angles[:, i]), np.cos(angles[:, i])
        across, along = vx * sine - vy * cosine, -vx * cosine - vy * sine
        omega = rates[:, i] + turn
        water += 0.5 * (m0 * across**2 + 2.0 * m1 * across * omega + m2 * omega**2)
        wake -= along * omega * (across * m0 + omega * m1)
        vx, vy = vx + length * omega * sine, vy - length * omega * cosine
    wake -= 0.5 * tip * (across + omega * length) ** 2 * along
    bent, bending = np.diff(angles, axis=1), np.diff(rates, axis=1)
    return water, 0.5 * (bent**2 @ stiffness), bending**2 @ damping, wake


def _points(stations: int) -> tuple[FloatArray, FloatArray]:
    """Gauss points over [0, 1] and their weights, between the stations of a profile."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    pieces = max(1, stations - 1)
    within = (0.5 * (nodes + 1.0) + np.arange(pieces)[:, np.newaxis]) / pieces
    return within.ravel(), np.tile(0.5 * weights / pieces, pieces)


def _beam(parameters: PlantParameters, path: Trajectory, motion: _Motion) -> _Four:
    vx, vy, turn = motion
    tail, share = parameters.tail, parameters.hydrodynamics.body_motion_in_tail
    count, length = tail.modes, tail.length_m
    parts = modes.table(parameters)
    eta, eta_dot = bend(parameters, path)
    first = MATRICES + 3 * count
    stiffness = parts[first : first + count, :count]
    damping = parts[first + count : first + 2 * count, :count]
    nodes, weights = _points(len(tail.depth_profile))
    along = [*nodes, 1.0]
    mass = virtual_mass_kg_m(parameters) * np.array(
        [factor_at(tail.depth_profile, float(x)) ** 2 for x in along]
    )
    shapes = [modes.shape(i + 1) for i in range(count)]
    forms = np.array([[one.value(float(x)) for x in along] for one in shapes])
    slopes = np.array([[one.slope(float(x)) / length for x in along] for one in shapes])
    alpha = path.tail_angle_rad
    sine, cosine = np.sin(alpha), np.cos(alpha)
    omega = (path.column(Column.ALPHA_DOT) + turn)[:, np.newaxis]
    v_across, v_along = vx * sine - vy * cosine, -vx * cosine - vy * sine
    normal = v_across[:, np.newaxis] + omega * (length * np.array(along)) + eta_dot @ forms
    normal = normal - share * (eta @ slopes) * v_along[:, np.newaxis]
    weighted = length * weights * mass[:-1]
    water = 0.5 * (normal[:, :-1] ** 2 @ weighted)
    turning = (normal * (omega + share * (eta_dot @ slopes)))[:, :-1] @ weighted
    wake = -v_along * (turning + 0.5 * mass[-1] * normal[:, -1] ** 2)
    spring = 0.5 * np.einsum("ni,ij,nj->n", eta, stiffness, eta)
    return water, spring, np.einsum("ni,ij,nj->n", eta_dot, damping, eta_dot), wake
