"""Mode shapes of a clamped beam, the integrals over them, and the beam's answer in closed form.

The shapes (4.9) are those of a uniform cantilever, φ = cos βτ − cosh βτ − δ (sin βτ − sinh βτ),
∫φ² = L. For a tail whose depth or thickness varies they serve as Rayleigh–Ritz functions: the
matrices of mass and stiffness are then full, and the beam is exact in the limit of many modes.

cosh − δ sinh cancels to nothing at high modes; written with (1 ∓ δ) e^{±βτ}/2, where 1 − δ is known
in closed form, it keeps its digits. All of it uses ``elementary`` and so has the same bits
everywhere.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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
from plant.parameters import FloatArray, PlantParameters, virtual_mass_kg_m
from plant.profile import factor_at, integral, moments
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
    shapes = [shape(i + 1) for i in range(n)]
    stations = tuple(len(profile) for profile in (depth, thickness) if profile)

    def over(function: Callable[[float], float], scale: float) -> float:
        return scale * integral(function, 0.0, 1.0, stations, pieces=2 * n + 2)

    def mass(x: float) -> float:
        return per_length * factor_at(depth, x) ** 2

    def stiff(x: float) -> float:
        return bending * factor_at(depth, x) * factor_at(thickness, x) ** 3

    result = np.zeros((MATRICES + 5 * n, max(n, 5)))
    tip = mass(1.0)
    result[HEADER, :5] = *moments(per_length, length, depth), length, tip
    for i, mode in enumerate(shapes):
        result[WITH_1, i] = over(_Product(mass, mode.value), length)
        result[WITH_TAU, i] = over(_Product(mass, mode.value, _part), length**2)
        result[SLOPE_1, i] = over(_Product(mass, mode.slope), 1.0)
        result[SLOPE_TAU, i] = over(_Product(mass, mode.slope, _part), length)
        result[TIP, i] = mode.value(1.0)
        result[TIP_SLOPE, i] = mode.slope(1.0) / length
        for j, other in enumerate(shapes):
            mixed = over(_Product(mass, mode.slope, other.value), 1.0)
            result[MATRICES + n + i, j] = mixed
            if j > i:
                continue
            entries = (
                (0, over(_Product(mass, mode.value, other.value), length)),
                (2, over(_Product(mass, mode.slope, other.slope), 1.0 / length)),
                (3, over(_Product(stiff, mode.curvature, other.curvature), 1.0 / length**3)),
            )
            for block, value in entries:
                orthogonal = i != j and block != 2 and not stations
                value = 0.0 if orthogonal else value
                result[MATRICES + block * n + i, j] = value
                result[MATRICES + block * n + j, i] = value
    first = MATRICES + 3 * n
    result[first + n :] = tail.damping_s * result[first : first + n]
    return result


def _part(x: float) -> float:
    return x


class _Product:
    """A product of functions of x, as an integrand."""

    __slots__ = ("_factors",)

    def __init__(self, *factors: Callable[[float], float]) -> None:
        self._factors = factors

    def __call__(self, x: float) -> float:
        result = 1.0
        for factor in self._factors:
            result *= factor(x)
        return result


@dataclass(frozen=True, slots=True)
class ModeResponse:
    """Steady motion of one mode: η(t) = amplitude_m · sin(ω_α t + φ_α + phase_rad) (4.15)."""

    frequency_rad_s: float  # ω_i
    damping_ratio: float  # ξ_i
    amplitude_m: float
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
