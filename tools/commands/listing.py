"""`fishbed list`: what there is, a line each, read from the tables of the code itself.

A category names the module and the table that holds its rows. A module that is not there yet is an
empty category and is said to be one; a module that is there and does not import is a fault.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
from collections.abc import Iterable, Mapping
from typing import Any

NAME = "list"
HELP = "what there is: scenarios, sensors, effects, causes, studies, transports"

TABLES: dict[str, tuple[str, str]] = {
    "sensors": ("navboard.sensors", "SENSORS"),
    "effects": ("tools.effects", "ALL"),
    "causes": ("tools.diagnosis.causes", "CAUSES"),
    "studies": ("tools.studies", "STUDIES"),
    "transports": ("spi_bus.transports", "TRANSPORTS"),
}
"""Category → module and table. A row has a name and says in a line what it is."""

NONE_YET: dict[str, str] = {
    "sensors": "none: the navigation board has no table of sensors",
    "effects": "none: there is no table of effects",
    "causes": "none: the diagnosis has no table of causes",
    "studies": "none: there is no table of studies",
    "transports": "none: the link has no table of transports",
}
"""What an empty category says."""

CATEGORIES = ("scenarios", *TABLES)

Row = tuple[str, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument("category", nargs="?", choices=CATEGORIES, help="only this category")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    wanted = (args.category,) if args.category else CATEGORIES
    found = {category: rows(category) for category in wanted}
    if args.json:
        import json

        print(json.dumps({name: dict(table) for name, table in found.items()}, indent=2))
        return 0
    blocks = []
    for category, table in found.items():
        width = max((len(name) for name, _ in table), default=0)
        lines = [f"  {name:<{width}}  {text}".rstrip() for name, text in table]
        blocks.append("\n".join([category, *(lines or [f"  {NONE_YET[category]}"])]))
    print("\n\n".join(blocks))
    return 0


def rows(category: str) -> list[Row]:
    """Names and descriptions of one category."""
    if category == "scenarios":
        return _scenarios()
    module_name, table_name = TABLES[category]
    if not _exists(module_name):
        return []
    table = getattr(importlib.import_module(module_name), table_name, ())
    return list(_rows(table))


def _exists(module: str) -> bool:
    """Whether a module is there, without importing it (its parents are imported)."""
    parts = module.split(".")
    return all(
        importlib.util.find_spec(".".join(parts[: depth + 1])) is not None
        for depth in range(len(parts))
    )


def _rows(table: Any) -> Iterable[Row]:
    named = table.items() if isinstance(table, Mapping) else ((row.name, row) for row in table)
    for name, row in named:
        text = row if isinstance(row, str) else getattr(row, "description", None) or row.__doc__
        words = (text or "").strip().split("\n")[0]
        part = getattr(row, "part", "")
        yield str(name), f"{words}: {part}" if part else words


def _scenarios() -> list[Row]:
    from tools import scenario

    configs = ((name, scenario.load(name)) for name in scenario.bundled())
    return [
        (name, f"{config.scenario.duration_s:>4g} s  {config.scenario.description}")
        for name, config in configs
    ]
