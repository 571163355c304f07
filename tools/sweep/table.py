"""The table of a sweep: a row for each point in order, a column for each thing known of it.

Columns are the point's number, the varied keys, the seed, the hash of the trace, every metric that
any point has, and the error. The order of rows and columns depends on the sweep alone, so the file
is the same byte for byte however many processes computed it, and in whichever order.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.errors import UserError
from tools.records.data import METRICS
from tools.sweep.plan import Plan
from tools.version import version


class TableError(UserError, OSError):
    """A table cannot be written where it is meant to be."""


@dataclass(frozen=True, slots=True)
class Table:
    """What a sweep found; a cell that does not apply is None."""

    about: Mapping[str, Any]
    """Which sweep it was."""
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    @property
    def failed(self) -> int:
        """How many points have an error instead of metrics."""
        return sum(row[-1] is not None for row in self.rows)

    def column(self, name: str) -> list[Any]:
        """One column, a value for each point."""
        place = self.columns.index(name)
        return [row[place] for row in self.rows]


def make_table(plan: Plan, records: Mapping[int, Mapping[str, Any]]) -> Table:
    """Put the records of all points in order."""
    flat = [dict(_flat(records[point].get("metrics", {}))) for point in range(len(plan))]
    metrics = list(METRICS)
    for found in flat:
        metrics.extend(name for name in found if name not in metrics)
    rows = tuple(
        (
            point,
            *plan.values(point),
            plan.seed(point),
            records[point].get("trace_sha256"),
            *(flat[point].get(name) for name in metrics),
            records[point].get("error"),
        )
        for point in range(len(plan))
    )
    columns = ("point", *plan.keys, "seed", "trace_sha256", *metrics, "error")
    about = {
        "scenario": plan.name,
        "version": version(),
        "vary": list(plan.keys),
        "points": len(plan),
        "failed": sum("error" in records[point] for point in range(len(plan))),
    }
    return Table(about, columns, rows)


def _flat(metrics: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Metrics by one name each; those of several robots get the robot's name before theirs."""
    for name, value in metrics.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def to_csv(table: Table) -> str:
    """The table as CSV; an empty cell is a value that does not apply, a list is JSON."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue()


def to_json(table: Table) -> str:
    """The table as one JSON document, a row on each line."""
    rows = ("  " + _dumps(dict(zip(table.columns, row, strict=True))) for row in table.rows)
    return (
        f'{{"sweep": {_dumps(table.about)},\n "columns": {_dumps(table.columns)},\n "rows": [\n'
        + ",\n".join(rows)
        + "\n]}\n"
    )


FORMS = {".csv": to_csv, ".json": to_json}
"""By the end of the file's name."""
BEGINNINGS = (b"point,", b'{"sweep": ')
"""Of what these write."""


def check_place(path: Path) -> None:
    """Raise `TableError` where a table cannot be written, or would replace anything but a table."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        refused = _objection(path)
    except OSError as error:
        refused = f"cannot be written: {error.strerror}"
    if refused:
        raise TableError(f"{path}: {refused}")


def _objection(path: Path) -> str:
    if path.is_dir():
        return "is a folder; --out wants a file"
    if path.suffix not in FORMS:
        return f"a table is a {' or '.join(FORMS)} file"
    if path.exists():
        with path.open("rb") as file:
            begin = file.read(max(map(len, BEGINNINGS)))
        if begin and not begin.startswith(BEGINNINGS):
            return "holds something else than a table of a sweep; name another --out"
    return ""


def write_table(path: Path, table: Table) -> None:
    """Write the whole table or nothing."""
    content = FORMS[path.suffix](table)
    try:
        handle, staging = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.absolute().parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(staging).chmod(0o644)  # mkstemp makes it private
            Path(staging).replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                Path(staging).unlink()
            raise
    except OSError as error:
        raise TableError(f"{path}: cannot be written: {error.strerror}") from error


def _cell(value: Any) -> Any:
    """A value as CSV has it: floats so that they read back exactly, as everywhere here."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, Sequence | Mapping) and not isinstance(value, str):
        return _dumps(value)
    return value


def _dumps(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)
