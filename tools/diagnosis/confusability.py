"""Which causes these data could not tell apart, whatever they say.

The cosine between the sensitivities of two causes, after nuisances are taken out, is the
correlation of their gains: at 1 no data from these manoeuvres separate them. Causes of several
parameters span planes; the largest canonical correlation (Hotelling 1936) is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from tools.diagnosis.model import FloatArray
from tools.diagnosis.screening import Kind, Screen


def map_of(screens: Sequence[Screen]) -> tuple[tuple[str, ...], FloatArray]:
    """Return the causes that can be seen, and the matrix of their |cosines|.

    Of several screens the first counts that shows both of a pair; all of them are in the last one.
    """
    every = [(screen, _bases(screen)) for screen in screens]
    last, shown = every[-1]
    kinds = dict(zip(last.owners, last.kinds, strict=True))
    names = tuple(name for name in shown if kinds[name] is Kind.CAUSE)
    matrix = np.eye(len(names))
    for (i, a), (k, b) in itertools.combinations(enumerate(names), 2):
        screen, bases = next(each for each in every if a in each[1] and b in each[1])
        matrix[i, k] = matrix[k, i] = _cosine(screen, bases[a], bases[b])
    return names, matrix


def cosine(screen: Screen, a: str, b: str) -> float:
    """Return the |cosine| of two candidates; zero where one of them cannot be seen."""
    bases = _bases(screen, (a, b))
    return _cosine(screen, bases[a], bases[b]) if a in bases and b in bases else 0.0


def guises(screen: Screen, least: float) -> dict[str, list[str]]:
    """Return for each unnamed term the causes of which it may be but another guise."""
    bases = _bases(screen)
    kinds = dict(zip(screen.owners, screen.kinds, strict=True))
    causes = [name for name in bases if kinds[name] is Kind.CAUSE]
    return {
        name: [c for c in causes if _cosine(screen, bases[name], bases[c]) >= least]
        for name in bases
        if kinds[name] is not Kind.CAUSE
    }


@dataclass(frozen=True, slots=True)
class _Basis:
    """The columns of a candidate, and what makes them orthonormal."""

    columns: tuple[int, ...]
    root: FloatArray


def _bases(screen: Screen, only: Collection[str] = ()) -> dict[str, _Basis]:
    """Return the bases of the candidates that can be seen, of all or ``only`` some of them."""
    spans: dict[str, dict[int, None]] = {}
    for candidate in screen.candidates:
        if not only or candidate.owner in only:
            spans.setdefault(candidate.owner, {}).update(dict.fromkeys(candidate.columns))
    information = screen.projection.information
    return {
        name: _Basis(tuple(columns), _root(information, tuple(columns)))
        for name, columns in spans.items()
    }


def _cosine(screen: Screen, a: _Basis, b: _Basis) -> float:
    between = screen.projection.information[np.ix_(a.columns, b.columns)]
    inner = a.root.T @ between @ b.root
    return min(float(np.linalg.norm(inner, 2)), 1.0) if inner.size else 0.0


def _root(information: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Return what makes the columns orthonormal; directions that barely matter are left out."""
    length = np.sqrt(np.maximum(np.diag(information)[list(columns)], 1e-300))
    inner = information[np.ix_(columns, columns)] / np.outer(length, length)
    values, vectors = np.linalg.eigh(inner)
    kept = values > 0.1 * values[-1]
    root: FloatArray = (vectors[:, kept] / np.sqrt(values[kept])) / length[:, None]
    return root
