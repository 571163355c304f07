"""Added mass of a body taken as a prolate spheroid (3.26–3.28)."""

import math
from dataclasses import dataclass

from plant.checks import check_number


@dataclass(frozen=True, slots=True)
class AddedMass:
    """Added mass and inertia of a body, as positive numbers: −X_u̇, −Y_v̇ (kg), −N_ṙ (kg·m²)."""

    surge_kg: float
    sway_kg: float
    yaw_kg_m2: float


def spheroid_added_mass(
    semi_axis_m: float, semi_width_m: float, density_kg_m3: float = 1000.0
) -> AddedMass:
    """Lamb's added mass of a prolate spheroid with semi-axes a > b (3.26–3.28).

    With e² = 1 − b²/a²: α₀ = 2(1 − e²)/e³ (½ ln((1+e)/(1−e)) − e),
    β₀ = 1/e² − (1 − e²)/(2e³) ln((1+e)/(1−e)); k₁ = α₀/(2 − α₀), k₂ = β₀/(2 − β₀),
    k′ = e⁴(β₀ − α₀) / ((2 − e²)(2e² − (2 − e²)(β₀ − α₀))); with the displaced mass m_f the results
    are k₁ m_f, k₂ m_f and k′ m_f (a² + b²)/5.
    """
    check_number("spheroid.semi_width_m", semi_width_m, above=0.0)
    check_number(
        "spheroid.semi_axis_m",
        semi_axis_m,
        above=semi_width_m,
        because="a prolate spheroid is longer than it is wide",
    )
    check_number("spheroid.density_kg_m3", density_kg_m3, above=0.0)
    a, b = semi_axis_m, semi_width_m
    e2 = 1.0 - (b / a) ** 2
    e = math.sqrt(e2)
    log = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e2) / e**3 * (0.5 * log - e)
    beta = 1.0 / e2 - (1.0 - e2) / (2.0 * e**3) * log
    displaced_kg = 4.0 / 3.0 * math.pi * density_kg_m3 * a * b * b
    k_yaw = e2 * e2 * (beta - alpha) / ((2.0 - e2) * (2.0 * e2 - (2.0 - e2) * (beta - alpha)))
    return AddedMass(
        surge_kg=alpha / (2.0 - alpha) * displaced_kg,
        sway_kg=beta / (2.0 - beta) * displaced_kg,
        yaw_kg_m2=k_yaw * displaced_kg * (a * a + b * b) / 5.0,
    )
