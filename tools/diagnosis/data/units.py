"""Units that cannot be: degrees for radians, minutes for seconds, centimetres for metres.

Magnitudes alone seldom tell, physics does: the heading must turn as fast as the gyro says, and the
robot must swim about as fast as the believed model, not a hundred times faster. What is wrong by
such a factor is refused with the line that mends it, since a factor that was guessed silently would
be worse than none.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tools.diagnosis.data.clock import FRAME_S
from tools.diagnosis.data.frequency import check_frequency
from tools.diagnosis.data.notice import DataError
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import FloatArray, Run

_DEGREE = math.pi / 180.0
_WINDOW_S = 0.5
_PATH_WINDOW_S = 2.0
_NEAR = 0.3
"""Share by which a factor may be off and still be meant."""
_LEAST_WINDOWS = 10
_LENGTHS = ((0.0254, "inches"), (0.01, "centimetres"), (0.001, "millimetres"))
_MODEL = 3.0
"""Factor by which a robot may swim faster or slower than it is believed to."""
_WRONG = 10.0
"""Factor by which it cannot."""
_STAYS_M, _NO_METRES = 0.2, 1e-3
_TURNS = 7.0
"""rad: angles in radians that are wrapped have no such range."""


def check_units(model: FishModel, runs: tuple[Run, ...]) -> None:
    """Refuse channels that are wrong by the factor of another unit."""
    names = [channel.name for channel in model.channels]
    for run in runs:
        # from rest: how it moved at first would be read from what may be in another unit
        believed = model.replay(replace(run, at_rest=True), {})
        check_frequency(run, names)
        _check_minutes(run, believed, names)
        _check_place(run, believed, names)
        _check_gps(run, believed, names)
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
    _, model_angle = _of(run, believed, names, name)
    model_turned = _turned(time_s, np.unwrap(model_angle), at_s)
    gyro = None
    if "gyro_z_rad_s" in names:
        gyro = _of(run, run.value, names, "gyro_z_rad_s")
    if gyro is not None and gyro[0].size > _LEAST_WINDOWS:
        steps = np.diff(gyro[0], prepend=gyro[0][0])
        reference, by = _turned(gyro[0], np.cumsum(gyro[1] * steps), at_s), "the gyro"
    else:
        # its start is fitted to these very data: it needs some time to swim as it is believed to
        settled = slice(turned.size // 3, None)
        turned, reference, by = turned[settled], model_turned[settled], "the believed robot"
    factor = _factor(turned, reference)
    usual = np.quantile(np.abs(model_turned), 0.75)
    fast = np.quantile(np.abs(turned), 0.75) * _DEGREE
    # on a straight way degrees are as small as radians: then the angle must be too fast, not the
    # gyro too slow
    too_fast = float(np.ptp(angle)) > _TURNS or (usual > 0.0 and _about(float(fast / usual)))
    if too_fast and _is(factor, 1.0 / _DEGREE):
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
    if _about(factor * _DEGREE):
        raise DataError(
            f"{run.name}, column gyro_z_rad_s: {factor:.1f} times the rate of the believed robot: "
            f"these are degrees per second; add [channels.gyro_z_rad_s] scale = {_DEGREE:.7g} to "
            "experiment.toml"
        )


def _check_place(run: Run, believed: FloatArray, names: list[str]) -> None:
    """Compare the speed of the path with that of the believed robot."""
    if "x_m" not in names or "y_m" not in names:
        return
    along = []
    for values in (run.value, believed):
        for name in ("x_m", "y_m"):
            time_s, place = _of(run, values, names, name)
            if time_s.size < _LEAST_WINDOWS or time_s[-1] - time_s[0] < 5.0:
                return
            at_s = _windows(time_s, _PATH_WINDOW_S)
            moved = np.diff(np.interp(at_s, time_s, place)) / _PATH_WINDOW_S
            along.append(math.sqrt(float(np.mean(np.square(moved)))))
    measured, usual = math.hypot(*along[:2]), math.hypot(*along[2:])
    if not usual >= 1e-3:
        return
    factor = measured / usual
    units = sorted(
        ((scale, unit) for scale, unit in _LENGTHS if _about(factor * scale)),
        key=lambda row: abs(math.log(factor * row[0])),
    )
    if not units:
        return
    wrong = [name for name, v in zip(("x_m", "y_m"), along[:2], strict=True) if v > _WRONG * usual]
    columns = (
        f"columns {' and '.join(wrong)}: move" if len(wrong) > 1 else f"column {wrong[0]}: moves"
    )
    meant = ", or else ".join(f"{unit} (scale = {scale:g})" for scale, unit in units)
    add = " and ".join(f"[channels.{name}]" for name in wrong)
    raise DataError(
        f"{run.name}, {columns} at {measured:.2g} m/s, {factor:.0f} times as fast as the believed "
        f"robot: these are {meant}; add that scale for {add} to experiment.toml"
        + ("" if len(wrong) > 1 else ", and look at the other one's unit")
    )


def _about(factor: float) -> bool:
    """Whether a factor is one as nearly as a robot swims as it is believed to."""
    return factor > 0.0 and abs(math.log(factor)) < math.log(_MODEL)


def _check_minutes(run: Run, believed: FloatArray, names: list[str]) -> None:
    """Refuse minutes: a camera that is too fast by far sees a robot that is, too."""
    for name in ("x_m", "y_m", "heading_rad"):
        if name not in names:
            continue
        time_s, values = _of(run, run.value, names, name)
        if time_s.size < _LEAST_WINDOWS or float(np.median(np.diff(time_s))) >= FRAME_S:
            continue
        _, usual = _of(run, believed, names, name)
        moved, expected = (
            float(np.median(np.abs(_turned(time_s, v, _windows(time_s, _WINDOW_S)))))
            for v in (np.unwrap(values) if name == "heading_rad" else values, usual)
        )
        if expected > 0.0 and moved > _WRONG * expected:
            raise DataError(
                f"{run.name}, column time_s: {1.0 / FRAME_S:.0f} pictures a second and "
                f"more, and a robot {moved / expected:.0f} times as fast as the believed one: "
                "these are minutes; add [channels.time_s] scale = 60 to experiment.toml"
            )


def _check_gps(run: Run, believed: FloatArray, names: list[str]) -> None:
    """Refuse latitude and longitude: a robot that moves by a metre moves by 1e-5 degrees."""
    gps = ("gps_x_m", "gps_y_m")
    if not all(name in names for name in gps):
        return
    ranges = []
    for values in (run.value, believed):
        each = [_of(run, values, names, name)[1] for name in gps]
        if any(v.size < _LEAST_WINDOWS for v in each):
            return
        ranges.append(max(float(np.ptp(v)) for v in each))
    moved, expected = ranges
    if expected > _STAYS_M and 0.0 < moved < _NO_METRES * expected:
        raise DataError(
            f"{run.name}, columns gps_x_m and gps_y_m: change by {moved:.1g} while the robot swims "
            f"some {expected:.1g} m: these are degrees of latitude and longitude; write metres "
            "along the tank's axes (111 320 m for a degree of latitude, times its cosine for one "
            "of longitude), or leave them out"
        )
