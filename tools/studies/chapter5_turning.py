"""Steady turning from the algebraic equations (5.34): Figs. 5.14 to 5.16.

The average line is (5.34) as printed, with m_b as the mass that is carried round; the dashed line
takes the water along, which is the equilibrium of (5.30).
"""

from collections.abc import Sequence

import numpy as np

from plant.averaging.turning import steady_turning
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat
from tools.studies.chapter5_models import Turned, agreement, original, pair, part_of, robot, sweep
from tools.studies.study import FloatArray, Progress, Result


def as_printed(parameters: PlantParameters, beat: TailBeat) -> Turned:
    """(5.34) with the scaling of section 5.4."""
    turn = steady_turning(parameters, beat)
    return Turned(turn.turn_radius_m, turn.turn_period_s)


def with_added_mass(parameters: PlantParameters, beat: TailBeat) -> Turned:
    """(5.34) with the added masses."""
    turn = steady_turning(parameters, beat, added_mass=True)
    return Turned(turn.turn_radius_m, turn.turn_period_s)


def over_bias(progress: Progress) -> Result:
    """Fig. 5.14: 20° to 40° of bias at 15°, 0.9 Hz."""
    bias = np.linspace(20.0, 40.0, 9)
    beats = [TailBeat.degrees(float(b), 15.0, 0.9) for b in bias]
    held = "amplitude 15°, 0.9 Hz"
    return _turning("Fig. 5.14", held, "bias (°)", bias, beats, (40.0, 100.0), progress)


def over_frequency(progress: Progress) -> Result:
    """Fig. 5.15: 0.9 Hz to 3 Hz at 20°, 15°."""
    frequency = np.linspace(0.9, 3.0, 8)
    beats = [TailBeat.degrees(20.0, 15.0, float(f)) for f in frequency]
    held = "bias 20°, amplitude 15°"
    return _turning("Fig. 5.15", held, "frequency (Hz)", frequency, beats, (40.0, 100.0), progress)


def over_amplitude(progress: Progress) -> Result:
    """Fig. 5.16: 15° to 30° of amplitude at 20°, 0.9 Hz."""
    amplitude = np.linspace(15.0, 30.0, 7)
    beats = [TailBeat.degrees(20.0, float(a), 0.9) for a in amplitude]
    held = "bias 20°, 0.9 Hz"
    return _turning("Fig. 5.16", held, "amplitude (°)", amplitude, beats, (50.0, 100.0), progress)


def _turning(
    name: str,
    held: str,
    label: str,
    x: FloatArray,
    beats: Sequence[TailBeat],
    tops: tuple[float, float],
    progress: Progress,
) -> Result:
    parameters = robot()
    full = sweep(parameters, beats, original, part_of(progress, 0, 3))
    printed = sweep(parameters, beats, as_printed, part_of(progress, 1, 3))
    carried = sweep(parameters, beats, with_added_mass, part_of(progress, 2, 3))
    apart = [
        100.0 * max(abs(a.radius_m / b.radius_m - 1.0) for a, b in zip(line, full, strict=True))
        for line in (printed, carried)
    ]
    return Result(
        figures=(
            pair(
                name,
                f"Steady turning from (5.34); {held}.",
                label,
                x,
                (
                    ("original (5.5)", full),
                    ("average (5.34)", printed),
                    ("with added masses", carried),
                ),
                tops,
            ),
        ),
        notes=(
            agreement("capture the original dynamic model very well", printed, full),
            (
                f"Largest difference in radius: {apart[0]:.1f} % as printed, with m_b as the mass "
                f"that is carried round, {apart[1]:.1f} % with the added masses."
            ),
        ),
    )
