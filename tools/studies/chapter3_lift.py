"""Turning with a lift that depends on the bias (3.34) in place of the angle of attack.

Figs. 3.12 and 3.13. The drag is then to be identified anew at each bias; the source says how and
prints the first pair of coefficients only, so the other two are found here by the same steps: so
that radius and period are those measured, for which the model with the coefficients of Table 3.2
at that bias stands. Two unknowns and two smooth equations, in logarithms: Powell's hybrid method.
"""

import math
from dataclasses import replace

from scipy.optimize import root

from plant.parameters import Hydrodynamics
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat
from tools.studies.chapter3_drag import fit
from tools.studies.chapter3_turning import (
    TABLE_3_2,
    Turn,
    better,
    bias_figure,
    identified,
    orbit,
    robot,
    sweep_bias,
    turn,
)
from tools.studies.study import Check, FloatArray, Progress, Result

SURROGATE = COEFFICIENT_SETS["chapter-3-surrogate"]
"""Identified at 20° with (3.34)."""


def surrogate(progress: Progress) -> Result:
    """Fig. 3.12: lift from the bias (3.34), drag not adapted."""
    turns = sweep_bias(robot(SURROGATE), lambda share: progress(0.6 * share))
    reference = sweep_bias(robot(Hydrodynamics()), lambda s: progress(0.6 + 0.4 * s))
    at_20 = TailBeat.degrees(20.0, 15.0, 0.9)
    beats = [orbit(robot(model), at_20).settling_beats for model in (SURROGATE, Hydrodynamics())]
    said = (
        f"At 20° the surrogate turns in {turns[0].period_s:.2f} s with mean |β| "
        f"{turns[0].mean_abs_beta_rad:.4f} rad; the model it was fitted like, in "
        f"{reference[0].period_s:.2f} s with {reference[0].mean_abs_beta_rad:.4f} rad. With (3.34) "
        f"the turn settles slowly there: a deviation falls by 1/e in {beats[0]:.0f} beats, with "
        f"(3.20) in {beats[1]:.1f}, so that a simulation of two minutes still shows a circle too "
        "tight by 2 %."
    )
    return Result(
        checks=(
            Check("radius at 20°: identified to be as before, about 27.5", 27.5,
                  100.0 * turns[0].radius_m, "cm", 0.02),
        ),
        figures=(
            bias_figure(
                "Fig. 3.12",
                "Steady turning over the bias with the lift surrogate (3.34) and constant drag; "
                "amplitude 15°, frequency 0.9 Hz. The dots are the model with the coefficients "
                "fitted to the measurement at each bias; the dashed line is Fig. 3.4.",
                (("lift from the bias", turns), ("lift from β", reference)),
            ),
        ),
        notes=(
            better(turns, reference, ("with (3.34)", "of Fig. 3.4")),
            said,
        ),
    )  # fmt: skip


def surrogate_adapted(progress: Progress) -> Result:
    """Fig. 3.13: lift from the bias, drag adapted by the steps of section 3.4.1."""
    pairs = [(SURROGATE.drag, SURROGATE.yaw_drag_n_m_s2)]
    for index, (bias, target) in enumerate(zip(TABLE_3_2, identified(), strict=True)):
        if index:
            pairs.append(identify(bias, target, pairs[-1]))
        progress(0.2 * (index + 1))
    law = fit(list(TABLE_3_2), [p[0] for p in pairs], [p[1] for p in pairs])
    model = replace(
        SURROGATE,
        drag=law.drag,
        drag_per_bias_squared=law.drag_per_bias_squared,
        yaw_drag_n_m_s2=law.yaw_drag_n_m_s2,
        yaw_drag_per_bias_n_m_s2=law.yaw_drag_per_bias_n_m_s2,
    )
    turns = sweep_bias(robot(model), lambda share: progress(0.6 + 0.2 * share))
    constant = sweep_bias(robot(SURROGATE), lambda share: progress(0.8 + 0.2 * share))
    found = "; ".join(
        f"{bias:g}°: C_D {pair[0]:.4f}, K_D {1e3 * pair[1]:.3f}e-3 kg·m²"
        for bias, pair in zip(TABLE_3_2, pairs, strict=True)
    )
    said = (
        "The source determines these laws by 'similar steps' and prints none of the numbers, and "
        "its measurements are not tabled. Here, with C′_L fixed, C_D and K_D were found at 30° and "
        "40° so that radius and period are those of the chapter's model with the coefficients of "
        f"Table 3.2 at that bias ({found}), then fitted as (3.32), (3.33): C′_D0 {law.drag:.4f}, "
        f"C′_D1 {law.drag_per_bias_squared:.4f} /rad², K′_D0 {1e4 * law.yaw_drag_n_m_s2:.3f}e-4, "
        f"K′_D1 {1e4 * law.yaw_drag_per_bias_n_m_s2:.3f}e-4 /rad."
    )
    return Result(
        figures=(
            bias_figure(
                "Fig. 3.13",
                "Steady turning over the bias with the lift surrogate (3.34) and adapted drag; "
                "amplitude 15°, frequency 0.9 Hz. The dots are the model with the coefficients "
                "fitted to the measurement at each bias; the dashed line is Fig. 3.12.",
                (("adapted drag", turns), ("constant drag", constant)),
            ),
        ),
        notes=(
            said,
            better(turns, constant),
        ),
    )


def identify(bias_deg: float, target: Turn, guess: tuple[float, float]) -> tuple[float, float]:
    """C_D and K_D with which the surrogate turns with the target's radius and period.

    Raises ``ValueError`` where there are none.
    """
    beat = TailBeat.degrees(bias_deg, 15.0, 0.9)

    def apart(logs: FloatArray, /) -> list[float]:
        drag, yaw = math.exp(logs[0]), math.exp(logs[1])
        found = turn(robot(replace(SURROGATE, drag=drag, yaw_drag_n_m_s2=yaw)), beat)
        return [
            math.log(found.radius_m / target.radius_m),
            math.log(found.period_s / target.period_s),
        ]

    answer = root(apart, [math.log(value) for value in guess], tol=1e-10)
    if not answer.success:
        raise ValueError(f"no drag coefficients at {bias_deg:g}°: {answer.message}")
    return math.exp(answer.x[0]), math.exp(answer.x[1])
