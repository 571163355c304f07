"""Several salesmen by a genetic algorithm: how the source found the paths of its Fig. 6.7.

The figure's caption, total distance and iteration, is that of J. Kirk's widely used MTSP_GA (MATLAB
Central File Exchange 19049), so what is here follows the description of that algorithm: a
population of solutions, each a route (a permutation of all points) and break points that cut it
into one closed tour for each salesman, which starts wherever it likes on its tour.

The first population is random but for one solution that takes the points in the order given. A
generation shuffles the population into groups of eight. The shortest of each group lives on,
and replaces the other seven by children of itself, with two random places on the route:

1. the part between them reversed (the 2-opt move of Croes, 1958);
2. the points at them exchanged;
3. the part between them moved on by one, the first point going to its end;
4. new break points;
5. to 7. as 1. to 3., with new break points as well.

There is no crossover: what one solution knows never meets what another knows. Route and break
points as a representation are discussed by Carter and Ragsdale, European Journal of Operational
Research 175 (2006) 246-257. The better way to short tours is `procboard.survey.tours`; this one is
here to be compared with.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procboard.errors import SurveyError
from procboard.survey.algebra import FloatArray

IntArray = npt.NDArray[np.intp]

GROUP = 8
"""Solutions that meet in a generation: one survivor and a child by each operator."""
_REVERSED, _EXCHANGED, _MOVED_ON = (1, 5), (2, 6), (3, 7)
_NEW_BREAKS = slice(4, 8)
"""Which children of a group an operator makes, counted from the survivor, 0."""
_DRAWN_AT_ONCE = 256
"""Generations whose random numbers are drawn together: fewer calls, the same numbers."""


@dataclass(frozen=True, slots=True)
class Evolution:
    """Settings: the population is that of MTSP_GA, the generations are those of the source.

    ``least_points``: of each salesman's tour. Raises ``SurveyError`` for what cannot evolve.
    """

    population: int = 80
    generations: int = 50_000
    least_points: int = 3

    def __post_init__(self) -> None:
        """Refuse a population without whole groups."""
        if self.population < GROUP or self.population % GROUP:
            raise SurveyError(f"a population is in groups of {GROUP}, got {self.population}")
        if self.generations < 0 or self.least_points < 1:
            raise SurveyError("generations must be 0 or more, and points on a tour 1 or more")


@dataclass(frozen=True, slots=True)
class Evolved:
    """The shortest solution that lived: a closed tour of point numbers for each salesman.

    ``length`` is the sum over the tours in the unit of the points; ``generation``, when it was
    found (0: in the first population).
    """

    tours: tuple[tuple[int, ...], ...]
    length: float
    generation: int


def evolved(
    points: FloatArray,
    salesmen: int,
    rng: np.random.Generator,
    settings: Evolution | None = None,
) -> Evolved:
    """Evolve closed tours through ``points``, shape (n, 2), that are short in sum.

    Raises ``SurveyError`` where there are fewer points than the tours must have.
    """
    settings = settings or Evolution()
    count = len(points)
    spare = count - salesmen * settings.least_points
    if salesmen < 1 or spare < 0:
        raise SurveyError(
            f"{count} points are too few for {salesmen} tours of {settings.least_points} or more"
        )
    away = points[:, None, :] - points[None, :, :]
    distances = np.sqrt((away * away).sum(axis=-1)).ravel()
    size, groups = settings.population, settings.population // GROUP
    least = settings.least_points * np.arange(1, salesmen)

    def breaks_of(drawn: IntArray) -> IntArray:
        return np.sort(drawn, axis=-1) + least

    routes = np.tile(np.arange(count), (size, 1))
    routes[1:] = rng.permuted(routes[1:], axis=1)
    breaks = breaks_of(rng.integers(0, spare + 1, (size, salesmen - 1)))
    best = _Best()
    draws = _draws(rng, settings.generations, size, (groups, 4, salesmen - 1), count, spare + 1)
    best.look(0, routes, breaks, _lengths(routes, breaks, distances))
    lengths = best.lengths
    for generation, (order, places, drawn) in enumerate(draws, 1):
        grouped = order.reshape(groups, GROUP)
        first = grouped[np.arange(groups), lengths[grouped].argmin(axis=1)]
        routes = _children(routes[first], places).reshape(size, count)
        cut = np.repeat(breaks[first][:, None, :], GROUP, axis=1)
        cut[:, _NEW_BREAKS] = breaks_of(drawn)
        breaks = cut.reshape(size, salesmen - 1)
        lengths = _lengths(routes, breaks, distances)
        best.look(generation, routes, breaks, lengths)
    return best.evolved()


def _draws(
    rng: np.random.Generator,
    generations: int,
    size: int,
    cuts: tuple[int, int, int],
    count: int,
    room: int,
) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
    """For each generation: the shuffle, two ordered places a group, numbers for new breaks."""
    for begin in range(0, generations, _DRAWN_AT_ONCE):
        number = min(_DRAWN_AT_ONCE, generations - begin)
        orders = rng.permuted(np.tile(np.arange(size), (number, 1)), axis=1)
        places = np.sort(rng.integers(0, count, (number, cuts[0], 2)), axis=-1)
        yield from zip(orders, places, rng.integers(0, room, (number, *cuts)), strict=True)


def _children(parents: IntArray, places: IntArray) -> IntArray:
    """Routes of each survivor and its seven children, shape (groups, 8, n)."""
    groups, count = parents.shape
    at = np.arange(count)
    low, high = places[:, :1], places[:, 1:]
    inside = (at >= low) & (at <= high)
    group = np.arange(groups)[:, None]
    children = np.repeat(parents[:, None, :], GROUP, axis=1)
    turned = parents[group, np.where(inside, low + high - at, at)]
    moved = parents[group, np.where(inside, np.where(at == high, low, at + 1), at)]
    for child in _REVERSED:
        children[:, child] = turned
    for child in _MOVED_ON:
        children[:, child] = moved
    for child in _EXCHANGED:
        children[group, child, low] = parents[group, high]
        children[group, child, high] = parents[group, low]
    return children


def _lengths(routes: IntArray, breaks: IntArray, distances: FloatArray) -> FloatArray:
    """Sum of the closed tours of each solution.

    The whole route closed, then at each break the step across it taken away, and each tour closed.
    """
    size, count = routes.shape
    row = np.arange(size)[:, None]
    first = np.concatenate((np.zeros((size, 1), dtype=np.intp), breaks), axis=1)
    last = np.concatenate((breaks, np.full((size, 1), count)), axis=1) - 1
    begins, ends = routes[row, first], routes[row, last]
    steps = distances[routes[:, :-1] * count + routes[:, 1:]].sum(axis=1)
    crossed = distances[ends[:, :-1] * count + begins[:, 1:]].sum(axis=1)
    closed = distances[ends * count + begins].sum(axis=1)
    return np.asarray(steps - crossed + closed)


class _Best:
    """The shortest solution so far."""

    def __init__(self) -> None:
        self.length = np.inf
        self.lengths: FloatArray = np.empty(0)
        self._generation = 0
        self._route: IntArray = np.empty(0, dtype=np.intp)
        self._breaks: IntArray = np.empty(0, dtype=np.intp)

    def look(
        self, generation: int, routes: IntArray, breaks: IntArray, lengths: FloatArray
    ) -> None:
        self.lengths = lengths
        shortest = int(lengths.argmin())
        if lengths[shortest] < self.length:
            self.length = float(lengths[shortest])
            self._generation = generation
            self._route, self._breaks = routes[shortest].copy(), breaks[shortest].copy()

    def evolved(self) -> Evolved:
        tours = np.split(self._route, self._breaks)
        return Evolved(
            tuple(tuple(map(int, tour)) for tour in tours), self.length, self._generation
        )
