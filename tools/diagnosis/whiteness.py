"""Is what is left white, and does it follow the inputs? Statistics, and where structure stands.

Per channel: the portmanteau sum of squared autocorrelations (Box and Pierce 1970); the largest
value of the periodogram (Fisher 1929), which a tone of any frequency raises; and for each known
signal (inputs, replayed states) the largest squared correlation with the innovations over a few
lags. Over the channels of one unit, and all runs: the largest value of the sum of their
periodograms, for what moves water or robot at one frequency shows a little in all of them; and by
how much their means differ between regimes, such as places in the tank. Their distributions in
healthy data come from the same draws as all else, because innovations of several channels at
different rates, with nuisances fitted, are not textbook white.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import gamma

from tools.diagnosis.evidence import Problem
from tools.diagnosis.judging import one_parameter_scale
from tools.diagnosis.model import FloatArray, IntArray

LAGS = 20
"""Number of lags, in samples of the channel."""
TONE_STEP_S = 0.02
"""Grid of the summed periodograms: tones up to 25 Hz."""
TONE_WINDOW_HZ = 0.4
"""A tone is judged beside what lies within half of this on either side."""
LEAST_TONE = 1e-9
"""Power that a median is taken for at least: a channel that never moves has none."""
LEAST_SAMPLES = 20
"""A regime with fewer samples of a channel is not judged by them."""
MOST_TONE = 1400.0
"""Beyond it probabilities are no numbers any more."""
CROSS_LAGS = (0, 1, 2, 4, 8, 16)
"""Lags at which signals are compared, in samples of the channel."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """What is asked of some channels: in words, where a signal or a tone is meant."""

    channels: tuple[int, ...]
    signal: str = ""
    kind: str = "white"


def structure(
    problem: Problem, signals: Sequence[Mapping[str, FloatArray | IntArray]]
) -> list[Statistic]:
    """Return what is asked: of each channel, and of all that have a unit."""
    numbers, labels = names_of(signals)
    found = []
    for index in range(len(problem.model.channels)):
        found += [Statistic((index,)), Statistic((index,), "", "peak")]
        found += [Statistic((index,), n, "cross") for n in numbers]
    for group in alike(problem).values():
        found.append(Statistic(tuple(group), "", "tone"))
        found += [Statistic(tuple(group), n, "regimes") for n in labels]
    return found


def names_of(
    signals: Sequence[Mapping[str, FloatArray | IntArray]],
) -> tuple[list[str], list[str]]:
    """Return the names of the signals that are numbers, and of those that are labels."""
    kinds = {name: series.dtype.kind for name, series in signals[0].items()} if signals else {}
    return [n for n in kinds if kinds[n] != "i"], [n for n in kinds if kinds[n] == "i"]


def structure_statistics(
    problem: Problem,
    residuals: Sequence[FloatArray],
    signals: Sequence[Mapping[str, FloatArray | IntArray]],
) -> FloatArray:
    """Return the statistics in the order of `structure`."""
    rows, mine, times = [], [], []
    for index in range(len(problem.model.channels)):
        here = [np.flatnonzero(run.channel == index) for run in problem.runs]
        rows.append(here)
        mine.append([residual[row] for residual, row in zip(residuals, here, strict=True)])
        times.append([run.time_s[row] for run, row in zip(problem.runs, here, strict=True)])

    def one(asked: Statistic) -> float:
        first = asked.channels[0]
        if asked.kind == "white":
            return portmanteau(mine[first])
        if asked.kind == "peak":
            return peak(mine[first], times[first])
        if asked.kind == "tone":
            return tone(problem, residuals, asked.channels)[0]
        known = [
            [signal[asked.signal][row] for signal, row in zip(signals, rows[index], strict=True)]
            for index in asked.channels
        ]
        if asked.kind == "cross":
            return cross(mine[first], [each.astype(np.float64) for each in known[0]])
        labels = [[each.astype(np.int64) for each in several] for several in known]
        return regimes([mine[index] for index in asked.channels], labels)

    return np.array([one(asked) for asked in structure(problem, signals)])


def regimes(series: Sequence[Sequence[FloatArray]], labels: Sequence[Sequence[IntArray]]) -> float:
    """Return how much the means of some channels differ from zero in regimes that have a label.

    With the mean of n samples, n mean² is of χ² with one degree of freedom in noise; their sum
    over regimes and channels is told as the χ²₁ value of the same probability.
    """
    total, count = 0.0, 0
    for each, label in zip(series, labels, strict=True):
        index = np.unique(np.concatenate(label), return_inverse=True)[1]
        sizes = np.bincount(index)
        sums = np.bincount(index, weights=np.concatenate(each))
        enough = sizes >= LEAST_SAMPLES
        total += float(np.sum(sums[enough] ** 2 / sizes[enough]))
        count += int(np.sum(enough))
    return float(one_parameter_scale(np.array([total]), count)[0]) if count else 0.0


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

    The sum is over channels and runs, relative to its median over the frequencies around: a tone
    raises what is estimated of disturbance too, and so belittles itself. It is told as −2 log of
    its probability at one frequency, where the sum of so many in noise is of a gamma law: that has
    the tail of χ² with two degrees of freedom, however many there are.
    """
    length = max(TONE_STEP_S, *(float(run.time_s[-1] - run.time_s[0]) for run in problem.runs))
    size = 1 << math.ceil(math.log2(2.0 * length / TONE_STEP_S + 2.0))
    total, count, fastest = np.zeros(size // 2), 0, 0
    for run, residual in zip(problem.runs, residuals, strict=True):
        slot = np.rint((run.time_s - run.time_s[0]) / TONE_STEP_S).astype(np.int64)
        for row in (run.channel == index for index in channels):
            if row.any():
                even = np.bincount(slot[row], weights=residual[row], minlength=size)
                samples = int(np.sum(row))
                total += np.abs(np.fft.rfft(even)[1:]) ** 2 / samples
                count, fastest = count + 1, max(fastest, samples)
    # what is above half the rate of samples is below it too
    total = total[: max(math.ceil(0.5 * fastest / length * size * TONE_STEP_S), 1)]
    law = gamma(max(count, 1))
    around = max(round(TONE_WINDOW_HZ * size * TONE_STEP_S), 1)
    total *= law.median() / np.maximum(median_filter(total, around), LEAST_TONE)
    top = int(np.argmax(total))
    improbable = min(-2.0 * float(law.logsf(total[top])), MOST_TONE)
    return improbable, (top + 1.0) / (size * TONE_STEP_S)


def describe(
    problem: Problem,
    residuals: Sequence[FloatArray],
    signals: Sequence[Mapping[str, FloatArray | IntArray]],
    channel: int,
) -> str:
    """Say where the innovations of a channel are least like noise: regime, time and frequency."""
    rows: list[IntArray] = [np.flatnonzero(run.channel == channel) for run in problem.runs]
    mine = [residual[row] for residual, row in zip(residuals, rows, strict=True)]
    where = [f"in {problem.model.channels[channel].name}", _regime(mine, rows, signals)]
    if any(run.time_s[-1] > run.time_s[0] for run in problem.runs):
        where += [_time(problem, mine, rows), _frequency(problem, mine, rows)]
    return ", ".join(where)


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
    signals: Sequence[Mapping[str, FloatArray | IntArray]],
) -> str:
    best = (-np.inf, "in all regimes alike")
    everything = np.concatenate(list(mine))
    for name in names_of(signals)[0]:
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
