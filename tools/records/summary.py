"""summary.json: the keys of the contract, in their order, and nothing that JSON cannot say."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from tools.records.data import METRICS, Metric, RunData
from tools.records.shoal_data import ShoalData


def summary(data: RunData | ShoalData) -> dict[str, Any]:
    """The document as plain data; metrics that do not apply are None.

    Of a shoal there are metrics for each robot, and under "shoal" those of the whole.
    """
    if isinstance(data, ShoalData):
        metrics: dict[str, Any] = {run.name: _metrics(run.metrics) for run in data.robots}
        metrics["shoal"] = {name: _plain(value) for name, value in data.whole.items()}
    else:
        metrics = _metrics(data.metrics)
    document: dict[str, Any] = {
        "scenario": data.scenario,
        "seed": data.seed,
        "duration_s": data.duration_s,
        "wall_s": round(data.wall_s, 3),
        "version": data.version,
        "trace_sha256": data.trace_sha256,
        "metrics": metrics,
    }
    if data.interrupted:
        document["interrupted"] = True
    if data.lateness:
        document["lateness"] = {key: _plain(value) for key, value in data.lateness.items()}
    if data.hil:
        document["hil"] = dict(data.hil)
    return document


def to_json(data: RunData | ShoalData) -> str:
    """The text of summary.json."""
    return json.dumps(summary(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _metrics(found: Mapping[str, Metric]) -> dict[str, Metric]:
    """Those of the contract first, and all of them."""
    known = {name: _plain(found.get(name)) for name in METRICS}
    return known | {name: _plain(value) for name, value in found.items() if name not in METRICS}


def _plain(value: Metric) -> Metric:
    """A number that JSON knows: numpy scalars become Python's, and no number becomes null."""
    if value is None:
        return None
    if hasattr(value, "item"):
        value = value.item()
    return value if isinstance(value, int) or math.isfinite(value) else None
