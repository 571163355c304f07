"""One experiment: a laboratory within its tolerances, six runs of varied manoeuvres, an effect.

Everything is drawn from one seed, in streams of their own for the robot, each run's manoeuvres,
water and instruments, so that the same experiment without its effect has the same noise: the
difference of the two is the effect alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plant.integrate import simulate
from plant.parameters import PlantParameters, Walls
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from tools.practice.hidden import HIDDEN, Laboratory, Shape
from tools.practice.instruments import healthy, measure
from tools.practice.swim import STEP_S, Water, disturbances, swim
from tools.records.data import Series

DURATION_S = 60.0
RUNS = 6
BEAT_COLUMNS = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
TOLERANCE = 0.03
"""The true robot's numbers lie this near those believed (uniform)."""

TOLERANCES: Mapping[str, tuple[str, ...]] = {
    "body": (
        "mass_kg",
        "hinge_distance_m",
        "wetted_area_m2",
        "yaw_inertia_kg_m2",
        "added_mass_surge_kg",
        "added_mass_sway_kg",
        "added_inertia_yaw_kg_m2",
    ),
    "tail": ("length_m", "depth_m"),
    "hydrodynamics": ("drag", "lift", "yaw_drag_n_m_s2"),
}

_TANK_M = 2.0  # wang2014: 4 m × 4 m about the origin
_LEAST_WALL_M, _ALONG_M = 0.05, 0.10
_ATTEMPTS = 200
_JUMPING = 0.1  # share of experiments whose tail jumps


@dataclass(frozen=True, slots=True)
class Effect:
    """What is hidden: a name of ``HIDDEN``, its size, and the shape drawn for it."""

    name: str
    size: float
    shape: Shape

    def parameters(self) -> dict[str, float]:
        """Its numbers, as the table of causes calls them."""
        return dict(HIDDEN[self.name].parameters(self.size, self.shape))


@dataclass(frozen=True, slots=True)
class Plan:
    """One run before it is swum."""

    programme: TailProgramme
    start: Start


def stream(seed: int, *keys: int) -> np.random.Generator:
    """Return the random numbers of one purpose."""
    return np.random.default_rng(np.random.SeedSequence([0xF15B, seed, *keys]))


def shape_of(name: str, seed: int) -> Shape:
    """Draw the shape of an effect for an experiment."""
    return HIDDEN[name].draw(stream(seed, 1, sorted(HIDDEN).index(name)))


def laboratory(seed: int) -> Laboratory:
    """Return the healthy laboratory of an experiment: true numbers near those believed."""
    draw = stream(seed, 2)
    believed = wang2014()
    parts = {}
    for section, names in TOLERANCES.items():
        part = getattr(believed, section)
        errors = {name: 1.0 + draw.uniform(-TOLERANCE, TOLERANCE) for name in names}
        parts[section] = replace(
            part, **{name: getattr(part, name) * factor for name, factor in errors.items()}
        )
    walls = Walls(x_min_m=-_TANK_M, y_min_m=-_TANK_M, x_max_m=_TANK_M, y_max_m=_TANK_M)
    robot: PlantParameters = replace(believed, walls=walls, **parts)
    return Laboratory(robot, healthy(stream(seed, 3)))


def water(seed: int) -> Water:
    """Return how restless the water of an experiment is."""
    draw = stream(seed, 4)
    return Water(
        force_n=math.exp(draw.uniform(math.log(2e-5), math.log(8e-5))),
        moment_n_m=math.exp(draw.uniform(math.log(4e-7), math.log(2e-6))),
        correlation_s=math.exp(draw.uniform(math.log(0.3), math.log(1.5))),
    )


def plan(seed: int, run: int, duration_s: float = DURATION_S) -> Plan:
    """Draw the manoeuvres of a run; those that would leave the tank are drawn again."""
    draw = stream(seed, 5, run)
    believed = wang2014()
    jumps = stream(seed, 10).random() < _JUMPING
    for _ in range(_ATTEMPTS):
        drawn = _manoeuvres(draw, run, duration_s, jumps)
        path = simulate(believed, drawn.programme, duration_s, 0.01, drawn.start, 50)
        farthest_m = max(float(np.abs(path.x_m).max()), float(np.abs(path.y_m).max()))
        if farthest_m <= _TANK_M - _LEAST_WALL_M:
            return drawn
    raise RuntimeError(f"no manoeuvre of run {run} of experiment {seed} stays in the tank")


