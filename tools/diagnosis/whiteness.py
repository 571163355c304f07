"""Is what is left white, and does it follow the inputs? Statistics, and where structure stands.

Per channel: the portmanteau sum of squared autocorrelations (Box and Pierce 1970); the largest
value of the periodogram (Fisher 1929), which a tone of any frequency raises; and for each known
signal (inputs, replayed states) the largest squared correlation with the innovations over a few
lags. Over the channels of one unit, and all runs: the largest value of the sum of their
periodograms, for what moves water or robot at one frequency shows a little in all of them. Their
distributions in healthy data come from the same draws as all else, because innovations of several
channels at different rates, with nuisances fitted, are not textbook white.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import gamma

from tools.diagnosis.evidence import Problem
from tools.diagnosis.model import FloatArray, IntArray

LAGS = 20
"""Number of lags, in samples of the channel."""
TONE_STEP_S = 0.02
"""Grid of the summed periodograms: tones up to 25 Hz."""
MOST_TONE = 1400.0
"""Beyond it probabilities are no numbers any more."""
CROSS_LAGS = (0, 1, 2, 4, 8, 16)
"""Lags at which signals are compared, in samples of the channel."""


def structure_names(
    problem: Problem, signals: Sequence[Mapping[str, FloatArray]]
) -> list[tuple[str, str]]:
    """Return (channel, signal) of each statistic; the first two of a channel have no signal.

    Tones in several channels stand last, with the first of these channels.
    """
    names = list(signals[0]) if signals else []
    every = [channel.name for channel in problem.model.channels]
    each = [(name, s) for name in every for s in ("", "", *names)]
    groups = [[every[i] for i in group] for group in alike(problem).values()]
    return [*each, *((group[0], f"a tone in {' and '.join(group)}") for group in groups)]


def structure_statistics(
    problem: Problem,
    residuals: Sequence[FloatArray],
    signals: Sequence[Mapping[str, FloatArray]],
) -> FloatArray:
    """Return the statistics in the order of `structure_names`."""
    found = []
    for index in range(len(problem.model.channels)):
        rows = [np.flatnonzero(run.channel == index) for run in problem.runs]
        mine = [residual[row] for residual, row in zip(residuals, rows, strict=True)]
        times = [run.time_s[row] for run, row in zip(problem.runs, rows, strict=True)]
        found += [portmanteau(mine), peak(mine, times)]
        for name in signals[0] if signals else ():
            series = [known[name][row] for known, row in zip(signals, rows, strict=True)]
            found.append(cross(mine, series))
    found += [tone(problem, residuals, group)[0] for group in alike(problem).values()]
    return np.array(found)


def autocorrelation(series: Sequence[FloatArray], lags: int = LAGS) -> FloatArray:
    """Return the autocorrelations at lags 1..lags, pooled over runs (zeros without data)."""
    energy = sum(float(s @ s) for s in series)
    if energy <= 0.0:
        return np.zeros(lags)
    return np.array(
        [sum(float(s[lag:] @ s[:-lag]) for s in series) / energy for lag in range(1, lags + 1)]
    )


def portmanteau(series: Sequence[FloatArray]) -> float:
    """Return n Σ ρ² over the lags."""
    count = sum(s.size for s in series)
    return float(count * np.sum(autocorrelation(series) ** 2))


def cross_correlation(
    series: Sequence[FloatArray], signal: Sequence[FloatArray], lags: Sequence[int] = CROSS_LAGS
) -> FloatArray:
    """Return correlations of the series with the signal some samples before, pooled over runs."""
    count = sum(s.size for s in series)
    if count == 0:
        return np.zeros(len(lags))
    mean = sum(float(np.sum(s)) for s in signal) / count
    centred = [s - mean for s in signal]
    energy = sum(float(s @ s) for s in series) * sum(float(s @ s) for s in centred)
    if energy <= 1e-20:
        return np.zeros(len(lags))
    totals = [
        sum(
            float(a[lag:] @ b[: b.size - lag])
            for a, b in zip(series, centred, strict=True)
            if a.size > lag
        )
        for lag in lags
    ]
    found: FloatArray = np.array(totals) / np.sqrt(energy)
    return found


def cross(series: Sequence[FloatArray], signal: Sequence[FloatArray]) -> float:
    """Return n times the largest squared correlation over the lags."""
    count = sum(s.size for s in series)
    return float(count * np.max(cross_correlation(series, signal) ** 2))


def spectrum(series: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (Hz) and the periodogram of one channel in one run (mean 1 if white).

    Samples are put on an even grid of their mean rate, which moves them by half a step at most.
    """
    length = float(time_s[-1] - time_s[0]) if time_s.size > 1 else 0.0
    if series.size < 8 or length <= 0.0:
        return np.zeros(0), np.zeros(0)
    step = length / (series.size - 1)
    slot = np.rint((time_s - time_s[0]) / step).astype(np.int64)
    even = np.bincount(slot, weights=series)
    power = np.abs(np.fft.rfft(even)) ** 2 / series.size
    frequency = np.asarray(np.fft.rfftfreq(even.size, step)[1:], dtype=np.float64)
    return frequency, np.asarray(power[1:], dtype=np.float64)


