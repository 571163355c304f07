"""Files of fields in the water that a scenario names: read them, and take them into a run folder.

A path in a scenario is relative to the scenario's file. A run folder holds its own copy, taken
before the run starts, and its scenario.toml names that: the folder stands alone and replays, what
becomes of the original meanwhile notwithstanding.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from plant.grid_field import GridError, GridField, from_csv, from_npz
from tools.errors import RunFolderError, ScenarioError

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.folder import RunFolder

QUANTITIES: Final = {"temperature": "temperature_c", "pollutant": "pollutant_ug_l"}
"""Field below `[tank]`, and what its file must hold."""
SUFFIXES: Final = (".csv", ".npz")
COPIES: Final = tuple(f"{name}{suffix}" for name in QUANTITIES for suffix in SUFFIXES)
"""Names of the copies in a run folder."""


def field_file(config: Scenario, name: str) -> Path | None:
    """Return the file of a field, None where the field is a formula."""
    named: str = getattr(config.tank, name).file
    return Path(named) if named else None


def read_field(config: Scenario, name: str) -> GridField | None:
    """Read the file of a field, None where there is none; raises `ScenarioError`."""
    path = field_file(config, name)
    if path is None:
        return None
    try:
        if path.suffix == ".csv":
            return from_csv(path.read_text(encoding="utf-8"), QUANTITIES[name])
        if path.suffix == ".npz":
            return from_npz(path.read_bytes(), QUANTITIES[name])
    except GridError as error:
        raise ScenarioError(f"tank.{name}.file: {path}: {error}") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"tank.{name}.file: {path}: not a text file in UTF-8") from error
    except OSError as error:
        says = f"cannot be read: {error.strerror}"
        raise ScenarioError(f"tank.{name}.file: {path}: {says}") from error
    raise ScenarioError(f"tank.{name}.file: {path}: must end in .csv or .npz")


def stage(folder: RunFolder, config: Scenario) -> Scenario:
    """Copy a scenario's files into a run folder in the making; return the scenario on the copies.

    Files that are there already stay. Raises `ScenarioError` for a file that cannot be read.
    """
    for name in QUANTITIES:
        path = field_file(config, name)
        if path is None or path.parent == folder.staging:
            continue
        read_field(config, name)  # refuse it before the run
        copy = folder.file(f"{name}{path.suffix}")
        try:
            shutil.copyfile(path, copy)
        except OSError as error:
            raise RunFolderError(
                f"{folder.path / copy.name}: cannot be written: {error.strerror}"
            ) from error
        config = _renamed(config, name, str(copy))
    return config


def beside(config: Scenario) -> Scenario:
    """Return a scenario that names its files as lying beside it."""
    for name in QUANTITIES:
        path = field_file(config, name)
        if path is not None:
            config = _renamed(config, name, path.name)
    return config


def _renamed(config: Scenario, name: str, file: str) -> Scenario:
    field = msgspec.structs.replace(getattr(config.tank, name), file=file)
    tank = msgspec.structs.replace(config.tank, **{name: field})
    return msgspec.structs.replace(config, tank=tank)
