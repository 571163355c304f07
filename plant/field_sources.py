"""Where fields in the water come from: a heater in a tank, a leak in a current, a spill.

All are steady or frozen in time, in closed form, and `plant.fields.Field`s. They are evaluated with
the project's own exponential and no function of the C library, so that a robot that swims in one
reads the same bits on every machine; SciPy's Bessel functions serve the tests only. A look costs up
to two milliseconds (images of a heater); `plant.field_matrices` makes a `GridField` of any of them.

Both Green's functions below are the modified Bessel function K₀: of the plane with losses
(H. S. Carslaw and J. C. Jaeger, Conduction of Heat in Solids, 2nd ed., 1959, chapter X) and, moved
by a current, of the plume (H. B. Fischer et al., Mixing in Inland and Coastal Waters, 1979,
chapter 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from plant.checks import check_number
from plant.compiled import compiled, compiled_apart
from plant.elementary import exp as _exp
from plant.elementary import sincos
from plant.fields import Plume
from plant.tank import Tank

exp = compiled(_exp)

_FAR = 20.0
"""K₀ is left out from here on: all images beyond it add 20 K₁(20) = 1.2e-8 of the mean."""


@compiled_apart
def bessel_k0_scaled(x: float) -> float:
    """Return eˣ K₀(x) for x > 0, to 1e-13 of its value.

    K₀(x) = ∫₀^∞ exp(−x cosh t) dt (Abramowitz and Stegun 9.6.24) by the trapezoidal rule, whose
    error falls exponentially with the step: near its peak exp(−x t²/2) asks for h ≤ 0.7/√x, and
    the far end, which falls doubly exponentially, for h ≤ 1/8.
    """
    step = 0.125 if x < 20.0 else 0.55 / math.sqrt(x)
    total = 0.5
    k = 1
    while True:
        grown = exp(k * step)
        depth = x * (0.5 * (grown + 1.0 / grown) - 1.0)
        if depth > 40.0:  # e⁻⁴⁰ = 4e-18
            return step * total
        total += exp(-depth)
        k += 1


@compiled_apart
def _with_images(
    x: float, y: float, xs: float, ys: float, width: float, height: float, core: float, reach: float
) -> float:
    """Sum of K₀(r/reach) over a source and its images in the walls of [0, width] × [0, height]."""
    far = _FAR * reach
    across = int(far / (2.0 * width)) + 1
    up = int(far / (2.0 * height)) + 1
    total = 0.0
    for i in range(-across, across + 1):
        for side in (-1.0, 1.0):
            dx = x - (2.0 * i * width + side * xs)
            for j in range(-up, up + 1):
                for level in (-1.0, 1.0):
                    dy = y - (2.0 * j * height + level * ys)
                    r = max(math.sqrt(dx * dx + dy * dy), core) / reach
                    if r < _FAR:
                        total += exp(-r) * bessel_k0_scaled(r)
    return total


@dataclass(frozen=True, slots=True)
class HeatedTank:
    """Steady temperature, °C, of a layer of water with a heater in a tank (section 6.5.1).

    Over the layer's depth d, with the excess θ over the temperature that the tank would have
    without the heater, an effective conductivity k and losses h from its surface,

        d k ∇²θ − h θ + Q δ = 0,   ∂θ/∂n = 0 at the walls.

    In the open θ = Q/(2πkd) K₀(r/ℓ) with ℓ = √(kd/h); the walls, which let no heat through, are
    mirrors. Within ``heater_radius_m`` the heater adds what it adds at that distance. The losses
    over the tank are Q.

    Only Q (1 kW) is the source's. Water at rest conducts 0.6 W/(m·K); k is what the convection of
    a heater stirs, an eddy diffusivity of 1e-4 m²/s (made up, times ρc_p = 4.18e6 J/(m³·K)). h is
    that of warm water to still air, with evaporation (made up, of the usual size).
    """

    tank: Tank
    x_m: float
    y_m: float
    power_w: float = 1000.0
    heater_radius_m: float = 0.02
    layer_m: float = 0.3
    conductivity_w_m_k: float = 418.0
    loss_w_m2_k: float = 30.0
    ambient_c: float = 20.0
    reach_m: float = field(init=False, repr=False, compare=False)
    """ℓ."""

    def __post_init__(self) -> None:
        """Refuse a heater outside its tank and what makes no layer of water."""
        tank = self.tank
        check_number("heated_tank.x_m", self.x_m, least=tank.x_min_m, most=tank.x_max_m)
        check_number("heated_tank.y_m", self.y_m, least=tank.y_min_m, most=tank.y_max_m)
        for name in ("heater_radius_m", "layer_m", "conductivity_w_m_k", "loss_w_m2_k"):
            check_number(f"heated_tank.{name}", getattr(self, name), above=0.0)
        for name in ("power_w", "ambient_c"):
            check_number(f"heated_tank.{name}", getattr(self, name))
        reach = math.sqrt(self.conductivity_w_m_k * self.layer_m / self.loss_w_m2_k)
        object.__setattr__(self, "reach_m", reach)

    def value(self, x_m: float, y_m: float) -> float:
        """Temperature at a point of the tank."""
        tank = self.tank
        kernel = _with_images(
            x_m - tank.x_min_m,
            y_m - tank.y_min_m,
            self.x_m - tank.x_min_m,
            self.y_m - tank.y_min_m,
            tank.x_max_m - tank.x_min_m,
            tank.y_max_m - tank.y_min_m,
            self.heater_radius_m,
            self.reach_m,
        )
        amplitude = self.power_w / (2.0 * math.pi * self.conductivity_w_m_k * self.layer_m)
        return self.ambient_c + amplitude * kernel


@dataclass(frozen=True, slots=True)
class Leak:
    """Steady slick of a leak in a current, µg/L: advection, anisotropic mixing, decay.

    With ξ along the current u and η across it, mixing D_ξ and D_η, decay λ (evaporation,
    degradation), a layer of depth d and a leak q,

        u ∂c/∂ξ = D_ξ ∂²c/∂ξ² + D_η ∂²c/∂η² − λ c + (q/d) δ,

        c = q/(2πd √(D_ξ D_η)) exp(uξ/2D_ξ) K₀(s ρ),  ρ² = ξ²/D_ξ + η²/D_η,  s² = u²/4D_ξ + λ.

    Open water; within ``radius_m`` of the leak the water has what it has at that distance upstream.
    """

    x_m: float
    y_m: float
    leak_ug_s: float
    current_m_s: float
    heading_rad: float = 0.0
    along_m2_s: float = 1e-2
    across_m2_s: float = 1e-3
    decay_per_s: float = 1e-4
    layer_m: float = 0.1
    radius_m: float = 0.05
    _axis: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what makes no steady slick; without a current it is decay that makes one."""
        for name in ("x_m", "y_m", "heading_rad"):
            check_number(f"leak.{name}", getattr(self, name))
        for name in ("leak_ug_s", "current_m_s"):
            check_number(f"leak.{name}", getattr(self, name), least=0.0)
        for name in ("along_m2_s", "across_m2_s", "decay_per_s", "layer_m", "radius_m"):
            check_number(f"leak.{name}", getattr(self, name), above=0.0)
        object.__setattr__(self, "_axis", sincos(self.heading_rad))

    def value(self, x_m: float, y_m: float) -> float:
        """Concentration at a point."""
        sine, cosine = self._axis
        dx, dy = x_m - self.x_m, y_m - self.y_m
        xi, eta = dx * cosine + dy * sine, dy * cosine - dx * sine
        if xi * xi + eta * eta < self.radius_m * self.radius_m:
            xi, eta = -self.radius_m, 0.0
        u, along, across = self.current_m_s, self.along_m2_s, self.across_m2_s
        rate = math.sqrt(u * u / (4.0 * along) + self.decay_per_s)
        far = rate * math.sqrt(xi * xi / along + eta * eta / across)
        kernel = exp(u * xi / (2.0 * along) - far) * bessel_k0_scaled(far)
        litres = 1000.0 * self.layer_m
        return self.leak_ug_s * kernel / (2.0 * math.pi * litres * math.sqrt(along * across))


