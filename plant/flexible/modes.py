"""Mode shapes of a clamped beam, the integrals over them, and the beam's answer in closed form.

The shapes (4.9) are those of a uniform cantilever, φ = cos βτ − cosh βτ − δ (sin βτ − sinh βτ),
∫φ² = L. For a tail whose depth or thickness varies they serve as Rayleigh–Ritz functions: the
matrices of mass and stiffness are then full, and the beam is exact in the limit of many modes.

cosh − δ sinh cancels to nothing at high modes; written with (1 ∓ δ) e^{±βτ}/2, where 1 − δ is known
in closed form, it keeps its digits. All of it uses ``elementary`` and so has the same bits
everywhere.
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.elementary import atan2, exp, sincos
from plant.errors import InvalidParameterError
from plant.flexible.beam import (
    HEADER,
    MATRICES,
    SLOPE_1,
    SLOPE_TAU,
    TIP,
    TIP_SLOPE,
    WITH_1,
    WITH_TAU,
)
from plant.packing import virtual_mass_kg_m
from plant.parameters import PlantParameters
from plant.profile import factor_at, gauss_points, moments
from plant.tail_input import TailBeat


@dataclass(frozen=True, slots=True)
class Shape:
    """One mode shape over x = τ/L: βL, δ and 1 − δ. Derivatives are by x."""

    number: float  # βL
    delta: float
    excess: float  # 1 − δ

    def _parts(self, x: float) -> tuple[float, float, float, float]:
        """Return cos βτ, sin βτ, ½(1 − δ)e^{βτ}, ½(1 + δ)e^{−βτ}."""
        sine, cosine = sincos(self.number * x)
        growing = 0.5 * self.excess * exp(self.number * x)
        return cosine, sine, growing, 0.5 * (1.0 + self.delta) * exp(-self.number * x)

    def value(self, x: float) -> float:
        """Return φ."""
        cosine, sine, growing, falling = self._parts(x)
        return cosine - self.delta * sine - growing - falling

    def slope(self, x: float) -> float:
        """Return dφ/dx."""
        cosine, sine, growing, falling = self._parts(x)
        return self.number * (falling - growing - sine - self.delta * cosine)

    def curvature(self, x: float) -> float:
        """Return d²φ/dx²."""
        cosine, sine, growing, falling = self._parts(x)
        return self.number**2 * (self.delta * sine - cosine - growing - falling)


def shape(mode: int) -> Shape:
    """Mode 1, 2, …: β L from 1 + cos βL cosh βL = 0 by Newton's method."""
    x = (mode - 0.5) * math.pi
    for _ in range(50):
        sine, cosine = sincos(x)
        small = exp(-x)
        sech = 2.0 * small / (1.0 + small * small)
        tanh = (1.0 - small * small) / (1.0 + small * small)
        step = (cosine + sech) / (-sine - sech * tanh)
        x -= step
        if abs(step) < 1e-15 * x:
            break
    sine, cosine = sincos(x)
    small = exp(-x)
    cosh, sinh = 0.5 * (1.0 / small + small), 0.5 * (1.0 / small - small)
    return Shape(x, (cosine + cosh) / (sine + sinh), (sine - cosine - small) / (sine + sinh))


