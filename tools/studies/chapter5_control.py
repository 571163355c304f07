"""Control in chapter 5: the proportional controller (Fig. 5.10) and target tracking (5.19, 5.21).

The source prints neither the proportional controller's gain and limit nor the tracking law's gains,
nor where the starts and targets of its figures lie. Gain and limit are found from the four numbers
that it does print, the two end points; the rest is chosen like in the figures and said to be so.
"""

import math
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.averaging.dynamics import AVERAGE
from plant.averaging.motion import swim
from plant.parameters import PlantParameters, Servo
from plant.robots import COEFFICIENT_SETS
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from procboard.applications.heading import bias_for
from procboard.applications.tracking_law import Mode, TrackingLaw
from tools.studies.closed_loop import Success, Tracked, steer, success_grid, track
from tools.studies.study import Check, Curve, Figure, Mark, Panel, Progress, Result

BEAT = TailBeat.degrees(0.0, 15.0, 1.0)
"""Of all figures here: 1 Hz, 15°; the bias is the controller's."""

TARGET_M = (2.0, 2.0)
HOLD_S = 5.0
DURATION_S = 200.0
GAIN = 0.768
"""rad of bias a rad of error. Not published: found with the limit below, see `proportional`."""
LIMIT_RAD = 0.93
"""Of the bias. Not published: found. Fig. 5.10c is drawn for ±1 rad."""
PUBLISHED_ORIGINAL_M = (1.9176, 2.2430)
PUBLISHED_AVERAGE_M = (2.0849, 2.2803)

STARTS_519_M = (
    (-1.0, 0.6), (-0.8, -0.7), (-0.3, 1.0), (0.2, -1.0),
    (0.5, 0.5), (0.9, -0.4), (1.0, 0.9), (-0.2, -0.3),
)  # fmt: skip
"""Starts around the target at the origin, all with heading 0: chosen, the source prints none."""

START_521_M = (0.1, 0.3)
TARGETS_521_M = ((0.35, 0.9), (1.25, 0.7), (0.8, 0.1), (0.65, 0.8))
"""About as in the figure's frame of 1.4 × 1 m; as in the scenario track-targets."""


def chapter_5() -> PlantParameters:
    """Return the robot of chapter 5: its coefficients, a tail that is where it is told to be."""
    return PlantParameters(hydrodynamics=COEFFICIENT_SETS["chapter-5"], servo=Servo(ideal=True))


@dataclass(frozen=True, slots=True)
class Proportional:
    """Fig. 5.10 for a gain and a limit: the paths of both models, the bias that both were given."""

    original: FloatArray
    """x, y of the original model, shape (n, 2), m."""
    average: FloatArray
    bias_s: FloatArray
    bias_rad: FloatArray


def proportional(gain: float = GAIN, limit_rad: float = LIMIT_RAD) -> Proportional:
    """Swim from rest at the origin towards (2, 2) by the original model, then repeat its biases.

    After about 100 s the robot passes the target and loops, so that the end points depend on gain
    and limit by decimetres for a per cent, and these can be found from them. The error is the plain
    difference of the target's direction (within ±π) and the heading, which counts its turns: the
    errors of a robot that looped are not brought back to ±π. With errors that are, the best gain
    and limit (1.20, 0.51 rad) leave half as much again of a difference, and a bias of half the size
    that Fig. 5.10c is drawn for.
    """
    parameters = chapter_5()

    def decide(_now_s: float, rows: FloatArray) -> float:
        x, y, psi = (float(value) for value in rows[-1, :3])
        error = math.atan2(TARGET_M[1] - y, TARGET_M[0] - x) - psi
        return bias_for(error, gain, limit_rad)

    steered = steer(parameters, Start(), BEAT, HOLD_S, DURATION_S, decide)
    beats = tuple(TailBeat(bias, BEAT.amplitude_rad, 1.0) for bias in steered.bias_rad)
    average = swim(
        parameters, TailProgramme(beats, steered.decided_s), DURATION_S, AVERAGE, step_s=0.02
    )
    return Proportional(
        np.column_stack((steered.x_m, steered.y_m)),
        np.column_stack((average.x_m, average.y_m)),
        np.array(steered.decided_s),
        np.array(steered.bias_rad),
    )


def fig_5_10(progress: Progress) -> Result:
    """Proportional control of the bias every five seconds, and the average model with its bias."""
    found = proportional()
    progress(1.0)
    pairs = (
        ("original", PUBLISHED_ORIGINAL_M, found.original),
        ("average", PUBLISHED_AVERAGE_M, found.average),
    )
    checks = tuple(
        Check(f"end point {axis}, {model} model", end[i], float(path[-1, i]), "m", 0.05, True)
        for model, end, path in pairs
        for i, axis in enumerate("xy")
    )
    panels = tuple(
        Panel(
            f"({letter}) {model} model",
            "x (m)",
            "y (m)",
            (
                Curve("path", path[:, 0], path[:, 1]),
                Curve("target", np.array(TARGET_M[:1]), np.array(TARGET_M[1:]), "marks"),
            ),
            marks=(Mark(*end, "end point"),),
            equal=True,
        )
        for letter, (model, end, path) in zip("ab", pairs, strict=True)
    )
    held_s = np.append(np.repeat(found.bias_s, 2)[1:], DURATION_S)
    bias = Curve("bias", held_s, np.repeat(found.bias_rad, 2))
    return Result(
        checks,
        (
            Figure(
                "Fig. 5.10",
                "Proportional control to (2, 2) m, the bias updated every five seconds",
                (*panels, Panel("(c)", "time (s)", "bias (rad)", (bias,))),
            ),
        ),
        (
            (
                f"Gain {GAIN:g} and limit {LIMIT_RAD:g} rad are not published. They are where a "
                "search over gains 0.1 to 2 and limits 0.3 to 1.05 rad brings both end points "
                "nearest to the published ones: two numbers found from four, so this shows that "
                "the published ones can be had, and is no proof. A per cent of gain moves the end "
                "points by decimetres."
            ),
        ),
    )


