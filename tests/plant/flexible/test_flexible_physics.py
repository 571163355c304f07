"""Balances, limits and published behaviour of both flexible tails."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from plant.flexible import modes, segments
from plant.flexible.beam import MATRICES, TIP
from plant.flexible.energy import tail_energy
from plant.flexible.segments import joint_stiffness_n_m, modulus_from_bending_pa
from plant.flexible.shape import segment_angles, tail_points, tip_displacement_m
from plant.hull import hull_forces
from plant.integrate import simulate
from plant.layout import Column
from plant.metrics import mean_thrust_n, steady_motion
from plant.packing import pack
from plant.parameters import PlantParameters, Tail
from plant.robots import flexible_tail, long_flexible_tail, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Trajectory

Robot = Callable[..., PlantParameters]
BEAT = TailBeat.degrees(0.0, 13.6, 0.9)
TURN = TailBeat.degrees(20.0, 13.6, 0.9)


def swim(p: PlantParameters, beat: TailBeat, duration_s: float, step_s: float) -> Trajectory:
    return simulate(p, TailProgramme.steady(beat), duration_s, step_s)


def later(path: Trajectory, begin_s: float) -> Trajectory:
    kept = path.time_s > begin_s - 1e-9
    return Trajectory(path.time_s[kept], path.rows[kept])


def speed(p: PlantParameters, frequency_hz: float, amplitude: float = 13.6) -> float:
    path = swim(p, TailBeat.degrees(0.0, amplitude, frequency_hz), 40.0, 0.01)
    return steady_motion(
        path.time_s, path.x_m, path.y_m, path.heading_rad, frequency_hz
    ).path_speed_m_s


TAPER = (1.2, 0.9, 0.5)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(
    "tail",
    [
        flexible_tail(5),
        replace(flexible_tail(3), depth_profile=TAPER, thickness_profile=(1.0, 0.7)),
        flexible_tail(1, 3),
        replace(flexible_tail(1, 3), depth_profile=TAPER, thickness_profile=(1.0, 0.7)),
    ],
)
def test_energy_balances(tail: Tail, share: float, robot: Robot) -> None:
    p = robot(tail, share)
    path = later(swim(p, TURN, 2.0, 2e-3), 1.0)
    energy = tail_energy(p, path)
    turned_over = float(np.abs(energy.body_w).mean() + energy.damping_w.mean())
    assert turned_over > 1e-6
    assert energy.unbalance_j(path.time_s) == pytest.approx(0.0, abs=3e-9 * turned_over)


def test_each_part_of_the_balance_counts(robot: Robot) -> None:
    p = robot(flexible_tail(5))
    path = later(swim(p, TURN, 2.0, 2e-3), 1.0)
    energy = tail_energy(p, path)
    for name in ("water_j", "spring_j", "damping_w", "wake_w", "body_w"):
        without = replace(energy, **{name: 0.0 * path.time_s})
        assert abs(without.unbalance_j(path.time_s)) > 1e-8


def test_momentum_balances(robot: Robot) -> None:
    # in the tank: body and water along the tail gain what the hull's drag and the tip give
    p = robot(flexible_tail(4))
    path = later(swim(p, TURN, 1.5, 2e-3), 0.5)
    packed, parts, count = pack(p), segments.table(p), 4
    u, v, r, psi = path.u_m_s, path.v_m_s, path.r_rad_s, path.heading_rad
    length, tip = parts[count, 0], parts[count, 1]
    angles = segment_angles(p, path)
    rates = np.column_stack((path.column(Column.ALPHA_DOT), path.rows[:, -3:]))
    vx, vy = u, v - r * packed.hinge
    px, py = packed.m1 * u, packed.m2 * v
    for i in range(count):
        sine, cosine = np.sin(angles[:, i]), np.cos(angles[:, i])
        across, omega = vx * sine - vy * cosine, rates[:, i] + r
        along = -vx * cosine - vy * sine
        impulse = parts[i, 0] * across + parts[i, 1] * omega
        px, py = px + impulse * sine, py - impulse * cosine
        vx, vy = vx + length * omega * sine, vy - length * omega * cosine
    end = across + omega * length
    fx = 0.5 * tip * end**2 * cosine + tip * end * along * sine
    fy = 0.5 * tip * end**2 * sine - tip * end * along * cosine
    for k in range(len(u)):
        side = hull_forces(
            packed, 0.0, 0.0, 0.0, float(u[k]), float(v[k]), float(r[k]), TURN.bias_rad
        )
        fx[k] += side[0] - packed.m2 * v[k] * r[k]
        fy[k] += side[1] + packed.m1 * u[k] * r[k]
    weights = np.ones(len(u))
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    weights *= (path.time_s[1] - path.time_s[0]) / 3.0
    for force, momentum in (
        (fx * np.cos(psi) - fy * np.sin(psi), px * np.cos(psi) - py * np.sin(psi)),
        (fx * np.sin(psi) + fy * np.cos(psi), px * np.sin(psi) + py * np.cos(psi)),
    ):
        gained = momentum[-1] - momentum[0]
        assert weights @ force == pytest.approx(gained, abs=1e-8 * np.abs(momentum).max())


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize("tail", [flexible_tail(5), flexible_tail(1, 3)])
def test_a_stiff_tail_is_the_rigid_one(tail: Tail, share: float, robot: Robot) -> None:
    rigid = swim(robot(Tail(), share), TURN, 3.0, 5e-3)
    apart = []
    for modulus in (1e12, 1e13):
        stiff = swim(robot(replace(tail, modulus_pa=modulus), share), TURN, 3.0, 5e-3)
        apart.append(np.abs(stiff.rows[:, :6] - rigid.rows[:, :6]).max(axis=0))
    assert np.all(apart[1] < 5e-4 * np.abs(rigid.rows[:, :6]).max(axis=0))
    # the deflection is proportional to the compliance
    assert apart[0] / apart[1] == pytest.approx(np.full(6, 10.0), rel=0.3)


def test_segments_converge_with_their_number(robot: Robot) -> None:
    # the first segment is rigid and half of each joint's length is lost: an error as 1/N
    beat = TailBeat.degrees(0.0, 1.0, 0.9)
    tips = []
    for count in (5, 10, 20, 40):
        p = robot(flexible_tail(count))
        tips.append(float(np.abs(tip_displacement_m(p, swim(p, beat, 6.0, 0.01))[-120:]).max()))
    steps = np.diff(tips)
    assert steps[0] / steps[1] == pytest.approx(2.0, abs=0.3)
    assert steps[1] / steps[2] == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(
    "profile",
    [{}, {"depth_profile": (1.2, 0.6), "thickness_profile": (1.0, 0.8)}],
)
def test_beam_and_segments_agree_at_small_amplitude(
    profile: dict[str, tuple[float, ...]], share: float, robot: Robot
) -> None:
    beat = TailBeat.degrees(0.0, 0.5, 0.9)
    beam = robot(replace(flexible_tail(1, 4), **profile), share)
    path = swim(beam, beat, 12.0, 0.01)
    tip, thrust = tip_displacement_m(beam, path)[-200:], mean_thrust_n(path, 0.9, 4)
    errors = []
    for count in (20, 40):
        p = robot(replace(flexible_tail(count), **profile), share)
        other = swim(p, beat, 12.0, 0.01)
        size = np.abs(tip).max()
        away = np.abs(tip_displacement_m(p, other)[-200:] - tip).max() / size
        errors.append((away, mean_thrust_n(other, 0.9, 4) / thrust - 1.0))
    (far, more), (near, less) = errors
    # Richardson: an error as 1/N vanishes
    assert near < 0.06
    assert 2.0 * near - far == pytest.approx(0.0, abs=0.006)
    assert 2.0 * less - more == pytest.approx(0.0, abs=0.012)


def test_speed_peaks_near_the_published_frequency(robot: Robot) -> None:
    # Fig. 4.9 is sampled every 0.45 Hz; the highest of its simulated points is at 1.35 Hz
    at = {f: speed(robot(flexible_tail(5), 0.0), f) for f in (0.45, 0.9, 1.35, 1.8, 2.25)}
    assert max(at, key=at.__getitem__) == 1.35
    # with the damping as printed, ten times κ K_S, there is no peak there
    printed = replace(flexible_tail(5), damping_s=0.79)
    heavy = {f: speed(robot(printed, 0.0), f) for f in (1.35, 1.8)}
    assert heavy[1.8] > heavy[1.35]


@pytest.mark.parametrize("make", [flexible_tail, long_flexible_tail])
def test_the_beam_parts_from_the_segments_above_the_peak(
    make: Callable[..., Tail], robot: Robot
) -> None:
    def parted(frequency_hz: float) -> float:
        beam, chain = robot(make(1, 4), 0.0), robot(make(5), 0.0)
        return speed(beam, frequency_hz) / speed(chain, frequency_hz) - 1.0

    assert abs(parted(0.45)) < 0.2
    assert parted(2.25) < -0.25


def test_static_deflection_gives_the_modulus_back() -> None:
    # a load P at the tip of a cantilever: w = P L³ / (3 E I), which is (4.30)
    p = wang2014_flexible(flexible_tail(1, 8))
    parts, load = modes.table(p), 0.01
    stiffness = np.diag(parts[MATRICES + 24 : MATRICES + 32, :8])
    deflection = float(load * np.sum(parts[TIP, :8] ** 2 / stiffness))
    got = modulus_from_bending_pa(0.08, 0.025, 0.3e-3, load, deflection)
    assert got == pytest.approx(1.48e9, rel=2e-4)
    # and of many joints: w = P Σ (L − x)² / K_S
    p = wang2014_flexible(flexible_tail(64))
    arms = [0.08 * (1.0 - j / 64) for j in range(1, 64)]
    joints = sum(load * a * a / joint_stiffness_n_m(p, j + 1) for j, a in enumerate(arms))
    assert modulus_from_bending_pa(0.08, 0.025, 0.3e-3, load, joints) == pytest.approx(
        1.48e9, rel=0.03
    )


def test_published_beam_test() -> None:
    # Fig. 4.6: about 6.2 … 6.8 mm under 8 … 9.5 mN; E in [1.41, 1.51] GPa whatever the length
    one = modulus_from_bending_pa(0.1, 0.025, 0.3e-3, 0.008, 0.03)
    assert modulus_from_bending_pa(0.2, 0.025, 0.3e-3, 0.008, 0.24) == pytest.approx(one)


@pytest.mark.parametrize("tail", [flexible_tail(5), flexible_tail(1, 3)])
def test_a_uniform_profile_is_a_uniform_tail(tail: Tail, robot: Robot) -> None:
    ones = replace(tail, depth_profile=(1.0, 1.0, 1.0), thickness_profile=(1.0, 1.0))
    plain, same = (swim(robot(t), TURN, 2.0, 0.01) for t in (tail, ones))
    assert same.rows == pytest.approx(plain.rows, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("tail", [flexible_tail(10), flexible_tail(1, 4)])
def test_what_a_taper_does(tail: Tail, robot: Robot) -> None:
    beat = TailBeat.degrees(0.0, 5.0, 0.2)  # slow: the tail bends as its load and stiffness say

    def bent(shape: Tail) -> float:
        p = robot(shape)
        path = swim(p, beat, 15.0, 0.02)
        deflection = tip_displacement_m(p, path) - 0.08 * np.sin(path.tail_angle_rad)
        return float(np.ptp(deflection[-260:]))

    plain = bent(tail)
    # thinner towards the tip it bends more; thicker at the joint, less
    assert bent(replace(tail, thickness_profile=(1.0, 0.5))) > 1.1 * plain
    assert bent(replace(tail, thickness_profile=(1.5, 1.0))) < 0.9 * plain
    # less water to carry at the tip
    assert bent(replace(tail, depth_profile=(1.0, 0.5))) < 0.9 * plain


def test_points_along_the_tail(robot: Robot) -> None:
    for tail in (flexible_tail(5), flexible_tail(1, 3)):
        p = robot(tail)
        path = swim(p, TURN, 1.0, 0.01)
        points = tail_points(p, path)
        lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
        assert points[0, -1] == pytest.approx(
            [-0.08 * np.cos(TURN.bias_rad), -0.08 * np.sin(TURN.bias_rad)], rel=1e-12
        )
        assert lengths == pytest.approx(
            np.full(len(points), 0.08), rel=0.1 if tail.modes else 1e-12
        )
        assert np.all(points[:, 0] == 0.0)
