"""The average model against the original dynamics: Figs. 5.1 to 5.3 and 5.7 to 5.12, Table 5.2.

Fig. 5.10, which closes a loop, is in a study of its own.
"""

import numpy as np

from plant.averaging.dynamics import (
    AVERAGE,
    CLASSICAL,
    ORIGINAL,
    PUBLISHED,
    PUBLISHED_HEAVY,
    SIMPLIFIED,
    Dynamics,
)
from plant.averaging.equilibrium import closed_form
from plant.averaging.geometric import first_order_path, first_order_turn
from plant.averaging.motion import Path, steady_turn, swim
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from tools.studies.chapter5_models import (
    agreement,
    average,
    heavy,
    original,
    pair,
    part_of,
    robot,
    sweep,
)
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

BEAT = TailBeat.degrees(20.0, 15.0, 1.0)
"""The beat of section 5.3 and Figs. 5.1 to 5.3."""

TABLE_5_2 = (
    (3.1181, 18.7749, 0.112114, 0.114017),
    (1.0955, 17.6312, 0.036991, 0.037648),
    (1.8308, 25.3103, 0.088677, 0.089746),
    (1.1385, 25.9040, 0.056431, 0.057084),
    (1.2914, 13.7375, 0.033976, 0.034661),
    (3.4704, 19.7953, 0.131556, 0.133695),
    (3.0845, 18.9117, 0.111713, 0.113599),
    (1.9513, 22.9263, 0.085645, 0.086837),
    (3.8507, 24.1873, 0.178275, 0.180581),
    (1.1033, 25.0937, 0.052984, 0.053632),
)
"""Frequency (Hz), amplitude (°), speed of the original and of the average model (m/s)."""

TABLE_5_2_TOLERANCE = 1e-6
"""m/s: one unit of the last printed digit."""

LAST_ROW = "original, 25.0937°, 1.1033 Hz"
TABLE_5_2_LAST_ROW = (
    "1.004e-6 m/s, where one unit of the last printed digit is 1e-6; the printed number is itself "
    "rounded by up to half a unit. Steps of 1, 0.5 and 0.1 ms give the same."
)

FIRST_ORDER_RADIUS = (
    "Not explained. The average gives this radius whether it is integrated exactly or with the "
    "printed approximations (5.22, 5.25), and its period agrees; the print of (5.23) and (5.24) is "
    "damaged."
)

_STYLES: tuple[Style, ...] = ("line", "dashed", "dotted")


def _path_panel(title: str, paths: tuple[tuple[str, Path], ...], *marks: Mark) -> Panel:
    curves = tuple(
        Curve(label, path.x_m, path.y_m, style)
        for (label, path), style in zip(paths, _STYLES, strict=False)
    )
    return Panel(title, "X (m)", "Y (m)", curves, marks, equal=True)


def averaging(progress: Progress) -> Result:
    """Fig. 5.1, with the numbers of section 5.3: which averages hold, and which does not."""
    parameters, programme = robot(), TailProgramme.steady(BEAT)
    simple = steady_turn(parameters, BEAT, SIMPLIFIED)
    printed = first_order_turn(parameters, BEAT, published=True)
    exact = first_order_turn(parameters, BEAT)
    progress(0.2)
    classical_dynamics = Dynamics(full_tail=False, scaling=CLASSICAL)
    full = swim(parameters, programme, 80.0, save_every=10)
    classical = swim(parameters, programme, 80.0, classical_dynamics, save_every=10)
    progress(0.4)
    first = first_order_path(parameters, BEAT, 80.0, ORIGINAL, Start(), steps_per_beat=40)
    classical_turn = steady_turn(parameters, BEAT, classical_dynamics)
    progress(1.0)
    return Result(
        checks=(
            Check("radius of (5.18)", 0.26776, _known(simple.outer_radius_m), "m", 0.003),
            Check("period of (5.18)", 59.7734, _known(simple.turn_period_s), "s", 0.003),
            Check(
                "radius, first-order average",
                0.270276,
                _known(printed.outer_radius_m),
                "m",
                0.003,
                known_difference=FIRST_ORDER_RADIUS,
            ),
            Check(
                "period, first-order average", 60.0873, _known(printed.turn_period_s), "s", 0.001
            ),
        ),
        figures=(
            Figure(
                "Fig. 5.1",
                "Path from rest at bias 20°, amplitude 15°, 1 Hz: the original dynamics, its "
                "classical average, and its first-order average besides.",
                (
                    _path_panel(
                        "",
                        (
                            ("original (5.5)", full),
                            ("classical average", classical),
                            ("first-order average", first),
                        ),
                    ),
                ),
            ),
        ),
        notes=(
            (
                "First-order average: closed form (5.23–5.25) with (5.22). Without that "
                f"approximation: {_known(exact.outer_radius_m):.6f} m, "
                f"{_known(exact.turn_period_s):.4f} s."
            ),
            (
                f"Classical average: {_known(classical_turn.turn_radius_m):.4f} m, "
                f"{_known(classical_turn.turn_period_s):.2f} s."
            ),
        ),
    )


