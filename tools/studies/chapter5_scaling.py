"""Scaling of the forcing: Tables 5.1 and 5.3, Figs. 5.4 to 5.6.

Table 5.1 is found by the source's own search over its 125 beats; the figures, sections through the
same 125 results, by the exact solution that the search approaches. The source's K_moment are
multiples of 0.005/25: it searched a grid of 0.005, here the grid is refined until it no longer
shows.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from plant.averaging.motion import SteadyTurn, steady_turn
from plant.averaging.search import (
    BeatGrid,
    Identified,
    Reference,
    Turn,
    blanket_search,
    identify,
)
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat
from tools.studies.chapter5_models import heavy, part_of, robot
from tools.studies.study import (
    Check,
    Curve,
    Figure,
    FloatArray,
    Mark,
    Panel,
    Progress,
    Result,
    Surface,
)

TABLE_5_1 = {10.0: 0.0796, 20.0: 0.1596, 30.0: 0.2424, 40.0: 0.33, 50.0: 0.416}
"""Bias in degrees → mean K_moment."""

TABLE_5_3 = {10.0: (0.8780, 0.2500), 20.0: (0.8980, 0.4650), 30.0: (0.8980, 0.6100)}
"""Bias in degrees → K_force, K_moment of the robot of 0.622 kg at 20°, 1 Hz."""


def _circle(steady: SteadyTurn) -> float | None:
    return steady.turn_radius_m


def _length(steady: SteadyTurn) -> float | None:
    return steady.path_radius_m


def _reference(radius: Callable[[SteadyTurn], float | None]) -> Reference:
    """Turns of the original dynamics with another radius than the outer one."""

    def turn(parameters: PlantParameters, beat: TailBeat) -> Turn:
        steady = steady_turn(parameters, beat)
        radius_m, period_s = radius(steady), steady.turn_period_s
        if radius_m is None or period_s is None:
            raise ValueError(f"{beat}: the path does not turn")
        return Turn(radius_m, period_s)

    return turn


def table_5_1(progress: Progress) -> Result:
    """Table 5.1 and the fit to it, by the source's search."""
    searched = identify(robot(), matching=blanket_search, progress=part_of(progress, 0, 2))
    exact = identify(robot(), progress=part_of(progress, 1, 2))
    circle, length = (
        identify(robot(), BeatGrid(frequencies_hz=(1.0,)), _reference(radius)).scaling.force
        for radius in (_circle, _length)
    )
    scaling = searched.scaling
    moments = tuple(
        Check(f"mean K_moment at {bias:g}°", published, float(found), "", 0.02)
        for (bias, published), found in zip(
            TABLE_5_1.items(), searched.moment_per_bias, strict=True
        )
    )
    bias = np.array(list(TABLE_5_1))
    line = scaling.moment + scaling.moment_per_rad * np.radians(bias)
    apart = max(
        float(np.abs(searched.force - exact.force).max()),
        float(np.abs(searched.moment - exact.moment).max()),
    )
    return Result(
        checks=(
            Check("K_force, mean over 125 beats", 0.8485, scaling.force, "", 0.02),
            *moments,
            Check("K_moment = a + b α₀: a", -0.0074, scaling.moment, "", 1e-3, absolute=True),
            Check("K_moment = a + b α₀: b", 0.4831, scaling.moment_per_rad, "1/rad", 0.01),
        ),
        figures=(
            Figure(
                "Table 5.1",
                "Mean K_moment of each bias, and the line through them.",
                (
                    Panel(
                        "",
                        "bias (°)",
                        "mean K_moment",
                        (
                            Curve("line", bias, line),
                            Curve("found", bias, searched.moment_per_bias, "marks"),
                        ),
                        tuple(Mark(x, y, "") for x, y in TABLE_5_1.items()),
                    ),
                ),
            ),
        ),
        notes=(
            (
                "Radii to be met are outer radii of the path with its ripples; without the ripples "
                f"the mean K_force is {circle:.4f}, from the path length of a turn {length:.4f}. "
                "K_moment follows from the period alone."
            ),
            f"Search and exact solution of the same 125 pairs differ by at most {apart:.1e}.",
        ),
    )


def table_5_3(progress: Progress) -> Result:
    """Table 5.3: mass and inertia of the body doubled."""
    grid = BeatGrid((1.0,), tuple(TABLE_5_3), (20.0,))
    found = identify(heavy(), grid, matching=blanket_search, progress=progress)
    only_mass = replace(robot(), body=replace(robot().body, mass_kg=heavy().body.mass_kg))
    alone = float(identify(only_mass, BeatGrid((1.0,), (30.0,), (20.0,))).moment[0, 0, 0])
    rows = [
        check
        for (bias, (force, moment)), ours_f, ours_m in zip(
            TABLE_5_3.items(), found.force.ravel(), found.moment.ravel(), strict=True
        )
        for check in (
            Check(f"K_force at {bias:g}°", force, float(ours_f), "", 0.02),
            Check(f"K_moment at {bias:g}°", moment, float(ours_m), "", 0.02),
        )
    ]
    scaling = found.scaling
    return Result(
        checks=(
            *rows,
            Check("K′_force, mean", 0.891, scaling.force, "", 0.02),
            Check("K_moment = a + b α₀: a", 0.0817, scaling.moment, "", 2e-3, absolute=True),
            Check("K_moment = a + b α₀: b", 1.0313, scaling.moment_per_rad, "1/rad", 0.01),
        ),
        notes=(
            (
                "Amplitude 20°, 1 Hz. The inertia of the body is doubled with its mass, the added "
                f"inertia is not; with the mass alone K_moment at 30° would be {alone:.3f}."
            ),
        ),
    )