def table(parameters: PlantParameters) -> FloatArray:
    """Make the (7 + 5n, max(n, 5)) table that ``beam`` describes, for n modes."""
    tail = parameters.tail
    n = tail.modes
    length = tail.length_m
    per_length = virtual_mass_kg_m(parameters)
    bending = tail.modulus_pa * tail.depth_m * tail.thickness_m**3 / 12.0
    depth, thickness = tail.depth_profile, tail.thickness_profile
    stations = tuple(len(profile) for profile in (depth, thickness) if profile)
    points, weights = gauss_points(0.0, 1.0, stations, pieces=2 * n + 2)
    deep = [factor_at(depth, x) for x in points]
    thick = [factor_at(thickness, x) for x in points]
    mass = np.array([w * per_length * d**2 for w, d in zip(weights, deep, strict=True)])
    stiff = np.array([w * bending * d * h**3 for w, d, h in zip(weights, deep, thick, strict=True)])
    shapes = [shape(i + 1) for i in range(n)]
    value = [np.array([mode.value(x) for x in points]) for mode in shapes]
    slope = [np.array([mode.slope(x) for x in points]) for mode in shapes]
    curvature = [np.array([mode.curvature(x) for x in points]) for mode in shapes]

    def over(scale: float, *factors: FloatArray) -> float:
        """Sum of products, rounded once (``fsum``): NumPy's order of summation is its own."""
        product = factors[0]
        for factor in factors[1:]:
            product = product * factor
        return scale * math.fsum(product.tolist())

    at = np.array(points)
    tip = per_length * factor_at(depth, 1.0) ** 2
    result = np.zeros((MATRICES + 5 * n, max(n, 5)))
    result[HEADER, :5] = *moments(per_length, length, depth), length, tip
    for i, mode in enumerate(shapes):
        result[WITH_1, i] = over(length, mass, value[i])
        result[WITH_TAU, i] = over(length**2, mass, value[i], at)
        result[SLOPE_1, i] = over(1.0, mass, slope[i])
        result[SLOPE_TAU, i] = over(length, mass, slope[i], at)
        result[TIP, i] = mode.value(1.0)
        result[TIP_SLOPE, i] = mode.slope(1.0) / length
        for j in range(n):
            result[MATRICES + n + i, j] = over(1.0, mass, slope[i], value[j])
        for j in range(i + 1):
            coupled = i == j or bool(stations)  # modes of a uniform beam are orthogonal
            entries = (
                (0, over(length, mass, value[i], value[j]) if coupled else 0.0),
                (2, over(1.0 / length, mass, slope[i], slope[j])),
                (3, over(1.0 / length**3, stiff, curvature[i], curvature[j]) if coupled else 0.0),
            )
            for block, entry in entries:
                result[MATRICES + block * n + i, j] = entry
                result[MATRICES + block * n + j, i] = entry
    first = MATRICES + 3 * n
    result[first + n :] = tail.damping_s * result[first : first + n]
    return result


@dataclass(frozen=True, slots=True)
class ModeResponse:
    """Steady motion of one mode: η(t) = amplitude_m · sin(ω_α t + φ_α + phase_rad) (4.15)."""

    frequency_rad_s: float  # ω_i
    damping_ratio: float  # ξ_i
    amplitude_m: float  # signed as ∫mτφ_i is
    phase_rad: float  # in (−π, 0]: behind the base


def sinusoidal_response(parameters: PlantParameters, beat: TailBeat) -> tuple[ModeResponse, ...]:
    """Return the closed form (4.15) for every mode of a uniform, anchored beam; any bias.

    The printed arctangent of (4.15) leaves its branch open; above ω_i the mode lags by more than
    90°. Raises ``InvalidParameterError`` where the modes are coupled (a profile).
    """
    tail = parameters.tail
    if tail.modes == 0 or tail.depth_profile or tail.thickness_profile:
        raise InvalidParameterError("tail.modes", "the closed form is that of a uniform beam")
    parts = table(parameters)
    n = tail.modes
    omega = 2.0 * math.pi * beat.frequency_hz
    result = []
    for i in range(n):
        mass = float(parts[MATRICES + i, i])
        own = math.sqrt(float(parts[MATRICES + 3 * n + i, i]) / mass)
        ratio = 0.5 * tail.damping_s * own
        impedance = math.hypot(2.0 * own * ratio * omega, omega * omega - own * own)
        force = float(parts[WITH_TAU, i]) * beat.amplitude_rad * omega * omega
        phase = atan2(-2.0 * omega * own * ratio, own * own - omega * omega)
        amplitude = force / (mass * impedance) if force else 0.0
        result.append(ModeResponse(own, ratio, amplitude, phase))
    return tuple(result)
