"""The beam: mode shapes, matrices and right-hand side against independent forms; published form."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from plant.arrays import FloatArray
from plant.errors import InvalidParameterError
from plant.flexible import modes
from plant.flexible.beam import MATRICES, TIP, WITH_1, WITH_TAU
from plant.flexible.layout import FORCE_X, FORCE_Y, HINGE_MOMENT, LOADS, work_shape
from plant.flexible.modes import shape, sinusoidal_response
from plant.flexible.rates import flexible_rates
from plant.hull import hull_forces
from plant.integrate import simulate
from plant.layout import ROW, STATE, Drive, State
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.robots import flexible_tail, long_flexible_tail, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme

TINY = 1e-30


def phi(mode: int, x: float, derivative: int = 0) -> float:
    """(4.9) as printed, over τ/L; good for low modes."""
    middle = (mode - 0.5) * math.pi
    b = float(brentq(lambda b: 1 + math.cos(b) * math.cosh(b), middle - 0.5, middle + 0.5))
    d = (math.cos(b) + math.cosh(b)) / (math.sin(b) + math.sinh(b))
    y = b * x
    if derivative == 0:
        return math.cos(y) - math.cosh(y) - d * (math.sin(y) - math.sinh(y))
    if derivative == 1:
        return b * (-math.sin(y) - math.sinh(y) - d * (math.cos(y) - math.cosh(y)))
    return b * b * (-math.cos(y) - math.cosh(y) + d * (math.sin(y) + math.sinh(y)))


@pytest.mark.parametrize("mode", [1, 2, 3, 4])
def test_shapes_are_those_of_a_cantilever(mode: int) -> None:
    ours = shape(mode)
    for x in np.linspace(0.0, 1.0, 11):
        assert ours.value(float(x)) == pytest.approx(phi(mode, float(x)), abs=1e-9)
        assert ours.slope(float(x)) == pytest.approx(phi(mode, float(x), 1), abs=1e-8)
        assert ours.curvature(float(x)) == pytest.approx(phi(mode, float(x), 2), abs=1e-7)


def test_known_roots() -> None:
    # Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1
    known = (1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839)
    assert [shape(i + 1).number for i in range(5)] == pytest.approx(known, abs=5e-9)


def test_high_modes_keep_their_digits() -> None:
    # |φ(L)| = 2 for every mode, with neither moment nor shear at the free end (4.8)
    for mode in range(1, 21):
        ours = shape(mode)
        assert abs(ours.value(1.0)) == pytest.approx(2.0, rel=1e-12)
        assert ours.curvature(1.0) / ours.number**2 == pytest.approx(0.0, abs=1e-12)
        assert ours.value(0.0) == pytest.approx(0.0, abs=1e-12)
        assert ours.slope(0.0) / ours.number == pytest.approx(0.0, abs=1e-12)


def test_matrices_of_a_uniform_beam() -> None:
    p = wang2014_flexible(flexible_tail(1, 3))
    parts = modes.table(p)
    length, m = p.tail.length_m, pack(p).tail_mass
    bending = 1.48e9 * 0.025 * 0.3e-3**3 / 12
    for i in range(3):
        b = shape(i + 1).number
        assert parts[MATRICES + i, i] == pytest.approx(m * length, rel=1e-12)  # ∫φ² = L
        stiffness = bending * b**4 / length**3
        assert parts[MATRICES + 9 + i, i] == pytest.approx(stiffness, rel=1e-11)
        assert parts[MATRICES + 12 + i, i] == pytest.approx(0.079 * stiffness, rel=1e-11)
        first = quad(lambda x, i=i: x * phi(i + 1, x), 0.0, 1.0)[0]
        assert parts[WITH_TAU, i] == pytest.approx(m * length**2 * first, rel=1e-9)
        for j in range(3):
            mixed = quad(lambda x, i=i, j=j: phi(i + 1, x, 1) * phi(j + 1, x), 0.0, 1.0)[0]
            assert parts[MATRICES + 3 + i, j] == pytest.approx(m * mixed, rel=1e-8, abs=1e-10)


def beam_reference(
    p: PlantParameters, y: FloatArray, tail: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """u̇, v̇, ṙ, η̈ and F_hx, F_hy, M_A from v⊥ = w_0 + Ωτ + ẇ − s w′ v∥ by quadrature."""
    n, length, c = p.tail.modes, p.tail.length_m, p.body.hinge_distance_m
    share = p.hydrodynamics.body_motion_in_tail
    alpha, alpha_dot, base = tail
    motion, eta, eta_dot = y[3:6], y[STATE : STATE + n], y[STATE + n :]
    nodes, weights = np.polynomial.legendre.leggauss(24)
    xs, ws = 0.5 * (nodes + 1.0), 0.5 * weights
    forms = np.array([[phi(i + 1, float(x)) for i in range(n)] for x in (*xs, 1.0)])
    slopes = np.array([[phi(i + 1, float(x), 1) / length for i in range(n)] for x in (*xs, 1.0)])
    profile = p.tail.depth_profile or (1.0, 1.0)
    factors = np.interp([*xs, 1.0], np.linspace(0, 1, len(profile)), profile)
    m = 0.25 * math.pi * p.water.density_kg_m3 * (p.tail.depth_m * factors) ** 2
    thickness = np.interp(xs, np.linspace(0, 1, 2), p.tail.thickness_profile or (1.0, 1.0))
    bends = np.array([[phi(i + 1, float(x), 2) / length**2 for i in range(n)] for x in xs])
    ei = p.tail.modulus_pa * p.tail.depth_m * p.tail.thickness_m**3 / 12 * factors[:-1]
    stiffness = (bends * (ei * thickness**3 * ws * length)[:, None]).T @ bends

    def velocity(x: NDArray[np.complex128]) -> Any:
        """v⊥ at the nodes and the tip; x: u, v, r, α, η, α̇, η̇."""
        u, v, r, a = x[0], x[1], x[2], x[3]
        bent, rate, bent_dot = x[4 : 4 + n], x[4 + n], x[5 + n :]
        w0 = share * (u * np.sin(a) - (v - r * c) * np.cos(a))
        along = share * (-u * np.cos(a) - (v - r * c) * np.sin(a))
        tau = length * np.array([*xs, 1.0])
        tilt = share * (slopes @ bent)
        return w0 + (rate + share * r) * tau + forms @ bent_dot - tilt * along

    now = np.concatenate((motion, [alpha], eta, [alpha_dot], eta_dot))
    along = share * (-motion[0] * math.cos(alpha) - (motion[1] - motion[2] * c) * math.sin(alpha))
    tilt, turn = share * (slopes @ eta), alpha_dot + share * motion[2] + share * (slopes @ eta_dot)

    def loads(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        by_time = np.concatenate((z[:3], [alpha_dot], eta_dot, [base], z[3:]))
        value = velocity(now + 1j * TINY * by_time)
        v_n, v_dot = value.real, value.imag / TINY
        tip = m[-1] * v_n[-1] * along
        part = m[:-1] * ws * length
        normal = -np.sum(part * v_dot[:-1]) + tip
        tension = np.sum(part * (tilt * v_dot + v_n * turn)[:-1])
        tension -= 0.5 * m[-1] * v_n[-1] ** 2 + tip * tilt[-1]
        moment = -np.sum(part * v_dot[:-1] * xs * length) + length * tip
        each = -(part * v_dot[:-1]) @ forms[:-1] + forms[-1] * tip
        fx = normal * math.sin(alpha) - tension * math.cos(alpha)
        fy = -normal * math.cos(alpha) - tension * math.sin(alpha)
        return np.array([fx, fy, moment]), each

    b = p.body
    own = np.array(
        [
            b.mass_kg + b.added_mass_surge_kg,
            b.mass_kg + b.added_mass_sway_kg,
            b.yaw_inertia_kg_m2 + b.added_inertia_yaw_kg_m2,
        ]
    )
    free = np.array(hull_forces(pack(p), *y[:6].tolist(), 0.0))
    pull = stiffness @ (eta + p.tail.damping_s * eta_dot)

    def unbalance(z: FloatArray) -> FloatArray:
        (fx, fy, moment), each = loads(z)
        body = own * z[:3] - free - np.array([fx, fy, moment - c * fy])
        return np.concatenate((body, each - pull))

    at_zero = unbalance(np.zeros(3 + n))
    columns = np.array([unbalance(e) - at_zero for e in np.eye(3 + n)]).T
    z: FloatArray = np.linalg.solve(columns, -at_zero)
    return z, loads(z)[0]


@pytest.mark.parametrize("share", [0.0, 0.7, 1.0])
@pytest.mark.parametrize(
    "profile", [{}, {"depth_profile": (1.2, 0.6), "thickness_profile": (1.5, 0.5)}]
)
def test_beam_obeys_its_equations(profile: dict[str, Any], share: float) -> None:
    n = 3
    p = wang2014_flexible(replace(flexible_tail(1, n), **profile))
    p = replace(p, hydrodynamics=replace(p.hydrodynamics, body_motion_in_tail=share))
    random = np.random.default_rng(7)
    for _ in range(3):
        omega, amplitude, phase, bias = 6.0, 0.3, random.uniform(0.0, 6.0), 0.4
        tail = (
            bias + amplitude * math.sin(phase),
            amplitude * omega * math.cos(phase),
            -amplitude * omega**2 * math.sin(phase),
        )
        motion = random.uniform(-1.0, 1.0, 3) * (0.3, 0.3, 2.0)
        y = np.concatenate(
            (
                State(0.0, 0.0, 0.4, *motion, 0.0, 0.0, 0.0),
                random.uniform(-0.01, 0.01, n),
                random.uniform(-0.1, 0.1, n),
            )
        )
        out = np.zeros(STATE + 2 * n + LOADS)
        drive = Drive(bias, amplitude, omega, phase, 0.0)
        parts, work = modes.table(p), np.zeros(work_shape(n))
        flexible_rates(pack(p), drive, 0.0, y, out, parts, n, work)
        wanted, loads = beam_reference(p, y, tail)
        got = np.concatenate((out[3:6], out[STATE + n : STATE + 2 * n]))
        assert got == pytest.approx(wanted, rel=1e-8, abs=1e-9)
        ours = out[STATE + 2 * n :][[FORCE_X, FORCE_Y, HINGE_MOMENT]]
        assert ours == pytest.approx(loads, rel=1e-8, abs=1e-10)


def test_the_anchored_form_is_the_published_one() -> None:
    # (4.16) with the sign of its garbled term: f = −m v̇⊥ n̂ + m v⊥ α̇ m̂, tip −½ m v_L² m̂
    p = wang2014_flexible(flexible_tail(1, 2))
    parts = modes.table(p)
    eta, eta_dot = np.array([0.004, -0.001]), np.array([0.05, 0.03])
    alpha, alpha_dot, base = 0.3, 1.1, -4.0
    n, length, m = 2, p.tail.length_m, pack(p).tail_mass
    # a drive through that angle, rate and acceleration: b + A sin φ with ω = 1
    amplitude = math.hypot(alpha_dot, base)
    drive = Drive(alpha + base, amplitude, 1.0, math.atan2(-base, alpha_dot), 0.0)
    y = np.concatenate((State(0.0, 0.0, 0.0, 0.1, 0.02, 0.3, 0.0, 0.0, 0.0), eta, eta_dot))
    out = np.zeros(STATE + 2 * n + LOADS)
    flexible_rates(pack(p), drive, 0.0, y, out, parts, n, np.zeros(work_shape(n)))
    eta_ddot = out[STATE + n : STATE + 2 * n]
    stiffness = np.diag(parts[MATRICES + 3 * n : MATRICES + 4 * n, :n])
    mass = np.diag(parts[MATRICES : MATRICES + n, :n])
    modal = -parts[WITH_TAU, :n] * base - stiffness * (eta + p.tail.damping_s * eta_dot)
    assert eta_ddot == pytest.approx(modal / mass, rel=1e-12)  # (4.11)
    normal = -m * length**2 / 2 * base - parts[WITH_1, :n] @ eta_ddot
    distributed = alpha_dot * (m * length**2 / 2 * alpha_dot + parts[WITH_1, :n] @ eta_dot)
    tip = alpha_dot * length + parts[TIP, :n] @ eta_dot
    tension = distributed - 0.5 * m * tip**2
    loads = out[STATE + 2 * n :]
    assert loads[FORCE_X] == pytest.approx(
        normal * math.sin(alpha) - tension * math.cos(alpha), rel=1e-12
    )
    assert loads[FORCE_Y] == pytest.approx(
        -normal * math.cos(alpha) - tension * math.sin(alpha), rel=1e-12
    )
    about = -m * length**3 / 3 * base - parts[WITH_TAU, :n] @ eta_ddot
    assert loads[HINGE_MOMENT] == pytest.approx(about, rel=1e-12)


@pytest.mark.parametrize("bias", [0.0, 0.4])
@pytest.mark.parametrize("tail", [flexible_tail(1, 4), long_flexible_tail(1, 4)])
def test_time_domain_settles_on_the_closed_form(tail: Any, bias: float) -> None:
    p = wang2014_flexible(tail)
    beat = TailBeat(bias, math.radians(13.6), 0.9)
    phase = 0.3
    path = simulate(p, TailProgramme.steady(beat, phase), 24.0, 5e-3)
    omega = 2 * math.pi * 0.9
    late = path.time_s > 22.0
    for i, mode in enumerate(sinusoidal_response(p, beat)):
        wanted = mode.amplitude_m * np.sin(omega * path.time_s[late] + phase + mode.phase_rad)
        got = path.rows[late, ROW + i]
        # transients die with 1/κ or ξω; the rest is the error of the step
        assert got == pytest.approx(wanted, abs=2e-7 * abs(mode.amplitude_m) + 1e-12)
        assert mode.damping_ratio == pytest.approx(0.079 * mode.frequency_rad_s / 2)


def test_the_closed_form_lags_by_a_right_angle_at_resonance() -> None:
    p = wang2014_flexible(flexible_tail(1, 1))
    own = sinusoidal_response(p, TailBeat(0.0, 0.1, 1.0))[0].frequency_rad_s
    for factor, low, high in ((0.2, -0.6, 0.0), (1.0, -1.5708, -1.5707), (5.0, -3.15, -1.6)):
        response = sinusoidal_response(p, TailBeat(0.0, 0.1, factor * own / (2 * math.pi)))[0]
        assert low < response.phase_rad < high


def test_no_closed_form_where_modes_are_coupled() -> None:
    p = wang2014_flexible(replace(flexible_tail(1, 2), depth_profile=(1.0, 0.5)))
    with pytest.raises(InvalidParameterError, match="uniform"):
        sinusoidal_response(p, TailBeat(0.0, 0.1, 1.0))
