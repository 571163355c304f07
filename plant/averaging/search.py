"""Scaling of the forcing identified for any robot: the search of section 5.4.

For one beat the average model has two unknowns, K_force and K_moment, and has to meet two numbers
of the original dynamics, radius and period of the steady turn. ``match`` solves that exactly: the
rate Ω and the speed |Ω|R are given, so the moment balance gives K_moment, and the ratio of the two
force balances is one scalar equation for the angle of attack, which then gives K_force.
``blanket_search`` is what the source did: it tries a grid of pairs, keeps the one with the least
squared relative error of radius and period, and refines around it. Both agree to the grid's
resolution; the first takes microseconds.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from plant.arrays import FloatArray
from plant.averaging.average import mean_forces
from plant.averaging.dynamics import ORIGINAL, REDUCED, Dynamics, Reduced, Scaling, reduced
from plant.averaging.equilibrium import NoEquilibriumError
from plant.averaging.motion import steady_turn
from plant.checks import check_number
from plant.compiled import compiled, fixed_tuple
from plant.errors import InvalidParameterError
from plant.orbit import periodic_orbit
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat

LEAST_SCALE, MOST_SCALE = 0.01, 3.0
"""Range of both scalings that a blanket search covers."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A steady turn to be met: radius (m) and period (s)."""

    radius_m: float
    period_s: float

    def __post_init__(self) -> None:
        """Refuse what is no turn."""
        check_number("turn.radius_m", self.radius_m, above=0.0)
        check_number("turn.period_s", self.period_s, above=0.0)


@dataclass(frozen=True, slots=True)
class Match:
    """The scaling that makes the average model turn as the original does with one beat."""

    beat: TailBeat
    turn: Turn
    force: float
    moment: float


@dataclass(frozen=True, slots=True)
class BeatGrid:
    """Combinations of tail-beats, angles in degrees; the default are the source's 125."""

    frequencies_hz: Sequence[float] = (1.0, 2.0, 3.0, 4.0, 5.0)
    biases_deg: Sequence[float] = (10.0, 20.0, 30.0, 40.0, 50.0)
    amplitudes_deg: Sequence[float] = (10.0, 15.0, 20.0, 25.0, 30.0)

    def beats(self) -> tuple[TailBeat, ...]:
        """Every combination, amplitude fastest, then frequency, then bias."""
        return tuple(
            TailBeat.degrees(bias, amplitude, frequency)
            for bias in self.biases_deg
            for frequency in self.frequencies_hz
            for amplitude in self.amplitudes_deg
        )


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """Outcome of a search. ``force``, ``moment``: (biases, frequencies, amplitudes)."""

    grid: BeatGrid
    matches: tuple[Match, ...]
    force: FloatArray = field(repr=False)
    moment: FloatArray = field(repr=False)
    scaling: Scaling

    @property
    def moment_per_bias(self) -> FloatArray:
        """Mean K_moment of each bias (Table 5.1), shape (biases,)."""
        mean: FloatArray = self.moment.mean(axis=(1, 2))
        return mean


Reference = Callable[[PlantParameters, TailBeat], Turn]
"""Gives the turn that the average model has to meet."""


def original_turn(parameters: PlantParameters, beat: TailBeat) -> Turn:
    """Turn of the original dynamics (5.5), with the outer radius of its path.

    With the radius of the circle without ripples K_force comes out 1.8 % under the source's, with
    the path length of a turn 0.2 %, with the outer radius 0.6 % (docs/averaging.md).
    """
    steady = steady_turn(parameters, beat, ORIGINAL, steps_per_beat=96, tolerance=1e-8)
    if steady.outer_radius_m is None or steady.turn_period_s is None:
        raise NoEquilibriumError(f"{beat} does not turn")
    return Turn(steady.outer_radius_m, steady.turn_period_s)


