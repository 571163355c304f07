"""Timed commands from a file, in the place of an operator: for demonstrations, and for tests.

# seconds, then what to do
0.0  frequency_hz=1.0 amplitude_deg=15
2.0  bias_deg=-20          # to the left
8.0  stop
9.0  end
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tools.errors import UserError
from tools.teleop.setpoint import End, Hold, Input, Stop

KEYS: Final[dict[str, tuple[str, float]]] = {
    "frequency_hz": ("frequency_hz", 1.0),
    "amplitude_deg": ("amplitude_rad", math.pi / 180.0),
    "amplitude_rad": ("amplitude_rad", 1.0),
    "bias_deg": ("bias_rad", math.pi / 180.0),
    "bias_rad": ("bias_rad", 1.0),
}
"""Key: field of a `Hold`, and factor to its unit."""
_WORDS: Final[dict[str, Callable[[], Input]]] = {
    "stop": Stop,
    "end": lambda: End("the script is at its end"),
}


def parse(text: str, name: str = "script") -> list[tuple[float, Input]]:
    """Return (seconds, input) in order, the last one an `End`.

    Raises:
        UserError: a line that says something else, with its place.

    """
    steps: list[tuple[float, Input]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        words = raw.partition("#")[0].split()
        if not words:
            continue
        where = f"{name}, line {number}"
        at_s = _number(words[0], where)
        if at_s < (steps[-1][0] if steps else 0.0):
            raise UserError(f"{where}: {at_s:g} s is before the line above: sort them by time")
        steps.append((at_s, _input(words[1:], where)))
        if isinstance(steps[-1][1], End):
            return steps
    if not steps:
        raise UserError(f"{name}: nothing in it; write lines such as: 1.5 frequency_hz=1")
    steps.append((steps[-1][0], _WORDS["end"]()))
    return steps


def read(path: Path) -> list[tuple[float, Input]]:
    """Read a script.

    Raises:
        UserError: it cannot be read, or says something else.

    """
    try:
        return parse(path.read_text(encoding="utf-8"), str(path))
    except OSError as error:
        raise UserError(f"--input script:{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not a text file in UTF-8") from error


def _input(words: list[str], where: str) -> Input:
    if len(words) == 1 and words[0] in _WORDS:
        return _WORDS[words[0]]()
    values: dict[str, float] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in KEYS:
            known = ", ".join((*_WORDS, *(f"{name}=…" for name in KEYS)))
            raise UserError(f"{where}: '{word}' is none of {known}")
        field, factor = KEYS[key]
        values[field] = _number(value, where) * factor
    if not values:
        raise UserError(f"{where}: a time and nothing to do: write for example stop")
    return Hold(**values)


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UserError(f"{where}: '{text}' is no number")
    return value
