"""How much the numbers of a steady-state table scatter, from the table alone, whatever is wrong.

Any cause makes the ratio of measured to predicted steady motion a smooth function of the beat: over
biases of 10° to 45° a straight line follows its logarithm to 0.3 % for effects of 15 % (an offset
of the tail is the exception: 5 % of 30 %, and 1.7 % by a parabola). So what a few smooth terms in
bias, amplitude and frequency leave is scatter, and needs no cause to be known (the estimate of a
variance from a smooth fit; Gasser, Sroka and Jennen-Steinmetz 1986). Taking the believed model's
own misfit for scatter would hide every cause behind it: with a dozen numbers the likelihood cannot
tell the two apart.

With ν degrees of freedom the estimate s is itself uncertain, and gains over it follow Student's law
(1908), not that of known deviations: an alarm comes from an s that is small by chance. There are
two ways out, and the smaller deviation is used:

- nothing is assumed, and s is multiplied by the factor by which a gain at the alarm's threshold
  becomes as improbable as alarms should be, P(F₁,ν > 30 factor²) = 3·10⁻⁴: 1.6 for ν = 5, 3.5 for
  ν = 3, 11 for ν = 2. Of five rows that leaves nothing to be seen;
- numbers taken by hand, with a yardstick and a timer as the source's were, are not believed to be
  better than 1 %. Then s is rarely small by chance, and it is enough that a candidate's gain
  reaches the threshold in one table of a hundred if they scatter far more than that:
  P(F₁,ν > 25 factor²) = 10⁻², which is 2.0 for ν = 2, 1.2 for ν = 3 and none above. In healthy
  tables of 4 to 9 rows with 0.5 to 2 % of scatter this alarms once in a thousand, with 5 % once in
  a hundred (docs/diagnosis-method.md).

Below two degrees of freedom a table says nothing of its scatter, and 3 % are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher_snedecor

from plant.tail_input import TailBeat
from tools.diagnosis.model import FloatArray

ALARM_GAIN = 30.0
"""The gain in twice the log-likelihood that an alarm needs, and a fifth more."""
ALARM_P = 3e-4
"""How often one candidate may reach it by chance, if nothing is assumed."""
HAND_SHARE = 0.01
"""Few numbers are not believed to be better than this: 3 mm of 30 cm, half a second of a minute."""
HAND_GAIN, HAND_P = 25.0, 1e-2
"""Threshold (``options.least_gain``) and probability where that is assumed."""
UNKNOWN_SHARE = 0.03
"""What is assumed of a table that cannot say how much it scatters."""
LEAST_FREEDOM = 2
ROWS_PER_TERM = 2
LEAST_SHARE = 1e-4
"""Numbers are not believed to be better than this: rounded ones may lie on a curve exactly."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviation of one column as a share of its values, with degrees of freedom."""

    estimate: float
    freedom: int

    @property
    def assumed(self) -> bool:
        """Whether the table says too little of it, and something is assumed."""
        return self.freedom < LEAST_FREEDOM

    @property
    def share(self) -> float:
        """What is used: the estimate, raised for its own uncertainty; see the module."""
        if self.assumed:
            return max(UNKNOWN_SHARE, self.estimate)
        alone = self.estimate * raised(self.freedom)
        by_hand = self.estimate * raised(self.freedom, HAND_GAIN, HAND_P)
        return min(alone, max(by_hand, HAND_SHARE))


def raised(freedom: int, gain: float = ALARM_GAIN, p_value: float = ALARM_P) -> float:
    """Return the factor for an estimate with so many degrees of freedom, at least 1."""
    return max(1.0, math.sqrt(float(fisher_snedecor.isf(p_value, 1, freedom)) / gain))


def own_scatter(beats: Sequence[TailBeat], measured: FloatArray, predicted: FloatArray) -> Scatter:
    """Return the scatter of measured values (n,) of some beats.

    ``predicted``: by the believed model (n,), NaN where it has no steady motion.
    """
    usable = np.isfinite(predicted) & (predicted > 0.0) & (measured > 0.0)
    rows = np.flatnonzero(usable)
    terms = _terms([beats[i] for i in rows.tolist()])
    freedom = rows.size - terms.shape[1]
    if freedom < 1:
        return Scatter(0.0, 0)
    ratio = np.log(measured[rows] / predicted[rows])
    left = ratio - terms @ np.linalg.lstsq(terms, ratio, rcond=None)[0]
    estimate = math.sqrt(float(left @ left) / freedom)
    return Scatter(max(estimate, LEAST_SHARE), freedom)


def _terms(beats: Sequence[TailBeat]) -> FloatArray:
    """Return smooth terms (n, m), the plainest first, one for every second row, no idle one."""
    told = np.array([(b.bias_rad, b.amplitude_rad, b.frequency_hz) for b in beats]).reshape(-1, 3)
    bias, amplitude, frequency = told.T
    wide, side = np.abs(bias), np.sign(bias)
    offered = [
        wide,
        side,
        amplitude,
        frequency,
        side * wide,
        wide**2,
        amplitude**2,
        frequency**2,
        wide * amplitude,
        wide * frequency,
        amplitude * frequency,
    ]
    count = bias.size
    most = max(count // ROWS_PER_TERM, 2)
    chosen = np.ones((count, 1))
    for term in offered:
        size = float(np.max(np.abs(term), initial=0.0))
        if chosen.shape[1] >= most or size == 0.0:
            continue
        more = np.column_stack([chosen, term / size])
        if np.linalg.matrix_rank(more, tol=1e-6) == more.shape[1]:
            chosen = more
    return chosen
