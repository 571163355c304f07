"""summary.json: the keys of the contract, in their order, and nothing that JSON cannot say."""

from __future__ import annotations

import json
import math
from typing import Any

from tools.records.data import METRICS, Metric, RunData


def summary(data: RunData) -> dict[str, Any]:
    """The document as plain data; metrics that do not apply are None."""
    document: dict[str, Any] = {
        "scenario": data.scenario,
        "seed": data.seed,
        "duration_s": data.duration_s,
        "wall_s": round(data.wall_s, 3),
        "version": data.version,
        "trace_sha256": data.trace_sha256,
        "metrics": {name: _plain(data.metrics.get(name)) for name in METRICS},
    }
    extra = {key: _plain(value) for key, value in data.metrics.items() if key not in METRICS}
    document["metrics"].update(extra)
    if data.interrupted:
        document["interrupted"] = True
    if data.lateness:
        document["lateness"] = {key: _plain(value) for key, value in data.lateness.items()}
    if data.hil:
        document["hil"] = dict(data.hil)
    return document


def to_json(data: RunData) -> str:
    """The text of summary.json."""
    return json.dumps(summary(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Metric) -> Metric:
    """A number that JSON knows: numpy scalars become Python's, and no number becomes null."""
    if value is None:
        return None
    if hasattr(value, "item"):
        value = value.item()
    return value if isinstance(value, int) or math.isfinite(value) else None
