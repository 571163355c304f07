"""Linear algebra of small matrices with the same bits on every machine.

What a board wants to sample next follows from comparisons of computed numbers, and a mission's
trace must be the same bytes everywhere. BLAS and LAPACK add in an order that depends on the
processor. Here only elementwise +, −, ×, / and square roots work, which IEEE 754 defines to the
bit, and every sum runs in the order of its index. The price, a few milliseconds for a 24 × 24
matrix, is nothing beside the minutes that a robot swims.

Singular values come from one-sided Jacobi rotations (Hestenes 1958; Golub and Van Loan, Matrix
Computations, 4th ed., section 8.6.3), with pairs in the order of a tournament, so that half of the
columns are rotated at a time. Columns are chosen by Gram–Schmidt with pivoting, which picks those
of QR with column pivoting (Businger and Golub 1965).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

EPSILON: Final = 2.0**-52
"""Spacing of doubles at 1."""
_MOST_SWEEPS: Final = 30  # ten are enough for any matrix tried; a NaN must not turn for ever


class Svd(NamedTuple):
    """A = U diag(s) Vᵀ with k = min(m, n): U (m, k), s (k,) falling, V (n, k)."""

    u: FloatArray
    s: FloatArray
    v: FloatArray


def total(terms: FloatArray) -> FloatArray:
    """Sum over the first axis, in its order."""
    if not len(terms):
        return np.zeros(terms.shape[1:])
    sums: FloatArray = np.add.accumulate(terms, axis=0)[-1]
    return sums


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrix product of (m, k) and (k, n), both small: m · k · n products are held at a time."""
    if a.shape[1] != b.shape[0]:
        raise ValueError(f"product of {a.shape} and {b.shape}")
    return total(a.T[:, :, None] * b[:, None, :])


def svd(matrix: FloatArray) -> Svd:
    """Return the thin singular value decomposition of a matrix of finite numbers.

    Columns of U that belong to singular values of zero are zero; of V, where m < n.
    """
    if matrix.shape[0] < matrix.shape[1]:
        v, s, u = svd(matrix.T)
        return Svd(u, s, v)
    n = matrix.shape[1]
    # one on the other, the columns of A and of V turn alike
    work = np.vstack([matrix, np.eye(n)])
    top = matrix.shape[0]
    rounds = _tournament(n)
    for _ in range(_MOST_SWEEPS):
        turned = [_rotate(work, top, left, right) for left, right in rounds]
        if not any(turned):
            break
    s = np.sqrt(total(work[:top] * work[:top]))
    order = np.argsort(-s, kind="stable")
    work, s = work[:, order], s[order]
    return Svd(work[:top] / np.where(s > 0.0, s, 1.0), s, work[top:])


def _tournament(n: int) -> list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
    """Rounds in which each of n columns meets each other once (the circle method)."""
    players = list(range(n + n % 2))
    rounds = []
    for _ in range(len(players) - 1):
        half = len(players) // 2
        met = zip(players[:half], reversed(players[half:]), strict=True)
        pairs = [(min(pair), max(pair)) for pair in met if max(pair) < n]  # n rests
        left, right = zip(*pairs, strict=True) if pairs else ((), ())
        rounds.append((np.array(left, np.intp), np.array(right, np.intp)))
        players.insert(1, players.pop())
    return rounds


def _rotate(
    work: FloatArray, top: int, left: npt.NDArray[np.intp], right: npt.NDArray[np.intp]
) -> bool:
    """Make pairs of columns orthogonal in their first ``top`` rows; say whether any was not."""
    p, q = work[:, left], work[:, right]
    a, b = total(p[:top] * p[:top]), total(q[:top] * q[:top])
    c = total(p[:top] * q[:top])
    turn = np.abs(c) > EPSILON * np.sqrt(a * b)
    if not turn.any():
        return False
    with np.errstate(over="ignore"):  # an angle of zero is right then
        cotangent = (b - a) / (2.0 * np.where(turn, c, 1.0))  # of twice the angle
        tangent = np.copysign(1.0, cotangent) / (
            np.abs(cotangent) + np.sqrt(1.0 + cotangent * cotangent)
        )
    cosine = np.where(turn, 1.0 / np.sqrt(1.0 + tangent * tangent), 1.0)
    sine = np.where(turn, cosine * tangent, 0.0)
    work[:, left], work[:, right] = cosine * p - sine * q, sine * p + cosine * q
    return True


def independent_columns(matrix: FloatArray, count: int) -> list[int]:
    """Return the ``count`` columns that QR with column pivoting takes first, in ascending order.

    Each is the one farthest from the span of those before it. Of equals the leftmost counts.
    """
    rest = np.array(matrix)
    taken: list[int] = []
    for _ in range(count):
        lengths = np.sqrt(total(rest * rest))
        lengths[taken] = -1.0
        best = int(np.argmax(lengths))
        taken.append(best)
        if lengths[best] <= 0.0:
            continue
        axis = rest[:, best] / lengths[best]
        for _ in range(2):  # once more for what rounding left (Kahan: twice is enough)
            rest -= axis[:, None] * total(axis[:, None] * rest)
    return sorted(taken)


def inverse(parts: Svd, rank: int) -> FloatArray:
    """Return V₁ diag(1/s₁) U₁ᵀ: the pseudo-inverse of the best approximation of a rank, (n, m)."""
    return product(parts.v[:, :rank] / parts.s[:rank], parts.u[:, :rank].T)
