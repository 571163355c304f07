"""What the studies of chapter 5 share: its robot, and two models beside each other over a sweep.

Turning radii of a model with a beating tail are outer radii, half the width of the path as plotted,
which is what the source's own numbers fit (docs/averaging.md); the averages have no ripples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plant.averaging.dynamics import AVERAGE, ORIGINAL, Dynamics, Scaling
from plant.averaging.motion import steady_turn
from plant.parameters import PlantParameters
from plant.robots import COEFFICIENT_SETS, wang2014
from plant.tail_input import TailBeat
from tools.studies.study import Curve, Figure, FloatArray, Panel, Progress, Style


@dataclass(frozen=True, slots=True)
class Turned:
    """A steady turn as the figures give it: radius (m) and period (s)."""

    radius_m: float
    period_s: float


Model = Callable[[PlantParameters, TailBeat], Turned]


_STYLES: tuple[Style, ...] = ("line", "marks", "dashed")


def robot() -> PlantParameters:
    """The robot of Table 3.1 with the coefficients of chapter 5."""
    return replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-5"])


def heavy() -> PlantParameters:
    """The same with 0.622 kg, and the body's inertia doubled with it."""
    parameters = robot()
    body = parameters.body
    double = replace(
        body, mass_kg=2.0 * body.mass_kg, yaw_inertia_kg_m2=2.0 * body.yaw_inertia_kg_m2
    )
    return replace(parameters, body=double)


def turned(parameters: PlantParameters, beat: TailBeat, dynamics: Dynamics) -> Turned:
    """Steady turn of a beat. Raises ``ValueError`` where the path is straight."""
    steady = steady_turn(parameters, beat, dynamics)
    if steady.outer_radius_m is None or steady.turn_period_s is None:
        raise ValueError(f"{beat}: the path does not turn")
    return Turned(steady.outer_radius_m, steady.turn_period_s)


def original(parameters: PlantParameters, beat: TailBeat) -> Turned:
    """The original dynamics (5.5)."""
    return turned(parameters, beat, ORIGINAL)


def average(scaling: Scaling) -> Model:
    """The average model (5.30) with a scaling."""

    def model(parameters: PlantParameters, beat: TailBeat) -> Turned:
        return turned(parameters, beat, replace(AVERAGE, scaling=scaling))

    return model


def sweep(
    parameters: PlantParameters, beats: Sequence[TailBeat], model: Model, progress: Progress
) -> tuple[Turned, ...]:
    """A model's steady turn of each beat."""
    turns = []
    for index, beat in enumerate(beats):
        turns.append(model(parameters, beat))
        progress((index + 1) / len(beats))
    return tuple(turns)


def part_of(progress: Progress, index: int, count: int) -> Progress:
    """Progress of the ``index``-th of ``count`` equal parts."""
    return lambda share: progress((index + share) / count)


def pair(
    name: str,
    caption: str,
    x_label: str,
    x: FloatArray,
    lines: Sequence[tuple[str, Sequence[Turned]]],
    tops: tuple[float, float],
) -> Figure:
    """Radius and period over ``x``; the first line drawn through, with the published axes."""

    def curves(value: Callable[[Turned], float]) -> tuple[Curve, ...]:
        return tuple(
            Curve(label, x, np.array([value(item) for item in turns]), style)
            for (label, turns), style in zip(lines, _STYLES, strict=False)
        )

    return Figure(
        name,
        caption,
        (
            Panel(
                "(a) radius",
                x_label,
                "turning radius (cm)",
                curves(lambda item: 100.0 * item.radius_m),
                y_range=(0.0, tops[0]),
            ),
            Panel(
                "(b) period",
                x_label,
                "turning period (s)",
                curves(lambda item: item.period_s),
                y_range=(0.0, tops[1]),
            ),
        ),
    )


def apart_percent(model: Sequence[Turned], reference: Sequence[Turned]) -> tuple[float, float]:
    """Largest difference of a model from the original dynamics: in radius, and in period, %."""
    pairs = list(zip(model, reference, strict=True))
    return (
        100.0 * max(abs(a.radius_m / b.radius_m - 1.0) for a, b in pairs),
        100.0 * max(abs(a.period_s / b.period_s - 1.0) for a, b in pairs),
    )


def agreement(claim: str, model: Sequence[Turned], reference: Sequence[Turned]) -> str:
    """Tell those differences; the source says in words, without a number, how well they agree."""
    radius, period = apart_percent(model, reference)
    return (
        f"Largest difference of the average model from the original: {radius:.1f} % in radius, "
        f"{period:.1f} % in period; the source says '{claim}'."
    )
