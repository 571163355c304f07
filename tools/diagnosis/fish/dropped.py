"""Commands that never arrived: which ones is not known, so the likeliest are looked for.

With a share p of n commands lost independently, a certain set of m of them is lost with probability
p^m (1 − p)^(n − m). Its price −2 log of that stands beside the sum of squares of the whitened
innovations r. Sets are looked for along time, as the estimator goes: until a command, only the
earlier ones matter to its innovations, so the ``BEAM`` cheapest beginnings are gone on with, each
with the command and without it.
Taken is the set that makes the sum of both least at a share of ``TYPICAL``: were it chosen at p,
innovations would jump where p passes the point at which another set is cheaper, and an estimate
there has no slope. Where commands are lost by halves each loss costs 4.4 too much, which is little
beside what one that can be seen explains.

The price must be seen by whoever only looks at innovations, or a cause that may choose among 2^n
explanations would look better than it is. So it is added to them, along a direction that is
orthogonal to r and spread over all of a run, by two parts ρ₁, ρ₂:

    |r′|² = |r|² + ρ₁² + ρ₂²,   ρ₁² = least price of m losses (at p = m/n),   ρ₁² + ρ₂² = price.

ρ₂ changes its sign at p = m/n, where it is nearly linear with slope √(n/(p(1 − p))): so Gauss and
Newton's method finds p, and its standard error is that of a share. Each innovation moves by about
ρ/√(number of samples), which no test of whiteness sees. At p = 0 nothing is lost, and nothing
changes.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np

from tools.diagnosis.model import FloatArray

Path = list[tuple[tuple[int, ...], float]]
"""Sets of lost commands, with the sum of squares that is left."""

Squares = Callable[[tuple[int, ...], int], float]
"""Sum of squares of the innovations until a command (one beyond the last: of all)."""

BEAM = 6
"""Beginnings that are gone on with: those that the next seconds tell apart need no more."""
TYPICAL = 0.1
"""Share of lost commands at which sets of them are weighed."""
_KEPT = 128


def search(changes: int, squares: Squares) -> Path:
    """Find the likeliest sets of lost commands among 1 … ``changes``, and add that of none."""
    beam: Path = [((), 0.0)]
    for i in range(1, changes + 1):
        sets = [each for lost, _ in beam for each in (lost, (*lost, i))]
        tried = [(lost, squares(lost, i + 1)) for lost in sets]
        tried.sort(key=lambda item: item[1] + price(len(item[0]), i, TYPICAL))
        beam = tried[:BEAM]
    return beam if any(not lost for lost, _ in beam) else [*beam, ((), squares((), changes + 1))]


def price(lost: int, changes: int, share: float) -> float:
    """Return −2 log of the probability that just these are lost."""
    total = 0.0
    if lost:
        total -= 2.0 * lost * math.log(share)
    if changes - lost:
        total -= 2.0 * (changes - lost) * math.log1p(-share)
    return total


def chosen(path: Path, changes: int) -> tuple[int, ...]:
    """Return the set that explains best at its price."""
    return min(path, key=lambda item: item[1] + price(len(item[0]), changes, TYPICAL))[0]


def priced(whitened: FloatArray, lost: int, changes: int, share: float) -> FloatArray:
    """Return whitened innovations with the price of a set of lost commands in them."""
    if changes == 0:
        return whitened
    likeliest = lost / changes
    least = price(lost, changes, likeliest) if 0 < lost < changes else 0.0
    excess = max(0.0, price(lost, changes, share) - least)
    first = math.sqrt(max(0.0, least))
    second = math.copysign(math.sqrt(excess), share - likeliest)
    count = whitened.size
    a, b = np.ones(count), np.ones(count)
    a[1::2] = -1.0
    b[2::4] = b[3::4] = -1.0
    basis: list[FloatArray] = []
    for direction in (whitened, a, b):
        rest = direction.copy()
        for known in basis:
            rest -= known * float(known @ rest)
        size = float(np.linalg.norm(rest))
        basis.append(rest / size if size > 0.0 else rest)
    return whitened + first * basis[1] + second * basis[2]


class Paths:
    """Searches that were made already; safe for threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[Any, ...], tuple[tuple[Any, ...], Path]] = OrderedDict()

    def of(
        self, owners: tuple[Any, ...], context: tuple[Any, ...], find: Callable[[], Path]
    ) -> Path:
        """Return the path for some objects (by identity) and a context, searched for once."""
        key = (*(id(owner) for owner in owners), context)
        with self._lock:
            found = self._kept.get(key)
            if found is not None and all(a is b for a, b in zip(found[0], owners, strict=True)):
                self._kept.move_to_end(key)
                return found[1]
        path = find()
        with self._lock:
            self._kept[key] = (owners, path)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return path
