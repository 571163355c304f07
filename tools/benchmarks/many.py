"""Many robots and steady motions: ensembles, the periodic-orbit solver, the search of Table 5.1."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plant.arrays import FloatArray
from plant.ensemble import cores, simulate_ensemble
from plant.integrate import simulate
from plant.layout import Column
from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.parameters import PlantParameters
from plant.robots import COEFFICIENT_SETS, wang2014, wang2014_flexible
from plant.tail_input import TailBeat, TailProgramme
from tools.benchmarks.measure import Effort, Figures, Row, best_s

STEP_S = 5e-3
ORBIT_STEPS_S = (1e-3, STEP_S)
STEADY = 1e-8
"""A simulated motion counts as steady within this of the orbit, as a share of its velocities."""

_BIASES_DEG = (0.0, 20.0, 40.0)
_MOST_BEATS = 200


def ensemble(effort: Effort) -> Figures:
    """Parameter sets with other drags, 30 s at 5 ms each, final states kept."""
    drags = np.linspace(0.1, 0.5, effort.members)
    base = wang2014()
    robots = [
        replace(base, hydrodynamics=replace(base.hydrodynamics, drag=float(drag))) for drag in drags
    ]
    programme = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
    steps = round(effort.swim_s / STEP_S)

    def alone() -> FloatArray:
        ends = [
            simulate(p, programme, effort.swim_s, STEP_S, save_every=steps).rows[-1, :6]
            for p in robots
        ]
        return np.array(ends)

    def together(workers: int) -> FloatArray:
        ends = simulate_ensemble(
            robots, programme, effort.swim_s, STEP_S, save_every=0, workers=workers
        )
        ends.check()
        return ends.values[:, 0]

    if not np.array_equal(together(cores()), alone()):
        raise RuntimeError("an ensemble's member differs from the same robot alone")
    one_s, single_s, all_s = best_s(
        effort.repeats, alone, lambda: together(1), lambda: together(cores())
    )
    begin, used = time.perf_counter(), time.process_time()
    together(cores())
    used = (time.process_time() - used) / (time.perf_counter() - begin)
    # of all threads together: what workers cost each other, however many cores are free
    one_cpu_s, all_cpu_s = best_s(
        effort.repeats, alone, lambda: together(cores()), clock=time.process_time
    )
    return {
        "members": float(len(robots)),
        "swim_s": effort.swim_s,
        "one_worker": one_s / single_s,
        "all_workers": one_s / all_s,
        "cpu": all_cpu_s / one_cpu_s,
        "ratio": effort.swim_s * len(robots) / all_s,
        "cores": float(cores()),
        "busy": used,
    }


def ensemble_rows(figures: Figures) -> Sequence[Row]:
    """Speed per robot against one alone."""
    return [
        Row(
            f"ensemble of {figures['members']:,.0f}, one worker, per robot",
            f"{figures['one_worker']:.2f} × one alone",
            "≥ 1 × (but for noise)",
            "same bits",
        ),
        Row(
            f"  {figures['cores']:.0f} workers ({figures['busy']:.1f} cores were free)",
            f"{figures['all_workers']:.2f} × one alone",
            f"≥ {figures['cores']:.0f} × on free cores",
            "same bits",
        ),
        Row("  processor time per robot", f"{figures['cpu']:.2f} × one alone", "about 1 ×"),
        Row("  all robots together", f"{figures['ratio']:,.0f} × real time"),
    ]


def orbit(effort: Effort) -> Figures:
    """The periodic-orbit solver against simulating from rest until steady, same grid."""
    figures: Figures = {}
    for robot, p in _robots().items():
        for step_s in ORBIT_STEPS_S:
            for bias in _BIASES_DEG:
                ratio, solved, simulated, beats = _against_simulation(effort, p, bias, step_s)
                name = f"{robot}_{1e3 * step_s:g}_ms_{bias:g}_deg"
                figures |= {
                    f"{name}_ratio": ratio,
                    f"{name}_error": solved,
                    f"{name}_simulated": simulated,
                    f"{name}_beats": beats,
                }
    return figures


def _robots() -> dict[str, PlantParameters]:
    """The rigid tail, and five segments with the body's motion in the tail forces."""
    published = wang2014_flexible()
    moving = replace(published.hydrodynamics, body_motion_in_tail=1.0)
    return {"rigid": wang2014(), "segments": replace(published, hydrodynamics=moving)}