def spill(
    mass_ug: float,
    age_s: float,
    *,
    x_m: float,
    y_m: float,
    current_m_s: float = 0.0,
    heading_rad: float = 0.0,
    along_m2_s: float = 1e-2,
    across_m2_s: float = 1e-3,
    decay_per_s: float = 0.0,
    layer_m: float = 0.1,
) -> Plume:
    """Return a slick, µg/L, an age after a mass was spilled at a point, as it drifts and spreads.

    The same balance as `Leak` for a mass at once, a Gaussian (Fischer et al. 1979, section 2.4):
    its centre drifts, its variances are 2Dt, its mass decays as exp(−λt).
    """
    for name, value in (
        ("age_s", age_s),
        ("along_m2_s", along_m2_s),
        ("across_m2_s", across_m2_s),
        ("layer_m", layer_m),
    ):
        check_number(f"spill.{name}", value, above=0.0)
    sine, cosine = sincos(heading_rad)
    drift = current_m_s * age_s
    litres = 1000.0 * layer_m
    mixed = 4.0 * math.pi * age_s * litres * math.sqrt(along_m2_s * across_m2_s)
    return Plume(
        peak=mass_ug * _exp(-decay_per_s * age_s) / mixed,
        x_m=x_m + drift * cosine,
        y_m=y_m + drift * sine,
        sigma_along_m=math.sqrt(2.0 * along_m2_s * age_s),
        sigma_across_m=math.sqrt(2.0 * across_m2_s * age_s),
        axis_rad=heading_rad,
    )
