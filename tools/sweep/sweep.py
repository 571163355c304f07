"""A sweep from its plan to its table: what is done already, who computes the rest, what is kept.

from tools.sweep.plan import make_plan
from tools.sweep.sweep import sweep

plan = make_plan("circle", ["procboard.tail_beat.bias_rad=0.2:0.6:5"], duration_s=60)
table = sweep(plan)
print(table.column("turn_radius_m"))
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.sweep.cluster import compute_on
from tools.sweep.journal import Journal
from tools.sweep.local import compute_here, cores
from tools.sweep.plan import Plan
from tools.sweep.table import Table, make_table
from tools.version import version


def journal_path(out: Path) -> Path:
    """Where the journal of a table lies."""
    return out.with_name(out.name + ".partial")


def open_journal(plan: Plan, out: Path, *, restart: bool = False) -> Journal:
    """Open the journal beside a table; raises `JournalError` where it is another sweep's."""
    from tools.sweep.compute import code_digest

    header = {
        "scenario": plan.name,
        "points": len(plan),
        "version": version(),
        "definition": plan.digest(),
        "code": code_digest(),
    }
    return Journal(journal_path(out), header, restart=restart)


def sweep(
    plan: Plan,
    journal: Journal | None = None,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    step: Callable[[], None] = lambda: None,
) -> Table:
    """Compute every point that the journal does not hold; returns the table of all.

    `jobs` is the number of processes, by default one for each core; `scheduler` is the address of
    a Dask cluster that computes instead; `step` is called after each point.
    """
    from tools.sweep.compute import encode

    def task(point: int) -> bytes:
        return encode(plan.config(point))

    records: dict[int, dict[str, Any]] = dict(journal.records) if journal else {}
    missing = [point for point in range(len(plan)) if point not in records]
    if scheduler is None:
        results = compute_here(missing, task, jobs or cores())
    else:
        results = compute_on(scheduler, missing, task)
    with contextlib.closing(results):
        for point, record in results:
            if journal is not None:
                journal.add(point, record)
            records[point] = record
            step()
    return make_table(plan, records)
