"""`experiment.toml`: what is believed, which files are runs, and how their columns are read.

A number that means nothing (a scale of nan, a noise of zero) is refused by its place: used
silently, it would make a diagnosis of something else.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from tools import scenario
from tools.configuration import Scenario
from tools.diagnosis.data.notice import DataError
from tools.diagnosis.data.screen import BEAT_COLUMNS, TOLD, Reading
from tools.diagnosis.data.steady_table import COLUMNS as STEADY
from tools.diagnosis.fish.channels import NAMES
from tools.errors import ScenarioError

BELIEVED = "wang2014"
"""What a table alone is compared with."""

_BATTERY = "battery_v"
_DEVIATIONS = tuple(f"{name}_sd" for name in STEADY)
KNOWN = ("time_s", *BEAT_COLUMNS, TOLD, _BATTERY, *NAMES, *STEADY, *_DEVIATIONS)
"""Names that `[channels.X]` may have."""

_SIZES = ("time_s", *BEAT_COLUMNS[1:], _BATTERY, *STEADY, *_DEVIATIONS)
"""Those that no scale turns around: times, amplitudes, frequencies, lengths."""


class RunFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of `[[runs]]`."""

    file: str
    start: Annotated[str, Meta(pattern="^(rest|unknown)$")] = "rest"
    held_out: bool | None = None


class Column(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of `[channels.X]`."""

    sigma: float | None = None
    column: str | None = None
    scale: float = 1.0


class Description(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole of `experiment.toml`."""

    name: str = ""
    scenario: str = BELIEVED
    set: dict[str, str | float | int | bool | list[float]] = {}
    runs: list[RunFile] = []
    channels: dict[str, Column] = {}

    @property
    def readings(self) -> dict[str, Reading]:
        """How columns are read, by channel."""
        return {
            name: Reading(channel.column or name, channel.scale)
            for name, channel in self.channels.items()
        }

    @property
    def sigmas(self) -> dict[str, float]:
        """Noise that is told, by channel."""
        return {name: c.sigma for name, c in self.channels.items() if c.sigma is not None}


def read_description(file: Path) -> Description:
    """Read and check `experiment.toml`; raises ``DataError`` with the place of what is wrong."""
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
        document = msgspec.convert(data, Description)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{file}: not valid TOML: {error}") from None
    except UnicodeDecodeError:
        raise DataError(f"{file}: not a text file in UTF-8") from None
    except msgspec.ValidationError as error:
        raise DataError(f"{file}: {_plainly(str(error), data)}") from None
    if not document.runs:
        raise DataError(f'{file}: names no run; add [[runs]] with file = "run01.csv"')
    _check_files(file, document)
    for name, channel in document.channels.items():
        _check_channel(file, name, channel)
    _check_columns(file, document)
    return document


def _check_files(file: Path, document: Description) -> None:
    """Refuse files that are missing, and one that is listed twice: it would test itself."""
    seen: set[Path] = set()
    for run in document.runs:
        path = file.parent / run.file
        if not path.is_file():
            raise DataError(f"{file}: [[runs]] file = {run.file!r}: there is no such file")
        whole = path.resolve()
        if whole in seen:
            raise DataError(
                f"{file}: [[runs]] file = {run.file!r}: is listed twice; remove one: a run that "
                "was copied says nothing new, and cannot be held out against itself"
            )
        seen.add(whole)


def _check_channel(file: Path, name: str, channel: Column) -> None:
    if name not in KNOWN:
        raise DataError(f"{file}: [channels.{name}]: no such channel; there are {', '.join(KNOWN)}")
    place = f"{file}: [channels.{name}]"
    if not math.isfinite(channel.scale) or channel.scale == 0.0:
        raise DataError(
            f"{place} scale = {channel.scale:g}: must be a finite number other than zero, from the "
            "file's unit to SI"
        )
    if name in _SIZES and channel.scale < 0.0:
        raise DataError(f"{place} scale = {channel.scale:g}: must be above zero")
    if channel.column == "":
        raise DataError(f'{place} column = "": names no column')
    if channel.sigma is None:
        return
    if name not in NAMES:
        where = f"; give it in a column {name}_sd" if name in STEADY else ""
        raise DataError(f"{place} sigma = {channel.sigma:g}: {name} has no noise to be told{where}")
    if not (math.isfinite(channel.sigma) and channel.sigma > 0.0):
        raise DataError(
            f"{place} sigma = {channel.sigma:g}: must be a finite number above zero; without it "
            "the noise is estimated"
        )


def _check_columns(file: Path, document: Description) -> None:
    """Refuse one column for two channels."""
    taken: dict[str, str] = {}
    for name, channel in document.channels.items():
        if channel.column is None:
            continue
        if channel.column in taken:
            raise DataError(
                f"{file}: [channels.{name}] column = {channel.column!r}: is that of "
                f"[channels.{taken[channel.column]}] too"
            )
        taken[channel.column] = name


def believed_scenario(file: Path, document: Description) -> Scenario:
    """Load the believed scenario, a bundled one or a file beside the experiment."""
    source: str | Path = document.scenario
    if document.scenario not in scenario.bundled() and not Path(source).is_absolute():
        source = file.parent / document.scenario
    sets = [f"{key}={_toml(value)}" for key, value in document.set.items()]
    try:
        return scenario.load(source, sets)
    except ScenarioError as error:
        text = str(error).replace("--set", "[set]")
        raise ScenarioError(f"{file}: {text}") from None


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)  # a basic string of TOML, quotes and all
    return repr(value)


def _plainly(message: str, data: Mapping[str, object]) -> str:
    """Turn msgspec's words into a line with the path."""
    what, _, where = message.partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    path = _named(path, data)
    return f"{path}: {what[0].lower() + what[1:]}" if path else what


def _named(path: str, data: Mapping[str, object]) -> str:
    """Return a path with the key that msgspec writes as `[...]`, where only one can be meant."""
    head, found, rest = path.partition("[...]")
    table = data.get(head)
    if not found or not isinstance(table, Mapping):
        return path
    if not rest:  # a value of [set] that is a table: its keys must be in quotes
        keys = [key for key, value in table.items() if isinstance(value, Mapping)]
        return f"[{head}] {keys[0]} (write whole keys in quotes)" if keys else path
    key = rest.lstrip(".")
    numbers = (int, float) if key in ("sigma", "scale") else (str,)
    keys = [
        name
        for name, value in table.items()
        if isinstance(value, Mapping) and key in value and not isinstance(value[key], numbers)
    ]
    return f"[{head}.{keys[0]}] {key}" if keys else path
