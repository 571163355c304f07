"""Which software made a row of the journal: figures of different engines are never put together.

What decides a row is the source of the engine, of the plant and of what makes and scores a set; a
digest of these is the engine's name. The commit stands beside it, for people. The files that only
count and print are left out, so that a page can be written again without diagnosing again.
"""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools.version import version

ROOT = Path(__file__).resolve().parents[2]
DECIDE = ("plant", "tools/diagnosis", "tools/practice")
TELL = (
    "tools/diagnosis/page/",
    "tools/practice/benchmark.py",
    "tools/practice/origin.py",
    "tools/practice/tally.py",
    "tools/practice/told.py",
)
"""What no row depends on among these."""


def engine(root: Path = ROOT) -> str:
    """Return the digest of the sources that decide a row."""
    found = hashlib.sha256()
    for package in DECIDE:
        for file in sorted((root / package).rglob("*.py")):
            name = file.relative_to(root).as_posix()
            if not name.startswith(TELL):
                found.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()[:12]


def commit(root: Path = ROOT) -> str:
    """Return the commit, `-dirty` where files differ from it; "" outside a repository."""
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    try:
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def origin() -> dict[str, str]:
    """Return what a row says of the software that made it."""
    return {"engine": engine(), "commit": commit(), "version": version()}


def of_one_engine(
    rows: Sequence[dict[str, Any]], wanted: str
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """Return the rows of one engine, each set once, and how many of others are left out.

    Of a set that is there twice the later row counts.
    """
    mine: dict[str, dict[str, Any]] = {}
    others: dict[str, int] = {}
    for row in rows:
        name = row.get("engine", "unknown")
        if name == wanted:
            mine[row["key"]] = row
        else:
            others[name] = others.get(name, 0) + 1
    return list(mine.values()), others
