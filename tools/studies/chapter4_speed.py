"""Swimming with a flexible tail: speed over frequency, and from rest (Figs. 4.9 to 4.11).

Both models of the tail, segments and beam, drive the same body; as published, the robot counts as
anchored for the tail's forces. The speed is that of the steady motion (``plant.orbit``).
"""

from dataclasses import dataclass, replace

import numpy as np

from plant.integrate import simulate
from plant.orbit import periodic_orbit
from plant.packing import virtual_mass_kg_m
from plant.parameters import PlantParameters, Tail
from plant.robots import flexible_tail, long_flexible_tail, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from tools.studies.study import (
    Check,
    Curve,
    Figure,
    FloatArray,
    Mark,
    Panel,
    Progress,
    Result,
    Style,
)

AMPLITUDE_DEG = 13.6
MODES = 4
"""Modes of the beam; the source gives no number. With eight the speed is the same to 2e-5."""
FREQUENCY_HZ = np.linspace(0.15, 3.0, 39)
MEASURED_HZ = 0.45
"""The source's frequencies are multiples of it (assumed from the 0.45, 0.9, 1.35 Hz it names)."""
STEPS_PER_BEAT = 100
"""Speeds are then within 1e-7 of those at 400 steps."""
TRANSIENT_S = 20.0

DAMPING_REASON = (
    "Misprint: κ K_S with the published κ = 0.079 s and K_S is a tenth of what is printed. With "
    "the printed value the speed has no peak up to 3 Hz at all (the dotted line)."
)


@dataclass(frozen=True, slots=True)
class TailPlan:
    """A tail of chapter 4: what its figure is called and what is printed of it."""

    figure: str
    segments: Tail
    beam: Tail
    stiffness_n_m: float
    damping_n_m_s: float
    words: str


def over_frequency(progress: Progress) -> Result:
    """Fig. 4.9: speed over frequency with the tail of 8 cm × 2.5 cm."""
    first = TailPlan(
        "Fig. 4.9", flexible_tail(), flexible_tail(1, MODES), 5.2e-3, 4.1e-3, "8 cm × 2.5 cm"
    )
    return _speeds(first, progress)


def over_frequency_long(progress: Progress) -> Result:
    """Fig. 4.10: speed over frequency with the tail of 9.8 cm × 2.34 cm."""
    second = TailPlan(
        "Fig. 4.10",
        long_flexible_tail(),
        long_flexible_tail(1, MODES),
        4.0e-3,
        3.13e-3,
        "9.8 cm × 2.34 cm",
    )
    return _speeds(second, progress)


def cruise_m_s(parameters: PlantParameters, frequency_hz: float) -> float:
    """Steady speed at 13.6° without bias."""
    beat = TailBeat.degrees(0.0, AMPLITUDE_DEG, frequency_hz)
    step_s = 1.0 / (frequency_hz * STEPS_PER_BEAT)
    return periodic_orbit(parameters, beat, step_s).path_speed_m_s