def _tracked(name: str, runs: tuple[Tracked, ...]) -> tuple[Curve, ...]:
    """Paths of one panel as one curve with gaps, their starts, and where a controller took over."""
    gap = np.array([math.nan])
    x = np.concatenate([part for run in runs for part in (run.path.x_m, gap)])
    y = np.concatenate([part for run in runs for part in (run.path.y_m, gap)])
    starts = np.array([(run.path.x_m[0], run.path.y_m[0]) for run in runs])
    marks = [Curve("start", starts[:, 0], starts[:, 1], "marks")]
    for mode in Mode:
        places = np.array(
            [(x, y) for run in runs for at_s, x, y, to in run.switches if to is mode and at_s > 0]
        )
        if places.size:
            words = f"{mode.name.lower()} from here"
            marks.append(Curve(words, places[:, 0], places[:, 1], "marks"))
    return (Curve(name, x, y), *marks)


def fig_5_19(progress: Progress) -> Result:
    """Target at the origin, several starts with one heading; then a grid of poses."""
    parameters, law = chapter_5(), TrackingLaw(BEAT.amplitude_rad, BEAT.frequency_hz)
    runs = tuple(
        track(parameters, law, BEAT, Start(x, y), ((0.0, 0.0),), 400.0, number)
        for number, (x, y) in enumerate(STARTS_519_M)
    )
    progress(0.04)
    wide = success_grid(
        parameters, law, BEAT, 0.6, progress=lambda part: progress(0.04 + 0.48 * part)
    )
    near = success_grid(
        parameters, law, BEAT, 0.25, progress=lambda part: progress(0.52 + 0.48 * part)
    )
    arrived = sum(bool(run.reached_s) for run in runs)
    # Of the grids the source says nothing: they are told in the notes, and a test holds them.
    checks = (Check("starts that reach the target", 1.0, arrived / len(runs), "of all", 0.01),)
    paths = Panel("(a) paths", "x (m)", "y (m)", _tracked("path", runs), equal=True)
    times = Panel(
        "(b) time from every pose of the grids",
        "distance at the start (m)",
        "time (s)",
        (_times("within 0.6 m", wide), _times("within 0.25 m", near)),
    )
    return Result(
        checks,
        (Figure("Fig. 5.19", "Target tracking from different starts", (paths, times)),),
        (
            "Starts and gains are not published: chosen. A target counts as reached at 0.02 m.",
            (
                f"Grids: 7 × 7 places × 8 headings from rest, with the camera's noise; "
                f"{_words(wide)} within 0.6 m, {_words(near)} within 0.25 m."
            ),
        ),
    )


def _words(grid: tuple[Success, ...]) -> str:
    times = [run.reached_s for run in grid if run.reached_s is not None]
    slowest = f", after {max(times):.0f} s at most" if times else ""
    return f"{len(times)} of {len(grid)}{slowest}"


def _times(label: str, grid: tuple[Success, ...]) -> Curve:
    pairs = np.array(
        [(math.hypot(run.x_m, run.y_m), run.reached_s) for run in grid if run.reached_s is not None]
    ).reshape(-1, 2)
    return Curve(label, pairs[:, 0], pairs[:, 1], "marks")


def fig_5_21(progress: Progress) -> Result:
    """Four targets in a row with the servo's tail, as the experiment had a servo."""
    law = TrackingLaw(BEAT.amplitude_rad, BEAT.frequency_hz)
    run = track(PlantParameters(), law, BEAT, Start(*START_521_M), TARGETS_521_M, 300.0, seed=1)
    progress(1.0)
    targets = np.array(TARGETS_521_M)
    times = ", ".join(f"{at_s:.0f}" for at_s in run.reached_s)
    return Result(
        (Check("targets reached", 4.0, float(len(run.reached_s)), "targets", 0.1, True),),
        (
            Figure(
                "Fig. 5.21",
                "Several targets one after the other",
                (
                    Panel(
                        "",
                        "x (m)",
                        "y (m)",
                        (
                            *_tracked("path", (run,)),
                            Curve("targets", targets[:, 0], targets[:, 1], "marks"),
                        ),
                        equal=True,
                    ),
                ),
            ),
        ),
        (
            (
                "The source prints no coordinates: targets within 1.2 × 0.9 m as in its figure. "
                f"Reached after {times} s. The scenario track-targets swims it with the boards."
            ),
        ),
    )
