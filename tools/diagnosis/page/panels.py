"""What the pictures show: measured against simulated, what is left, and how white it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tools.diagnosis.fish.steady import SteadyInputs
from tools.diagnosis.model import FloatArray, IntArray
from tools.diagnosis.result import Diagnosis
from tools.diagnosis.whiteness import LAGS, autocorrelation, cross_correlation, names_of
from tools.studies.study import Curve, Panel, Ribbon, Style

PATH = ("x_m", "y_m")
MOST_POINTS = 240
"""Points of a curve: an eye sees no more in a picture of this size."""
BEYOND = 2.0
"""Half width of the bands, in standard deviations."""


def extended(diagnosis: Diagnosis) -> bool:
    """Whether there is an extended model to show."""
    return bool(diagnosis.values)


def path_panel(diagnosis: Diagnosis, run: int) -> Panel | None:
    """Return the path of a run in the tank; None where no camera saw it."""
    columns = [_rows(diagnosis, run, name) for name in PATH]
    if any(rows.size < 2 for rows in columns):
        return None
    count = min(rows.size for rows in columns)
    every = _every(count)
    x, y = (rows[:count][::every] for rows in columns)
    measured = diagnosis.problem.runs[run].value
    curves = [Curve("measured", measured[x], measured[y], "marks")]
    for label, replay, style in _replays(diagnosis, run):
        curves.append(Curve(label, replay[x], replay[y], style))
    return Panel("", "x / m", "y / m", tuple(curves), equal=True)


def channel_panel(diagnosis: Diagnosis, run: int, name: str) -> Panel | None:
    """Return a channel of a run over time, measured and simulated; None where it was not."""
    rows = _rows(diagnosis, run, name)
    if rows.size < 2:
        return None
    measured = diagnosis.problem.runs[run]
    channel = diagnosis.problem.model.channels[int(measured.channel[rows[0]])]
    rows = rows[:: _every(rows.size)]
    time_s = measured.time_s[rows]
    seen = _unwrapped(measured.value[rows], angle=channel.angle)
    curves = [Curve("measured", time_s, seen, "marks")]
    ribbons: list[Ribbon] = []
    for label, replay, style in _replays(diagnosis, run):
        told = replay[rows]
        if channel.angle:  # on the turn of the measured angle that is nearest
            told = seen + np.angle(np.exp(1j * (told - seen)))
        curves.append(Curve(label, time_s, told, style))
        if len(curves) == 2 + int(extended(diagnosis)):
            wide = BEYOND * diagnosis.traces.spread[run][rows]
            ribbons.append(Ribbon("95 % of runs", time_s, told - wide, told + wide))
    unit = f" / {channel.unit}" if channel.unit else ""
    return Panel("", "time / s", f"{name}{unit}", tuple(curves), ribbons=tuple(ribbons))


def whiteness_panel(diagnosis: Diagnosis, index: int) -> Panel | None:
    """Return the autocorrelation of a channel's innovations, before and after."""
    before = _innovations(diagnosis, diagnosis.traces.innovations_before, index)
    count = sum(series.size for series in before)
    if count < 2 * LAGS:
        return None
    lags = np.arange(1, LAGS + 1, dtype=np.float64)
    curves = [Curve("believed model", lags, autocorrelation(before), "dashed")]
    if extended(diagnosis):
        after = _innovations(diagnosis, diagnosis.traces.innovations_after, index)
        curves.append(Curve("extended model", lags, autocorrelation(after), "line"))
    edge = np.full(LAGS, BEYOND / np.sqrt(count))
    name = diagnosis.problem.model.channels[index].name
    ribbon = Ribbon("white noise", lags, -edge, edge)
    return Panel(name, "lag / samples", "autocorrelation", tuple(curves), ribbons=(ribbon,))


