"""First-order (geometric) averaging for oscillatory inputs (5.6–5.25), without symbols.

The tail's part g(t) is large but does not involve the state, so its flow is a shift by
h(t) = ∫₀ᵗ g dt and the pull-back of f by it is f(z + h(t)). One average over a beat gives the
equation for z, and the motion is x(t) = z(t) + h(t). No series and no symbolic integration is
needed: h comes from the Fourier coefficients of g, and the trapezoidal rule over a period is exact
for trigonometric polynomials, which is all that (5.18) has, and converges faster than any power for
(5.5). Only r|r| has a kink: its average is taken piece by piece between the zeros of z₃ + h₃, by
Gauss's rule, exact as well.

Beside it stands the closed form of the source (5.23–5.25), with its approximation
h₃ ≈ (k₂₂/ω)(1 − cos ωt) (5.22). The printed lines are damaged and were derived again; what they
lack is in docs/averaging.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, root

from plant.arrays import FloatArray
from plant.averaging.dynamics import (
    SIMPLIFIED,
    Dynamics,
    Reduced,
    check_beat,
    reduced,
    tail_coefficients,
)
from plant.averaging.equilibrium import NoEquilibriumError
from plant.averaging.motion import Path, SteadyTurn
from plant.checks import check_number
from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat
from plant.trajectory import Start

_SAMPLES = 256  # of a beat; h has harmonics up to about 12 at rounding level
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True, slots=True, eq=False)
class Forced:
    """What a beat adds: ``mean`` (3,) of f₄, f₅, f₆ and ``shift`` (3, n), the h of one beat.

    ``shift`` in m/s, m/s, rad/s at n even phases from 0, where it is 0; ``spectrum`` (n/2 + 1,): of
    h₃, so that h₃(τ) = Re Σ spectrum_k e^{ikτ}. ``k22``: of (5.22), rad/s².
    """

    omega: float
    mean: FloatArray
    shift: FloatArray
    spectrum: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    k22: float


def _primitive(oscillating: FloatArray, omega: float) -> FloatArray:
    """∫₀ᵗ of rows (3, n) with zero mean over one beat, at the same phases."""
    n = oscillating.shape[1]
    coefficients = np.fft.rfft(oscillating, axis=1)
    k = np.arange(coefficients.shape[1])
    coefficients[:, 0] = 0.0
    coefficients[:, 1:] /= 1j * k[1:] * omega
    coefficients[:, -1] = 0.0  # the highest has no phase
    h = np.fft.irfft(coefficients, n, axis=1)
    result: FloatArray = h - h[:, :1]
    return result


def forced(parameters: PlantParameters, beat: TailBeat, dynamics: Dynamics = SIMPLIFIED) -> Forced:
    """Mean and shift of the tail's part of (5.5) or (5.18)."""
    check_beat(beat)
    if dynamics.scaling is not None:
        raise InvalidParameterError("dynamics.scaling", "an average has nothing left to average")
    p = reduced(parameters, beat.bias_rad, dynamics)
    c3, c5, c6 = tail_coefficients(parameters)
    omega = 2.0 * math.pi * beat.frequency_hz
    phase = np.sin(2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES)
    alpha = beat.bias_rad + beat.amplitude_rad * phase
    alpha_ddot = -beat.amplitude_rad * omega * omega * phase
    if dynamics.full_tail:
        sine, cosine = np.sin(alpha), np.cos(alpha)
    else:
        sine, cosine = alpha - alpha**3 / 6.0, 1.0 - alpha**2 / 2.0
    part = np.stack(
        (
            -c3 / p.m1 * alpha_ddot * sine,
            c3 / p.m2 * alpha_ddot * cosine,
            -(c5 * cosine + c6) * alpha_ddot,
        )
    )
    mean: FloatArray = part.mean(axis=1)
    shift = _primitive(part - mean[:, None], omega)
    spectrum = np.fft.rfft(shift[2]) / _SAMPLES
    spectrum[1:] *= 2.0
    return Forced(omega, mean, shift, spectrum, float(-spectrum[1].real * omega))


