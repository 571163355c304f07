"""What the equations of chapter 3 say of momentum and energy, derived apart from their solution.

With V_τ = v∥ m̂ + v⊥ n̂ the velocity of a point of the tail and m v⊥ n̂ the momentum per length of
the water that goes with it, (3.5–3.24) are statements on

    P = m₁u x̂ + m₂v ŷ + ∫ m v⊥ n̂ dτ                                    (in the tank frame)
    H = J₃r + X × (m₁u x̂ + m₂v ŷ) + ∫ X_τ × m v⊥ n̂ dτ                  (about the tank's origin)
    T = ½m₁u² + ½m₂v² + ½J₃r² + ½∫ m v⊥² dτ.

P changes by the force at the tip F_c (3.9) and by drag and lift on the hull. H changes by their
moments, and by ∫ m v∥v⊥ dτ: the Munk moment of the tail's own slices, which (3.18) leaves out as it
puts all that flows along the tail into the tip. T changes by the work of the servo against the
moment at the joint, −M_A α̇; by drag; and by

    F_c·V_L + ∫ m v⊥(α̇ + r) v∥ dτ = m v∥ v_L² − ½ m v∥ w²,

of which ½ m v_L² v∥ is the kinetic energy shed at the tip with the speed −v∥ of the water along
the tail, and the rest the work of that same flow on its way from the joint (w) to the tip (v_L).

None of these appears in the code, which solves for accelerations. Each is integrated over a run.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import cumulative_simpson

from plant.arrays import FloatArray
from plant.integrate import simulate
from plant.layout import Column, Packed
from plant.packing import pack
from plant.parameters import Hydrodynamics, PlantParameters, Tail
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start, Trajectory

ComplexArray = npt.NDArray[np.complex128]

BEAT = TailBeat.degrees(25, 20, 1.3)
START = Start(x_m=0.3, y_m=-0.2, heading_rad=0.7, u_m_s=0.05, v_m_s=0.01, r_rad_s=0.4)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact to τ⁵


@dataclass(frozen=True, slots=True)
class Motion:
    """A run in the terms of the equations; vectors are complex numbers in the tank frame."""

    p: Packed
    run: Trajectory

    def __getitem__(self, column: Column) -> FloatArray:
        return self.run.column(column)

    @property
    def turned(self) -> ComplexArray:
        """Body axes: multiplying by this takes a vector from the body into the tank."""
        turned: ComplexArray = np.exp(1j * self[Column.PSI])
        return turned

    @property
    def along(self) -> ComplexArray:
        """m̂ in the tank; n̂ is this turned by a right angle to the left."""
        turned: ComplexArray = np.exp(1j * self[Column.ALPHA])
        return -turned * self.turned

    @property
    def hinge_velocity(self) -> ComplexArray:
        u, v, r = self[Column.U], self[Column.V], self[Column.R]
        return (u + 1j * (v - r * self.p.hinge)) * self.turned

    def slice_at(self, tau: float) -> tuple[FloatArray, FloatArray]:
        """v∥ and v⊥ of a point of the tail."""
        turning = self[Column.R] + self[Column.ALPHA_DOT]
        velocity = self.hinge_velocity + turning * tau * 1j * self.along
        across = velocity * np.conj(1j * self.along)
        return (velocity * np.conj(self.along)).real, across.real

    def slices(self) -> list[tuple[float, FloatArray, FloatArray]]:
        """Places τ with weights m dτ: (τ and weight, v∥, v⊥) for quadrature along the tail."""
        half = 0.5 * self.p.tail_length
        return [(half * (node + 1.0), *self.slice_at(half * (node + 1.0))) for node in NODES]

    def weights(self) -> FloatArray:
        return self.p.tail_mass * 0.5 * self.p.tail_length * WEIGHTS

    def place(self, tau: float) -> ComplexArray:
        centre = self[Column.X] + 1j * self[Column.Y]
        return centre - self.p.hinge * self.turned + tau * self.along

    def tip_force(self) -> ComplexArray:
        along, across = self.slice_at(self.p.tail_length)
        m = self.p.tail_mass
        return -0.5 * m * across**2 * self.along + m * across * along * 1j * self.along

    def hull_force(self) -> ComplexArray:
        """Drag against the velocity, lift to its right where β is positive (3.19, 3.20, 3.22)."""
        velocity = (self[Column.U] + 1j * self[Column.V]) * self.turned
        beta = np.arctan2(self[Column.V], self[Column.U])
        pressure = self.p.half_rho_s * np.abs(velocity)
        return -pressure * velocity * (self.p.drag + 1j * self.p.lift * beta)

    def body_momentum(self) -> ComplexArray:
        body = self.p.m1 * self[Column.U] + 1j * self.p.m2 * self[Column.V]
        return body * self.turned

    def tail_momenta(self) -> list[ComplexArray]:
        return [
            weight * across * 1j * self.along
            for weight, (_, _, across) in zip(self.weights(), self.slices(), strict=True)
        ]


def cross(a: ComplexArray, b: ComplexArray) -> FloatArray:
    return (np.conj(a) * b).imag


def gained(motion: Motion, rate: FloatArray) -> FloatArray:
    total: FloatArray = cumulative_simpson(rate, x=motion.run.time_s, initial=0)
    return total


def impulse(motion: Motion, force: ComplexArray) -> ComplexArray:
    return gained(motion, force.real) + 1j * gained(motion, force.imag)


ROBOTS = {
    "Table 3.1": wang2014(),
    "long tail": replace(wang2014(), tail=Tail(length_m=0.15, depth_m=0.05)),
    "no hull forces": replace(
        wang2014(), hydrodynamics=Hydrodynamics(drag=0.0, lift=0.0, yaw_drag_n_m_s2=0.0)
    ),
}


@pytest.fixture(scope="module", params=ROBOTS)
def motion(request: pytest.FixtureRequest) -> Motion:
    p: PlantParameters = ROBOTS[request.param]
    run = simulate(p, TailProgramme.steady(BEAT, 0.4), 10.0, 5e-4, START)
    return Motion(pack(p), run)


def test_linear_momentum(motion: Motion) -> None:
    momentum = motion.body_momentum() + sum(motion.tail_momenta())
    given = impulse(motion, motion.tip_force() + motion.hull_force())
    scale = float(np.abs(momentum).max())
    assert np.abs(momentum - momentum[0] - given).max() < 1e-8 * scale
    # both sides are alive, and the tip has its part in them
    assert np.abs(momentum - momentum[0]).max() > 0.1 * scale
    without = impulse(motion, motion.hull_force())
    assert np.abs(momentum - momentum[0] - without).max() > 0.01 * scale


def test_angular_momentum_about_the_tanks_origin(motion: Motion) -> None:
    p = motion.p
    centre = motion[Column.X] + 1j * motion[Column.Y]
    angular = p.j3 * motion[Column.R] + cross(centre, motion.body_momentum())
    munk = np.zeros_like(angular)
    for (tau, along, across), momentum, weight in zip(
        motion.slices(), motion.tail_momenta(), motion.weights(), strict=True
    ):
        angular = angular + cross(motion.place(tau), momentum)
        munk += weight * along * across
    moment = cross(motion.place(p.tail_length), motion.tip_force())
    moment = moment + cross(centre, motion.hull_force())
    moment -= p.yaw_drag * motion[Column.R] * np.abs(motion[Column.R])
    scale = float(np.abs(angular).max())
    assert np.abs(angular - angular[0] - gained(motion, moment + munk)).max() < 1e-8 * scale
    assert np.abs(angular - angular[0] - gained(motion, moment)).max() > 1e-3 * scale


def test_energy(motion: Motion) -> None:
    p = motion.p
    u, v, r = motion[Column.U], motion[Column.V], motion[Column.R]
    kinetic = 0.5 * (p.m1 * u**2 + p.m2 * v**2 + p.j3 * r**2)
    for weight, (_, _, across) in zip(motion.weights(), motion.slices(), strict=True):
        kinetic = kinetic + 0.5 * weight * across**2
    servo = -motion[Column.HINGE_MOMENT] * motion[Column.ALPHA_DOT]
    drag = -p.half_rho_s * p.drag * np.hypot(u, v) ** 3 - p.yaw_drag * np.abs(r) ** 3
    along, tip = motion.slice_at(p.tail_length)
    _, hinge = motion.slice_at(0.0)
    flow = p.tail_mass * along * (tip**2 - 0.5 * hinge**2)
    scale = float(np.abs(gained(motion, np.abs(servo))).max())
    assert np.abs(kinetic - kinetic[0] - gained(motion, servo + drag + flow)).max() < 1e-8 * scale
    # every part matters
    parts = {"servo": servo, "flow": flow} | ({"drag": drag} if p.drag > 0.0 else {})
    for part in parts.values():
        without = gained(motion, servo + drag + flow - part)
        assert np.abs(kinetic - kinetic[0] - without).max() > 1e-3 * scale
    # what the servo puts in is more than the motion has at the end: the water keeps the rest
    if p.drag > 0.0:
        assert gained(motion, servo)[-1] > kinetic[-1] - kinetic[0] > -kinetic[0]


def test_over_a_steady_beat_the_servo_pays_for_drag_and_wake() -> None:
    beat = TailBeat.degrees(0, 15, 0.9)
    step = 1 / (0.9 * 1000)
    run = simulate(wang2014(), TailProgramme.steady(beat), 120 / 0.9, step)
    motion = Motion(pack(wang2014()), Trajectory(run.time_s[-1001:], run.rows[-1001:]))
    p = motion.p
    u, v, r = motion[Column.U], motion[Column.V], motion[Column.R]
    servo = -motion[Column.HINGE_MOMENT] * motion[Column.ALPHA_DOT]
    drag = p.half_rho_s * p.drag * np.hypot(u, v) ** 3 + p.yaw_drag * np.abs(r) ** 3
    along, tip = motion.slice_at(p.tail_length)
    _, hinge = motion.slice_at(0.0)
    wake = -p.tail_mass * along * (tip**2 - 0.5 * hinge**2)
    means = [float(np.mean(each[:-1])) for each in (servo, drag, wake)]
    assert means[0] == pytest.approx(means[1] + means[2], rel=1e-7)
    assert all(mean > 0.0 for mean in means)


def test_yaw_alone_decays_by_its_closed_form() -> None:
    # J₃ ṙ = −K_D r|r|  →  r = r₀ / (1 + K_D r₀ t / J₃)
    none = Hydrodynamics(drag=0.0, lift=0.0)
    p = replace(wang2014(), tail=Tail(depth_m=1e-7), hydrodynamics=none)
    run = simulate(p, TailProgramme.steady(TailBeat()), 20.0, start=Start(r_rad_s=2.0))
    decay = 11.29e-4 / pack(p).j3
    assert run.r_rad_s == pytest.approx(2.0 / (1 + decay * 2.0 * run.time_s), rel=1e-9)
    assert run.heading_rad[-1] == pytest.approx(math.log(1 + decay * 40.0) / decay, rel=1e-9)


def test_a_slow_sideslip_decays_exponentially() -> None:
    # fast ahead, v ≪ u, no yaw (a hull without Munk moment): m₂ v̇ = −½ρSu(C_D + C_L) v
    hull = Hydrodynamics(drag=0.2, lift=4.5, munk_coupling=0.0)
    body = replace(wang2014().body, mass_kg=1000.0, added_mass_surge_kg=1000.0)
    p = replace(wang2014(), tail=Tail(depth_m=1e-7), hydrodynamics=hull, body=body)
    start = Start(u_m_s=0.5, v_m_s=1e-7)
    run = simulate(p, TailProgramme.steady(TailBeat()), 5.0, start=start)
    rate = 0.5 * 1000 * 0.0108 * 4.7 * 0.5 / pack(p).m2
    # u itself loses 1e-3 in these five seconds; its mean counts
    rate *= float(np.mean(run.u_m_s)) / 0.5
    assert run.v_m_s[-1] == pytest.approx(1e-7 * math.exp(-rate * 5.0), rel=1e-6)
