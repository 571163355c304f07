"""Steady turning with the rigid tail (Figs. 3.4 to 3.6, 3.9, 3.10, 3.12, 3.13).

The source waits until the robot turns steadily and then measures its circle; so does this. A
figure is a sweep of one tail-beat number with the other two held, so one function does them all.
Start from rest, simulate until the transient has died (its slowest part decays within about 20 s),
and average over the last whole beats.
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.integrate import simulate
from plant.metrics import steady_motion
from plant.parameters import PlantParameters, wang2014
from plant.tail_input import TailBeat, TailProgramme
from tools.studies.study import Check, Curve, Figure, FloatArray, Panel, Progress, Result

STEPS_PER_BEAT = 250
SETTLE_S = 60.0
BEATS = 20


@dataclass(frozen=True, slots=True)
class Turn:
    """Steady turning: radius (m), period (s), mean |β| over a beat (rad)."""

    radius_m: float
    period_s: float
    mean_abs_beta_rad: float


def turn(parameters: PlantParameters, beat: TailBeat) -> Turn:
    """Simulate from rest to the steady turn of one beat and measure it."""
    step = 1.0 / (beat.frequency_hz * STEPS_PER_BEAT)
    beats = math.ceil(SETTLE_S * beat.frequency_hz) + BEATS
    t = simulate(
        parameters, TailProgramme.steady(beat), beats / beat.frequency_hz, step, save_every=10
    )
    motion = steady_motion(t.time_s, t.x_m, t.y_m, t.heading_rad, beat.frequency_hz, BEATS)
    last = slice(-BEATS * STEPS_PER_BEAT // 10, None)
    beta = np.arctan2(t.v_m_s[last], t.u_m_s[last])
    if motion.turn_radius_m is None or motion.turn_period_s is None:
        raise ValueError(f"{beat}: the path does not turn")
    return Turn(motion.turn_radius_m, motion.turn_period_s, float(np.abs(beta).mean()))


def over_bias(progress: Progress) -> Result:
    """Fig. 3.4: bias 20° to 40° at 15°, 0.9 Hz."""
    bias_deg = np.linspace(20.0, 40.0, 11)
    turns = []
    for i, bias in enumerate(bias_deg):
        turns.append(turn(wang2014(), TailBeat.degrees(float(bias), 15.0, 0.9)))
        progress((i + 1) / bias_deg.size)
    radius_cm = np.array([100.0 * item.radius_m for item in turns])
    period_s = np.array([item.period_s for item in turns])
    return Result(
        checks=(
            Check("turning radius at 20°, 15°, 0.9 Hz", 27.5, float(radius_cm[0]), "cm", 0.01),
        ),
        figures=(
            Figure(
                "Fig. 3.4",
                "Turning radius and period over the bias, at 15° and 0.9 Hz",
                (
                    _panel("(a)", "radius (cm)", bias_deg, radius_cm),
                    _panel("(b)", "period (s)", bias_deg, period_s),
                ),
            ),
        ),
    )


def _panel(title: str, what: str, x: FloatArray, y: FloatArray) -> Panel:
    return Panel(title, "bias (°)", f"turning {what}", (Curve("model", x, y),))