def plant_turn(parameters: PlantParameters, beat: TailBeat) -> Turn:
    """Turn of the full plant, with the body motion in the tail forces and the coupling it has.

    An average model with this scaling stands for the dynamics of chapter 3, not for (5.5).
    """
    orbit = periodic_orbit(parameters, beat, 1.0 / (96.0 * beat.frequency_hz))
    if orbit.turn_radius_m is None or orbit.turn_period_s is None:
        raise NoEquilibriumError(f"{beat} does not turn")
    return Turn(orbit.turn_radius_m, orbit.turn_period_s)


def match(
    parameters: PlantParameters, beat: TailBeat, turn: Turn, full_tail: bool = False
) -> Match:
    """Scaling with which (5.30) turns with this radius and period, exactly.

    Raises ``NoEquilibriumError`` where no angle of attack below 90° lets it.
    """
    mean = mean_forces(parameters, beat, full_tail)
    p = reduced(parameters, beat.bias_rad, Dynamics())
    if beat.bias_rad == 0.0:
        raise InvalidParameterError("tail_beat.bias_rad", "a beat without bias does not turn")
    x, y = mean.x, abs(mean.y)
    omega = 2.0 * math.pi / turn.period_s
    speed = omega * turn.radius_m

    def needed(beta: float) -> tuple[float, float]:
        """Forces along and across the body that keep the turn going, for a positive bias."""
        u, v = speed * math.cos(beta), speed * math.sin(beta)
        drag, lift = p.c1 * speed, p.c2 * speed * beta
        return (
            p.m2 * v * omega + drag * u - lift * v,
            -p.m1 * u * omega + drag * v + lift * u,
        )

    def askew(beta: float) -> float:
        along, across = needed(beta)
        return along * y - across * x

    if askew(0.0) * askew(0.5 * math.pi) > 0.0:
        raise NoEquilibriumError(
            f"{beat}: no scaling turns with {turn.radius_m:.4g} m in {turn.period_s:.4g} s"
        )
    beta = float(brentq(askew, 0.0, 0.5 * math.pi, xtol=1e-14, rtol=1e-13))
    along, across = needed(beta)
    force = (along * x + across * y) / (x * x + y * y)
    if force <= 0.0:
        raise NoEquilibriumError(
            f"{beat}: {turn.radius_m:.4g} m in {turn.period_s:.4g} s needs a force against the "
            f"way (K_force {force:.4g})"
        )
    u, v = speed * math.cos(beta), speed * math.sin(beta)
    moment = p.j3 * p.c4 * omega * omega + p.munk * (p.m1 - p.m2) * u * v
    return Match(beat, turn, force, moment / abs(mean.moment))


@compiled
def _predict(p: Reduced, x: float, y: float, moment: float, most_steps: int) -> tuple[float, float]:
    """Radius and period of (5.30) without coupling for scaled forces (N) and moment (N·m).

    Fixed point of the two force balances along and across the way, which contracts where β is
    small against 1; −1 where it does not settle.
    """
    omega = math.sqrt(moment / (p.j3 * p.c4))
    beta = 0.0
    speed = math.sqrt(x / p.c1)
    for _ in range(most_steps):
        sine, cosine = math.sin(beta), math.cos(beta)
        brake = 0.5 * (p.m2 - p.m1) * omega * sine * cosine
        speed = (math.sqrt(brake * brake + p.c1 * (x * cosine + y * sine)) - brake) / p.c1
        mass = p.m1 * cosine * cosine + p.m2 * sine * sine
        h = -p.c2 * speed * beta + (y * cosine - x * sine) / speed + mass * omega
        # its slope but for the small terms
        step = h / (p.c2 * speed + (x * cosine + y * sine) / speed)
        beta += step
        if abs(step) < 1e-10:
            return speed / omega, 2.0 * math.pi / omega
    return -1.0, -1.0