def _manoeuvres(draw: np.random.Generator, run: int, duration_s: float, jumps: bool) -> Plan:
    """Four to seven beats; changes come where the tail passes its bias.

    A change keeps the bias of the run and the tail's speed there, amplitude times frequency, so
    that an ideal tail's motion has no jump. With ``jumps`` bias (by up to 20°) and speed jump: an
    ideal tail takes that without an impulse, any other does not, and the smallest lag is seen.
    Every third run begins with a straight course along a wall.
    """
    count = int(draw.integers(4, 8))
    lengths_s = draw.dirichlet(np.full(count, 4.0)) * duration_s
    along = run % 3 == 2
    bias, begin_s = (0.0 if along else draw.uniform(-40.0, 40.0)), 0.0
    speed = float(draw.uniform(10.0, 22.0))  # degrees × Hz
    beats, starts = [], []
    for index, length_s in enumerate(lengths_s.tolist()):
        first = along and index == 0
        frequency_hz = float(draw.uniform(0.6, 1.5))
        amplitude = min(speed / frequency_hz, 25.0)
        if not jumps:
            frequency_hz = speed / amplitude
        beats.append(TailBeat.degrees(bias, amplitude, frequency_hz))
        starts.append(begin_s)
        half_beats = max(2, round((20.0 if first else length_s) * 2.0 * frequency_hz))
        if half_beats % 2 and not jumps:
            half_beats += 1
        # on the grid of the swimmer: what is recorded of a command is when it was obeyed
        begin_s = STEP_S * round((begin_s + half_beats / (2.0 * frequency_hz)) / STEP_S)
        if jumps:
            bias = float(np.clip(bias + draw.uniform(-20.0, 20.0), -40.0, 40.0))
            speed = float(draw.uniform(10.0, 22.0))
    kept = sum(start < duration_s - 2.0 for start in starts)
    programme = TailProgramme(tuple(beats[:kept]), tuple(starts[:kept]))
    if along:
        return Plan(programme, Start(float(draw.uniform(-1.5, 0.5)), -_TANK_M + _ALONG_M))
    place = draw.uniform(-0.8, 0.8, 2)
    return Plan(programme, Start(float(place[0]), float(place[1]), float(draw.uniform(-3.1, 3.1))))


def arrived(programme: TailProgramme, share: float, draw: np.random.Generator) -> TailProgramme:
    """Return the programme without the commands that never came; the first one always came."""
    kept = [0, *(i for i in range(1, len(programme.beats)) if draw.random() >= share)]
    return TailProgramme(
        tuple(programme.beats[i] for i in kept), tuple(programme.starts_s[i] for i in kept)
    )


def swim_experiment(
    seed: int,
    effects: tuple[Effect, ...] = (),
    runs: int = RUNS,
    duration_s: float = DURATION_S,
    *,
    exact: bool = False,
) -> dict[str, dict[str, Series]]:
    """Swim an experiment with what is hidden in it: the channels of each run, by its name.

    ``exact`` instruments neither round nor are noisy.
    """
    lab = laboratory(seed)
    if exact:
        perfect = replace(lab.instruments, noise_scale=0.0, rounded=False)
        lab = replace(lab, instruments=perfect)
    for effect in effects:
        lab = HIDDEN[effect.name].change(lab, effect.size, effect.shape)
    restless = water(seed)
    swum: dict[str, dict[str, Series]] = {}
    for run in range(runs):
        planned = plan(seed, run, duration_s)
        told = arrived(planned.programme, lab.dropped, stream(seed, 6, run))
        current = lab.parameters.water
        start = Start.at_rest(
            current, planned.start.x_m, planned.start.y_m, planned.start.heading_rad
        )
        steps = round(duration_s / STEP_S)
        force = disturbances(restless, steps, stream(seed, 7, run))
        path = swim(lab.parameters, told, duration_s, start, force, lab.unlisted)
        samples = measure(path, lab.instruments, stream(seed, 8, run))
        slower = 1.0 + lab.instruments.clock_drift
        begins_s = np.array(planned.programme.starts_s) * slower
        told_beats = zip(*(_numbers(beat) for beat in planned.programme.beats), strict=True)
        for name, numbers in zip(BEAT_COLUMNS, told_beats, strict=True):
            samples[name] = Series(begins_s, np.array(numbers))
        swum[f"run{run + 1:02d}"] = samples
    return swum


def _numbers(beat: TailBeat) -> tuple[float, float, float]:
    return beat.bias_rad, beat.amplitude_rad, beat.frequency_hz
