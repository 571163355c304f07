"""What instruments make of a path: own rates and phases, noise, steps, and what is wrong with them.

Camera: two LEDs, 1 mm of noise each axis, 0.1 m apart, in steps of 0.1 mm (``plant.camera``). Gyro:
the LPY503AL's noise density over its bandwidth, through a 12-bit converter at 3.3 V. Compass: the
LSM303DLH's field noise in a horizontal field of 20 µT, in its steps. Small errors of calibration,
as a careful laboratory leaves them, are in every instrument (``Calibration``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from plant.arrays import FloatArray
from tools.practice.swim import STEP_S
from tools.records.data import Series

CAMERA_HZ, GYRO_HZ, COMPASS_HZ = 30.0, 50.0, 20.0
LED_NOISE_M, LED_BASELINE_M, CENTROID_STEP_M = 1e-3, 0.10, 1e-4
GYRO_NOISE_RAD_S = math.radians(0.014 * math.sqrt(0.5 * math.pi * 140.0))
GYRO_STEP_RAD_S = math.radians(3.3 / 4096 / 8.3e-3)
COMPASS_NOISE_RAD = 0.010  # 0.2 µT across and along in a field of 20 µT
COMPASS_STEP_RAD = 0.0047  # one count of 1055/gauss in that field


@dataclass(frozen=True, slots=True)
class Instruments:
    """What is wrong with the instruments: names and meanings are those of the causes.

    In no table are: a gyro whose bias runs away (``gyro_drift_rad_s2``), or that saturates near a
    rate of 1/``gyro_limit_s_rad``; a lens whose scale falls with the square of the distance
    (``lens_per_m2``); iron under the tank's floor at ``iron_at_m`` that turns the compass by
    ``iron_rad`` beside it, within ``iron_reach_m``; a compass that is late. With ``rounded`` off
    numbers have no steps: of two experiments that hardly differ, steps would make their difference
    noisy.
    """

    gyro_bias_rad_s: float = 0.0
    gyro_scale: float = 0.0
    compass_offset_rad: float = 0.0
    hard_iron: tuple[float, float] = (0.0, 0.0)
    soft_iron: tuple[float, float] = (0.0, 0.0)
    camera_scale: float = 0.0
    camera_rotation_rad: float = 0.0
    camera_delay_s: float = 0.0
    clock_drift: float = 0.0
    hold_s: float = 0.0
    gyro_drift_rad_s2: float = 0.0
    gyro_limit_s_rad: float = 0.0
    lens_per_m2: float = 0.0
    iron_rad: float = 0.0
    iron_at_m: tuple[float, float] = (0.0, 0.0)
    iron_reach_m: float = 0.3
    compass_delay_s: float = 0.0
    noise_scale: float = 1.0
    rounded: bool = True
    calibration: Calibration = field(default_factory=lambda: Calibration())


@dataclass(frozen=True, slots=True)
class Calibration:
    """Errors that a healthy laboratory has."""

    gyro_bias_rad_s: float = 0.0
    gyro_scale: float = 0.0
    compass_offset_rad: float = 0.0
    camera_scale: float = 0.0
    camera_rotation_rad: float = 0.0

    @classmethod
    def drawn(cls, generator: np.random.Generator) -> Calibration:
        """Draw those of one laboratory: uniform within what a calibration leaves over."""
        draw = generator.uniform
        return cls(
            gyro_bias_rad_s=math.radians(draw(-0.3, 0.3)),
            gyro_scale=draw(-0.01, 0.01),
            compass_offset_rad=math.radians(draw(-1.0, 1.0)),
            camera_scale=draw(-0.002, 0.002),
            camera_rotation_rad=math.radians(draw(-0.3, 0.3)),
        )


def measure(
    path: FloatArray, instruments: Instruments, generator: np.random.Generator
) -> dict[str, Series]:
    """Return the samples of every channel of a path on the grid of ``swim.STEP_S``."""
    last_s = (path.shape[0] - 1) * STEP_S
    look = CubicSpline(np.arange(path.shape[0]) * STEP_S, path)
    result: dict[str, Series] = {}
    result.update(_camera(look, last_s, instruments, generator))
    result["gyro_z_rad_s"] = _gyro(look, last_s, instruments, generator)
    result["compass_rad"] = _compass(look, last_s, instruments, generator)
    slower = 1.0 + instruments.clock_drift
    return {name: Series(each.time_s * slower, each.value) for name, each in result.items()}


def _times(rate_hz: float, last_s: float, generator: np.random.Generator) -> FloatArray:
    first = generator.uniform(0.0, 1.0 / rate_hz)
    count = math.floor((last_s - first) * rate_hz) + 1
    return first + np.arange(count) / rate_hz


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    return np.arctan2(np.sin(angle_rad), np.cos(angle_rad))


def _camera(
    look: CubicSpline, last_s: float, wrong: Instruments, generator: np.random.Generator
) -> dict[str, Series]:
    time_s = _times(CAMERA_HZ, last_s, generator)
    noise = wrong.noise_scale * LED_NOISE_M * generator.standard_normal((4, time_s.size))
    holds = generator.uniform(0.0, 1.0, time_s.size)
    seen = look(np.maximum(time_s - wrong.camera_delay_s, 0.0))
    x, y, heading = seen[:, 0], seen[:, 1], seen[:, 2]
    shrink = 1.0 - wrong.lens_per_m2 * (x * x + y * y)
    scale = (1.0 + wrong.camera_scale + wrong.calibration.camera_scale) * shrink
    turn = wrong.camera_rotation_rad + wrong.calibration.camera_rotation_rad
    centre = (
        scale * (x * math.cos(turn) - y * math.sin(turn)),
        scale * (x * math.sin(turn) + y * math.cos(turn)),
    )
    # The noise of both LEDs is isotropic and independent: that of their mean is given in the
    # tank's axes, that of their difference in the robot's. So a robot that is turned a little
    # keeps its noise, and two experiments that hardly differ do so in nothing but their effects.
    common, apart = noise[:2] / math.sqrt(2.0), noise[2:] / math.sqrt(2.0)
    cosine, sine = np.cos(heading + turn), np.sin(heading + turn)
    ahead, aside = 0.5 * LED_BASELINE_M + apart[0], apart[1]
    half = (ahead * cosine - aside * sine, ahead * sine + aside * cosine)
    step_m = CENTROID_STEP_M * wrong.rounded
    front = [_stepped(c + n + d, step_m) for c, n, d in zip(centre, common, half, strict=True)]
    rear = [_stepped(c + n - d, step_m) for c, n, d in zip(centre, common, half, strict=True)]
    values = {
        "x_m": 0.5 * (front[0] + rear[0]),
        "y_m": 0.5 * (front[1] + rear[1]),
        "heading_rad": np.arctan2(front[1] - rear[1], front[0] - rear[0]),
    }
    shown = _held(time_s, wrong.hold_s, holds)
    return {name: Series(time_s, value[shown]) for name, value in values.items()}


def _held(time_s: FloatArray, hold_s: float, draws: FloatArray) -> np.ndarray:
    """Index of the frame that each frame shows: the camera stalls again and again, up to hold_s."""
    shown = np.arange(time_s.size)
    if hold_s <= 0.0:
        return shown
    i = 0
    while i < time_s.size:
        until_s = time_s[i] + hold_s * draws[i]
        j = i + 1
        while j < time_s.size and time_s[j] <= until_s:
            shown[j] = i
            j += 1
        i = j
    return shown


def _stepped(value: FloatArray, step: float) -> FloatArray:
    return np.floor(value / step + 0.5) * step if step else value


def _gyro(
    look: CubicSpline, last_s: float, wrong: Instruments, generator: np.random.Generator
) -> Series:
    time_s = _times(GYRO_HZ, last_s, generator)
    noise = wrong.noise_scale * GYRO_NOISE_RAD_S * generator.standard_normal(time_s.size)
    rate = look(time_s)[:, 5]
    rate = rate / (1.0 + (wrong.gyro_limit_s_rad * rate) ** 4) ** 0.25
    rate = rate * (1.0 + wrong.gyro_scale + wrong.calibration.gyro_scale)
    bias = wrong.gyro_bias_rad_s + wrong.calibration.gyro_bias_rad_s
    rate = rate + bias + wrong.gyro_drift_rad_s2 * time_s
    return Series(time_s, _stepped(rate + noise, GYRO_STEP_RAD_S * wrong.rounded))


def _compass(
    look: CubicSpline, last_s: float, wrong: Instruments, generator: np.random.Generator
) -> Series:
    time_s = _times(COMPASS_HZ, last_s, generator)
    noise = wrong.noise_scale * COMPASS_NOISE_RAD * generator.standard_normal(time_s.size)
    state = look(np.maximum(time_s - wrong.compass_delay_s, 0.0))
    psi = state[:, 2]
    (hard, hard_at), (soft, soft_at) = wrong.hard_iron, wrong.soft_iron
    away = np.hypot(state[:, 0] - wrong.iron_at_m[0], state[:, 1] - wrong.iron_at_m[1])
    error = (
        wrong.compass_offset_rad
        + wrong.calibration.compass_offset_rad
        + hard * np.sin(psi - hard_at)
        + soft * np.sin(2.0 * psi - soft_at)
        + wrong.iron_rad * np.exp(-0.5 * (away / wrong.iron_reach_m) ** 2)
    )
    told = _stepped(psi + error + noise, COMPASS_STEP_RAD * wrong.rounded)
    return Series(time_s, _wrapped(told))


def healthy(generator: np.random.Generator) -> Instruments:
    """Return the instruments of one laboratory, with what its calibration left over."""
    return replace(Instruments(), calibration=Calibration.drawn(generator))
