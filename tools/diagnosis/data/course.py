"""Whether a robot swims where it heads: a heading in degrees does not, however little it turns.

A fish drifts sideways a little; a strong current may carry it anywhere. So this is only said.
"""

from __future__ import annotations

import math

import numpy as np

from tools.diagnosis.data.notice import Notice
from tools.diagnosis.model import FloatArray, Run

_WINDOW_S = 2.0
_LEAST_MOVED_M = 0.03
"""In such a time, several times what a camera's noise and the sway of a beat make."""
_LEAST_WINDOWS = 8
_TOGETHER, _APART = 0.9, 0.5
"""Mean length of the resultant of unit vectors: 1 where all point one way, 0 anywhere."""


def check_course(run: Run, names: tuple[str, ...], notices: list[Notice]) -> None:
    """Say where the camera's headings and the path that it saw do not go together."""
    if not all(name in names for name in ("x_m", "y_m", "heading_rad")):
        return
    (t, x), (_, y), (at_s, heading) = (
        (run.time_s[run.channel == names.index(name)], run.value[run.channel == names.index(name)])
        for name in ("x_m", "y_m", "heading_rad")
    )
    if min(x.size, y.size, heading.size) < 2 or x.size != y.size:
        return
    edges = np.arange(t[0], t[-1], _WINDOW_S)
    if edges.size < 2:
        return
    dx, dy = np.diff(np.interp(edges, t, x)), np.diff(np.interp(edges, t, y))
    moving = np.hypot(dx, dy) > _LEAST_MOVED_M
    course = np.arctan2(dy, dx)
    found = [(c, heading[_within(at_s, a)]) for c, a in zip(course, edges[:-1], strict=True)]
    kept = [(c, h) for (c, h), m in zip(found, moving, strict=True) if m and h.size]
    if len(kept) < _LEAST_WINDOWS:
        return

    def together(scale: float) -> float:
        away = [np.mean(np.exp(1j * (scale * h - c))) for c, h in kept]
        return float(abs(np.mean(away)))

    if together(1.0) >= _APART:
        return
    degrees = together(math.pi / 180.0) > _TOGETHER
    hint = (
        "are these degrees? then add [channels.heading_rad] scale = 0.01745329"
        if degrees
        else "look at its unit and its sign, or think of a current"
    )
    notices.append(
        Notice(
            "course",
            f"{run.name}, column heading_rad: the robot does not swim where it heads; {hint}",
        )
    )


def _within(at_s: FloatArray, begin_s: float) -> np.ndarray:
    return (at_s >= begin_s) & (at_s < begin_s + _WINDOW_S)
