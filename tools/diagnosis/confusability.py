"""Which causes these data could not tell apart, whatever they say.

The cosine between the sensitivities of two causes, after nuisances are taken out, is the
correlation of their gains: at 1 no data from these manoeuvres separate them. Causes of several
parameters span planes; the largest canonical correlation (Hotelling 1936) is taken.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from tools.diagnosis.model import FloatArray
from tools.diagnosis.screening import Kind, Screen


def map_of(
    screen: Screen, kinds: Collection[Kind] = (Kind.CAUSE,)
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the candidates of some kinds that can be seen, and the matrix of their |cosines|."""
    spans: dict[str, list[int]] = {}
    for candidate in screen.candidates:
        if candidate.kind in kinds:
            mine = spans.setdefault(candidate.owner, [])
            mine += [c for c in candidate.columns if c not in mine]
    names = tuple(spans)
    roots = {name: _root(screen.projection.information, columns) for name, columns in spans.items()}
    matrix = np.eye(len(names))
    for i, a in enumerate(names):
        for k in range(i):
            b = names[k]
            between = screen.projection.information[np.ix_(spans[a], spans[b])]
            inner = roots[a].T @ between @ roots[b]
            value = float(np.linalg.norm(inner, 2)) if inner.size else 0.0
            matrix[i, k] = matrix[k, i] = min(value, 1.0)
    return names, matrix


def _root(information: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Return what makes the columns orthonormal; directions that barely matter are left out."""
    length = np.sqrt(np.maximum(np.diag(information)[list(columns)], 1e-300))
    inner = information[np.ix_(columns, columns)] / np.outer(length, length)
    values, vectors = np.linalg.eigh(inner)
    kept = values > 0.1 * values[-1]
    root: FloatArray = (vectors[:, kept] / np.sqrt(values[kept])) / length[:, None]
    return root


def cosine(screen: Screen, a: str, b: str) -> float:
    """Return the |cosine| of two candidates; zero where one of them cannot be seen."""
    names, matrix = map_of(screen, tuple(Kind))
    if a not in names or b not in names:
        return 0.0
    return float(matrix[names.index(a), names.index(b)])


def guises(screen: Screen, least: float) -> set[str]:
    """Return the unnamed terms that are but another guise of a cause that has a name."""
    names, matrix = map_of(screen, tuple(Kind))
    kinds = dict(zip(screen.owners, screen.kinds, strict=True))
    named = [i for i, name in enumerate(names) if kinds[name] is Kind.CAUSE]
    return {
        name
        for i, name in enumerate(names)
        if kinds[name] is not Kind.CAUSE and any(matrix[i, k] >= least for k in named)
    }


def alike(names: Sequence[str], matrix: FloatArray, least: float) -> list[list[str]]:
    """Return pairs whose |cosine| is at least this, most alike first."""
    pairs = [
        (float(matrix[i, k]), [names[k], names[i]])
        for i in range(len(names))
        for k in range(i)
        if matrix[i, k] >= least
    ]
    return [pair for _, pair in sorted(pairs, key=lambda item: -item[0])]
