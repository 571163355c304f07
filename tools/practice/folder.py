"""The experiment folder: runs as CSV files, `experiment.toml`, and the answer under a seal.

The seal only keeps an eye from reading what a mind should find: the answer is JSON, packed.
"""

from __future__ import annotations

import base64
import csv
import json
import math
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from tools.errors import UserError
from tools.practice.experiment import Effect, Swum

SEALED = "answer.sealed"
BEAT_COLUMNS = ("tail_bias_rad", "tail_amplitude_rad", "tail_frequency_hz")
CHANNELS = ("x_m", "y_m", "heading_rad", "gyro_z_rad_s", "compass_rad")
_DIGITS = 9


def check_new(place: Path) -> None:
    """Refuse a place where something is.

    Raises ``UserError``.
    """
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise UserError(f"{place}: is there already; name a new folder")


def write(place: Path, seed: int, swum: Sequence[Swum], answer: dict[str, Any]) -> None:
    """Write the folder; it must not exist, or be empty."""
    check_new(place)
    place.mkdir(parents=True, exist_ok=True)
    for run in swum:
        _write_run(place / f"{run.name}.csv", run)
    document = {
        "name": f"practice {seed}",
        "scenario": "wang2014",
        "runs": [{"file": f"{run.name}.csv", "start": "rest"} for run in swum],
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


def _write_run(file: Path, run: Swum) -> None:
    """One row for each moment at which something was sampled or told; empty where it was not."""
    columns = (*BEAT_COLUMNS, *CHANNELS)
    rows: dict[float, dict[str, float]] = {}
    for begin_s, beat in run.beats:
        told = (beat.bias_rad, beat.amplitude_rad, beat.frequency_hz)
        rows.setdefault(_rounded(begin_s), {}).update(zip(BEAT_COLUMNS, told, strict=True))
    for name, (time_s, values) in run.samples.items():
        for at_s, value in zip(time_s.tolist(), values.tolist(), strict=True):
            rows.setdefault(_rounded(at_s), {})[name] = value
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("time_s", *columns))
        for at_s in sorted(rows):
            row = rows[at_s]
            cells = (_text(row[name]) if name in row else "" for name in columns)
            writer.writerow((_text(at_s), *cells))


def _rounded(time_s: float) -> float:
    return round(time_s, 7)


def _text(value: float) -> str:
    if not math.isfinite(value):
        raise ValueError(f"an instrument reported {value}")
    return f"{value:.{_DIGITS}g}"
