"""Items as lines for people, or as one JSON document, written as they come."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, TextIO

from tools.decode.items import Item, Tally, What
from tools.decode.session import Session

_DIGITS = 6
"""Significant digits of a value on the terminal: more than any instrument has."""


def write_text(out: TextIO, session: Session, *, summary_only: bool = False) -> None:
    """Print a file's items and its summary."""
    out.write(f"{_printable(str(session.path))}: {session.kind.name}, {session.variant.name}\n")
    for item in session.items():
        if not summary_only:
            out.write(line(item) + "\n")
    out.writelines(f"  {text}\n" for text in summary(session.tally))


def line(item: Item) -> str:
    """Return an item as one line: time, direction, name, words, values."""
    time = f"{item.time_s:14.6f}" if item.time_s is not None else f"{'@' + str(item.offset):>14}"
    words = item.name if item.what is What.MESSAGE else f"{item.what}: {item.name}"
    if item.what is What.CONTROL:
        words = item.name
    if item.what is What.AGAIN:
        words = f"{item.name} again"
    parts = [time, f"{item.direction:<8}", words]
    if item.what is What.LINE:
        parts[2] = f"line {item.text}"
    elif item.text:
        parts.append(item.text)
    if item.what in (What.MESSAGE, What.AGAIN):
        parts.append(_values(item.fields))
    elif item.what in (What.ERROR, What.GAP) and item.time_s is not None:
        parts.append(f"@{item.offset}")
    return _printable("  ".join(part for part in parts if part))


def _values(fields: dict[str, Any]) -> str:
    shown = (
        f"{name}={value:.{_DIGITS}g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in fields.items()
    )
    return " ".join(shown)


def _printable(text: str) -> str:
    """Keep what a file says from moving the terminal's cursor."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)


def summary(tally: Tally) -> list[str]:
    """Return the count as lines."""
    lines = []
    octets = ", ".join(
        f"{count} {direction}".strip() for direction, count in sorted(tally.octets.items())
    )
    span = ""
    if tally.first_s is not None and tally.last_s is not None:
        span = f" from {tally.first_s:.6f} to {tally.last_s:.6f} s"
    lines.append(f"{'octets':<16}{octets or 'none'}{span}")
    lines.append(f"{'frames':<16}{tally.frames}, {tally.crc_errors} damaged")
    lines.append(f"{'messages':<16}{_counts(tally.messages)}")
    if tally.control:
        lines.append(f"{'control':<16}{_counts(tally.control)}")
    lines.append(f"{'again':<16}{tally.retransmissions}; numbers that never came: {tally.lost}")
    if tally.errors:
        lines.append(f"{'errors':<16}{_counts(tally.errors)}")
    return lines


def _counts(counts: dict[str, int]) -> str:
    total = sum(counts.values())
    each = ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
    return f"{total} ({each})" if each else "0"


def write_json(out: TextIO, sessions: Iterable[Session]) -> None:
    """Print one document, item by item."""
    out.write('{"files": [')
    for index, session in enumerate(sessions):
        out.write(",\n" if index else "\n")
        head = {
            "file": str(session.path),
            "kind": session.kind.name,
            "protocol": session.variant.protocol,
            "variant": session.variant.name,
        }
        out.write(json.dumps(head)[:-1] + ', "items": [')
        for number, item in enumerate(session.items()):
            out.write(",\n" if number else "\n")
            out.write(json.dumps(_object(item), allow_nan=False))
        out.write(f'],\n"summary": {json.dumps(session.tally.as_dict(), allow_nan=False)}}}')
    out.write("\n]}\n")


def _object(item: Item) -> dict[str, Any]:
    return {
        "what": item.what.value,
        "name": item.name,
        "time_s": item.time_s,
        "direction": item.direction or None,
        "offset": item.offset,
        "text": item.text,
        "header": item.header,
        "fields": item.fields,
    }