@compiled
def _blanket(
    constants: FloatArray,
    x: float,
    y: float,
    moment: float,
    radius: float,
    period: float,
    points: int,
    levels: int,
    best: FloatArray,
) -> None:
    """Refine a grid of points² pairs ``levels`` times around its best; ``best`` (3,) takes it."""
    p = Reduced(*fixed_tuple(constants, REDUCED))
    # a radius goes with √(K_force/K_moment), a period with 1/√K_moment: even in logarithms
    low_f, high_f = math.log(LEAST_SCALE), math.log(MOST_SCALE)
    low_m, high_m = low_f, high_f
    best[2] = math.inf
    for _ in range(levels):
        step_f, step_m = (high_f - low_f) / (points - 1), (high_m - low_m) / (points - 1)
        for i in range(points):
            force = math.exp(low_f + i * step_f)
            for j in range(points):
                trial = math.exp(low_m + j * step_m)
                r, t = _predict(p, force * x, force * y, trial * moment, 200)
                if r < 0.0:
                    continue
                cost = (r / radius - 1.0) ** 2 + (t / period - 1.0) ** 2
                if cost < best[2]:
                    best[0], best[1], best[2] = force, trial, cost
        low_f, high_f = math.log(best[0]) - 3.0 * step_f, math.log(best[0]) + 3.0 * step_f
        low_m, high_m = math.log(best[1]) - 3.0 * step_m, math.log(best[1]) + 3.0 * step_m


def blanket_search(
    parameters: PlantParameters, beat: TailBeat, turn: Turn, points: int = 41, levels: int = 6
) -> Match:
    """The source's search: try pairs from 0.01 to 3 and refine around the best, down to 1e-5.

    For robots without the coupling, as chapter 5 has them. Raises ``InvalidParameterError``
    otherwise, and ``NoEquilibriumError`` where no pair comes within 1 % of radius and period.
    """
    p = reduced(parameters, beat.bias_rad, Dynamics())
    if p.munk != 0.0:
        raise InvalidParameterError(
            "hydrodynamics.munk_coupling", "the blanket search is for robots without; use match"
        )
    mean = mean_forces(parameters, beat)
    best = np.zeros(3)
    _blanket(
        np.array(p),
        mean.x,
        abs(mean.y),
        abs(mean.moment),
        turn.radius_m,
        turn.period_s,
        points,
        levels,
        best,
    )
    if not best[2] < 1e-4:
        raise NoEquilibriumError(
            f"{beat}: no scaling from {LEAST_SCALE:g} to {MOST_SCALE:g} comes near "
            f"{turn.radius_m:.4g} m in {turn.period_s:.4g} s"
        )
    return Match(beat, turn, float(best[0]), float(best[1]))


def identify(
    parameters: PlantParameters,
    grid: BeatGrid | None = None,
    reference: Reference = original_turn,
    matching: Callable[[PlantParameters, TailBeat, Turn], Match] = match,
    progress: Callable[[float], None] | None = None,
) -> Identified:
    """Search the scaling of a robot over a grid of beats, as section 5.4 does.

    K_force is the mean over all beats; K_moment the line through the means of each bias by least
    squares (one bias alone: a constant). ``reference``: whose turns are to be met; ``matching``:
    ``match`` or ``blanket_search``. Raises ``NoEquilibriumError`` with the beat that cannot be met.
    """
    grid = grid or BeatGrid()
    beats = grid.beats()
    if not beats:
        raise InvalidParameterError("grid", "a search needs at least one beat")
    matches = []
    for index, beat in enumerate(beats):
        matches.append(matching(parameters, beat, reference(parameters, beat)))
        if progress:
            progress((index + 1) / len(beats))
    shape = (len(grid.biases_deg), len(grid.frequencies_hz), len(grid.amplitudes_deg))
    force = np.array([item.force for item in matches]).reshape(shape)
    moment = np.array([item.moment for item in matches]).reshape(shape)
    biases = np.abs(np.radians(np.asarray(grid.biases_deg, dtype=np.float64)))
    means = moment.mean(axis=(1, 2))
    if biases.size > 1:
        slope, offset = np.polyfit(biases, means, 1)
    else:
        slope, offset = 0.0, means[0]
    return Identified(
        grid,
        tuple(matches),
        force,
        moment,
        Scaling(float(force.mean()), float(offset), float(slope)),
    )
