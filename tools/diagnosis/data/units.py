"""Units that cannot be: degrees for radians, milliseconds for seconds, centimetres for metres.

Magnitudes alone seldom tell, physics does: the heading must turn as fast as the gyro says, and the
robot must swim about as fast as the believed model, not a hundred times faster. What is wrong by
such a factor is refused with the line that mends it, since a factor that was guessed silently would
be worse than none.
"""

from __future__ import annotations

import math

import numpy as np

from tools.diagnosis.data.notice import DataError
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray, Run

_DEGREE = math.pi / 180.0
_WINDOW_S = 0.5
_PATH_WINDOW_S = 2.0
_NEAR = 0.3
"""Share by which a factor may be off and still be meant."""
_LEAST_WINDOWS = 10


def check_units(model: FishModel, runs: tuple[Run, ...]) -> None:
    """Refuse channels that are wrong by the factor of another unit."""
    names = [channel.name for channel in model.channels]
    for run in runs:
        believed = model.replay(run, {})
        _check_place(run, believed, names)
        for name in ("heading_rad", "compass_rad"):
            if name in names:
                _check_angle(run, believed, names, name)
        if "gyro_z_rad_s" in names:
            _check_rate(run, believed, names)


def _of(run: Run, values: FloatArray, names: list[str], name: str) -> tuple[FloatArray, FloatArray]:
    here = run.channel == names.index(name)
    return run.time_s[here], values[here]


def _turned(time_s: FloatArray, angle: FloatArray, at_s: FloatArray) -> FloatArray:
    """By how much an angle changes in each window; wraps make outliers."""
    ends = np.interp(np.append(at_s, at_s[-1] + _WINDOW_S), time_s, angle)
    return np.diff(ends)


def _windows(time_s: FloatArray, length_s: float) -> FloatArray:
    return np.arange(time_s[0], time_s[-1] - length_s, length_s)


def _factor(part: FloatArray, whole: FloatArray) -> float | None:
    """Return the usual ratio where the whole is large; None where there is no usual one."""
    big = np.abs(whole) >= max(float(np.quantile(np.abs(whole), 0.6)), 1e-9)
    if np.sum(big) < _LEAST_WINDOWS:
        return None
    ratios = part[big] / whole[big]
    usual = float(np.median(ratios))
    scatter = float(np.median(np.abs(ratios - usual)))
    return usual if scatter < 0.3 * abs(usual) else None


def _is(factor: float | None, wanted: float) -> bool:
    return factor is not None and abs(math.log(max(abs(factor), 1e-12) / wanted)) < _NEAR


def _check_angle(run: Run, believed: FloatArray, names: list[str], name: str) -> None:
    """Compare a heading with the gyro, or with the believed motion where there is none."""
    time_s, angle = _of(run, run.value, names, name)
    if time_s.size < _LEAST_WINDOWS or time_s[-1] - time_s[0] < 5.0:
        return
    at_s = _windows(time_s, _WINDOW_S)
    turned = _turned(time_s, angle, at_s)
    gyro = None
    if "gyro_z_rad_s" in names:
        gyro = _of(run, run.value, names, "gyro_z_rad_s")
    if gyro is not None and gyro[0].size > _LEAST_WINDOWS:
        steps = np.diff(gyro[0], prepend=gyro[0][0])
        reference, by = _turned(gyro[0], np.cumsum(gyro[1] * steps), at_s), "the gyro"
    else:
        _, model_angle = _of(run, believed, names, name)
        reference, by = _turned(time_s, np.unwrap(model_angle), at_s), "the believed robot"
    factor = _factor(turned, reference)
    wide = float(np.ptp(angle)) > 7.0
    if wide and _is(factor, 1.0 / _DEGREE):
        sign = math.copysign(1.0, factor or 1.0)
        raise DataError(
            f"{run.name}, column {name}: turns {abs(factor or 0.0):.1f} times as fast as {by}: "
            f"these are degrees; add [channels.{name}] scale = {sign * _DEGREE:.7g} to "
            "experiment.toml"
        )
    if by == "the gyro" and factor is not None and factor < 0.0 and _is(factor, 1.0):
        raise DataError(
            f"{run.name}, column {name}: turns the other way than {by}; angles count "
            f"counter-clockwise: add [channels.{name}] scale = -1 to experiment.toml, or mend the "
            "sign of the gyro"
        )


def _check_rate(run: Run, believed: FloatArray, names: list[str]) -> None:
    """Compare the gyro with the believed motion."""
    _, rate = _of(run, run.value, names, "gyro_z_rad_s")
    _, usual = _of(run, believed, names, "gyro_z_rad_s")
    if rate.size < _LEAST_WINDOWS:
        return
    size = float(np.sqrt(np.mean(np.square(usual))))
    if size < 0.01:
        return
    factor = float(np.sqrt(np.mean(np.square(rate - np.mean(rate))))) / size
    if abs(math.log(max(factor, 1e-12) * _DEGREE)) < math.log(3.0):
        raise DataError(
            f"{run.name}, column gyro_z_rad_s: {factor:.1f} times the rate of the believed robot: "
            f"these are degrees per second; add [channels.gyro_z_rad_s] scale = {_DEGREE:.7g} to "
            "experiment.toml"
        )


def _check_place(run: Run, believed: FloatArray, names: list[str]) -> None:
    """Compare the speed of the path with that of the believed robot."""
    if "x_m" not in names or "y_m" not in names:
        return
    speeds = []
    for values in (run.value, believed):
        moved = 0.0
        for name in ("x_m", "y_m"):
            time_s, place = _of(run, values, names, name)
            if time_s.size < _LEAST_WINDOWS or time_s[-1] - time_s[0] < 5.0:
                return
            at_s = _windows(time_s, _PATH_WINDOW_S)
            moved += float(np.mean(np.square(np.diff(np.interp(at_s, time_s, place)))))
        speeds.append(math.sqrt(moved) / _PATH_WINDOW_S)
    if speeds[1] < 1e-3:
        return
    factor = speeds[0] / speeds[1]
    for scale, unit in ((0.01, "centimetres"), (0.001, "millimetres")):
        if abs(math.log(factor * scale)) < math.log(3.0):
            raise DataError(
                f"{run.name}, columns x_m and y_m: move at {speeds[0]:.2g} m/s, {factor:.0f} times "
                f"as fast as the believed robot: these are {unit}; add [channels.x_m] and "
                f"[channels.y_m] with scale = {scale:g} to experiment.toml"
            )
