"""The flexible tail by itself: its tip, its shape, what it costs (Figs. 4.7, 4.8, 4.13, 4.14).

The source holds the robot by a bracket. With the robot anchored in the tail forces, as published,
the tail moves alike on a swimming robot, so the same simulation serves. Positions are relative to
the joint; across is the body's y, along is towards the rear.
"""

import math
import time
from collections.abc import Sequence

import numpy as np

from plant.flexible.modes import shape
from plant.integrate import simulate
from plant.layout import ROW, Column
from plant.parameters import PlantParameters
from plant.robots import flexible_tail, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Trajectory
from tools.studies.study import Curve, Figure, FloatArray, Panel, Progress, Result, Style

MODES = 4
STEPS_PER_BEAT = 200
BASE_DEG, BASE_HZ = 13.6, 0.9
"""Base motion of Figs. 4.7 and 4.8 (assumed: that of Figs. 4.9 to 4.14; the source gives none)."""
SETTLED_BEATS = 10
TIMED_S, TIMED_STEP_S = 10.0, 1.67e-4
TIMED_REPEATS = 3
POINTS = 41
FRAMES = 6


def tip(progress: Progress) -> Result:
    """Fig. 4.7: displacement of the tip for three, four and five segments."""
    curves = []
    beat = TailBeat.degrees(0.0, BASE_DEG, BASE_HZ)
    ends: dict[int, FloatArray] = {}
    styles: dict[int, Style] = {5: "line", 4: "dashed", 3: "dotted"}
    for index, count in enumerate((5, 4, 3, 10)):
        tail = flexible_tail(count)
        t = simulate(
            wang2014_flexible(tail),
            TailProgramme.steady(beat),
            3.0,
            1.0 / (BASE_HZ * STEPS_PER_BEAT),
        )
        ends[count] = tail.length_m / count * -np.sin(_angles(t)).sum(axis=1)
        if count in styles:
            curve = Curve(f"{count} segments", t.time_s, 100.0 * ends[count], styles[count])
            curves.append(curve)
        progress((index + 1) / 4)
    apart = "; ".join(
        f"{count}: {1e3 * float(np.abs(ends[count] - ends[10]).max()):.2f} mm"
        for count in (3, 4, 5)
    )
    said = (
        f"Greatest distance to the tip of ten segments, by number of segments: {apart}. The source "
        "does not give the base's motion; 13.6° and 0.9 Hz are those of its other figures."
    )
    return Result(
        figures=(
            Figure(
                "Fig. 4.7",
                "Displacement of the tail's tip across the body; base 13.6°, 0.9 Hz, from rest.",
                (Panel("", "time (s)", "tip displacement (cm)", tuple(curves)),),
            ),
        ),
        notes=(said,),
    )


def cost(progress: Progress) -> Result:
    """Fig. 4.8: processor time of 10 s at 0.167 ms for two to six segments, measured here."""
    beat = TailProgramme.steady(TailBeat.degrees(0.0, BASE_DEG, BASE_HZ))
    counts = np.arange(2, 7)
    spent = np.zeros(counts.size)
    for index, count in enumerate(counts):
        parameters = wang2014_flexible(flexible_tail(int(count)))
        simulate(parameters, beat, 10 * TIMED_STEP_S, TIMED_STEP_S)  # compiles
        spent[index] = min(_seconds(parameters, beat) for _ in range(TIMED_REPEATS))
        progress((index + 1) / counts.size)
    caption = "Processor time for 10 s of the simulation of Fig. 4.7 at steps of 0.167 ms."
    curves = (Curve("measured on this machine", counts.astype(float), spent, "marks"),)
    top = 1.1 * float(spent.max())
    panel = Panel("", "number of segments", "processor time (s)", curves, y_range=(0.0, top))
    said = (
        "A measurement of this machine, different each time, and no check. The axis of the "
        "source's figure ends at 12 s (Simulink at 3.1 GHz); both grow with the number of segments."
    )
    return Result(figures=(Figure("Fig. 4.8", caption, (panel,)),), notes=(said,))


