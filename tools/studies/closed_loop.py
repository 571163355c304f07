"""The plant alone with somebody at the tail: swim a while, look, choose the next bias.

`steer` holds each bias for a while and then asks for the next: that is the proportional controller
of Fig. 5.10, every five seconds, and target tracking, every beat. `track` puts the robot's own law
and estimate (`procboard.applications`) behind a camera with noise and a compass with an offset, so
that what is counted here is the code that the robot runs; only boards and links are left out.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plant.arrays import FloatArray
from plant.camera import CameraParameters
from plant.divergence import diverged
from plant.errors import InvalidParameterError
from plant.integrate import motion_of, take_over
from plant.layout import Column
from plant.parameters import PlantParameters
from plant.servo import lag_share
from plant.tail_input import TailBeat, drive_of
from plant.trajectory import Start
from procboard.applications.tracking_estimate import PoseTrack
from procboard.applications.tracking_law import Mode, TrackingLaw

STEP_S = 5e-3
"""Of the integrator: the state is good to 1e-6 over a beat of 1 Hz (tests/plant)."""
REPORTS_PER_BEAT = 10
"""Of the navigation board, at 1 Hz."""
COMPASS_SIGMA_RAD = 0.01
"""Noise of the heading that the navigation board reports (assumed; its filter does better)."""

Decide = Callable[[float, FloatArray], float | None]
"""(time, rows of what was swum since the last decision) → bias, or None to end there."""


@dataclass(frozen=True, slots=True)
class Steered:
    """A path on the grid, columns as in `plant.layout.Column`, and the biases it was swum with."""

    time_s: FloatArray
    rows: FloatArray
    decided_s: tuple[float, ...]
    bias_rad: tuple[float, ...]

    @property
    def x_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.rows[:, int(Column.X)]

    @property
    def y_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.rows[:, int(Column.Y)]


def steer(
    parameters: PlantParameters,
    start: Start,
    beat: TailBeat,
    hold_s: float,
    duration_s: float,
    decide: Decide,
    step_s: float = STEP_S,
    phase_rad: float = 0.0,
) -> Steered:
    """Swim with the amplitude and frequency of ``beat`` and a bias that is chosen anew each hold.

    ``hold_s`` is rounded to whole steps. The phase runs on over every change. A real servo has the
    speed of its full pack. Raises ``DivergedError``, and ``InvalidParameterError`` for a delay of
    the command: the next bias would be chosen before the last one is in force.
    """
    servo = parameters.servo
    if servo.command_delay_s != 0.0:
        raise InvalidParameterError(
            "servo.command_delay_s",
            f"must be 0 where the bias is steered, got {servo.command_delay_s!r}",
        )
    motion = motion_of(parameters, step_s)
    state = motion.state(np.array(start.state()))
    each = max(1, round(hold_s / step_s))
    omega = 2.0 * math.pi * beat.frequency_hz
    limit = math.inf if servo.ideal else servo.speed_limit_rad_s(servo.high_voltage_v)
    rows = np.zeros((1, motion.width))
    pieces: list[FloatArray] = []
    decided_s: list[float] = []
    biases: list[float] = []
    before = None
    for k in range(math.floor(duration_s / (each * step_s) + 0.5)):
        first = k * each
        now_s = first * step_s
        if k == 0:  # a row of the start: nothing was swum yet
            rows[0, : Column.R + 1] = state[: Column.R + 1]
        bias = decide(now_s, rows)
        if bias is None:
            break
        decided_s.append(now_s)
        biases.append(bias)
        told = drive_of(
            TailBeat(bias, beat.amplitude_rad, beat.frequency_hz),
            phase_rad + omega * now_s,
            now_s,
            servo.command_lag_s,
            limit,
            before,
            lag_share(servo),
        )
        vector, last = take_over(parameters, motion, before, told, state), first + each
        before = told
        rows = np.empty((each + 1, motion.width))
        reached = motion.march(vector, first, first, last, state, rows, first, 1)
        if reached != last:
            raise diverged(parameters, vector, first, reached, step_s, state)
        pieces.append(rows[:-1])
    pieces.append(rows[-1:])
    path: FloatArray = np.concatenate(pieces)
    time_s = np.arange(path.shape[0], dtype=np.float64) * step_s
    return Steered(time_s, path, tuple(decided_s), tuple(biases))


@dataclass(frozen=True, slots=True)
class Instruments:
    """What the robot's law looks through: the camera's noise, lost poses, the reported heading."""

    led_noise_m: float = CameraParameters().led_noise_m
    led_baseline_m: float = CameraParameters().led_baseline_m
    heading_sigma_rad: float = COMPASS_SIGMA_RAD
    lost_poses: float = 0.0
    """Share of the poses that do not arrive."""


@dataclass(frozen=True, slots=True)
class Tracked:
    """Target tracking: the path, when each target was reached, where which controller took over."""

    path: Steered
    reached_s: tuple[float, ...]
    switches: tuple[tuple[float, float, float, Mode], ...]
    """(time, x, y, controller), the first one included."""


def track(
    parameters: PlantParameters,
    law: TrackingLaw,
    beat: TailBeat,
    start: Start,
    targets_m: tuple[tuple[float, float], ...],
    limit_s: float,
    seed: int = 0,
    instruments: Instruments | None = None,
    step_s: float = STEP_S,
) -> Tracked:
    """Swim to the targets in their order, a pose once a beat; stop at the last or after a while.

    The seed draws the noise, the compass's offset and the phase of the beat at the start.
    """
    seen = instruments or Instruments()
    beat_s = 1.0 / beat.frequency_hz
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0x7AC])))
    beats = math.ceil(limit_s / beat_s) + 1
    phase_rad, offset_rad = generator.uniform(-math.pi, math.pi, 2)
    leds = (seen.led_noise_m * generator.standard_normal((beats, 4))).tolist()
    compass = seen.heading_sigma_rad * generator.standard_normal((beats, REPORTS_PER_BEAT))
    arrives = (generator.random(beats) >= seen.lost_poses).tolist()
    poses = PoseTrack(beat_s, forget_s=5.0)
    waiting = list(targets_m)
    reached: list[float] = []
    switches: list[tuple[float, float, float, Mode]] = []
    mode: Mode | None = None

    def decide(now_s: float, rows: FloatArray) -> float | None:
        nonlocal mode
        count = len(rows) - 1
        number = round(now_s / beat_s)
        x, y, psi = (float(value) for value in rows[-1, : Column.PSI + 1])
        if count:
            step = [round(count * (i + 1) / REPORTS_PER_BEAT) for i in range(REPORTS_PER_BEAT)]
            headings = rows[step, int(Column.PSI)] + offset_rad + compass[number]
            for i, heading in enumerate(headings.tolist()):
                poses.take_heading(now_s - beat_s * (1 - step[i] / count), heading)
        if arrives[number]:
            front_x, front_y, rear_x, rear_y = leds[number]
            poses.take_pose(
                now_s,
                x + 0.5 * (front_x + rear_x),
                y + 0.5 * (front_y + rear_y),
                psi + (front_y - rear_y) / seen.led_baseline_m,
                round(1e3 * now_s),
            )
            while waiting and poses.passed_m(waiting[0]) <= law.gains.arrival_m:
                reached.append(now_s)
                waiting.pop(0)
                mode = None
        else:
            poses.carry_on(now_s)
        if not waiting:
            return None
        motion = poses.motion(waiting[0])
        if motion is None:
            return 0.0
        chosen, bias = law.step(Mode.TURNING if mode is None else mode, motion)
        if chosen is not mode:
            switches.append((now_s, x, y, chosen))
            mode = chosen
        return bias

    path = steer(parameters, start, beat, beat_s, limit_s, decide, step_s, phase_rad)
    return Tracked(path, tuple(reached), tuple(switches))


@dataclass(frozen=True, slots=True)
class Success:
    """One run of a grid of poses: where it began, and when it reached the target (None: never)."""

    x_m: float
    y_m: float
    heading_rad: float
    reached_s: float | None


def success_grid(
    parameters: PlantParameters,
    law: TrackingLaw,
    beat: TailBeat,
    reach_m: float,
    places: int = 7,
    headings: int = 8,
    limit_s: float = 400.0,
    instruments: Instruments | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Success, ...]:
    """Track the origin from rest at every pose of a grid.

    ``places``² within ±``reach_m``, each with ``headings`` all around.
    """
    axis = np.linspace(-reach_m, reach_m, places)
    turns = np.arange(headings) * 2.0 * math.pi / headings
    starts = [(float(x), float(y), float(psi)) for x in axis for y in axis for psi in turns]
    found = []
    for number, (x, y, psi) in enumerate(starts):
        swum = track(
            parameters, law, beat, Start(x, y, psi), ((0.0, 0.0),), limit_s, number, instruments
        )
        found.append(Success(x, y, psi, swum.reached_s[0] if swum.reached_s else None))
        if progress is not None:
            progress((number + 1) / len(starts))
    return tuple(found)
