"""The plant alone against real time, and against SciPy's ``solve_ivp`` with the same model.

Speed without accuracy is none, so every method runs with the longest step, or the loosest
tolerance, that keeps the state within 1e-6 of a tight-tolerance reference over the whole swim (as a
share of the largest value that each of x, y, heading, u, v, r takes). The table shows what was
reached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

from plant.arrays import FloatArray
from plant.integrate import simulate
from plant.parameters import PlantParameters
from plant.robots import wang2014, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from tools.benchmarks.measure import Effort, Figures, Row, best_s
from tools.benchmarks.models import (
    POSE_AND_VELOCITIES,
    RightHandSide,
    rigid_model,
    segment_model,
)

BEAT = TailBeat.degrees(20, 15, 0.9)
"""The source's turn: bias 20°, amplitude 15°, 0.9 Hz."""

ACCURACY = 1e-6
STEPS_S = (20e-3, 10e-3, 5e-3, 2e-3, 1e-3, 5e-4)
TOLERANCES = tuple(10.0**-k for k in range(3, 13))

_EVERY_S = 0.1  # the states are compared
_Method = Literal["DOP853", "LSODA", "Radau"]
_METHODS: tuple[_Method, ...] = ("DOP853", "LSODA", "Radau")


def rigid(effort: Effort) -> Figures:
    """Rigid tail, 20° bias, from rest."""
    reference = _scipy(rigid_model(wang2014(), BEAT), "DOP853", 1e-12, effort.swim_s)
    return _compared(effort, wang2014(), rigid_model, reference, _METHODS[:2])


def rigid_rows(figures: Figures) -> Sequence[Row]:
    """Ours and SciPy's."""
    return _rows("rigid tail", figures, "≥ 5,000 × real time")


def segments(effort: Effort) -> Figures:
    """Five segments with body motion in the tail forces, 20° bias, from rest."""
    published = wang2014_flexible()
    moving = replace(published.hydrodynamics, body_motion_in_tail=1.0)
    p = replace(published, hydrodynamics=moving)
    reference = _scipy(segment_model(p, BEAT), "Radau", 1e-10, effort.swim_s)
    return _compared(effort, p, segment_model, reference, _METHODS[1:])


def segments_rows(figures: Figures) -> Sequence[Row]:
    """Ours and SciPy's."""
    return _rows("five segments with body motion", figures, "≥ 500 × real time")


def default_step(effort: Effort) -> Figures:
    """The rigid tail at 1 ms, every step saved: what a study pays that asks for no accuracy."""
    programme = TailProgramme.steady(BEAT)
    simulate(wang2014(), programme, 1.0)
    (best,) = best_s(effort.repeats, lambda: simulate(wang2014(), programme, effort.swim_s))
    return {"ratio": effort.swim_s / best}


def default_step_rows(figures: Figures) -> Sequence[Row]:
    """As it is."""
    return [Row("rigid tail, 1 ms, all rows kept", f"{figures['ratio']:,.0f} × real time")]


def error(states: FloatArray, reference: FloatArray) -> float:
    """Largest difference of any state, as a share of the largest value that it takes."""
    return float((np.abs(states - reference).max(axis=0) / np.abs(reference).max(axis=0)).max())


def _ours(p: PlantParameters, step_s: float, swim_s: float) -> FloatArray:
    every = round(_EVERY_S / step_s)
    run = simulate(p, TailProgramme.steady(BEAT), swim_s, step_s, save_every=every)
    return run.rows[:, :POSE_AND_VELOCITIES]


def _scipy(
    model: tuple[RightHandSide, FloatArray], method: _Method, rtol: float, swim_s: float
) -> FloatArray:
    rhs, start = model
    solution = solve_ivp(
        rhs,
        (0.0, swim_s),
        start,
        method=method,
        t_eval=np.linspace(0.0, swim_s, round(swim_s / _EVERY_S) + 1),
        rtol=rtol,
        atol=1e-3 * rtol,
    )
    states: FloatArray = solution.y[:POSE_AND_VELOCITIES].T
    return states


def _compared(
    effort: Effort,
    p: PlantParameters,
    model_of: Callable[[PlantParameters, TailBeat], tuple[RightHandSide, FloatArray]],
    reference: FloatArray,
    methods: Sequence[_Method],
) -> Figures:
    """Speed and error of ours and of each method, at the accuracy wanted."""
    swim_s = effort.swim_s
    _ours(p, STEPS_S[0], 1.0)
    for step_s in STEPS_S:
        ours = error(_ours(p, step_s, swim_s), reference)
        if ours <= ACCURACY:
            break
    figures = {"step_s": step_s, "error": ours}
    runs: list[Callable[[], object]] = [partial(_ours, p, step_s, swim_s)]
    for method in methods:
        model = model_of(p, BEAT)
        for rtol in TOLERANCES:
            theirs = error(_scipy(model, method, rtol, swim_s), reference)
            if theirs <= ACCURACY:
                break
        figures |= {f"{method}_rtol": rtol, f"{method}_error": theirs}
        runs.append(partial(_scipy, model, method, rtol, swim_s))
    times = best_s(effort.repeats, *runs)
    (ours_s,) = best_s(10 * effort.repeats, runs[0])
    figures["ratio"] = swim_s / min(ours_s, times[0])
    return figures | {
        f"{method}_ratio": swim_s / time_s
        for method, time_s in zip(methods, times[1:], strict=True)
    }


def _rows(what: str, figures: Figures, wanted: str) -> Sequence[Row]:
    rows = [
        Row(
            f"{what}, steps of {1e3 * figures['step_s']:g} ms",
            f"{figures['ratio']:,.0f} × real time",
            wanted,
            f"{figures['error']:.0e}",
        )
    ]
    for method in _METHODS:
        if f"{method}_ratio" in figures:
            ratio = figures[f"{method}_ratio"]
            rows.append(
                Row(
                    f"  in solve_ivp, {method}, rtol {figures[f'{method}_rtol']:.0e}",
                    f"{ratio:,.0f} × real time",
                    f"(ours: {figures['ratio'] / ratio:,.0f} × as fast)",
                    f"{figures[f'{method}_error']:.0e}",
                )
            )
    return rows