def _known(value: float | None) -> float:
    """A radius or period of what does turn."""
    return float("nan") if value is None else value


def trajectory(progress: Progress) -> Result:
    """Fig. 5.2: path of the original dynamics from rest, and a part of it close up."""
    path = swim(robot(), TailProgramme.steady(BEAT), 80.0)
    progress(1.0)
    near = (path.y_m > -0.245) & (path.y_m < -0.205) & (path.x_m > 0.3)
    close = Path(path.time_s[near], path.rows[near])
    return Result(
        figures=(
            Figure(
                "Fig. 5.2",
                "Path of the body's centre from rest at bias 20°, amplitude 15°, 1 Hz: "
                "(a) 80 s, (b) close up.",
                (
                    _path_panel("(a)", (("original (5.5)", path),)),
                    _path_panel("(b)", (("original (5.5)", close),)),
                ),
            ),
        ),
        notes=(
            (
                "The source's axes show X from 0.35 m to 0.38 m close up and Y down to −0.5 m; "
                f"here X is {close.x_m.mean():.3f} m and the least Y {path.y_m.min():.3f} m. How "
                "the beat starts, which turns the whole circle about the origin, is not printed."
            ),
        ),
    )


def heading(progress: Progress) -> Result:
    """Fig. 5.3: heading of the same run."""
    path = swim(robot(), TailProgramme.steady(BEAT), 80.0, save_every=2)
    progress(1.0)
    close = (path.time_s >= 35.0) & (path.time_s <= 45.0)
    psi = path.heading_rad
    return Result(
        figures=(
            Figure(
                "Fig. 5.3",
                "Heading of the run of Fig. 5.2: (a) 80 s, (b) close up.",
                (
                    Panel(
                        "(a)",
                        "time (s)",
                        "heading (rad)",
                        (Curve("original (5.5)", path.time_s, psi),),
                        y_range=(-8.0, 2.0),
                    ),
                    Panel(
                        "(b)",
                        "time (s)",
                        "heading (rad)",
                        (Curve("original (5.5)", path.time_s[close], psi[close]),),
                    ),
                ),
            ),
        ),
    )


def surge(progress: Progress) -> Result:
    """Table 5.2: speed straight ahead of the original and the average model."""
    parameters = robot()
    checks = []
    errors, printed_errors = [], []
    for index, (frequency, amplitude, full, averaged) in enumerate(TABLE_5_2):
        beat = TailBeat.degrees(0.0, amplitude, frequency)
        ours = steady_turn(parameters, beat).speed_m_s
        ours_averaged = closed_form(parameters, beat).speed_m_s
        at = f"{amplitude:g}°, {frequency:g} Hz"
        checks += [
            Check(
                what,
                published,
                computed,
                "m/s",
                TABLE_5_2_TOLERANCE,
                absolute=True,
                known_difference=TABLE_5_2_LAST_ROW
                if what == "original, 25.0937°, 1.1033 Hz"
                else "",
            )
            for what, published, computed in (
                (f"original, {at}", full, ours),
                (f"average, {at}", averaged, ours_averaged),
            )
        ]
        errors.append(100.0 * (ours_averaged / ours - 1.0))
        printed_errors.append(100.0 * (averaged / full - 1.0))
        progress((index + 1) / len(TABLE_5_2))
    checks.append(
        Check("largest error of the average model", 2.0, max(errors), "%", 0.05, absolute=True)
    )
    return Result(
        checks=tuple(checks),
        notes=(
            (
                "Speeds of the original are net displacement over time in steady swimming. The "
                f"published errors run from {min(printed_errors):.2f} % to "
                f"{max(printed_errors):.2f} %, ours from {min(errors):.2f} % to "
                f"{max(errors):.2f} %."
            ),
        ),
    )


def over_bias(progress: Progress) -> Result:
    """Fig. 5.7: 20° to 40° of bias at 20°, 1 Hz."""
    bias = np.linspace(20.0, 40.0, 5)
    beats = [TailBeat.degrees(float(b), 20.0, 1.0) for b in bias]
    full = sweep(robot(), beats, original, part_of(progress, 0, 2))
    mean = sweep(robot(), beats, average(PUBLISHED), part_of(progress, 1, 2))
    return Result(
        figures=(
            pair(
                "Fig. 5.7",
                "Steady turning over the bias; amplitude 20°, 1 Hz.",
                "bias (°)",
                bias,
                (("original (5.5)", full), ("average (5.30)", mean)),
                (35.0, 80.0),
            ),
        ),
        notes=(agreement("high fidelity", mean, full),),
    )


