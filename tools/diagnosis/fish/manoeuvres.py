"""Segments of manoeuvres that a robot can be told by tail-beats, and programmes made of them.

What separates causes is variety: speed (drag, current), curvature (lift, yaw drag, compass), rest
(biases of instruments, current), changes (delays, lags, lost commands), length (drifts, clocks) and
a wall. A programme is a scenario with its tail-beats sent by radio: an emulated robot, boards on
the bench and a robot in a tank take the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from plant.errors import PlantError
from plant.integrate import simulate
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start
from tools.configuration import BaseStation, Identity, Initial, Scenario, TimedTailBeat
from tools.configuration import TailBeat as FirstBeat
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.model import FloatArray, IntArray, Run
from tools.hil_section import Hil

NAME = "separating"
LONGEST_S = 60.0
_WALL_M = 0.10
"""From the wall: the scale on which a wall is felt (`wall_effect`)."""
_MARGIN_M = 0.15
"""A robot of 0.2 m keeps so far from the walls when it is not sent there (assumed)."""

Timed = tuple[float, TailBeat]


@dataclass(frozen=True, slots=True)
class Segment:
    """Beats with their durations (s); ``words`` say what is swum; ``wall``: beside one."""

    words: str
    beats: tuple[Timed, ...]
    wall: bool = False

    @property
    def duration_s(self) -> float:
        """Its length."""
        return sum(seconds for seconds, _ in self.beats)


def _beat(bias_deg: float, amplitude_deg: float = 15.0, frequency_hz: float = 0.9) -> TailBeat:
    return TailBeat.degrees(bias_deg, amplitude_deg, frequency_hz)


_REST = _beat(0.0, 0.0)


def _steady(words: str, seconds: float, beat: TailBeat, *, wall: bool = False) -> Segment:
    return Segment(f"{seconds:g} s {words}", ((seconds, beat),), wall)


def _in_turn(words: str, seconds: float, *beats: TailBeat) -> Segment:
    """Change between beats for ten seconds."""
    times = round(10.0 / seconds)
    turn = tuple((seconds, beats[i % len(beats)]) for i in range(times))
    return Segment(f"10 s {words}", turn)


SEGMENTS: tuple[Segment, ...] = (
    _steady("straight", 10.0, _beat(0.0)),
    _steady("straight", 20.0, _beat(0.0)),
    _steady("straight, slowly (0.6 Hz, 10°)", 10.0, _beat(0.0, 10.0, 0.6)),
    _steady("straight, fast (1.4 Hz, 20°)", 10.0, _beat(0.0, 20.0, 1.4)),
    *(
        _steady(f"turning at a bias of {b:+d}°", 10.0, _beat(b))
        for b in (-40, -20, -10, 10, 20, 40)
    ),
    *(_steady(f"turning at a bias of {b:+d}°", 20.0, _beat(b)) for b in (-25, 25)),
    _steady("turning slowly (bias 20°, 0.6 Hz, 22°)", 10.0, _beat(20.0, 22.0, 0.6)),
    _steady("turning fast (bias −20°, 1.4 Hz, 20°)", 10.0, _beat(-20.0, 20.0, 1.4)),
    Segment("4 s turning and 6 s at rest", ((4.0, _beat(20.0)), (6.0, _REST))),
    _in_turn("stop and go", 2.5, _beat(0.0, 20.0, 1.2), _REST),
    _in_turn("weaving (bias ±30°)", 2.5, _beat(30.0), _beat(-30.0)),
    _in_turn(
        "changing between 0.6 and 1.4 Hz", 2.5, _beat(10.0, 15.0, 0.6), _beat(10.0, 15.0, 1.4)
    ),
    _in_turn(
        "changing between 8° and 22° of amplitude", 2.5, _beat(-10.0, 8.0), _beat(-10.0, 22.0)
    ),
    _steady("straight along a wall", 20.0, _beat(0.0), wall=True),
)
"""The library. Bias and amplitude stay within 60° together, the navigation board's limit."""


def programme(segments: Sequence[Segment]) -> TailProgramme:
    """Return the beats of segments one after the other."""
    beats: list[TailBeat] = []
    starts: list[float] = []
    now = 0.0
    for segment in segments:
        for seconds, beat in segment.beats:
            if not beats or beats[-1] != beat:
                beats.append(beat)
                starts.append(now)
            now += seconds
    return TailProgramme(tuple(beats), tuple(starts))


