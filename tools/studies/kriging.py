"""Ordinary kriging: a field from samples anywhere, to compare other reconstructions with.

The field is taken as an unknown constant and a Gaussian process about it, whose correlation falls
with the distance, along x and y by lengths of their own; samples have independent noise. Lengths
and noise are those of the greatest marginal likelihood; constant and variance, given these, have
closed forms (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and
5; Cressie, Statistics for Spatial Data, 1993, chapter 3). Unlike the completion of low-rank
matrices this knows that near cells are alike, and not that rows depend on each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

FloatArray = npt.NDArray[np.float64]
Kernel = Callable[[FloatArray], FloatArray]
"""Correlation over the distance in lengths; 1 at 0."""

LEAST_NOISE = 1e-8
"""Variance of the noise over that of the field, without which near samples make the matrix of
correlations singular to rounding."""
MOST_NOISE = 1e3
_SHARES, _RATIOS = (0.03, 0.1, 0.3, 1.0, 3.0), (1e-6, 1e-2, 1.0)
"""Coarse grid of lengths, as shares of the field's, and of noise."""
_STARTS = 4
"""Of the optimisation, the likeliest of the grid: the likelihood has several maxima."""


def squared_exponential(h: FloatArray) -> FloatArray:
    """Correlation of a field that is smooth without limit."""
    return np.asarray(np.exp(-0.5 * h * h))


def matern_3_2(h: FloatArray) -> FloatArray:
    """Matérn correlation, ν = 3/2: a field that can be differentiated once."""
    g = math.sqrt(3.0) * h
    return np.asarray((1.0 + g) * np.exp(-g))


def matern_5_2(h: FloatArray) -> FloatArray:
    """Matérn correlation, ν = 5/2: a field that can be differentiated twice, as heat spreads."""
    g = math.sqrt(5.0) * h
    return np.asarray((1.0 + g + g * g / 3.0) * np.exp(-g))


def _distances(points: FloatArray, others: FloatArray, lengths: FloatArray) -> FloatArray:
    away = (points[:, None, :] - others[None, :, :]) / lengths
    return np.asarray(np.sqrt((away * away).sum(axis=-1)))


class Kriged:
    """A field known from samples, for given lengths and noise.

    ``points``: shape (n, 2); ``values``: shape (n,); ``lengths``: along x and y, in the unit of the
    points; ``noise_ratio``: variance of the noise over that of the field. ``mean``, ``deviation``
    (of the field about it) and ``noise`` (of a sample) are in the unit of the values, and
    ``log_likelihood`` is the marginal likelihood's. Raises ``ValueError`` for samples that are not
    as many as their places, for none, and for numbers that are none.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        lengths: tuple[float, float],
        noise_ratio: float,
        kernel: Kernel = matern_5_2,
    ) -> None:
        points, values = _samples(points, values)
        self.lengths, self.noise_ratio, self.kernel = lengths, noise_ratio, kernel
        self._points, self._scale = points, np.array(lengths)
        count = len(points)
        correlation = kernel(_distances(points, points, self._scale))
        self._factor = cho_factor(correlation + noise_ratio * np.eye(count), lower=True)
        self._ones = cho_solve(self._factor, np.ones(count))
        self.mean = float(self._ones @ values / self._ones.sum())
        rest = values - self.mean
        self._weights = cho_solve(self._factor, rest)
        variance = max(float(rest @ self._weights) / count, 0.0)
        self.deviation = math.sqrt(variance)
        self.noise = math.sqrt(noise_ratio * variance)
        logs = 2.0 * float(np.log(np.diagonal(self._factor[0])).sum())
        spread = count * math.log(variance) if variance else -math.inf
        self.log_likelihood = -0.5 * (count * (math.log(2.0 * math.pi) + 1.0) + spread + logs)

    def at(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Value of the field at places, shape (k, 2), and its standard deviation, shape (k,) each.

        The deviation is that of the field without noise, and includes that of the constant.
        """
        places = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        near = self.kernel(_distances(places, self._points, self._scale))
        solved = cho_solve(self._factor, near.T)
        unknown = (1.0 - near @ self._ones) ** 2 / self._ones.sum()
        share = np.maximum(1.0 - (near * solved.T).sum(axis=1) + unknown, 0.0)
        return self.mean + near @ self._weights, self.deviation * np.sqrt(share)


def kriged(points: FloatArray, values: FloatArray, kernel: Kernel = matern_5_2) -> Kriged:
    """Find lengths and noise of the greatest marginal likelihood.

    Lengths are sought from a tenth of the mean spacing of samples to ten times the field, noise
    from `LEAST_NOISE` to `MOST_NOISE`. Samples that are all equal make a constant field. Raises
    ``ValueError`` as `Kriged`.
    """
    points, values = _samples(points, values)
    extent = np.ptp(points, axis=0)
    extent = np.where(extent > 0.0, extent, extent.max() or 1.0)
    if np.ptp(values) == 0.0:
        return Kriged(points, values, (float(extent[0]), float(extent[1])), LEAST_NOISE, kernel)
    spacing = extent / math.sqrt(len(points))

    def unlikely(logs: FloatArray) -> float:
        x, y, noise = np.exp(logs)
        try:
            return -Kriged(points, values, (x, y), noise, kernel).log_likelihood
        except np.linalg.LinAlgError:  # singular to rounding: not a field to be told from samples
            return math.inf

    low = np.log([*(0.1 * spacing), LEAST_NOISE])
    high = np.log([*(10.0 * extent), MOST_NOISE])
    coarse = [
        np.log([x * extent[0], y * extent[1], noise])
        for x, y, noise in product(_SHARES, _SHARES, _RATIOS)
    ]
    begun = sorted((np.clip(logs, low, high) for logs in coarse), key=unlikely)[:_STARTS]
    found = min(
        (
            minimize(unlikely, logs, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)))
            for logs in begun
        ),
        key=lambda result: float(result.fun),
    )
    x, y, noise = (float(value) for value in np.exp(found.x))
    return Kriged(points, values, (x, y), noise, kernel)


def _samples(points: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    places = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    measured = np.asarray(values, dtype=np.float64).ravel()
    if len(places) != len(measured) or not len(places):
        raise ValueError(f"{len(places)} places and {len(measured)} values: nothing to krige")
    if not (np.isfinite(places).all() and np.isfinite(measured).all()):
        raise ValueError("places and values must be finite numbers")
    return places, measured
