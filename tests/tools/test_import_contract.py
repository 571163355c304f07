"""The import contract covers every module: one on no floor would be free to do anything."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
LAYERS = next(c["layers"] for c in CONTRACTS["contracts"] if c["type"] == "layers")
FLOORS = [set(re.findall(r"[a-z0-9_]+(?:\.[a-z0-9_]+)*", layer)) for layer in LAYERS]
SPLIT = ("spi_bus", "radio_802154")


def test_floors_are_five_and_none_shares_a_module() -> None:
    assert len(FLOORS) == 5
    every = [module for floor in FLOORS for module in floor]
    assert len(every) == len(set(every))


@pytest.mark.parametrize("package", SPLIT)
def test_every_module_of_a_split_package_stands_on_a_floor(package: str) -> None:
    placed = set().union(*FLOORS)
    found = {
        f"{package}.{entry.stem}"
        for entry in (ROOT / package).iterdir()
        if (entry.suffix == ".py" and entry.stem != "__init__") or (entry / "__init__.py").exists()
    }
    assert found - placed == set()


@pytest.mark.parametrize("package", SPLIT)
def test_a_split_package_itself_imports_nothing(package: str) -> None:
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    assert not [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]


def test_every_whole_package_is_on_a_floor() -> None:
    whole = set(CONTRACTS["root_packages"]) - set(SPLIT)
    assert whole <= set().union(*FLOORS)