def heavy_over_bias(progress: Progress) -> Result:
    """Fig. 5.8: mass and inertia doubled, 10° to 30° of bias at 20°, 1 Hz."""
    bias = np.linspace(10.0, 30.0, 5)
    beats = [TailBeat.degrees(float(b), 20.0, 1.0) for b in bias]
    return _heavy("Fig. 5.8", "amplitude 20°", "bias (°)", bias, beats, (40.0, 60.0), progress)


def heavy_over_amplitude(progress: Progress) -> Result:
    """Fig. 5.9: mass and inertia doubled, 10° to 50° of amplitude at 20°, 1 Hz."""
    amplitude = np.linspace(10.0, 50.0, 9)
    beats = [TailBeat.degrees(20.0, float(a), 1.0) for a in amplitude]
    return _heavy("Fig. 5.9", "bias 20°", "amplitude (°)", amplitude, beats, (25.0, 60.0), progress)


def _heavy(
    name: str,
    held: str,
    label: str,
    x: FloatArray,
    beats: list[TailBeat],
    tops: tuple[float, float],
    progress: Progress,
) -> Result:
    full = sweep(heavy(), beats, original, part_of(progress, 0, 2))
    mean = sweep(heavy(), beats, average(PUBLISHED_HEAVY), part_of(progress, 1, 2))
    return Result(
        figures=(
            pair(
                name,
                f"Steady turning of the robot of 0.622 kg; {held}, 1 Hz.",
                label,
                x,
                (("original (5.5)", full), ("average (5.30)", mean)),
                tops,
            ),
        ),
        notes=(agreement("match well", mean, full),),
    )


def forward(progress: Progress) -> Result:
    """Fig. 5.11: time for 50 cm at steady speed over the frequency."""
    frequency = np.linspace(0.9, 3.0, 8)
    times: list[tuple[float, float]] = []
    for index, item in enumerate(frequency):
        beat = TailBeat.degrees(0.0, 15.0, float(item))
        times.append(
            (
                0.5 / steady_turn(robot(), beat).speed_m_s,
                0.5 / closed_form(robot(), beat).speed_m_s,
            )
        )
        progress((index + 1) / frequency.size)
    full, mean = np.array(times).T
    apart = 100.0 * float(np.abs(mean / full - 1.0).max())
    return Result(
        checks=(
            Check(
                "largest difference of the average model: 'less than 2 %' in Table 5.2",
                0.0,
                apart,
                "%",
                2.0,
                absolute=True,
            ),
        ),
        figures=(
            Figure(
                "Fig. 5.11",
                "Time for 50 cm at steady speed; amplitude 15°.",
                (
                    Panel(
                        "",
                        "frequency (Hz)",
                        "time (s)",
                        (
                            Curve("original (5.5)", frequency, full),
                            Curve("average (5.30)", frequency, mean, "marks"),
                        ),
                        y_range=(0.0, 25.0),
                    ),
                ),
            ),
        ),
        notes=("The amplitude of this figure is not given; 15° is that of Fig. 5.12.",),
    )


def from_rest(progress: Progress) -> Result:
    """Fig. 5.12: from rest straight ahead at 15°, 0.9 Hz."""
    programme = TailProgramme.steady(TailBeat.degrees(0.0, 15.0, 0.9))
    duration_s = 30.0
    full = _run(robot(), programme, duration_s, ORIGINAL)
    progress(0.5)
    mean = _run(robot(), programme, duration_s, AVERAGE)
    progress(1.0)
    way = [float(np.hypot(path.x_m[-1], path.y_m[-1])) for path in (full, mean)]

    def panel(title: str, label: str, full_y: FloatArray, mean_y: FloatArray) -> Panel:
        return Panel(
            title,
            "time (s)",
            label,
            (
                Curve("original (5.5)", full.time_s, full_y),
                Curve("average (5.30)", mean.time_s, mean_y, "dashed"),
            ),
        )

    return Result(
        figures=(
            Figure(
                "Fig. 5.12",
                "From rest straight ahead; amplitude 15°, 0.9 Hz.",
                (
                    panel("(a)", "X (m)", full.x_m, mean.x_m),
                    panel("(b)", "Y (m)", full.y_m, mean.y_m),
                    Panel(
                        "(c)",
                        "X (m)",
                        "Y (m)",
                        (
                            Curve("original (5.5)", full.x_m, full.y_m),
                            Curve("average (5.30)", mean.x_m, mean.y_m, "dashed"),
                        ),
                    ),
                ),
            ),
        ),
        notes=(
            (
                "The first beat turns the original by "
                f"{np.degrees(float(full.heading_rad[-1])):.0f}°, which the average model, without "
                "a beat, does not know; the measured path drifts by up to 0.2 m as well. In 30 s "
                f"the average comes {100.0 * (way[1] - way[0]):.1f} cm farther than the original."
            ),
        ),
    )


def _run(
    parameters: PlantParameters, programme: TailProgramme, duration_s: float, dynamics: Dynamics
) -> Path:
    return swim(parameters, programme, duration_s, dynamics, save_every=4)
