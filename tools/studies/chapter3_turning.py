"""Steady turning with the rigid tail (Figs. 3.4 to 3.6, 3.9, 3.10, 3.12, 3.13).

The source waits until the robot turns steadily and then measures its circle; here the steady turn
is the periodic orbit of the beat (``plant.orbit``), so nothing has to die out first. A figure is a
sweep of one tail-beat number with the other two held, so one function does them all.

All forces are quadratic in the speeds (without a current and with an ideal servo), so a faster
beat is the same motion in a shorter time, and the radius does not depend on the frequency at all.

The source prints few of these numbers. What was measured at 20°, 30° and 40° of bias stands in
Table 3.2 in another form, as the coefficients that were fitted to it, so the model with these
coefficients says what was measured there.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.parameters import Hydrodynamics, PlantParameters
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat
from tools.studies.study import (
    Band,
    Check,
    Curve,
    Figure,
    FloatArray,
    Mark,
    Panel,
    Progress,
    Result,
)

STEPS_PER_BEAT = 250
"""Radius and period are then within 1e-7 of those at 1000 steps."""

BIAS_DEG = np.linspace(20.0, 40.0, 21)
AMPLITUDE_DEG = np.linspace(15.0, 30.0, 16)
FREQUENCY_HZ = np.linspace(0.9, 3.0, 15)
TABLE_3_2 = {20.0: "chapter-3", 30.0: "chapter-3-30deg", 40.0: "chapter-3-40deg"}
"""Bias in degrees → the coefficients identified there."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Steady turning: radius (m), period (s), mean |β| over a beat (3.31), rad."""

    radius_m: float
    period_s: float
    mean_abs_beta_rad: float


def robot(water: Hydrodynamics) -> PlantParameters:
    """The robot of Table 3.1 with an ideal servo and the given coefficients."""
    return replace(wang2014(), hydrodynamics=water)


def orbit(parameters: PlantParameters, beat: TailBeat) -> PeriodicOrbit:
    """Steady motion of one beat, on the grid of these studies."""
    return periodic_orbit(parameters, beat, 1.0 / (beat.frequency_hz * STEPS_PER_BEAT))


def turn(parameters: PlantParameters, beat: TailBeat) -> Turn:
    """Steady turn of one beat. Raises ``ValueError`` where the path is straight."""
    steady = orbit(parameters, beat)
    if steady.turn_radius_m is None or steady.turn_period_s is None:
        raise ValueError(f"{beat}: the path does not turn")
    return Turn(steady.turn_radius_m, steady.turn_period_s, steady.mean_abs_beta_rad)


def over_bias(progress: Progress) -> Result:
    """Fig. 3.4: bias 20° to 40° at 15°, 0.9 Hz, coefficients of 20° throughout."""
    turns = sweep_bias(wang2014(), progress)
    at_20 = 100.0 * turns[0].radius_m
    return Result(
        checks=(Check("turning radius at 20°, 15°, 0.9 Hz", 27.5, at_20, "cm", 0.01),),
        figures=(
            bias_figure(
                "Fig. 3.4",
                "Steady turning over the bias; amplitude 15°, frequency 0.9 Hz. The dots are the "
                "model with the coefficients that were fitted to the measurement at each bias.",
                (("model", turns),),
                Mark(20.0, 27.5, "about 27.5 cm"),
            ),
        ),
    )


def over_amplitude(progress: Progress) -> Result:
    """Fig. 3.5: amplitude 15° to 30° at 20°, 0.9 Hz."""
    turns = _sweep(wang2014(), _beats(amplitude=AMPLITUDE_DEG), progress)
    radius = 100.0 * _radius_m(turns)
    middle = "radius at {}° amplitude: about 27.5, nearly constant"
    return Result(
        checks=(
            Check(middle.format(15), 27.5, float(radius[0]), "cm", 0.01),
            Check(middle.format(30), 27.5, float(radius[-1]), "cm", 0.01),
        ),
        figures=(
            Figure(
                "Fig. 3.5",
                "Steady turning over the amplitude; bias 20°, frequency 0.9 Hz.",
                _pair(
                    "amplitude (°)",
                    (("model", AMPLITUDE_DEG, turns),),
                    marks=(Mark(22.0, 27.5, "about 27.5 cm over the range"),),
                    bands=(Band(26.0, 30.5, "means measured: 26 to 30.5 cm"),),
                    tops=(40.0, 80.0),
                ),
            ),
        ),
    )  # fmt: skip