def peak(series: Sequence[FloatArray], times: Sequence[FloatArray]) -> float:
    """Return twice the largest value of the periodograms of all runs: a tone of any frequency.

    Twice it is −2 log of its probability in noise, as of ``tone``.
    """
    tops = [spectrum(s, t)[1] for s, t in zip(series, times, strict=True)]
    return 2.0 * float(max((np.max(top) for top in tops if top.size), default=0.0))


def alike(problem: Problem) -> dict[str, list[int]]:
    """Return the channels of each unit that were measured: what moves one will move the others."""
    found: dict[str, list[int]] = {}
    for index, channel in enumerate(problem.model.channels):
        if any((run.channel == index).any() for run in problem.runs):
            found.setdefault(channel.unit, []).append(index)
    return found


def tone(
    problem: Problem, residuals: Sequence[FloatArray], channels: Sequence[int]
) -> tuple[float, float]:
    """Return how improbable the largest sum of periodograms is at any frequency, and which (Hz).

    The sum is over channels and runs. It is told as −2 log of its probability at one frequency,
    where the sum of so many in noise is of a gamma law: that has the tail of χ² with two degrees of
    freedom, however many there are.
    """
    length = max(float(run.time_s[-1] - run.time_s[0]) for run in problem.runs)
    size = 1 << math.ceil(math.log2(2.0 * length / TONE_STEP_S + 2.0))
    total, count = np.zeros(size // 2), 0
    for run, residual in zip(problem.runs, residuals, strict=True):
        slot = np.rint((run.time_s - run.time_s[0]) / TONE_STEP_S).astype(np.int64)
        for row in (run.channel == index for index in channels):
            if row.any():
                even = np.bincount(slot[row], weights=residual[row], minlength=size)
                total += np.abs(np.fft.rfft(even)[1:]) ** 2 / float(np.sum(row))
                count += 1
    top = int(np.argmax(total))
    improbable = min(-2.0 * float(gamma.logsf(total[top], max(count, 1))), MOST_TONE)
    return improbable, (top + 1.0) / (size * TONE_STEP_S)


def describe(
    problem: Problem,
    residuals: Sequence[FloatArray],
    signals: Sequence[Mapping[str, FloatArray]],
    channel: int,
) -> str:
    """Say where the innovations of a channel are least like noise: regime, time and frequency."""
    rows: list[IntArray] = [np.flatnonzero(run.channel == channel) for run in problem.runs]
    mine = [residual[row] for residual, row in zip(residuals, rows, strict=True)]
    name = problem.model.channels[channel].name
    return f"in {name}, {_regime(mine, rows, signals)}, {_time(problem, mine, rows)}, " + (
        _frequency(problem, mine, rows)
    )


def _excess(values: FloatArray) -> float:
    """Return how unlike unit white noise these are: larger mean square or mean, in deviations."""
    if values.size < 8:
        return 0.0
    square = (float(values @ values) - values.size) / np.sqrt(2.0 * values.size)
    mean = abs(float(np.sum(values))) / np.sqrt(values.size)
    return max(float(square), float(mean))


def _regime(
    mine: Sequence[FloatArray],
    rows: Sequence[IntArray],
    signals: Sequence[Mapping[str, FloatArray]],
) -> str:
    best = (-np.inf, "in all regimes alike")
    everything = np.concatenate(list(mine))
    for name in signals[0] if signals else ():
        values = np.concatenate([s[name][row] for s, row in zip(signals, rows, strict=True)])
        low, high = np.quantile(values, [1.0 / 3.0, 2.0 / 3.0])
        if not high > low:
            continue
        for word, chosen in (("small", values <= low), ("large", values >= high)):
            excess = _excess(everything[chosen])
            edge = low if word == "small" else high
            sign = "below" if word == "small" else "above"
            if excess > best[0]:
                best = (excess, f"most where {name} is {word} ({sign} {edge:.3g})")
    return best[1]


def _time(problem: Problem, mine: Sequence[FloatArray], rows: Sequence[IntArray]) -> str:
    best = (-np.inf, "at all times alike")
    for run, series, row in zip(problem.runs, mine, rows, strict=True):
        if series.size < 16:
            continue
        time = run.time_s[row]
        for part in np.array_split(np.arange(series.size), 4):
            excess = _excess(series[part])
            if excess > best[0]:
                span = (
                    f"{time[part[0]] - run.time_s[0]:.0f} to {time[part[-1]] - run.time_s[0]:.0f}"
                )
                best = (excess, f"most in {run.name} from {span} s")
    return best[1]


def _frequency(problem: Problem, mine: Sequence[FloatArray], rows: Sequence[IntArray]) -> str:
    best = (-np.inf, 0.0)
    for run, series, row in zip(problem.runs, mine, rows, strict=True):
        frequency, power = spectrum(series, run.time_s[row])
        if frequency.size:
            top = int(np.argmax(power))
            best = max(best, (float(power[top]), float(frequency[top])))
    return f"strongest at {best[1]:.2g} Hz"