def _zero_between(rate: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function whose signs at both ends differ, or differ by rounding only."""
    at_low, at_high = rate(low), rate(high)
    if at_low * at_high > 0.0:
        return low if abs(at_low) < abs(at_high) else high
    return float(brentq(rate, low, high))


def _mean_square_signed(forced: Forced, z3: float) -> float:
    """Mean of (z₃ + h₃)|z₃ + h₃| over a beat, piece by piece between its zeros."""
    size = abs(forced.spectrum).max()
    kept = forced.spectrum[: 1 + int(np.max(np.nonzero(abs(forced.spectrum) > 1e-15 * size)))]
    k = np.arange(kept.size)

    def rate(phase: FloatArray) -> FloatArray:
        values: FloatArray = z3 + (np.exp(1j * np.multiply.outer(phase, k)) @ kept).real
        return values

    def at_phase(phase: float) -> float:
        return float(rate(np.array([phase]))[0])

    phases = 2.0 * np.pi * np.arange(_SAMPLES + 1) / _SAMPLES
    positive = rate(phases) >= 0.0
    crossings = np.nonzero(positive[:-1] != positive[1:])[0]
    zeros = [_zero_between(at_phase, phases[i], phases[i + 1]) for i in crossings]
    total = 0.0
    for low, high in pairwise((0.0, *zeros, 2.0 * math.pi)):
        half = 0.5 * (high - low)
        # the series is smooth; several panels keep 24 nodes enough for any number of harmonics
        for panel in range(4):
            centre = low + half * (2 * panel + 1) / 4.0
            r = rate(centre + half / 4.0 * _NODES)
            total += half / 4.0 * float(_WEIGHTS @ (r * np.abs(r)))
    return total / (2.0 * math.pi)


def average_rates(
    parameters: PlantParameters, beat: TailBeat, z: FloatArray, dynamics: Dynamics = SIMPLIFIED
) -> FloatArray:
    """ż of the exact first-order average ⟨f(z + h)⟩ + ⟨f₄…₆⟩: m/s², m/s², rad/s²."""
    p = reduced(parameters, beat.bias_rad, dynamics)
    return _rates(p, forced(parameters, beat, dynamics), z)


def _rates(p: Reduced, f: Forced, z: FloatArray) -> FloatArray:
    u, v, r = z[:, None] + f.shift
    if p.full != 0.0:
        speed = np.hypot(u, v)
        attack = np.arctan2(v, u)
    else:
        speed = u
        attack = v / u
    drag, lift = p.c1 * speed, p.c2 * speed * attack
    slope: FloatArray = f.mean + np.array(
        [
            np.mean(p.m2 * v * r - drag * u + lift * v) / p.m1,
            np.mean(-p.m1 * u * r - drag * v - lift * u) / p.m2,
            p.munk * (p.m1 - p.m2) / p.j3 * np.mean(u * v)
            - p.c4 * _mean_square_signed(f, float(z[2])),
        ]
    )
    return slope


def published_rates(parameters: PlantParameters, beat: TailBeat, z: FloatArray) -> FloatArray:
    """ż of (5.23–5.25), their damaged terms restored, for (5.18): m/s², m/s², rad/s²."""
    p = reduced(parameters, beat.bias_rad, SIMPLIFIED)
    return _published_rates(p, forced(parameters, beat, SIMPLIFIED), z)


def _published_rates(p: Reduced, f: Forced, z: FloatArray) -> FloatArray:
    z1, z2, z3 = (float(value) for value in z)
    h1, h2 = f.shift[0], f.shift[1]
    a = f.k22 / f.omega
    h3 = a * (1.0 - np.cos(2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES))
    b1, b2 = float(h1.mean()), float(h2.mean())
    b11, b22, b12 = float((h1 * h1).mean()), float((h2 * h2).mean()), float((h1 * h2).mean())
    b13, b23 = float((h1 * h3).mean()), float((h2 * h3).mean())
    lift = p.c1 + p.c2
    # (5.25): mean of (z₃ + a − a cos τ)|z₃ + a − a cos τ|, which changes sign at cos τ = w
    w = 1.0 + z3 / a
    square = z3 * z3 + 2.0 * a * z3 + 1.5 * a * a
    if abs(w) >= 1.0:
        turning = math.copysign(square, w)
    else:
        theta = math.acos(w)
        turning = square * (math.pi - 2.0 * theta) / math.pi
        turning += 4.0 * a * (z3 + a) * math.sin(theta) / math.pi
        turning -= a * a * math.sin(2.0 * theta) / (2.0 * math.pi)
    slope: FloatArray = f.mean + np.array(
        [
            (
                p.m2 * (z2 * z3 + b2 * z3 + a * z2 + b23)
                - p.c1 * (z1 * z1 + 2.0 * b1 * z1 + b11)
                + p.c2 * (z2 * z2 + 2.0 * b2 * z2 + b22)
            )
            / p.m1,
            (
                -p.m1 * (z1 * z3 + b1 * z3 + a * z1 + b13)
                - lift * (z1 * z2 + b1 * z2 + b2 * z1 + b12)
            )
            / p.m2,
            -p.c4 * turning,
        ]
    )
    return slope


def average_equilibrium(
    parameters: PlantParameters,
    beat: TailBeat,
    dynamics: Dynamics = SIMPLIFIED,
    published: bool = False,
) -> FloatArray:
    """Equilibrium z (3,): of ⟨f(z + h)⟩, or of the published closed form.

    Raises ``NoEquilibriumError`` where none is found from forward swimming.
    """
    p = reduced(parameters, beat.bias_rad, dynamics)
    f = forced(parameters, beat, dynamics)

    def field(z: FloatArray) -> FloatArray:
        return _published_rates(p, f, z) if published else _rates(p, f, z)

    # without the coupling the rate stands alone, and its mean moment falls with z₃
    reach = float(abs(f.shift[2]).max()) + math.sqrt(abs(float(f.mean[2])) / p.c4) + f.omega * 1e-6

    def braking(z3: float) -> float:
        return float(f.mean[2]) - p.c4 * _mean_square_signed(f, z3)

    z3 = float(brentq(braking, -3.0 * reach, 3.0 * reach))
    speed = math.sqrt(math.hypot(p.m1 * float(f.mean[0]), p.m2 * float(f.mean[1])) / p.c1)
    size = np.array([speed, speed, f.omega])
    unit = size * f.omega

    def share(scaled: FloatArray) -> FloatArray:
        slope: FloatArray = field(scaled * size) / unit
        return slope

    found = root(share, np.array([1.0, 0.1, z3 / f.omega]), tol=1e-14)
    z: FloatArray = found.x * size
    if not np.all(abs(field(z)) <= 1e-11 * unit):
        raise NoEquilibriumError(f"{beat}: no equilibrium of the first-order average was found")
    return z


def first_order_turn(
    parameters: PlantParameters,
    beat: TailBeat,
    dynamics: Dynamics = SIMPLIFIED,
    published: bool = False,
) -> SteadyTurn:
    """Steady motion x(t) = z + h(t) of the first-order average, measured as ``steady_turn`` does.

    With p(t) = Σ P_k e^{ikωt} in the frame that turns with Ω, the path about its centre is
    Σ P_k e^{ikωt}/(i(Ω + kω)).
    """
    f = forced(parameters, beat, dynamics)
    z = average_equilibrium(parameters, beat, dynamics, published)
    shift = f.shift.copy()
    if published:
        shift[2] = f.k22 / f.omega * (1.0 - np.cos(2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES))
    u, v, r = z[:, None] + shift
    rate = float(r.mean())
    heading = _primitive((r - rate)[None, :], f.omega)[0]
    part = np.fft.fft((u + 1j * v) * np.exp(1j * heading)) / _SAMPLES
    k = np.fft.fftfreq(_SAMPLES, 1.0 / _SAMPLES)
    speed = float(abs(part[0]))
    path_speed = float(np.hypot(u, v).mean())
    turns = abs(rate) > 1e-9 * f.omega
    outer = None
    if turns:
        outer = float(abs(np.fft.ifft(part / (rate + k * f.omega)) * _SAMPLES).max())
    return SteadyTurn(
        speed_m_s=speed,
        path_speed_m_s=path_speed,
        turn_rate_rad_s=rate,
        turn_radius_m=speed / abs(rate) if turns else None,
        turn_period_s=2.0 * math.pi / abs(rate) if turns else None,
        outer_radius_m=outer,
        path_radius_m=path_speed / abs(rate) if turns else None,
        velocity=(float(u.mean()), float(v.mean()), rate),
        settled=(float(z[0]), float(z[1]), float(z[2])),
        beats=0,
    )


def first_order_path(
    parameters: PlantParameters,
    beat: TailBeat,
    duration_s: float,
    dynamics: Dynamics = SIMPLIFIED,
    start: Start | None = None,
    steps_per_beat: int = 64,
) -> Path:
    """Path of x(t) = z(t) + h(t), z from the exact first-order average, from a start on.

    z is solved by DOP853 at 1e-9 (it is slow, so that takes few steps); heading and position are
    primitives of splines. Raises ``InvalidParameterError``; ``NoEquilibriumError`` if z runs away.
    """
    check_number("first_order_path.duration_s", duration_s, above=0.0)
    p = reduced(parameters, beat.bias_rad, dynamics)
    f = forced(parameters, beat, dynamics)
    begin = start or Start(u_m_s=0.02)
    z0 = [begin.u_m_s, begin.v_m_s, begin.r_rad_s]
    solved = solve_ivp(
        lambda _, z: _rates(p, f, z),
        (0.0, duration_s),
        z0,
        method="DOP853",
        rtol=1e-9,
        atol=1e-12,
        dense_output=True,
    )
    at_times = solved.sol
    if not solved.success or at_times is None:
        raise NoEquilibriumError(f"{beat}: the first-order average runs away: {solved.message}")
    count = max(2, math.ceil(duration_s * beat.frequency_hz * steps_per_beat))
    t = np.linspace(0.0, duration_s, count + 1)
    phase = (beat.frequency_hz * t) % 1.0
    grid = np.arange(_SAMPLES + 1) / _SAMPLES
    wrapped = np.hstack((f.shift, f.shift[:, :1]))
    h = CubicSpline(grid, wrapped, axis=1, bc_type="periodic")(phase)
    velocity = at_times(t) + h
    heading = begin.heading_rad + CubicSpline(t, velocity[2]).antiderivative()(t)
    way = (velocity[0] + 1j * velocity[1]) * np.exp(1j * heading)
    x = begin.x_m + CubicSpline(t, way.real).antiderivative()(t)
    y = begin.y_m + CubicSpline(t, way.imag).antiderivative()(t)
    return Path(t, np.column_stack((x, y, heading, velocity.T)))
