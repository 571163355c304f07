"""URLs of transports: `scheme:rest?option=value&…`, with the mistakes that people make in them.

Options are declared where they are used, as a table name → converter; what is left over is an error
that names the options there are, unless the transport passes it on (python-can's own options).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any
from urllib.parse import parse_qsl, unquote

from spi_bus.errors import TransportUrlError

__all__ = ["Url", "boolean", "integer", "nearest", "number", "parse", "take"]

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):(.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Url:
    """A URL taken apart: `scheme:rest?options`; `rest` keeps its slashes."""

    text: str
    scheme: str
    rest: str
    options: dict[str, str]


def parse(text: str, example: str = "pty: or serial:///dev/ttyUSB0?baud=115200") -> Url:
    """Take a URL apart; `example` is what to write, for somebody who wrote none.

    Raises:
        TransportUrlError: no scheme, or an option without a value or given twice.

    """
    match = _SCHEME.fullmatch(text)
    if match is None or re.fullmatch(r"COM\d+:?", text, re.IGNORECASE):
        hint = f"write for example {example}"
        if text.startswith("/") or text.upper().startswith("COM"):
            hint = f"for a serial port write serial://{text.rstrip(':')}?baud=115200"
        raise TransportUrlError(f"{text!r} is no transport URL: {hint}")
    scheme, rest = match[1].lower(), match[2]
    rest, _, query = rest.partition("?")
    options: dict[str, str] = {}
    if query:
        try:
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True)
        except ValueError as error:
            raise TransportUrlError(
                f"{text}: options are written ?name=value&name=value, not ?{query}"
            ) from error
        for name, value in pairs:
            if name in options:
                raise TransportUrlError(f"{text}: option {name!r} is given twice")
            options[name] = value
    return Url(text, scheme, unquote(rest), options)


def take(
    url: Url,
    converters: Mapping[str, Callable[[str], Any]],
    *,
    leftover: dict[str, str] | None = None,
) -> dict[str, Any]:
    """Return the options of a URL, converted; those that are not in the table go to `leftover`.

    Raises:
        TransportUrlError: a value that does not convert; without `leftover`, an unknown option.

    """
    found: dict[str, Any] = {}
    for name, text in url.options.items():
        if name in converters:
            try:
                found[name] = converters[name](text)
            except ValueError as error:
                raise TransportUrlError(f"{url.text}: {name}={text!r}: {error}") from error
        elif leftover is None:
            raise TransportUrlError(
                f"{url.text}: {url.scheme}: has no option {name!r}{nearest(name, converters)}"
            )
        else:
            leftover[name] = text
    return found


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean …?" or "; there are …", for the end of a message."""
    names = list(known)
    close = get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]}?"
    return f"; there are {', '.join(names)}" if names else "; it has none"


def integer(low: int, high: int) -> Callable[[str], int]:
    """Return a converter to an integer in a range, decimal or 0x…."""

    def convert(text: str) -> int:
        try:
            value = int(text, 0)
        except ValueError as error:
            raise ValueError("not a whole number") from error
        if not low <= value <= high:
            raise ValueError(f"outside {low} to {high}")
        return value

    return convert


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a converter to a number in a range."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError as error:
            raise ValueError("not a number") from error
        if not low <= value <= high:
            raise ValueError(f"outside {low} to {high}")
        return value

    return convert


def boolean(text: str) -> bool:
    """Convert 1/0, yes/no, true/false, on/off; nothing at all is yes."""
    lowered = text.lower()
    if lowered in ("", "1", "yes", "true", "on"):
        return True
    if lowered in ("0", "no", "false", "off"):
        return False
    raise ValueError("not yes or no")
