"""How a tail's depth and thickness vary from joint to tip, and integrals over them.

A profile is a row of factors at equally spaced stations, linear between them; it multiplies the
tail's depth or thickness, so that what scales the whole (a worn fin, a thicker sheet) keeps the
shape. An empty one is uniform. Integrals are Gauss–Legendre sums of eight points between stations,
exact for every polynomial that occurs and with the same bits everywhere: only +, −, ×, / and exact
summation.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from plant.errors import InvalidParameterError

_NODES = (0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363)
_WEIGHTS = (0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763)
# Gauss–Legendre, eight points on [−1, 1] (Abramowitz & Stegun, table 25.4)


def check_profile(name: str, profile: object) -> None:
    """Refuse what is no tuple of at least two factors, positive but for the last."""
    if not isinstance(profile, tuple) or len(profile) == 1:
        raise InvalidParameterError(
            name, f"must be empty (uniform) or two or more factors, joint to tip, got {profile!r}"
        )
    for station, factor in enumerate(profile):
        number = isinstance(factor, (int, float)) and not isinstance(factor, bool)
        if not number or not math.isfinite(factor) or factor > 1e3:
            raise InvalidParameterError(name, f"must hold numbers up to 1000, got {factor!r}")
        if factor < 0.0 or (factor == 0.0 and station < len(profile) - 1):
            raise InvalidParameterError(
                name, f"must be positive (the tip may be zero), got {factor!r} at {station}"
            )


def factor_at(profile: Sequence[float], part: float) -> float:
    """Factor at a part (0 joint … 1 tip) of the length."""
    if not profile:
        return 1.0
    place = part * (len(profile) - 1)
    station = min(int(place), len(profile) - 2)
    within = place - station
    return profile[station] * (1.0 - within) + profile[station + 1] * within


def gauss_points(
    begin: float, end: float, stations: Sequence[int] = (), pieces: int = 1
) -> tuple[list[float], list[float]]:
    """Points in (begin, end), ascending, and weights; panels end at stations, split into pieces.

    ``stations``: numbers of factors of the profiles in the integrand; their kinks are at multiples
    of 1/(number − 1). ``pieces``: panels between two kinks, for an integrand that oscillates.
    """
    edges = {begin, end}
    for count in stations:
        inner = (station / (count - 1) for station in range(1, count - 1))
        edges.update(part for part in inner if begin < part < end)
    points, weights = [], []
    rule = [
        *((-node, weight) for node, weight in zip(_NODES[::-1], _WEIGHTS[::-1], strict=True)),
        *zip(_NODES, _WEIGHTS, strict=True),
    ]
    for low, high in pairwise(sorted(edges)):
        half = 0.5 * (high - low) / pieces
        for piece in range(pieces):
            middle = low + (2 * piece + 1) * half
            points += [middle + half * node for node, _ in rule]
            weights += [half * weight for _, weight in rule]
    return points, weights


def integral(
    function: Callable[[float], float], begin: float, end: float, stations: Sequence[int] = ()
) -> float:
    """∫ function(part) d part from ``begin`` to ``end``; ``stations`` as in ``gauss_points``."""
    points, weights = gauss_points(begin, end, stations)
    return math.fsum(
        weight * function(point) for point, weight in zip(points, weights, strict=True)
    )


def moments(
    per_length: float, length: float, depth: Sequence[float], begin: float = 0.0, end: float = 1.0
) -> tuple[float, float, float]:
    """∫m, ∫mτ, ∫mτ² of a virtual mass ``per_length`` × factor² (kg, kg·m, kg·m²).

    Over the part of the tail from ``begin`` to ``end`` of its length, τ counted from ``begin``.
    """
    if not depth:
        span = length * (end - begin)
        return (
            per_length * span,
            per_length * span * span / 2.0,
            per_length * span * span * span / 3.0,
        )

    def moment(power: int) -> Callable[[float], float]:
        return lambda part: factor_at(depth, part) ** 2 * (part - begin) ** power

    stations = (len(depth),)
    return (
        per_length * length * integral(moment(0), begin, end, stations),
        per_length * length**2 * integral(moment(1), begin, end, stations),
        per_length * length**3 * integral(moment(2), begin, end, stations),
    )
