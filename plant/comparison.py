"""What a real servo changes: from the ideal tail to the HS-5646WP in rungs, each adding one thing.

    ideal        the tail is where it is told to be (the model of chapter 3)
    lag          the servo's position loop and motor lag follow the beat continuously
    hold         the target is sampled at 50 Hz, held, and comes one frame late (servo PWM)
    speed limit  the servo turns no faster than its supply allows
    dead band    the whole servo

Lag comes before hold, since a tail without lag would jump at every frame with infinite speed, and
"held but ideal" has no meaning. The difference of each rung from the one before is what that thing
does. The rungs end where quantised pulses, filters and links of the boards begin. What is wrong
outside the servo (delay and lag of the command, the linkage, the water) is the same on each rung.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from plant.elementary import sincos
from plant.errors import InvalidParameterError
from plant.integrate import simulate
from plant.layout import Column
from plant.metrics import SteadyMotion, steady_motion
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Trajectory
from plant.vehicle import FS_PER_S, TRUTH_COLUMNS, Vehicle

FRAME_FS = FS_PER_S // 50
"""Servo frame: a pulse every 20 ms."""

_NO_LIMIT_RAD_S = 1e6


@dataclass(frozen=True, slots=True)
class Rung:
    """Steady motion with everything up to ``name``; changes are fractions (0.01 is 1 %).

    ``change_*``: against the rung before; ``total_*``: against the ideal tail. Radius entries are
    None where the path does not turn. ``amplitude_rad``: of the true tail angle, half its range.
    """

    name: str
    motion: SteadyMotion
    amplitude_rad: float
    change_speed: float
    total_speed: float
    change_radius: float | None
    total_radius: float | None


def hold_targets(
    parameters: PlantParameters, beat: TailBeat, duration_s: float, supply_v: float = 7.4
) -> Vehicle:
    """Drive a vehicle with the beat sampled once a frame, each sample sent a frame later."""
    vehicle = Vehicle(parameters, supply_v=supply_v)
    omega = 2.0 * math.pi * beat.frequency_hz
    vehicle.set_servo_target(0, beat.bias_rad)
    for frame in range(1, math.ceil(duration_s * FS_PER_S / FRAME_FS)):
        sampled_s = (frame - 1) * FRAME_FS / FS_PER_S
        angle = beat.bias_rad + beat.amplitude_rad * sincos(omega * sampled_s)[0]
        vehicle.set_servo_target(frame * FRAME_FS, angle)
        vehicle.advance(frame * FRAME_FS)
    return vehicle


def compare_servo(
    parameters: PlantParameters,
    beat: TailBeat,
    duration_s: float = 180.0,
    beats: float = 54.0,
    supply_v: float = 7.4,
) -> tuple[Rung, ...]:
    """Measure each rung over the last ``beats`` beats of a run from rest.

    ``parameters.servo`` is the servo to explain; 180 s let the motion settle (its slowest rate is
    that of the speed, about 10 s).
    """
    if parameters.servo.ideal:
        raise InvalidParameterError("servo.ideal", "an ideal servo leaves nothing to compare")
    servo = parameters.servo
    programme = TailProgramme.steady(beat)
    unlimited = replace(
        servo,
        dead_band_rad=0.0,
        extra_dead_band_rad=0.0,
        slowness_s_rad=0.0,
        low_voltage_speed_rad_s=_NO_LIMIT_RAD_S,
        high_voltage_speed_rad_s=_NO_LIMIT_RAD_S,
    )
    limited = replace(servo, dead_band_rad=0.0, extra_dead_band_rad=0.0)
    measured: list[tuple[str, SteadyMotion, float]] = []
    for name, kind in (("ideal", replace(unlimited, ideal=True)), ("lag", unlimited)):
        path = simulate(replace(parameters, servo=kind), programme, duration_s, save_every=10)
        measured.append((name, *_measure(path, beat, beats)))
    for name, kind in (("hold", unlimited), ("speed limit", limited), ("dead band", servo)):
        vehicle = hold_targets(replace(parameters, servo=kind), beat, duration_s, supply_v)
        path = _as_trajectory(vehicle, round(duration_s * FS_PER_S))
        measured.append((name, *_measure(path, beat, beats)))
    return _rungs(measured)


def _as_trajectory(vehicle: Vehicle, until_fs: int) -> Trajectory:
    """Truth of a vehicle in the form of a plain run."""
    truth = vehicle.truth(until_fs)
    rows = np.zeros((truth.shape[0], len(Column)))
    first = TRUTH_COLUMNS.index("x_m")
    rows[:, : Column.ALPHA_DOT + 1] = truth[:, first : first + Column.ALPHA_DOT + 1]
    return Trajectory(truth[:, 0], rows)


def _measure(path: Trajectory, beat: TailBeat, beats: float) -> tuple[SteadyMotion, float]:
    """Steady motion and tail amplitude of the last beats."""
    motion = steady_motion(
        path.time_s, path.x_m, path.y_m, path.heading_rad, beat.frequency_hz, beats
    )
    tail = path.tail_angle_rad[path.time_s >= path.time_s[-1] - beats / beat.frequency_hz]
    return motion, 0.5 * float(tail.max() - tail.min())


def _change(new: float | None, old: float | None) -> float | None:
    return new / old - 1.0 if new is not None and old is not None else None


def _rungs(measured: list[tuple[str, SteadyMotion, float]]) -> tuple[Rung, ...]:
    """Put each rung beside the one before and the first."""
    ideal = measured[0][1]
    before = ideal
    result = []
    for name, motion, amplitude in measured:
        result.append(
            Rung(
                name=name,
                motion=motion,
                amplitude_rad=amplitude,
                change_speed=motion.path_speed_m_s / before.path_speed_m_s - 1.0,
                total_speed=motion.path_speed_m_s / ideal.path_speed_m_s - 1.0,
                change_radius=_change(motion.turn_radius_m, before.turn_radius_m),
                total_radius=_change(motion.turn_radius_m, ideal.turn_radius_m),
            )
        )
        before = motion
    return tuple(result)
