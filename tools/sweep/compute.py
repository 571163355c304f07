"""One point of a sweep: a scenario in, what came of it out, as plain data that JSON can say.

This is what worker processes and the workers of a cluster run. Nothing of the machine goes into the
record, neither the time it took nor who computed it, so that the table is the same wherever it is
made. An error is a record too: the point's parameters let the motion diverge, or (with its
traceback) something in this software broke.
"""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from tools.configuration import Scenario
from tools.errors import UserError
from tools.version import version

Record: TypeAlias = dict[str, Any]
"""`trace_sha256` and `metrics`; or `error`, with `fault` (a traceback) where it is ours, and with
`given_up` where nobody lived to say more."""

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "firmware_model",
    "navboard",
    "plant",
    "procboard",
    "radio_802154",
    "spi_bus",
    "tools",
)


@cache
def code_digest() -> str:
    """SHA-256 over the sources of the project: what computes, whatever its version is called."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0")
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def encode(config: Scenario) -> bytes:
    """A scenario for the way to a worker."""
    return msgspec.json.encode(config)


def compute(task: bytes, stop: Callable[[], bool] = lambda: False) -> Record | None:
    """Swim one encoded scenario; None where `stop` said so before its end."""
    from tools.bench import Bench  # heavy, and who only hands points out never needs it
    from tools.records.summary import summary

    try:
        config = msgspec.json.decode(task, type=Scenario)
        bench = Bench.from_scenario(config)
        bench.run(lambda seconds: None, stop)
        if bench.interrupted:
            return None
        said = summary(bench.run_data(compare=False))
    except UserError as error:
        return {"error": str(error)}
    except MemoryError:  # of this machine, not of the point: another attempt may have more room
        raise
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        return {"error": f"fault in fishbed: {what}", "fault": traceback.format_exc()}
    return {"trace_sha256": said["trace_sha256"], "metrics": said["metrics"]}


def compute_remotely(task: bytes, code: str) -> Record:
    """The same on a worker of a cluster, which may have another version of this software."""
    if code_digest() != code:
        return {"other_code": version()}
    record = compute(task)
    assert record is not None  # nobody stops it
    return record