def peak(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Where a sampled curve is highest: by the parabola through three points, or at its end."""
    i = int(np.argmax(y))
    if i in (0, y.size - 1):
        return float(x[i]), float(y[i])
    c2, c1, c0 = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
    at = -c1 / (2.0 * c2)
    return float(x[i] + at), float(c0 + 0.5 * c1 * at)


def _speeds(plan: TailPlan, progress: Progress) -> Result:
    published = wang2014_flexible(plan.segments)
    moving = replace(published.hydrodynamics, body_motion_in_tail=1.0)
    printed = replace(plan.segments, damping_s=10.0 * plan.segments.damping_s)
    robots = {
        "five segments": published,
        f"beam, {MODES} modes": wang2014_flexible(plan.beam),
        "five segments, body motion considered": replace(published, hydrodynamics=moving),
        "five segments, K_D as printed": wang2014_flexible(printed),
    }
    speeds: dict[str, FloatArray] = {}
    for k, (name, parameters) in enumerate(robots.items()):
        speeds[name] = np.zeros(FREQUENCY_HZ.size)
        for i, frequency in enumerate(FREQUENCY_HZ):
            speeds[name][i] = 100.0 * cruise_m_s(parameters, float(frequency))
            progress((k + (i + 1) / FREQUENCY_HZ.size) / len(robots))
    segments, beam, moving_speed, _ = speeds.values()
    at, height = peak(FREQUENCY_HZ, segments)
    checks = list(_stiffness(plan))
    marks: tuple[Mark, ...] = ()
    if plan.figure == "Fig. 4.9":
        multiple = FREQUENCY_HZ / MEASURED_HZ
        coarse = np.isclose(multiple, np.round(multiple))
        best = float(FREQUENCY_HZ[coarse][np.argmax(segments[coarse])])
        mass = 1e3 * virtual_mass_kg_m(published)
        half = "greatest speed lies at; tolerance half a step of 0.45 Hz"
        checks += [
            Check("greatest speed at multiples of 0.45 Hz lies at", 1.35, best, "Hz", 0.01),
            Check(half, 1.35, at, "Hz", 0.225, absolute=True),
            Check("virtual mass of the tail per metre", 490.9, mass, "g/m", 0.05, absolute=True),
        ]
        marks = (Mark(1.35, height, "fastest at 1.35 Hz"),)
    apart = "; ".join(
        f"{frequency:.2f} Hz: {b:.2f} and {s:.2f} cm/s"
        for frequency, s, b in zip(FREQUENCY_HZ, segments, beam, strict=True)
        if round(frequency * 100) in (45, 90, 135, 180, 225, 270)
    )
    styles: tuple[Style, ...] = ("line", "dashed", "line", "dotted")
    curves = tuple(
        Curve(name, FREQUENCY_HZ, speed, style)
        for (name, speed), style in zip(speeds.items(), styles, strict=True)
    )
    caption = f"Steady speed over the tail-beat frequency; amplitude 13.6°, tail {plan.words}."
    panel = Panel("", "tail-beat frequency (Hz)", "speed (cm/s)", curves, marks)
    slower = 1.0 - float(np.interp(0.9, FREQUENCY_HZ, moving_speed / segments))
    said = (
        f"Beam and segments, as published: {apart}. Above the peak the beam falls below the "
        "segments, as in the source; at 0.9 Hz it lies above them, where the source finds both "
        f"near its measurement. The segments are fastest at {at:.2f} Hz. With the body's motion "
        "considered in the tail forces, which the source neglects here, the "
        f"robot is slower by {100.0 * slower:.0f} % at 0.9 Hz."
    )
    return Result(tuple(checks), (Figure(plan.figure, caption, (panel,)),), (said,))


def _stiffness(plan: TailPlan) -> tuple[Check, ...]:
    """K_S (4.18) and K_D = κ K_S beside what is printed."""
    tail = plan.segments
    length = tail.length_m / tail.segments
    stiffness = tail.modulus_pa * tail.depth_m * tail.thickness_m**3 / (12.0 * length)
    return (
        Check("K_S (4.18)", plan.stiffness_n_m, stiffness, "N·m", 0.01),
        Check(
            "K_D = κ K_S",
            plan.damping_n_m_s,
            tail.damping_s * stiffness,
            "N·m·s",
            0.01,
            known_difference=DAMPING_REASON,
        ),
    )


def transient(progress: Progress) -> Result:
    """Fig. 4.11: from rest with five segments, 13.6°, 0.9 Hz."""
    beat = TailBeat.degrees(0.0, AMPLITUDE_DEG, 0.9)
    step = 1.0 / (beat.frequency_hz * STEPS_PER_BEAT)
    t = simulate(wang2014_flexible(), TailProgramme.steady(beat), TRANSIENT_S, step)
    progress(1.0)
    far = float(np.hypot(t.x_m[-1], t.y_m[-1]))
    caption = "Forward swimming from rest with five segments; 13.6°, 0.9 Hz, no bias."
    panels = (
        Panel("(a)", "time (s)", "X (m)", (Curve("model", t.time_s, t.x_m),)),
        Panel("(b)", "time (s)", "Y (m)", (Curve("model", t.time_s, t.y_m),)),
        Panel("(c) path", "X (m)", "Y (m)", (Curve("model", t.x_m, t.y_m),), equal=True),
    )
    said = (
        f"After {TRANSIENT_S:g} s the robot is {far:.3f} m away. How oblique the path is depends "
        "on the phase at the start, which the source does not give."
    )
    return Result(figures=(Figure("Fig. 4.11", caption, panels),), notes=(said,))
