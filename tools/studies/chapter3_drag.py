"""Where the numbers of the model come from (Tables 3.1 and 3.2).

Added masses are those of a prolate spheroid (3.26-3.28). The adapted drag is a least-squares fit
through three identified pairs of coefficients (3.32, 3.33).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plant.parameters import Body
from plant.robots import COEFFICIENT_SETS
from plant.spheroid import spheroid_added_mass
from tools.studies.chapter3_turning import (
    BIAS_DEG,
    TABLE_3_2,
    identified,
)
from tools.studies.study import Check, Curve, Figure, Panel, Progress, Result

SEMI_AXIS_M, SEMI_WIDTH_M = 0.07, 0.033


@dataclass(frozen=True, slots=True)
class DragLaw:
    """C_D = C′_D0 + C′_D1 α₀² (3.32), K_D = K′_D0 + K′_D1 |α₀| (3.33)."""

    drag: float
    drag_per_bias_squared: float
    yaw_drag_n_m_s2: float
    yaw_drag_per_bias_n_m_s2: float


def fit(bias_deg: Sequence[float], drag: Sequence[float], yaw: Sequence[float]) -> DragLaw:
    """Least squares through identified coefficients."""
    bias = np.radians(np.array(bias_deg))
    c1, c0 = np.polyfit(bias**2, np.array(drag), 1)
    k1, k0 = np.polyfit(bias, np.array(yaw), 1)
    return DragLaw(float(c0), float(c1), float(k0), float(k1))


def added_mass(progress: Progress) -> Result:
    """Table 3.1: the computed entries, to the last printed digit."""
    found = spheroid_added_mass(SEMI_AXIS_M, SEMI_WIDTH_M)
    displaced = 4.0 / 3.0 * math.pi * 1000.0 * SEMI_AXIS_M * SEMI_WIDTH_M**2
    body = Body()
    inertia = body.mass_kg * (2.0 * body.hinge_distance_m) ** 2 / 12.0
    rows = (
        ("displaced mass m_f", 0.3193, displaced, "kg", 0.5e-4),
        ("added mass −X_u̇", 0.0621, found.surge_kg, "kg", 0.5e-4),
        ("added mass −Y_v̇", 0.2299, found.sway_kg, "kg", 0.5e-4),
        ("added inertia −N_ṙ", 1.0413e-4, found.yaw_kg_m2, "kg·m²", 0.5e-8),
        ("inertia J_bz", 5.0797e-4, inertia, "kg·m²", 0.5e-8),
    )
    progress(1.0)
    return Result(
        checks=tuple(Check(*row, absolute=True) for row in rows),
        notes=("Tolerance: half a unit of the last printed digit.",),
    )


def table_3_2(progress: Progress) -> Result:
    """Table 3.2 and the fit of (3.32, 3.33) through it."""
    sets = [COEFFICIENT_SETS[name] for name in TABLE_3_2.values()]
    law = fit(list(TABLE_3_2), [s.drag for s in sets], [s.yaw_drag_n_m_s2 for s in sets])
    dots = identified()
    progress(0.5)
    rows = (
        ("C′_D0", 0.1936, law.drag, "", 0.5e-4),
        ("C′_D1", 0.1412, law.drag_per_bias_squared, "1/rad²", 0.5e-4),
        ("K′_D0", 9.655e-4, law.yaw_drag_n_m_s2, "kg·m²", 0.5e-7),
        ("K′_D1", 4.383e-4, law.yaw_drag_per_bias_n_m_s2, "kg·m²/rad", 0.5e-7),
    )
    at = np.array(list(TABLE_3_2))
    fine = np.radians(BIAS_DEG)
    law.drag + law.drag_per_bias_squared * fine**2
    said = "; ".join(
        f"{bias:g}°: {100 * dot.radius_m:.2f} cm, {dot.period_s:.2f} s"
        for bias, dot in zip(TABLE_3_2, dots, strict=True)
    )
    return Result(
        checks=tuple(Check(*row, absolute=True) for row in rows),
        figures=(
            Figure(
                "Table 3.2",
                "Identified drag coefficients and the laws (3.32), (3.33) fitted to them.",
                (
                    Panel(
                        "drag",
                        "bias (°)",
                        "C_D",
                        (
                            Curve(
                                "(3.32)", BIAS_DEG, law.drag + law.drag_per_bias_squared * fine**2
                            ),
                            Curve("Table 3.2", at, np.array([s.drag for s in sets]), "marks"),
                        ),
                    ),
                    Panel(
                        "yaw drag",
                        "bias (°)",
                        "K_D (10⁻³ kg·m²)",
                        (
                            Curve(
                                "(3.33)",
                                BIAS_DEG,
                                1e3 * (law.yaw_drag_n_m_s2 + law.yaw_drag_per_bias_n_m_s2 * fine),
                            ),
                            Curve(
                                "Table 3.2",
                                at,
                                np.array([1e3 * s.yaw_drag_n_m_s2 for s in sets]),
                                "marks",
                            ),
                        ),
                    ),
                ),
            ),
        ),
        notes=(
            "Tolerance: half a unit of the last printed digit.",
            f"The model with each pair at its own bias, 15°, 0.9 Hz, turns at {said}.",
        ),
    )