def cross_panel(diagnosis: Diagnosis, index: int) -> Panel | None:
    """Return how a channel's innovations follow the known signal that they follow most."""
    before = _innovations(diagnosis, diagnosis.traces.innovations_before, index)
    count = sum(series.size for series in before)
    if count < 2 * LAGS:
        return None
    problem = diagnosis.problem
    signals = [
        problem.model.signals(run, diagnosis.after.values(i)) for i, run in enumerate(problem.runs)
    ]
    lags = tuple(range(LAGS + 1))

    def against(series: list[FloatArray], name: str) -> FloatArray:
        known = [
            each[name][run.channel == index]
            for each, run in zip(signals, problem.runs, strict=True)
        ]
        return cross_correlation(series, known, lags)

    rated = [(float(np.max(np.abs(against(before, name)))), name) for name in names_of(signals)[0]]
    if not rated:
        return None
    name = max(rated)[1]
    x = np.array(lags, dtype=np.float64)
    curves = [Curve("believed model", x, against(before, name), "dashed")]
    if extended(diagnosis):
        after = _innovations(diagnosis, diagnosis.traces.innovations_after, index)
        curves.append(Curve("extended model", x, against(after, name), "line"))
    edge = np.full(x.size, BEYOND / np.sqrt(count))
    title = f"{problem.model.channels[index].name} and {name}"
    ribbon = Ribbon("unrelated", x, -edge, edge)
    return Panel(title, "lag / samples", "correlation", tuple(curves), ribbons=(ribbon,))


def steady(diagnosis: Diagnosis) -> bool:
    """Whether rows of steady-state tables were diagnosed, not runs."""
    return all(isinstance(run.inputs, SteadyInputs) for run in diagnosis.problem.runs)


def steady_panel(diagnosis: Diagnosis, index: int) -> Panel | None:
    """Return a column of the tables against the part of the beat that varies most."""
    problem = diagnosis.problem
    rows = [run.channel == index for run in problem.runs]
    beats: list[tuple[float, float, float]] = []
    for run, row in zip(problem.runs, rows, strict=True):
        inputs = run.inputs
        assert isinstance(inputs, SteadyInputs)
        told = [inputs.beats[i] for i in inputs.row[row]]
        beats += [(b.bias_rad, b.amplitude_rad, b.frequency_hz) for b in told]
    if len(beats) < 2:
        return None
    every = np.array(beats)
    values = np.array([len(np.unique(np.round(every[:, i], 6))) for i in range(3)])
    axis = int(np.argmax(values))
    x = np.degrees(every[:, axis]) if axis < 2 else every[:, axis]
    order = np.argsort(x, kind="stable")

    def column(parts: Sequence[FloatArray]) -> FloatArray:
        joined: FloatArray = np.concatenate([p[row] for p, row in zip(parts, rows, strict=True)])
        return joined[order]

    measured = column([run.value for run in problem.runs])
    spread = column([np.sqrt(fixed.variance) for fixed in problem.filters])
    alone = int(np.sum(values > 1)) <= 1
    curves = [Curve("measured, ± 2 σ", x[order], measured, "marks", BEYOND * spread)]
    told_of: list[tuple[str, Sequence[FloatArray], Style]] = [
        ("believed model", diagnosis.traces.replay_before, "dashed")
    ]
    if extended(diagnosis):
        told_of.append(("extended model", diagnosis.traces.replay_after, "line"))
    for label, replay, style in told_of:
        curves.append(Curve(label, x[order], column(replay), _style(style, joined=alone)))
    names = ("bias / °", "amplitude / °", "frequency / Hz")
    channel = problem.model.channels[index]
    return Panel(channel.name, names[axis], f"{channel.name} / {channel.unit}", tuple(curves))


def _style(style: Style, *, joined: bool) -> Style:
    return style if joined else "marks"


def _innovations(
    diagnosis: Diagnosis, series: tuple[FloatArray, ...], index: int
) -> list[FloatArray]:
    return [
        each[run.channel == index] for each, run in zip(series, diagnosis.problem.runs, strict=True)
    ]


def _replays(diagnosis: Diagnosis, run: int) -> list[tuple[str, FloatArray, Style]]:
    traces = diagnosis.traces
    shown: list[tuple[str, FloatArray, Style]] = [
        ("believed model", traces.replay_before[run], "dashed")
    ]
    if extended(diagnosis):
        shown.append(("extended model", traces.replay_after[run], "line"))
    return shown


def _rows(diagnosis: Diagnosis, run: int, name: str) -> IntArray:
    names = [channel.name for channel in diagnosis.problem.model.channels]
    if name not in names:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(diagnosis.problem.runs[run].channel == names.index(name))


def _every(count: int) -> int:
    return max(1, count // MOST_POINTS)


def _unwrapped(values: FloatArray, *, angle: bool) -> FloatArray:
    return np.unwrap(values) if angle else values