def over_frequency(progress: Progress) -> Result:
    """Fig. 3.6: frequency 0.9 Hz to 3 Hz at 20°, 15°."""
    turns = _sweep(wang2014(), _beats(frequency=FREQUENCY_HZ), progress)
    radius = 100.0 * _radius_m(turns)
    return Result(
        checks=(
            Check("radius at 3 Hz: as at 0.9 Hz, about 27.5", 27.5, float(radius[-1]), "cm", 0.01),
        ),
        figures=(
            Figure(
                "Fig. 3.6",
                "Steady turning over the frequency; bias 20°, amplitude 15°.",
                _pair("frequency (Hz)", (("model", FREQUENCY_HZ, turns),), tops=(40.0, 80.0)),
            ),
        ),
        notes=(
            (
                "The published dependence on the frequency is negligible; the equations have none, "
                "since every force is quadratic in the speeds: radius × 1, period × 1/frequency."
            ),
        ),
    )


def mean_beta(progress: Progress) -> Result:
    """Fig. 3.9: mean |β| over bias, amplitude and frequency (3.31)."""
    share = [0.0, 0.0, 0.0]

    def part(index: int) -> Progress:
        def tell(value: float) -> None:
            share[index] = value
            progress(sum(share) / 3.0)

        return tell

    model = wang2014()
    sweeps = (
        ("(a) over the bias", "bias (°)", BIAS_DEG, _beats(bias=BIAS_DEG)),
        ("(b) over the amplitude", "amplitude (°)", AMPLITUDE_DEG, _beats(amplitude=AMPLITUDE_DEG)),
        ("(c) over the frequency", "frequency (Hz)", FREQUENCY_HZ, _beats(frequency=FREQUENCY_HZ)),
    )
    panels, found = [], []
    for index, (title, label, x, beats) in enumerate(sweeps):
        beta = np.array([item.mean_abs_beta_rad for item in _sweep(model, beats, part(index))])
        found.append(beta)
        panels.append(
            Panel(title, label, "mean |β| (rad)", (Curve("model", x, beta),), y_range=(0.0, 0.2))
        )
    over_bias_, over_amplitude_, _ = found
    linear = float(np.corrcoef(BIAS_DEG, over_bias_)[0, 1])
    spread = float(np.ptp(over_bias_))
    where = (
        "The source computes this with 'the model identified in Section 4.5', which is the chapter "
        "on flexible tails; here it is the model of this chapter (Section 3.3.2)."
    )
    little = (
        f"Mean |β| changes by {spread:.4f} rad over the biases, by "
        f"{float(np.ptp(over_amplitude_)):.4f} rad over the amplitudes and not at all over the "
        "frequencies; the source says 'little dependence' on both."
    )
    return Result(
        checks=(Check("correlation with the bias: 'nearly linear'", 1.0, linear, "", 0.01),),
        figures=(
            Figure(
                "Fig. 3.9",
                "Mean |β| over a beat; where they are held, bias 20°, amplitude 15°, frequency "
                "0.9 Hz. The axes end at 0.2 rad as the published ones do.",
                tuple(panels),
            ),
        ),
        notes=(where, little),
    )


def sweep_bias(model: PlantParameters, progress: Progress) -> tuple[Turn, ...]:
    """Steady turns at ``BIAS_DEG``, 15°, 0.9 Hz."""
    return _sweep(model, _beats(bias=BIAS_DEG), progress)


def bias_figure(
    name: str, caption: str, lines: Sequence[tuple[str, Sequence[Turn]]], *marks: Mark
) -> Figure:
    """A figure over the bias with the dots of Table 3.2; the first line is drawn through."""
    drawn = [(label, BIAS_DEG, turns) for label, turns in lines]
    panels = _pair("bias (°)", drawn, identified(), marks=marks, tops=(32.0, 80.0))
    return Figure(name, caption, panels)