def _seconds(parameters: PlantParameters, beat: TailProgramme) -> float:
    begin = time.process_time()
    simulate(parameters, beat, TIMED_S, TIMED_STEP_S, save_every=100)
    return time.process_time() - begin


def shapes_slow(progress: Progress) -> Result:
    """Fig. 4.13: shapes over half a beat at 0.4 Hz, 14°."""
    return _shapes("Fig. 4.13", 14.0, 0.4, progress)


def shapes_fast(progress: Progress) -> Result:
    """Fig. 4.14: shapes over half a beat at 0.9 Hz, 13.6°."""
    return _shapes("Fig. 4.14", 13.6, 0.9, progress)


def _shapes(name: str, amplitude_deg: float, frequency_hz: float, progress: Progress) -> Result:
    beat = TailProgramme.steady(TailBeat.degrees(0.0, amplitude_deg, frequency_hz))
    step = 1.0 / (frequency_hz * STEPS_PER_BEAT)
    duration = (SETTLED_BEATS + 0.5) / frequency_hz
    length = flexible_tail().length_m
    runs = []
    for modes, tail in enumerate((flexible_tail(), flexible_tail(1, MODES))):
        runs.append(simulate(wang2014_flexible(tail), beat, duration, step))
        progress(0.5 * (modes + 1))
    panels, apart = [], []
    for frame in range(FRAMES):
        share = 0.5 * frame / FRAMES
        row = round((SETTLED_BEATS + share) * STEPS_PER_BEAT)
        xs, ys = _segments(_angles(runs[0])[row], length)
        xb, yb = _beam(runs[1], row, length)
        apart.append(math.hypot(xs[-1] - xb[-1], ys[-1] - yb[-1]))
        panels.append(
            Panel(
                f"({'abcdef'[frame]}) {1e3 * share / frequency_hz:.0f} ms",
                "along (cm)",
                "across (cm)",
                (
                    Curve("five segments", 100.0 * xs, 100.0 * ys),
                    Curve("beam", 100.0 * xb, 100.0 * yb, "dashed"),
                ),
                equal=True,
            )
        )
    caption = (
        "Shape of the tail at six moments of half a beat, from where the base passes the middle; "
        f"{amplitude_deg:g}°, {frequency_hz:g} Hz."
    )
    said = (
        f"Tips of both models are at most {1e3 * max(apart):.1f} mm apart, "
        f"{100.0 * max(apart) / length:.1f} % of the length."
    )
    return Result(figures=(Figure(name, caption, tuple(panels)),), notes=(said,))


def _angles(t: Trajectory) -> FloatArray:
    """Angles of all segments (n, N): the base's, then those of the joints."""
    bend = (t.rows.shape[1] - ROW) // 2
    return np.hstack([t.rows[:, int(Column.ALPHA), None], t.rows[:, ROW : ROW + bend]])


def _segments(angles: FloatArray, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Ends of the segments from the joint on, along and across (m)."""
    part = length_m / angles.size
    along = np.concatenate(([0.0], np.cumsum(part * np.cos(angles))))
    across = np.concatenate(([0.0], np.cumsum(-part * np.sin(angles))))
    return along, across


def _beam(t: Trajectory, row: int, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Line of the beam: τ m̂ + w(τ) n̂, along and across (m)."""
    angle = float(t.rows[row, int(Column.ALPHA)])
    amplitudes: Sequence[float] = t.rows[row, ROW : ROW + MODES].tolist()
    x = np.linspace(0.0, 1.0, POINTS)
    w = np.zeros(POINTS)
    for mode, eta in enumerate(amplitudes):
        w += eta * np.array([shape(mode + 1).value(float(part)) for part in x])
    sine, cosine = math.sin(angle), math.cos(angle)
    return x * length_m * cosine - w * sine, -x * length_m * sine - w * cosine
