"""The table of all scenario keys in docs/scenarios.md, made from the types themselves.

`python -m tools.reference` writes it anew; a test fails while the page and the types differ.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import msgspec

from tools.configuration import Scenario
from tools.contradictions import KeyPath
from tools.scenario import bare_type, bounds, dotted, field_types

PAGE = Path(__file__).resolve().parent.parent / "docs" / "scenarios.md"
MARK = "<!-- below this line: made by python -m tools.reference -->\n"

TYPES = {float: "number", int: "whole number", str: "text", bool: "true or false"}


def reference() -> str:
    """Markdown: a table for each section, lists of tables included."""
    return "\n".join(_section((), Scenario)) + "\n"


def _section(at: KeyPath, kind: type[msgspec.Struct]) -> list[str]:
    lines: list[str] = []
    rows: list[str] = []
    below: list[str] = []
    defaults = {item.name: item for item in msgspec.structs.fields(kind)}
    for name, declared in field_types(at).items():
        path = (*at, name)
        inner = bare_type(declared)
        element = get_args(inner)[0] if get_origin(inner) is tuple else None
        if _is_table(inner):
            below += _section(path, inner)
        elif _is_table(bare_type(element)):
            rows.append(f"| `{name}` | a list of `[[{dotted(path)}]]` | |")
            below += _section((*path, 0), bare_type(element))
        else:
            default = defaults[name]
            value = default.default_factory() if _is_made(default) else default.default
            shown = "required" if default.required else _shown(value)
            rows.append(f"| `{name}` | {_words(declared)} | {shown} |")
    if at:
        head = dotted(at).removesuffix("[0]")
        lines += [f"### `{head}`", "", _meaning(kind), ""]
        if rows:
            lines += ["| Key | Allowed | Default |", "|---|---|---|", *rows, ""]
    return [*lines, *below]


def _is_made(default: msgspec.structs.FieldInfo) -> bool:
    return default.default_factory is not msgspec.NODEFAULT


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _meaning(kind: type[msgspec.Struct]) -> str:
    """A section's docstring without its own name."""
    text = " ".join((kind.__doc__ or "").split())
    first, colon, rest = text.partition("`: ")
    text = rest if colon and first.startswith("`[") else text
    return text[0].upper() + text[1:]


def _words(declared: Any) -> str:
    inner = bare_type(declared)
    if get_origin(inner) is Literal:
        return " or ".join(f"`{choice}`" for choice in get_args(inner))
    if get_origin(inner) is tuple:
        args = get_args(inner)
        count = "any number of" if args[-1] is Ellipsis else str(len(args))
        return f"list of {count}: {_words(args[0])}"
    if get_origin(inner) is dict:
        return f'table of `"NAME" = {TYPES[get_args(inner)[1]]}`'
    limits = bounds(declared)
    return f"{TYPES[inner]} {limits}".rstrip().replace(">=", "≥").replace("<=", "≤")


def _shown(value: Any) -> str:
    if value is None:
        return "drawn from the seed"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return "empty"
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(part) for part in value) + "]"
    return str(value) if not isinstance(value, str) or value else '""'


def main() -> int:
    """Write the table into the page, below the mark."""
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(text.partition(MARK)[0] + MARK + "\n" + reference(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