def _pair(
    name: str,
    caption: str,
    labels: tuple[str, str],
    axes: tuple[FloatArray, FloatArray],
    force: FloatArray,
    moment: FloatArray,
) -> Figure:
    """Surfaces (a) of K_force and (b) of K_moment, rows along the second axis."""
    return Figure(
        name,
        caption,
        (
            Surface("(a)", *labels, "K_force", *axes, force),
            Surface("(b)", *labels, "K_moment", *axes, moment),
        ),
    )


def _axes(found: Identified) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Biases (°), frequencies (Hz), amplitudes (°)."""
    grid = found.grid
    return np.array(grid.biases_deg), np.array(grid.frequencies_hz), np.array(grid.amplitudes_deg)


def bias_and_amplitude(progress: Progress) -> Result:
    """Fig. 5.4: at 1 Hz."""
    found = identify(robot(), BeatGrid(frequencies_hz=(1.0,)), progress=progress)
    bias, _, amplitude = _axes(found)
    force, moment = found.force[:, 0, :], found.moment[:, 0, :]
    change = float(np.ptp(moment, axis=1).max() / np.ptp(moment.mean(axis=1)))
    line = float(np.corrcoef(bias, moment.mean(axis=1))[0, 1])
    return Result(
        checks=(
            Check("mean K_force; 'nearly constant'", 0.8485, float(force.mean()), "", 0.02),
            Check("correlation of K_moment with the bias: 'linear'", 1.0, line, "", 0.01),
            Check(
                "change of K_moment over the amplitudes / over the biases: 'barely changes'",
                0.0,
                change,
                "",
                0.1,
                absolute=True,
            ),
        ),
        figures=(
            _pair(
                "Fig. 5.4",
                "Scaling over bias and amplitude; 1 Hz.",
                ("bias (°)", "amplitude (°)"),
                (bias, amplitude),
                force.T,
                moment.T,
            ),
        ),
        notes=(_range(force, "0.80 to 0.88"),),
    )


def bias_and_frequency(progress: Progress) -> Result:
    """Fig. 5.5: at 15° of amplitude."""
    found = identify(robot(), BeatGrid(amplitudes_deg=(15.0,)), progress=progress)
    bias, frequency, _ = _axes(found)
    force, moment = found.force[:, :, 0], found.moment[:, :, 0]
    return Result(
        checks=(
            Check(
                "change of K_force over the frequency: 'independence'",
                0.0,
                float(np.ptp(force, axis=1).max()),
                "",
                1e-3,
                absolute=True,
            ),
            Check(
                "change of K_moment over the frequency: 'independence'",
                0.0,
                float(np.ptp(moment, axis=1).max()),
                "",
                1e-3,
                absolute=True,
            ),
        ),
        figures=(
            _pair(
                "Fig. 5.5",
                "Scaling over bias and frequency; amplitude 15°.",
                ("bias (°)", "frequency (Hz)"),
                (bias, frequency),
                force.T,
                moment.T,
            ),
        ),
        notes=(
            _range(force, "0.80 to 0.84"),
            (
                "Without the coupling every term of (5.5) is quadratic in the speeds, so a faster "
                "beat swims the same path faster: the scaling does not know the frequency at all."
            ),
        ),
    )


def amplitude_and_frequency(progress: Progress) -> Result:
    """Fig. 5.6: at 20° of bias."""
    found = identify(robot(), BeatGrid(biases_deg=(20.0,)), progress=progress)
    _, frequency, amplitude = _axes(found)
    force, moment = found.force[0], found.moment[0]
    return Result(
        checks=(Check("mean K_moment", 0.1596, float(moment.mean()), "", 0.02),),
        figures=(
            _pair(
                "Fig. 5.6",
                "Scaling over frequency and amplitude; bias 20°.",
                ("frequency (Hz)", "amplitude (°)"),
                (frequency, amplitude),
                force.T,
                moment.T,
            ),
        ),
        notes=(_range(force, "0.82 to 0.87"),),
    )


def _range(force: FloatArray, bar: str) -> str:
    """Say over what K_force runs, here and by the colour bar of the source's picture."""
    return (
        f"K_force runs from {force.min():.3f} to {force.max():.3f}; the source's colour bar, {bar}."
    )