def adapted(progress: Progress) -> Result:
    """Fig. 3.10: as Fig. 3.4 with drag adapted to the bias (3.32, 3.33)."""
    model = robot(COEFFICIENT_SETS["chapter-3-adapted"])
    turns = sweep_bias(model, lambda share: progress(0.6 * share))
    constant = sweep_bias(wang2014(), lambda share: progress(0.6 + 0.4 * share))
    return Result(
        figures=(
            bias_figure(
                "Fig. 3.10",
                "Steady turning over the bias with adapted drag; amplitude 15°, frequency 0.9 Hz. "
                "The dots are the model with the coefficients fitted to the measurement at each "
                "bias; the dashed line is Fig. 3.4.",
                (("adapted drag", turns), ("constant drag", constant)),
            ),
        ),
        notes=(better(turns, constant),),
    )


def better(
    turns: Sequence[Turn],
    constant: Sequence[Turn],
    names: tuple[str, str] = ("adapted", "constant"),
) -> str:
    """How far both lines are from the dots at 20°, 30°, 40°, in a sentence."""
    at = [int(np.argmin(np.abs(BIAS_DEG - bias))) for bias in TABLE_3_2]
    dots = identified()

    def rms(lines: Sequence[Turn], value: Callable[[Turn], float]) -> float:
        apart = [value(lines[i]) / value(dot) - 1.0 for i, dot in zip(at, dots, strict=True)]
        return 100.0 * math.sqrt(float(np.mean(np.square(apart))))

    radius = [rms(lines, lambda item: item.radius_m) for lines in (turns, constant)]
    period = [rms(lines, lambda item: item.period_s) for lines in (turns, constant)]
    return (
        "Distance to the dots, root mean square over the three biases: radius "
        f"{radius[0]:.1f} % {names[0]}, {radius[1]:.1f} % {names[1]}; "
        f"period {period[0]:.1f} % {names[0]}, {period[1]:.1f} % {names[1]}."
    )


def identified() -> tuple[Turn, ...]:
    """Steady turns at 15°, 0.9 Hz with the coefficients of Table 3.2 at their own bias."""
    return tuple(
        turn(robot(COEFFICIENT_SETS[name]), TailBeat.degrees(bias, 15.0, 0.9))
        for bias, name in TABLE_3_2.items()
    )


def _beats(
    bias: FloatArray | None = None,
    amplitude: FloatArray | None = None,
    frequency: FloatArray | None = None,
) -> tuple[TailBeat, ...]:
    """The beats of a sweep over one of the three; the others are 20°, 15°, 0.9 Hz."""
    grids = [
        np.array([held]) if grid is None else grid
        for grid, held in ((bias, 20.0), (amplitude, 15.0), (frequency, 0.9))
    ]
    return tuple(
        TailBeat.degrees(float(b), float(a), float(f))
        for b, a, f in np.broadcast(*grids)  # one grid is long, two are single numbers
    )


def _sweep(
    model: PlantParameters, beats: Sequence[TailBeat], progress: Progress
) -> tuple[Turn, ...]:
    turns = []
    for index, beat in enumerate(beats):
        turns.append(turn(model, beat))
        progress((index + 1) / len(beats))
    return tuple(turns)


def _radius_m(turns: Sequence[Turn]) -> FloatArray:
    return np.array([item.radius_m for item in turns])


def _pair(
    label: str,
    lines: Sequence[tuple[str, FloatArray, Sequence[Turn]]],
    dots: Sequence[Turn] = (),
    *,
    marks: tuple[Mark, ...] = (),
    bands: tuple[Band, ...] = (),
    tops: tuple[float, float],
) -> tuple[Panel, Panel]:
    """Panels (a) radius and (b) period with the published axes, which end at ``tops``."""
    at = np.array(list(TABLE_3_2)[: len(dots)])

    def curves(value: Callable[[Turn], float]) -> tuple[Curve, ...]:
        drawn = [
            Curve(name, x, np.array([value(item) for item in turns]), "dashed" if i else "line")
            for i, (name, x, turns) in enumerate(lines)
        ]
        if dots:
            drawn.append(
                Curve("fitted at each bias", at, np.array([value(item) for item in dots]), "marks")
            )
        return tuple(drawn)

    return (
        Panel(
            "(a) radius",
            label,
            "turning radius (cm)",
            curves(lambda item: 100.0 * item.radius_m),
            marks,
            bands,
            y_range=(0.0, tops[0]),
        ),
        Panel(
            "(b) period",
            label,
            "turning period (s)",
            curves(lambda item: item.period_s),
            y_range=(0.0, tops[1]),
        ),
    )