def _against_simulation(
    effort: Effort, p: PlantParameters, bias: float, step_s: float
) -> tuple[float, float, float, float]:
    """How much faster; error of the solved and of the simulated motion; beats until steady."""
    beat = TailBeat.degrees(bias, 15, 0.9)
    exact = periodic_orbit(p, beat, step_s, tolerance=1e-11)
    steps = exact.trajectory.time_s.size - 1
    grid_s = exact.step_s

    def swim(beats: int) -> FloatArray:
        duration_s = beats * steps * grid_s
        programme = TailProgramme.steady(beat)
        return simulate(p, programme, duration_s, grid_s, save_every=steps).rows

    errors = [_deviation(exact, row) for row in swim(_MOST_BEATS)]
    # nobody tells a simulation when it is steady; it is given the exact number of beats
    beats = next(k for k, value in enumerate(errors) if value <= STEADY)
    solved: list[PeriodicOrbit] = []

    def solve() -> None:
        solved.append(periodic_orbit(p, beat, step_s, tolerance=STEADY))

    solve_s, swim_s = best_s(3 * effort.repeats, solve, lambda: swim(beats), clock=time.thread_time)
    return swim_s / solve_s, _deviation(exact, solved[0].trajectory.rows[0]), errors[beats], beats


def _deviation(orbit: PeriodicOrbit, row: FloatArray) -> float:
    """Largest deviation of velocities from the orbit's begin, as a share of what they reach."""
    velocities = orbit.trajectory.rows[:, Column.U : Column.R + 1]
    reached = np.abs(velocities).max(axis=0)
    reached[:2] = reached[:2].max()
    return float(np.max(np.abs(row[Column.U : Column.R + 1] - velocities[0]) / reached))


def orbit_rows(figures: Figures) -> Sequence[Row]:
    """For each robot and step the range over the biases, and the slowest of them."""
    rows = []
    for robot, what in (("rigid", "rigid tail"), ("segments", "five segments")):
        for step_s in ORBIT_STEPS_S:
            names = [f"{robot}_{1e3 * step_s:g}_ms_{bias:g}_deg" for bias in _BIASES_DEG]
            slowest = min(names, key=lambda name: figures[f"{name}_ratio"])
            ratios = [figures[f"{name}_ratio"] for name in names]
            error = max(figures[f"{name}_error"] for name in names)
            rows.append(
                Row(
                    f"orbit, {what}, {1e3 * step_s:g} ms, bias 0°, 20°, 40°",
                    f"{min(ratios):.0f}–{max(ratios):.0f} × simulating",
                    "≥ 20 ×",
                    f"{error:.0e}",
                )
            )
            rows.append(
                Row(
                    "  simulating from rest until steady",
                    f"{figures[f'{slowest}_beats']:.0f} beats",
                    "",
                    f"{figures[f'{slowest}_simulated']:.0e}",
                )
            )
    return rows


def search(effort: Effort) -> Figures:
    """The scaling of Table 5.1 by the source's search over 125 beats."""
    from plant.averaging.search import BeatGrid, blanket_search, identify

    p: PlantParameters = replace(wang2014(), hydrodynamics=COEFFICIENT_SETS["chapter-5"])
    grid = BeatGrid(frequencies_hz=BeatGrid().frequencies_hz[: effort.search_frequencies])
    identify(p, BeatGrid((1.0,), (20.0,), (20.0,)), matching=blanket_search)
    found: list[float] = []

    def run() -> None:
        found.append(identify(p, grid, matching=blanket_search).scaling.force)

    (best,) = best_s(1, run)
    return {"wall_s": best, "beats": float(len(grid.beats())), "force": found[0]}


def search_rows(figures: Figures) -> Sequence[Row]:
    """Time, and the K_force that was found."""
    return [
        Row(
            f"Table 5.1 by search, {figures['beats']:.0f} beats, one core",
            f"{figures['wall_s']:.1f} s",
            "< 60 s on two cores",
            f"K_force {figures['force']:.4f}",
        )
    ]