def place(plant: PlantParameters, config: Scenario, segments: Sequence[Segment]) -> Start | None:
    """Return where to set the robot down so that it stays in the tank; None where it cannot."""
    (left, low), (width, height) = config.tank.corner_m, config.tank.size_m
    duration_s = sum(segment.duration_s for segment in segments)
    try:
        path = simulate(plant, programme(segments), duration_s, 0.01, Start(), 25)
    except PlantError:
        return None
    x, y = path.x_m, path.y_m
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        return None
    if any(segment.wall for segment in segments):
        start = Start(left + _MARGIN_M - float(x.min()), low + _WALL_M)
        low -= _MARGIN_M + 0.5 * _WALL_M  # it was sent there; it must not swim through it
    else:
        across, up = float(x.min() + x.max()), float(y.min() + y.max())
        start = Start(left + 0.5 * (width - across), low + 0.5 * (height - up))
    top = config.tank.corner_m[1] + height
    inside = (
        start.x_m + x.min() >= left + _MARGIN_M - 1e-9
        and start.x_m + x.max() <= left + width - _MARGIN_M
        and start.y_m + y.min() >= low + _MARGIN_M - 1e-9
        and start.y_m + y.max() <= top - _MARGIN_M
    )
    return start if inside else None


def intervals(runs: Sequence[Run], channels: int) -> list[float | None]:
    """Return the usual interval (s) between samples of each channel; None where none were."""
    found: list[float | None] = []
    for index in range(channels):
        steps = [np.diff(run.time_s[run.channel == index]) for run in runs]
        every = np.concatenate(steps) if steps else np.empty(0)
        found.append(float(np.median(every)) if every.size else None)
    return found


def blank(
    segments: Sequence[Segment],
    start: Start,
    names: Sequence[str],
    every_s: Sequence[float | None],
    supply_v: float | None = None,
) -> Run:
    """Return a run from rest that nobody has swum yet: its times and inputs, sampled as before."""
    duration_s = sum(segment.duration_s for segment in segments)
    there = {
        "x_m": start.x_m,
        "y_m": start.y_m,
        "gps_x_m": start.x_m,
        "gps_y_m": start.y_m,
        "heading_rad": start.heading_rad,
        "compass_rad": start.heading_rad,
    }
    times: list[FloatArray] = []
    indices: list[IntArray] = []
    values: list[FloatArray] = []
    for index, (name, step) in enumerate(zip(names, every_s, strict=True)):
        if step is None:
            continue
        count = max(int(duration_s / step), 2)
        times.append(np.arange(count, dtype=np.float64) * step)
        indices.append(np.full(count, index, dtype=np.int64))
        values.append(np.full(count, there.get(name, 0.0)))
    time_s = np.concatenate(times)
    order = np.argsort(time_s, kind="stable")
    return Run(
        NAME,
        time_s[order],
        np.concatenate(indices)[order],
        np.concatenate(values)[order],
        FishInputs(programme(segments), supply_v=supply_v),
    )


def as_scenario(
    believed: Scenario, segments: Sequence[Segment], start: Start, description: str
) -> Scenario:
    """Return the scenario: the believed robot, told the beats by radio, from a start."""
    told = programme(segments)
    first, *later = zip(told.starts_s, told.beats, strict=True)

    def numbers(beat: TailBeat) -> tuple[float, float, float]:
        return beat.bias_rad, beat.amplitude_rad, beat.frequency_hz

    names = ("bias_rad", "amplitude_rad", "frequency_hz")
    replace = msgspec.structs.replace
    station: BaseStation = replace(
        believed.base_station,
        tail_beats=tuple(
            TimedTailBeat(
                at_s=at,
                bias_rad=beat.bias_rad,
                amplitude_rad=beat.amplitude_rad,
                frequency_hz=beat.frequency_hz,
            )
            for at, beat in later
        ),
        targets=(),
    )
    return replace(
        believed,
        scenario=Identity(
            name=NAME,
            description=description,
            duration_s=sum(segment.duration_s for segment in segments),
            seed=believed.scenario.seed,
        ),
        initial=Initial(x_m=start.x_m, y_m=start.y_m, heading_rad=start.heading_rad % math.tau),
        procboard=replace(
            believed.procboard,
            application="open-loop",
            tail_beat=FirstBeat(**dict(zip(names, numbers(first[1]), strict=True))),
        ),
        base_station=station,
        hil=Hil(),
    )
