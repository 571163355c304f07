"""The tail's part averaged over one beat, with its forces scaled (5.29, 5.30).

⟨α̈ sin α⟩ and ⟨α̈ cos α⟩ have closed forms: with α = α₀ + α_A sin τ they are
−ω²α_A J₁(α_A) cos α₀ and ω²α_A J₁(α_A) sin α₀. (5.30) has their polynomials for sin α ≈ α − α³/6
and cos α ≈ 1 − α²/2, which at 50° of bias are 4 % and 14 % off; the scaling was identified with the
polynomials and goes with them. ⟨α̈⟩ = 0, so the moment about the joint averages away; its effect
is what K_moment has to hold.
"""

import math
from typing import NamedTuple

from scipy.special import j1

from plant.averaging.dynamics import (
    Dynamics,
    Forcing,
    Scaling,
    check_beat,
    tail_coefficients,
)
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat


class MeanForces(NamedTuple):
    """Unscaled mean force and moment of the tail on the body: N, N, N·m."""

    x: float
    y: float
    moment: float


def mean_forces(parameters: PlantParameters, beat: TailBeat, full_tail: bool = False) -> MeanForces:
    """Mean of m₁f₄, m₂f₅ and J₃f₆ over a beat; ``full_tail`` as in ``Dynamics``.

    The polynomials are m₁·mL²/(12m₁) ω²α_A²(3 − (3/2)α₀² − (3/8)α_A²), m₂·mL²/(4m₂) ω²α_A²α₀ and
    −mL²c/4 ω²α_A²α₀; (5.32) prints the first with its division by m₁ although it calls it a force.
    """
    check_beat(beat)
    c3 = tail_coefficients(parameters)[0]
    bias, amplitude = beat.bias_rad, beat.amplitude_rad
    omega = 2.0 * math.pi * beat.frequency_hz
    if full_tail:
        beating = c3 * omega * omega * amplitude * float(j1(amplitude))
        x, y = beating * math.cos(bias), beating * math.sin(bias)
    else:
        beating = c3 * omega * omega * amplitude * amplitude / 6.0
        x = beating * (3.0 - 1.5 * bias * bias - 0.375 * amplitude * amplitude)
        y = beating * 3.0 * bias
    return MeanForces(x, y, -parameters.body.hinge_distance_m * y)


def scaled_forces(
    parameters: PlantParameters, beat: TailBeat, scaling: Scaling, full_tail: bool = False
) -> MeanForces:
    """``mean_forces`` times K_force and K_moment."""
    mean = mean_forces(parameters, beat, full_tail)
    moment = scaling.moment_at(beat.bias_rad)
    return MeanForces(scaling.force * mean.x, scaling.force * mean.y, moment * mean.moment)


def forcing(parameters: PlantParameters, beat: TailBeat, dynamics: Dynamics) -> Forcing:
    """Make the record that compiled code reads: a beating tail, or constants where averaged."""
    check_beat(beat)
    c3, c5, c6 = tail_coefficients(parameters)
    full = 1.0 if dynamics.full_tail else 0.0
    omega = 2.0 * math.pi * beat.frequency_hz
    bias = float(beat.bias_rad)
    if dynamics.scaling is None:
        return Forcing(bias, float(beat.amplitude_rad), omega, full, c3, c5, c6, 0.0, 0.0, 0.0)
    mean = scaled_forces(parameters, beat, dynamics.scaling, dynamics.full_tail)
    body = parameters.body
    return Forcing(
        bias,
        0.0,
        omega,
        full,
        c3,
        c5,
        c6,
        mean.x / (body.mass_kg + body.added_mass_surge_kg),
        mean.y / (body.mass_kg + body.added_mass_sway_kg),
        mean.moment / (body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2),
    )
