"""`--vary KEY=…`: which values a key goes through.

A list stands for itself. A range is spaced evenly in exact fractions of what was typed, so that
0.1:0.5:5 holds 0.3 and not 0.30000000000000004. A range without a count is only to be sampled.
Values are TOML, read by what reads `--set`; the key's declared type says what a range's values are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

from tools import scenario
from tools.contradictions import KeyPath
from tools.errors import ScenarioError

OPTION = "--vary"
HOW = "write KEY=A,B,… or KEY=FIRST:LAST:COUNT, or KEY=LOW:HIGH with --sample"
MOST_VALUES = 100_000
"""Of one key, and points of a sweep: beyond, a slip is likelier than a wish (assumed)."""

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*:\s*({_NUMBER})\s*(?::\s*([^:\s]+)\s*)?")
_OPENING, _CLOSING = "[{", "]}"


@dataclass(frozen=True, slots=True)
class Listed:
    """A key and the values that it goes through, in order."""

    path: KeyPath
    values: tuple[Any, ...]

    def drawn(self, part: float) -> Any:
        """The value at a part of the list, 0 ≤ part < 1."""
        return self.values[int(part * len(self.values))]


@dataclass(frozen=True, slots=True)
class Range:
    """A key and the bounds between which it is sampled; both can be drawn where it is whole."""

    path: KeyPath
    low: float
    high: float
    whole: bool

    def drawn(self, part: float) -> float | int:
        """The value at a part of the way, 0 ≤ part < 1."""
        if self.whole:
            return int(self.low) + int(part * (int(self.high) - int(self.low) + 1))
        return min(self.low + part * (self.high - self.low), self.high)  # rounding may go beyond


Axis: TypeAlias = Listed | Range


def parse_axes(texts: Iterable[str], taken: Mapping[KeyPath, str]) -> tuple[Axis, ...]:
    """Read every `--vary`; `taken` are keys that other options set, with the option's name.

    Raises `ScenarioError` for what is no such text, and for two options that set the same key.
    """
    axes: list[Axis] = []
    owners = dict(taken)
    for text in texts:
        axis = parse_vary(text)
        for path, option in owners.items():
            if _overlap(path, axis.path):
                key = scenario.dotted(axis.path)
                raise ScenarioError(f"{OPTION} {text}: {key} is set by {option} as well")
        owners[axis.path] = f"another {OPTION}"
        axes.append(axis)
    return tuple(axes)


def parse_vary(text: str) -> Axis:
    """Read one `KEY=A,B,…`, `KEY=FIRST:LAST:COUNT` or `KEY=LOW:HIGH`."""
    key, equals, rest = text.partition("=")
    if not equals or not key.strip() or not rest.strip():
        raise ScenarioError(f"{OPTION} {text}: {HOW}")
    match = _RANGE.fullmatch(rest)
    if match is None:
        return _listed(text, key, rest)
    path, _ = scenario.parse_set(f"{key}=0", OPTION)
    declared = scenario.declared_type(path)
    if declared not in (float, int, None):  # a key that does not exist is told by the scenario
        raise ScenarioError(f"{OPTION} {text}: {key.strip()} is no number: list its values, A,B,…")
    return _range(text, path, declared is int, match)


def _range(text: str, path: KeyPath, whole: bool, match: re.Match[str]) -> Axis:
    first, last = Fraction(match[1]), Fraction(match[2])
    if match[3] is None:
        if whole and not first.denominator == last.denominator == 1:
            raise ScenarioError(f"{OPTION} {text}: the bounds must be whole numbers")
        if not first < last:
            raise ScenarioError(f"{OPTION} {text}: the first bound must be below the second")
        return Range(path, float(first), float(last), whole)
    if not re.fullmatch(r"\d{1,9}", match[3]) or not 2 <= int(match[3]) <= MOST_VALUES:
        raise ScenarioError(
            f"{OPTION} {text}: the count of values must be a whole number from 2 to {MOST_VALUES}"
        )
    if first == last:
        raise ScenarioError(f"{OPTION} {text}: the first and the last value are the same")
    count = int(match[3])
    exact = [first + (last - first) * step / (count - 1) for step in range(count)]
    if not whole:
        return Listed(path, tuple(map(float, exact)))
    broken = next((value for value in exact if value.denominator != 1), None)
    if broken is not None:
        raise ScenarioError(
            f"{OPTION} {text}: {scenario.dotted(path)} is a whole number, "
            f"and {count} even steps would make it {float(broken):g}"
        )
    return Listed(path, tuple(map(int, exact)))


def _listed(text: str, key: str, rest: str) -> Listed:
    path: KeyPath = ()
    values: list[Any] = []
    for item in _split(rest):
        if not item.strip():
            raise ScenarioError(f"{OPTION} {text}: a value is empty; {HOW}")
        path, value = scenario.parse_set(f"{key}={item}", OPTION)
        if isinstance(value, Mapping):
            raise ScenarioError(f"{OPTION} {text}: a table; vary the keys in it one by one")
        if any(_same(value, known) for known in values):
            raise ScenarioError(f"{OPTION} {text}: {item.strip()} is there twice")
        values.append(value)
    return Listed(path, tuple(values))


def _split(text: str) -> Iterator[str]:
    """Split at the commas that stand in no brackets and in no quotes."""
    item, depth, quote = "", 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in _OPENING:
            depth += 1
        elif letter in _CLOSING:
            depth -= 1
        if letter == "," and not quote and depth == 0:
            yield item
            item = ""
        else:
            item += letter
    yield item


def _same(a: Any, b: Any) -> bool:
    return bool(a == b) and isinstance(a, bool) == isinstance(b, bool)


def _overlap(a: KeyPath, b: KeyPath) -> bool:
    """Whether one key is the other, or lies within it."""
    short = min(len(a), len(b))
    return a[:short] == b[:short]
