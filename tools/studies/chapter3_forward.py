"""Swimming straight with the rigid tail (Figs. 3.7, 3.8, 3.11).

Without bias the robot swims straight on but for the to and fro of the beat. Thrust and speed are
means over a beat of the steady motion (``plant.orbit``), once with the body's motion in the tail
forces (3.13) and once without it (3.30).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from plant.integrate import simulate
from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.parameters import PlantParameters
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Trajectory
from tools.studies.study import Check, Curve, Figure, FloatArray, Mark, Panel, Progress, Result

STEPS_PER_BEAT = 200
AMPLITUDE_DEG = np.linspace(15.0, 30.0, 16)
FREQUENCY_HZ = np.linspace(0.9, 3.0, 15)
TRANSIENT_S = 30.0

SPEED_REASON = (
    "The published equations and parameters give 32 % at 15°, 0.9 Hz, while both thrusts agree "
    "with the text; 'about 25 %' is not what they say."
)


def steady(parameters: PlantParameters, beat: TailBeat) -> PeriodicOrbit:
    """Steady swimming of one beat."""
    return periodic_orbit(parameters, beat, 1.0 / (beat.frequency_hz * STEPS_PER_BEAT))


def ignoring_body_motion() -> PlantParameters:
    """Chapter 3's robot with V_τ = α̇ τ n̂ in the tail forces (3.30)."""
    model = wang2014()
    return replace(model, hydrodynamics=replace(model.hydrodynamics, body_motion_in_tail=0.0))


def thrust(progress: Progress) -> Result:
    """Fig. 3.7: mean thrust over amplitude and frequency, with and without the body's motion."""
    with_, without = _both(progress)
    considered, ignored = (1e3 * lines[0][0].mean_thrust_n for lines in (with_, without))
    marks = (Mark(15.0, 1.188, "1.188 mN"), Mark(15.0, 0.755, "0.755 mN"))
    beside = (Mark(0.9, 1.188, "1.188 mN"), Mark(0.9, 0.755, "0.755 mN"))
    return Result(
        checks=(
            Check("thrust at 15°, 0.9 Hz, body motion ignored", 1.188, ignored, "mN", 0.001),
            Check("thrust at 15°, 0.9 Hz, body motion considered", 0.755, considered, "mN", 0.001),
            Check("too much where the motion is ignored", 57.0, 100.0 * (ignored / considered - 1),
                  "%", 0.5, absolute=True),
        ),
        figures=(
            Figure(
                "Fig. 3.7",
                "Mean thrust of the tail while swimming straight: (a) at 0.9 Hz, (b) at 15°.",
                _panels("mean thrust (mN)", with_, without, lambda item: 1e3 * item.mean_thrust_n,
                        (marks, beside)),
            ),
        ),
    )  # fmt: skip


def speed(progress: Progress) -> Result:
    """Fig. 3.8: speed over amplitude and frequency, with and without the body's motion."""
    with_, without = _both(progress)
    more = 100.0 * (without[0][0].speed_m_s / with_[0][0].speed_m_s - 1.0)
    least, most = (
        100.0 * (function(o.speed_m_s / w.speed_m_s for w, o in _zip(with_, without)) - 1.0)
        for function in (min, max)
    )
    return Result(
        checks=(
            Check("speed at 15°, 0.9 Hz: too much where the motion is ignored", 25.0, more, "%",
                  1.0, absolute=True, known_difference=SPEED_REASON),
        ),
        figures=(
            Figure(
                "Fig. 3.8",
                "Steady speed while swimming straight: (a) at 0.9 Hz, (b) at 15°.",
                _panels("speed (cm/s)", with_, without, lambda item: 100.0 * item.speed_m_s),
            ),
        ),
        notes=(
            ("Ignoring the body's motion overestimates the speed by "
            f"{least:.0f} to {most:.0f} % over all points of the figure."),
        ),
    )  # fmt: skip


