"""The experiment folder: runs as CSV files, `experiment.toml`, and the answer under a seal.

The seal only keeps an eye from reading what a mind should find: the answer is JSON, packed.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from tools.errors import UserError
from tools.practice.experiment import Effect
from tools.records.csv import write_channels
from tools.records.data import Series

SEALED = "answer.sealed"


def check_new(place: Path) -> None:
    """Refuse a place where something is.

    Raises ``UserError``.
    """
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise UserError(f"{place}: is there already; name a new folder")


def write(
    place: Path,
    name: str,
    believed: str,
    runs: Mapping[str, Mapping[str, Series]],
    answer: dict[str, Any],
) -> None:
    """Write the folder: the channels of each run, and the scenario that is believed.

    Raises ``UserError`` where something is at that place.
    """
    check_new(place)
    place.mkdir(parents=True, exist_ok=True)
    for run, channels in runs.items():
        write_channels(place / f"{run}.csv", channels)
    document = {
        "name": name,
        "scenario": believed,
        "runs": [{"file": f"{run}.csv", "start": "rest"} for run in runs],
    }
    (place / "experiment.toml").write_text(tomli_w.dumps(document), encoding="utf-8")
    (place / SEALED).write_bytes(seal(answer))


def answer(seed: int, kind: str, strength: float, effects: Sequence[Effect]) -> dict[str, Any]:
    """Return what was hidden, for the seal."""
    return {
        "seed": seed,
        "kind": kind,
        "strength": strength,
        "effects": [
            {"name": effect.name, "size": effect.size, "parameters": effect.parameters()}
            for effect in effects
        ],
    }


def seal(document: dict[str, Any]) -> bytes:
    """Pack an answer."""
    return base64.encodebytes(zlib.compress(json.dumps(document, sort_keys=True).encode()))


def unseal(place: Path) -> dict[str, Any]:
    """Read the answer of a folder.

    Raises ``UserError`` where there is none, or it was changed.
    """
    file = place / SEALED
    try:
        document: dict[str, Any] = json.loads(
            zlib.decompress(base64.decodebytes(file.read_bytes()))
        )
    except FileNotFoundError:
        raise UserError(
            f"{place}: holds no {SEALED}; `fishbed practice --seed N --out DIR` makes one"
        ) from None
    except (ValueError, zlib.error) as error:
        raise UserError(f"{file}: is no sealed answer, or was changed ({error})") from error
    return document
