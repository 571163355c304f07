"""The points of a sweep: which there are, in which order, and the scenario of each.

A grid is the product of its lists, the last key fastest; a sample is a Latin hypercube, so that
each key alone covers its range evenly however many keys there are. Repeats differ in the seed only
and follow each other; they are the same seeds at every point, so that points differ by what is
varied and not by luck. Every point is converted to a scenario before anything runs, its plant is
built and its files of fields are read as a run would do it, so that a combination that cannot swim
is refused before the others have swum. What is kept of a point are its values, and the scenario is
made again when its turn comes.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from tools import scenario
from tools.configuration import Scenario
from tools.contradictions import KeyPath
from tools.errors import ScenarioError
from tools.field_files import QUANTITIES, field_file, read_field
from tools.sweep.vary import MOST_VALUES, OPTION, Axis, Listed, Range, parse_axes

SEED: KeyPath = ("scenario", "seed")
DURATION: KeyPath = ("scenario", "duration_s")
LARGEST_SEED = 2**53
"""The bound of `tools.configuration.Seed`."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The points of a sweep, numbered from 0."""

    name: str
    """Of the scenario that is varied."""
    paths: tuple[KeyPath, ...]
    combinations: tuple[tuple[Any, ...], ...]
    """Values of the varied keys, as the scenario's own types have them."""
    repeat: int
    seeds: tuple[int, ...]
    """The first seed of each combination."""
    base: str
    """The resolved scenario without what is varied, for the digest."""
    member: Callable[[Mapping[KeyPath, Any]], Scenario]

    def __len__(self) -> int:
        return len(self.combinations) * self.repeat

    @property
    def keys(self) -> tuple[str, ...]:
        """The varied keys, dotted."""
        return tuple(map(scenario.dotted, self.paths))

    def values(self, point: int) -> tuple[Any, ...]:
        """The varied keys' values at a point."""
        return self.combinations[point // self.repeat]

    def seed(self, point: int) -> int:
        """The seed of a point."""
        combination, repeat = divmod(point, self.repeat)
        return self.seeds[combination] + repeat

    def config(self, point: int) -> Scenario:
        """The scenario of a point."""
        values = dict(zip(self.paths, self.values(point), strict=True))
        return self.member({**values, SEED: self.seed(point)})

    def digest(self) -> str:
        """SHA-256 over everything that decides the table but the code."""
        text = json.dumps([self.base, self.keys, self.combinations, self.repeat, self.seeds])
        return hashlib.sha256(text.encode()).hexdigest()


def make_plan(
    source: str | Path,
    varied: Sequence[str],
    *,
    sets: Iterable[str] = (),
    duration_s: float | None = None,
    seed: int | None = None,
    sample: int | None = None,
    repeat: int = 1,
) -> Plan:
    """Read what is varied, and convert every point of it.

    `varied` are texts of `--vary`; `sample` is the number of points to draw, None for the grid;
    `seed` is the scenario's, and the sample is drawn with it as well. Raises `ScenarioError`, whose
    line names the key and the value that cannot be.
    """
    sets = list(sets)
    taken = {scenario.parse_set(text)[0]: "--set" for text in sets}
    if duration_s is not None:
        taken[DURATION] = "--duration"
    if repeat > 1:
        taken[SEED] = "--repeat"
    if seed is not None and sample is None:
        taken[SEED] = "--seed"
    axes = parse_axes(varied, taken)
    if not axes and repeat == 1:
        raise ScenarioError(f"nothing is varied: say {OPTION} KEY=A,B,… or --repeat N")
    base = scenario.load(source, sets, duration_s=duration_s, seed=seed)
    drawn = _grid(axes) if sample is None else _sample(axes, sample, base.scenario.seed)
    points = len(drawn) * repeat
    if points > MOST_VALUES:
        raise ScenarioError(f"{points} points: a sweep has at most {MOST_VALUES}")
    member = scenario.family(source, sets, duration_s=duration_s, seed=seed, origin=OPTION)
    paths = tuple(axis.path for axis in axes)
    combinations: list[tuple[Any, ...]] = []
    seeds: list[int] = []
    read: set[tuple[str, Path]] = set()
    for values in drawn:
        config = _checked(member, paths, values, read)
        combinations.append(tuple(_value(config, path) for path in paths))
        seeds.append(config.scenario.seed)
    if max(seeds) + repeat - 1 > LARGEST_SEED:
        raise ScenarioError(f"--repeat {repeat}: a seed would be above {LARGEST_SEED}")
    return Plan(
        name=base.scenario.name,
        paths=paths,
        combinations=tuple(combinations),
        repeat=repeat,
        seeds=tuple(seeds),
        base=scenario.to_toml(base),
        member=member,
    )


def _checked(
    member: Callable[[Mapping[KeyPath, Any]], Scenario],
    paths: Sequence[KeyPath],
    values: Sequence[Any],
    read: set[tuple[str, Path]],
) -> Scenario:
    """Make one point, its plant and its fields; `read` are the files known to be good, and grows.

    Where several keys may be to blame, or the key in the message is not the varied one, the message
    names what is varied as well.
    """
    from tools.bench.model import plant_parameters  # slow to import: wrong keys are told sooner

    try:
        config = member(dict(zip(paths, values, strict=True)))
    except ScenarioError as error:
        if len(paths) < 2:
            raise
        raise ScenarioError(f"{error} ({_where(paths, values)})") from None
    if config.hil.live:
        raise ScenarioError(
            "hil: a sweep takes no scenario that somebody from outside takes part in: take [hil] "
            "out, or run it with fishbed hil"
        )
    try:
        plant_parameters(config)
        for name in QUANTITIES:
            path = field_file(config, name)
            if path is not None and (name, path) not in read:
                read_field(config, name)
                read.add((name, path))
    except ScenarioError as error:
        if not paths:
            raise
        raise ScenarioError(f"{error} ({_where(paths, values)})") from None
    return config


def _where(paths: Sequence[KeyPath], values: Sequence[Any]) -> str:
    """The varied keys and their values at a point, for a message."""
    pairs = zip(map(scenario.dotted, paths), values, strict=True)
    return "where " + ", ".join(f"{key}={value}" for key, value in pairs)


def _grid(axes: Sequence[Axis]) -> list[tuple[Any, ...]]:
    """Return the product of all lists."""
    ranges = [axis for axis in axes if isinstance(axis, Range)]
    if ranges:
        key, low, high = scenario.dotted(ranges[0].path), ranges[0].low, ranges[0].high
        raise ScenarioError(
            f"{OPTION} {key}={low:g}:{high:g}: how many values? "
            f"say {key}={low:g}:{high:g}:COUNT, or --sample N"
        )
    lists = [axis.values for axis in axes if isinstance(axis, Listed)]
    count = math.prod(map(len, lists))
    if count > MOST_VALUES:
        sizes = " × ".join(str(len(values)) for values in lists)
        raise ScenarioError(f"{sizes} = {count} points: a sweep has at most {MOST_VALUES}")
    return list(itertools.product(*lists))


def _sample(axes: Sequence[Axis], count: int, seed: int) -> list[tuple[Any, ...]]:
    """Draw a Latin hypercube over all keys."""
    if not axes:
        raise ScenarioError(f"--sample {count}: of what? say {OPTION} KEY=LOW:HIGH")
    if count > MOST_VALUES:
        raise ScenarioError(f"--sample {count}: a sweep has at most {MOST_VALUES} points")
    import numpy as np
    from scipy.stats.qmc import LatinHypercube

    parts = LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(count)
    parts = np.minimum(parts, np.nextafter(1.0, 0.0))  # its cells are closed at their upper end
    return [
        tuple(axis.drawn(part) for axis, part in zip(axes, row, strict=True))
        for row in parts.tolist()
    ]


def _value(config: Scenario, path: KeyPath) -> Any:
    """A key's value as plain data, after the scenario gave it its type."""
    place: Any = config
    for step in path:
        place = place[step] if isinstance(step, int) else getattr(place, step)
    plain = msgspec.to_builtins(place)
    return list(plain) if isinstance(plain, tuple) else plain