def transient(progress: Progress) -> Result:
    """Fig. 3.11: from rest with 15°, 0.9 Hz, drag adapted to zero bias and not adapted."""
    beat = TailBeat.degrees(0.0, 15.0, 0.9)
    drawn: dict[str, Trajectory] = {}
    for share, (name, key) in enumerate(
        (("adapted", "chapter-3-adapted"), ("not adapted", "chapter-3"))
    ):
        model = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS[key])
        step = 1.0 / (beat.frequency_hz * STEPS_PER_BEAT)
        drawn[name] = simulate(model, TailProgramme.steady(beat), TRANSIENT_S, step, save_every=4)
        progress(0.5 * (share + 1))
    reached = {name: float(np.hypot(t.x_m[-1], t.y_m[-1])) for name, t in drawn.items()}

    def panel(title: str, x_label: str, y_label: str, x: str, y: str, equal: bool) -> Panel:
        curves = tuple(
            Curve(name, getattr(t, x), getattr(t, y), "dashed" if i else "line")
            for i, (name, t) in enumerate(drawn.items())
        )
        return Panel(title, x_label, y_label, curves, equal=equal)

    said = (
        f"In {TRANSIENT_S:g} s the model with adapted drag comes {reached['adapted']:.3f} m far, "
        f"the other {reached['not adapted']:.3f} m. The first half beat from rest turns the "
        "heading, so the path is straight but oblique; how much depends on the phase at the start, "
        "which the source does not give (here the tail begins in the middle)."
    )
    return Result(
        figures=(
            Figure(
                "Fig. 3.11",
                "Forward swimming from rest; amplitude 15°, frequency 0.9 Hz, no bias.",
                (
                    panel("(a)", "time (s)", "X (m)", "time_s", "x_m", equal=False),
                    panel("(b)", "time (s)", "Y (m)", "time_s", "y_m", equal=False),
                    panel("(c) path", "X (m)", "Y (m)", "x_m", "y_m", equal=True),
                ),
            ),
        ),
        notes=(said,),
    )


Grid = tuple[tuple[PeriodicOrbit, ...], tuple[PeriodicOrbit, ...]]


def _both(progress: Progress) -> tuple[Grid, Grid]:
    """Steady swimming over amplitudes and over frequencies, for both models."""
    beats = (
        tuple(TailBeat.degrees(0.0, float(a), 0.9) for a in AMPLITUDE_DEG),
        tuple(TailBeat.degrees(0.0, 15.0, float(f)) for f in FREQUENCY_HZ),
    )
    total, done = 2 * sum(map(len, beats)), 0
    grids = []
    for model in (wang2014(), ignoring_body_motion()):
        lines = []
        for line in beats:
            found = []
            for beat in line:
                found.append(steady(model, beat))
                done += 1
                progress(done / total)
            lines.append(tuple(found))
        grids.append((lines[0], lines[1]))
    return grids[0], grids[1]


def _zip(with_: Grid, without: Grid) -> list[tuple[PeriodicOrbit, PeriodicOrbit]]:
    return [pair for lines in zip(with_, without, strict=True) for pair in zip(*lines, strict=True)]


def _panels(
    label: str,
    with_: Grid,
    without: Grid,
    value: Callable[[PeriodicOrbit], float],
    marks: tuple[tuple[Mark, ...], tuple[Mark, ...]] = ((), ()),
) -> tuple[Panel, ...]:
    axes: tuple[tuple[str, str, FloatArray], ...] = (
        ("(a) over the amplitude", "amplitude (°)", AMPLITUDE_DEG),
        ("(b) over the frequency", "frequency (Hz)", FREQUENCY_HZ),
    )
    return tuple(
        Panel(
            title,
            x_label,
            label,
            (
                Curve("body motion considered", x, np.array([value(item) for item in with_[i]])),
                Curve(
                    "body motion ignored",
                    x,
                    np.array([value(item) for item in without[i]]),
                    "dashed",
                ),
            ),
            marks[i],
        )
        for i, (title, x_label, x) in enumerate(axes)
    )
